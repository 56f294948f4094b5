"""What is done to the small case of every command, and what no trial may come to.

Each trial has a folder of its own. What lies in it at the end is held against what an undisturbed run leaves, byte by
byte, but for times and for what results keep for themselves in ``.testbench``.
"""

import contextlib
import hashlib
import re
import shutil
import signal
import sqlite3
import tempfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from fuzz.mutations import damaged as damaged_bytes
from fuzz.mutations import mistyped, nudged, of_text
from studies.reliability.process import STREAMS, Around, Ended, Running
from studies.reliability.small import CASES, Case, place_of, words_of

from testbench.core.errors import RecordError
from testbench.core.store import COMMIT, entry_of, manifest_of

SEED = 57
MOST, OTHERS = 100, 30  # times that a command is stopped
SIGNALS = {signal.SIGKILL: 137, signal.SIGTERM: 143, signal.SIGINT: 130}
FRESH = frozenset({5, 18, 43, 68, 88})
"""Stops of a Python of its own, which renders figures; the others are of forks that make them and do not."""
EACH = {"full disk": (10, 5), "two at once": (3, 2), "damaged input": (10, 10), "surroundings": (2, 2)}
"""Treatment -> trials of each command that writes most, and of each other one."""
FAULTS = ("traceback", "hung", "wrong status", "more than a line", "left processes", "other bytes", "not gone on",
          "half-written", "looked finished", "mixed", "neither", "other words")  # fmt: skip
HIDDEN = ".testbench"
SURROUNDINGS = (
    {"PYTHONHASHSEED": "1", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TZ": "Asia/Kathmandu"},
    {"PYTHONHASHSEED": "2", "LC_ALL": "tr_TR.UTF-8", "PYTHONUTF8": "0", "TZ": "America/St_Johns"},
)
_GROWING = (".sqlite", ".h5", ".jsonl", ".lock", ".part", ".sqlite-wal", ".sqlite-shm", ".sqlite-journal")
_PAGES = ("report.html", "index.html", "checksums.sha256")  # written last: with one, a folder looks finished
_TIMES = {
    # of a campaign, and of a benchmark, whose tables have a column of it: numbers are compared in tables/
    "report.html": rb"<dt>(cost|processor time)</dt><dd>[^<]*</dd>|<td class=\"number\">[^<]*</td>",
    "cells.jsonl": rb'"seconds": [\d.e-]*',
    "benchmark.json": rb'"seconds": [\d.e-]*',
    "methods.json": rb'"seconds": [\d.e-]*',
    "benchmark.csv": rb",[\d.e-]+(?=,[^,\n]*\n)",
    "methods.csv": rb",[\d.e-]+(?=\n)",
    "cases.csv": rb",[\d.]+(?=\n)",
    "README.md": rb"Processor time of a case: [^;]*;",
}
"""File -> what of it is processor time, which no two runs have in common."""
_DATED = (".html", ".csv", ".json")  # an index says when results were written, in the user's time zone
_LINE = re.compile(
    r"(\.\.\. |note: |  |error: |interrupted|ended by|finished runs are kept|what is finished is kept|"
    r"finished results are kept)"
)
_NUMBER = re.compile(r"[\d.]+ *")  # a terminal shows times, too
Found = tuple[str, str]


def digests(place: Path) -> dict[str, str]:
    """Return file -> SHA-256 of what lies in a folder, without times; of a store, of its rows: its pages keep history.

    An empty folder counts; locks do not.
    """
    found = {}
    for path in sorted(place.rglob("*")):
        name = path.relative_to(place).as_posix()
        if HIDDEN in name.split("/") or path.suffix in (".lock", ".sqlite-shm", ".sqlite-wal"):  # come and go
            continue
        if path.is_dir():
            if not any(path.iterdir()):
                found[f"{name}/"] = "empty"
            continue
        content = _rows(path) if path.suffix == ".sqlite" else path.read_bytes()
        if path.name in _TIMES:
            content = re.sub(_TIMES[path.name], b"", content)
        if path.suffix in _DATED:
            content = re.sub(rb"20\d\d-\d\d-\d\d \d\d:\d\d", b"", content)
        found[name] = hashlib.sha256(content).hexdigest()
    return found


def _rows(path: Path) -> bytes:
    try:
        with contextlib.closing(sqlite3.connect(path)) as db:
            heads = [row[1] for row in db.execute("PRAGMA table_info(runs)") if row[1] != "seconds"]
            return repr(db.execute(f"SELECT {','.join(heads)} FROM runs ORDER BY run").fetchall()).encode()
    except sqlite3.Error:  # a store that is not whole yet
        return path.read_bytes()


@dataclass(frozen=True)
class Wanted:
    """What an undisturbed run does: time, texts, what lay there before and after, and the largest file it wrote."""

    ended: Ended
    before: Mapping[str, str]
    after: Mapping[str, str]
    largest: int
    ends: bool = False  # what it has when it is told to stop is a result

    @property
    def written(self) -> list[str]:
        """Names of the files that were written."""
        return [name for name, digest in self.after.items() if self.before.get(name) != digest and name[-1] != "/"]


class Trials:
    """Trials of the small cases; what they read lies in ``kit``."""

    def __init__(self, kit: Path) -> None:
        self.kit = kit
        self.undisturbed = cache(self._undisturbed)

    @contextlib.contextmanager
    def room(self, case: Case) -> Iterator[tuple[Path, Around]]:
        """Give a trial its folder and its surroundings; all is removed afterwards."""
        top = Path(tempfile.mkdtemp(prefix="reliability_"))  # a TemporaryDirectory would be removed by forks that end
        place = top / "place"
        try:
            (top / "tmp").mkdir()
            place_of(case, self.kit, place)
            yield place, Around(environment={"TMPDIR": str(top / "tmp")}, prepare=case.prepare)
        finally:
            for folder in [place, *place.rglob("*")] if place.exists() else []:
                folder.chmod(0o755)  # LOCKED took the right to remove them
            shutil.rmtree(top, ignore_errors=True)

    def _undisturbed(self, name: str, fresh: bool = False) -> Wanted:
        case = CASES[name]
        with self.room(case) as (place, around):
            before = digests(place)
            ended = _done(case.words, place, replace(around, fresh=fresh), case)
            assert ended.status == case.status, f"{name}: status {ended.status}: {ended.err[-500:]}"
            wanted = Wanted(ended, before, digests(place), 0, case.ends)
            return replace(wanted, largest=max([(place / n).stat().st_size for n in wanted.written], default=0))

    def trial(self, name: str, treatment: str) -> Found:
        """Treat a command once; return what came of it and what is to be said of that."""
        kind, _, rest = treatment.rpartition(" ")
        act: Callable[[str, str], Found] = {
            "stopped": self.stopped,
            "full disk": self.full_disk,
            "two at once": self.two_at_once,
            "damaged input": self.damaged_input,
            "surroundings": self.surroundings,
        }.get(kind, self.surrounded)
        return act(name, rest if act != self.surrounded else treatment)

    def stopped(self, name: str, number: str) -> Found:
        """Stop a command at a drawn moment: what lies there is a result, or none; one in four is then gone on with.

        Where it is gone on with, or run again, all is as if nothing had happened.
        """
        case, k = CASES[name], int(number)
        rng = np.random.default_rng([SEED, zlib.crc32(name.encode()), k])
        fresh, sent = k in FRESH, (signal.SIGKILL, signal.SIGTERM, signal.SIGKILL, signal.SIGINT)[k % 4]
        whom = "everything" if sent == signal.SIGINT else "it"  # a terminal sends to all that run in it
        if sent == signal.SIGKILL and case.workers:
            whom = ("it", "worker", "everything")[k // 4 % 3]
        wanted = self.undisturbed(name, fresh)
        lasts = wanted.ended.took_s
        with self.room(case) as (place, around):
            around = replace(around, fresh=fresh)
            running = Running(words_of(case.words), place, around)
            if k % 3 == 0:
                moment = f"after {1e3 * (at := float(rng.uniform(0.0, 0.05))):.0f} ms"
                over = running.wait(at)
            elif k % 3 == 1 and wanted.written:
                count = int(rng.integers(1, len(wanted.written) + 1))
                moment = f"as file {count} of {len(wanted.written)} appeared"
                over = running.wait_for_files(place, count, 3.0 * lasts + 5.0)
            else:
                moment = f"after {(at := float(rng.uniform(0.0, 1.05 * lasts))):.2f} of {lasts:.2f} s"
                over = running.wait(at)
            if not over:
                running.send(sent, whom)
            ended = running.ended(5.0 if sent == signal.SIGKILL else 30.0)
            said = f"{sent.name} to {whom} {moment}{', fresh' * fresh}{', it had ended' * over}"
            allowed = {case.status} if over else {case.status, SIGNALS[sent]} | ({3} if whom == "worker" else set())
            fault = unsound(ended, allowed, fresh) or half(place, wanted)
            if not fault and sent != signal.SIGKILL and ended.orphans:
                fault = "left processes"
            if fault:
                return fault, f"{said}: status {ended.status}: {ended.err[-200:]}"
            if ended.status == case.status and (over or not case.ends):
                return self._compared(place, wanted, said)
            if run_again(k):
                fault_again = self._again(case, place, around, wanted)
                if fault_again:
                    return fault_again[0], f"{said}; {fault_again[1]}"
                return self._compared(place, wanted, said)
            fault, left = whole(place, wanted)
            return (fault, f"{said}: {left}") if fault else (left, said)

    def _again(self, case: Case, place: Path, around: Around, wanted: Wanted) -> Found | None:
        """Go on with a command, by the first words that do; to be refused is right where all is there already."""
        for words in case.again or (case.words,):
            ended = _done(words, place, around, case)
            if fault := unsound(ended, {case.status, 2, 3}):
                return fault, f"again: status {ended.status}: {ended.err[-200:]}"
            if ended.status == case.status:
                return None
        if other(place, wanted):
            return "not gone on", f"again: status {ended.status}: {ended.err[-200:]}"
        return None

    def _compared(self, place: Path, wanted: Wanted, said: str) -> Found:
        differ = other(place, wanted)
        return ("other bytes", f"{said}: {', '.join(differ)[:200]}") if differ else ("the same bytes", said)

    def full_disk(self, name: str, number: str) -> Found:
        """Leave no room for files above a size: one line, nothing half-written; with room, all is as it should be."""
        case, wanted = CASES[name], self.undisturbed(name)
        count = EACH["full disk"][0 if case.most else 1]
        size = int(wanted.largest * int(number) / count)
        with self.room(case) as (place, around):
            ended = _done(case.words, place, replace(around, bytes=size), case)
            said = f"room for {size} bytes of {wanted.largest}"
            fault = unsound(ended, {case.status, 3}) or half(place, wanted)
            cut = [p.name for p in place.rglob("*") if p.suffix == ".part"]
            if fault or cut:
                return fault or "half-written", f"{said}: status {ended.status}: {', '.join(cut)} {ended.err[-200:]}"
            if ended.status != case.status and (fault := self._again(case, place, around, wanted)):
                return fault[0], f"{said}; {fault[1]}"
            return self._compared(place, wanted, said)

    def two_at_once(self, name: str, number: str) -> Found:
        """Run a command twice at once: one does it, the other does it, too, or is refused in one line."""
        case, wanted = CASES[name], self.undisturbed(name)
        with self.room(case) as (place, around):
            running = [Running(words_of(case.words), place, around)]
            running[0].wait(0.3 * int(number) * wanted.ended.took_s)
            running.append(Running(words_of(case.words), place, around))
            both = [process.ended() for process in running]
            said = f"statuses {both[0].status} and {both[1].status}"
            for ended in both:
                if fault := unsound(ended, {case.status, 2, 3}):
                    return fault, f"{said}: {ended.err[-200:]}"
            if case.status not in {ended.status for ended in both}:
                return "neither", f"{said}: {both[0].err[-150:]} {both[1].err[-150:]}"
            return self._compared(place, wanted, said)

    def damaged_input(self, name: str, number: str) -> Found:
        """Damage a file that is read: refused in one line, or taken for what it says."""
        case, k = CASES[name], int(number)
        rng = np.random.default_rng([SEED, zlib.crc32(name.encode()), k, 1])
        with self.room(case) as (place, around):
            files = sorted(p for p in place.rglob("*") if p.is_file())
            if not files:
                return "reads nothing", ""
            path = files[int(rng.integers(len(files)))]
            damage = _damage(path, k)
            path.write_bytes(damage(path.read_bytes(), rng))
            ended = _done(case.words, place, around, case)
            fault = unsound(ended, {0, 1, 2, 3})
            said = f"{path.relative_to(place)}: status {ended.status}: {ended.err[-200:]}"
            return fault or ("read" if ended.status == case.status else "refused"), said

    def surroundings(self, name: str, number: str) -> Found:
        """Begin a Python of another hash seed, locale and time zone: the same bytes."""
        case = CASES[name]
        with self.room(case) as (place, around):
            environment = {**around.environment, **SURROUNDINGS[int(number)]}
            ended = _done(case.words, place, replace(around, fresh=True, environment=environment), case)
            wanted = self.undisturbed(name, True)
            if fault := unsound(ended, {case.status, 3}):
                return fault, f"status {ended.status}: {ended.err[-300:]}"
            if ended.status != case.status and "the names of files must be ones" in ended.err:
                return "refused", ended.err[-300:]
            return self._compared(place, wanted, f"status {ended.status}")

    def surrounded(self, name: str, treatment: str) -> Found:
        """Close or fill streams, remove the working directory, or take the right to write."""
        case = CASES[name]
        streams = tuple(treatment.split(", ")) if treatment in STREAM_TREATMENTS else ()
        with self.room(case) as (place, around):
            gone, locked, before = treatment == GONE, treatment == LOCKED, digests(place)
            if locked:
                for path in (place, *place.rglob("*")):
                    path.chmod(0o555 if path.is_dir() else 0o444)
            around = replace(around, streams=streams, gone=gone, plain=locked)
            ended = Running(words_of(case.words, f"{place}/" if gone else ""), place, around).ended()
            allowed = {case.status}
            if ">/dev/full" in streams or gone or locked:
                allowed |= {2, 3}
            if "| true" in streams:
                allowed |= {141}
            if fault := unsound(ended, allowed):
                return fault, f"status {ended.status}: {ended.err[-300:]} {ended.out[-200:]}"
            if ended.status in (2, 3) and ">/dev/full" not in streams:
                changed = {n for n, digest in digests(place).items() if before.get(n) != digest}
                return ("half-written", ", ".join(changed)) if changed else ("refused", ended.err[-200:])
            wanted = self.undisturbed(name)
            if (
                {"2>&-", "2>/dev/full"} & set(streams)
                and ">&-" not in streams
                and _NUMBER.sub("", ended.out) != _NUMBER.sub("", wanted.ended.out)
            ):
                return "other words", ended.out[-200:]
            return self._compared(place, wanted, f"status {ended.status}")


STREAM_TREATMENTS = (*STREAMS, "<&-, >&-, 2>&-")
PLACES = GONE, LOCKED = "no working directory", "no right to write"


def treatments(case: Case) -> list[str]:
    """Return what is done to a case in the whole study."""
    counted = {"stopped": (MOST, OTHERS), **EACH}
    out = [f"{kind} {k}" for kind, (most, others) in counted.items() for k in range(most if case.most else others)]
    return [*out, *STREAM_TREATMENTS, *PLACES]


def run_again(number: int) -> bool:
    """Say whether a stop is one of the fourth, of all signals and moments alike, after which a command is run again."""
    return number // 4 % 4 == 0


def unsound(ended: Ended, allowed: Collection[int], fresh: bool = False) -> str:
    """Return the fault of how a process ended; "" if there is none."""
    if ended.status is None:
        return "hung"
    texts = ended.out + ended.err
    if "Traceback" in texts or "Exception ignored" in texts:
        ours = "/testbench/" in texts.replace("/testbench/__init__.py", "").replace("/testbench/__main__.py", "")
        return "traceback" if not fresh or ours else ""  # Python was interrupted before it came to the testbench
    if ended.status not in allowed:
        return "wrong status"
    lines = [line for line in ended.err.splitlines() if line.strip()]
    if sum(line.startswith("error: ") for line in lines) > 1 or any(not _LINE.match(line) for line in lines):
        return "more than a line"
    return ""


def half(place: Path, wanted: Wanted) -> str:
    """Return the fault of what a stopped command left: files that are not whole, a page without what it stands for."""
    found = digests(place)
    written = set(wanted.written)
    fresh = {n for n in written & set(found) if wanted.before.get(n) != found[n] and not n.endswith(_GROWING)}
    if not wanted.ends and any(found[name] != wanted.after[name] for name in fresh):
        return "half-written"
    for page in (name for name in fresh if Path(name).name in _PAGES):
        folder = f"{Path(page).parent}/"
        if any(name.startswith(folder) and name not in found for name in written):
            return "looked finished"
    return ""


def whole(place: Path, wanted: Wanted) -> Found:
    """Settle what a stopped command left, and return the fault of it, or how much of it is there.

    In each folder of results the manifest is whole, no move is left to be made, every file that it lists has the bytes
    that it gives, and nothing that was written lies beside them that it does not list.
    """
    owns = sorted(place.rglob(HIDDEN))
    homes = {own.parent for own in owns}
    for own in owns:
        folder = own.parent
        try:
            manifest = manifest_of(folder)
        except RecordError as error:
            return "half-written", str(error)
        if (own / COMMIT).exists():
            return "mixed", f"{folder.name}: moves are left to be made"
        listed = manifest.files if manifest else {}
        for name, entry in listed.items():
            if entry is not None and entry_of(folder / name) != entry:
                return "half-written", f"{folder.name}/{name} is not what its manifest says"
        for name in set(wanted.written) - set(wanted.before):
            path = place / name
            mine = next((above for above in path.parents if above in homes), None) == folder
            if mine and path.exists() and path.relative_to(folder).as_posix() not in listed:
                return "mixed", f"{name} lies there, and no manifest lists it"
    if fault := half(place, wanted):
        return fault, "once it was settled"
    found = digests(place)
    if found == dict(wanted.after):
        return "", "the new result"
    if found == dict(wanted.before):
        return "", "as before"
    return "", "a part that is whole"


def other(place: Path, wanted: Wanted) -> list[str]:
    """Return the names of what lies there and should not, does not and should, or has other bytes."""
    found = digests(place)
    return sorted(n for n in {*found, *wanted.after} if found.get(n) != wanted.after.get(n))


def _done(words: str, place: Path, around: Around, case: Case) -> Ended:
    return Running(words_of(words), place, around).ended()


def _damage(path: Path, k: int) -> Callable[[bytes, np.random.Generator], bytes]:
    if path.suffix == ".toml" and k % 2:
        change = nudged if k % 4 == 1 else mistyped
        return lambda content, rng: change(content.decode(), rng).encode()
    return of_text if path.suffix in (".toml", ".csv", ".txt", ".json", ".md") else damaged_bytes
