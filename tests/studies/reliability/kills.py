"""SIGKILL at random moments, then the command again: nothing lost, nothing twice, the bytes of an undisturbed run."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from studies.reliability import small
from studies.reliability.cases import KEPT, ROOT, Row, go_on

COUNT, RUNS, LONGEST_S = 100, 12, 900
SEED = 34
ENVIRONMENT = {
    **os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "OPENBLAS_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(KEPT / "compiled"),  # a second sooner, and killed, too
}  # fmt: skip
_TIMES = {
    "report.html": rb"<dt>cost</dt><dd>[^<]*</dd>",  # of a campaign
    "rows.jsonl": rb'"seconds": [^}]*',
    "cases.csv": rb",[\d.]+(?=\n)",
    "README.md": rb"Processor time of a case: [^;]*;",
}
"""File -> what of it is processor time, which no two runs have in common."""
WHOM = ("parent", "worker", "everything")
"""Who is killed: the command, a process below it (a worker, or what forks them), or all of its processes at once."""


@dataclass(frozen=True)
class Killed:
    """A command that is killed: words with {out}, the words that go on with it, and a store of runs if it has one."""

    words: tuple[str, ...]
    again: tuple[str, ...]
    store: str = ""
    module: str = "testbench"


def commands(folder: Path) -> dict[str, Killed]:
    """Return what is killed; files of scenarios are written into ``folder``."""
    from questions.campaign.short_campaigns import SHORT

    texts = {"short": SHORT.format(head=f"runs = {RUNS}", vary=""), "plan": small.PLAN, "gap": small.GAP}
    for stem, text in texts.items():
        (folder / f"{stem}.toml").write_text(text, encoding="utf-8")
    fly = (str(folder / "short.toml"), "--out", "{out}", "--workers", "1")
    plan = ("plan", "show", str(folder / "plan.toml"), "--out", "{out}")
    gap = ("gap", str(folder / "gap.toml"), "--controls", "2", "--workers", "2", "--out", "{out}")
    blind = (*small.BLIND, "--out", "{out}", "--cases", "3", "--workers", "2")
    return {
        "campaign": Killed(("campaign", "run", *fly), ("campaign", "resume", *fly), "campaign_short/campaign.sqlite"),
        "plan": Killed(plan, plan),
        "gap --controls": Killed(gap, gap),
        "blind test": Killed(blind, blind, module="studies.blind"),
    }


def begun(killed: Killed, words: Sequence[str], out: Path) -> subprocess.Popen[bytes]:
    """Begin a command in a group of processes of its own."""
    arguments = [word.format(out=out) for word in words]
    quiet = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-m", killed.module, *arguments], cwd=ROOT, env=ENVIRONMENT,
                            stdout=quiet, stderr=quiet, start_new_session=True)  # fmt: skip


def below(process: int) -> list[int]:
    """Return the processes below one, as /proc lists them."""
    out: list[int] = []
    for child in Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split():
        out += [int(child)]
        with contextlib.suppress(OSError):
            out += below(int(child))
    return out


def digests(out: Path) -> dict[str, str]:
    """Return file -> SHA-256 of what a command wrote, without times; of a store, of its rows: its pages keep history.

    Rows of the blind test are sorted: two workers end in any order.
    """
    found = {}
    for path in sorted(p for p in out.rglob("*") if p.is_file() and p.suffix != ".lock" and p.stat().st_size):
        content = _rows(path) if path.suffix == ".sqlite" else path.read_bytes()
        if path.name in _TIMES:
            content = re.sub(_TIMES[path.name], b"", content)
        if path.name == "rows.jsonl":
            content = b"\n".join(sorted(content.splitlines()))
        found[path.relative_to(out).as_posix()] = hashlib.sha256(content).hexdigest()
    return found


def _rows(path: Path) -> bytes:
    with contextlib.closing(sqlite3.connect(path)) as db:
        heads = [row[1] for row in db.execute("PRAGMA table_info(runs)") if row[1] != "seconds"]
        return repr(db.execute(f"SELECT {','.join(heads)} FROM runs ORDER BY run").fetchall()).encode()


@cache
def undisturbed(name: str) -> tuple[float, dict[str, str]]:
    """Return how long a command takes, s, and what it writes."""
    with tempfile.TemporaryDirectory() as place:
        killed, out = commands(Path(place))[name], Path(place, "out")
        start = time.monotonic()
        status = begun(killed, killed.words, out).wait(LONGEST_S)
        assert status == 0, f"{name} ended with {status}"
        return time.monotonic() - start, digests(out)


def trial(name: str, number: int, whom: str) -> tuple[str, str]:
    """Kill a command once at a random moment, run it again, and compare what is there with an undisturbed run."""
    duration, wanted = undisturbed(name)
    moment = float(np.random.default_rng([SEED, number]).uniform(0.0, 1.1 * duration))
    with tempfile.TemporaryDirectory() as place:
        killed, out = commands(Path(place))[name], Path(place, "out")
        process = begun(killed, killed.words, out)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(moment)
        ended = process.poll() is not None
        if not ended:
            _kill(process, whom, number)
            process.wait(LONGEST_S)  # after the death of a worker the command goes on by itself
        if process.returncode != 0:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # workers that outlive their parent
            again = killed.again if not killed.store or (out / killed.store).exists() else killed.words
            status = begun(killed, again, out).wait(LONGEST_S)
            if (
                status and killed.again != killed.words
            ):  # a store that was not whole yet: the message says to run it anew
                status = begun(killed, killed.words, out).wait(LONGEST_S)
            if status:
                return "not gone on", f"status {status} after {whom} at {moment:.2f} s"
        found = digests(out)
        other = sorted(n for n in {*found, *wanted} if found.get(n) != wanted.get(n))
        said = f"{whom} at {moment:.2f} of {duration:.1f} s" + ("; it had ended" if ended else "")
        return ("the same bytes", said) if not other else ("other bytes", f"{said}: {', '.join(other)}")


def _kill(process: subprocess.Popen[bytes], whom: str, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, FileNotFoundError):
        if whom == "everything":
            os.killpg(process.pid, signal.SIGKILL)
            return
        children = below(process.pid) if whom == "worker" else []
        os.kill(children[number % len(children)] if children else process.pid, signal.SIGKILL)


def kills(only: Sequence[str], count: int = COUNT) -> dict[str, list[Row]]:
    """Kill each command ``count`` times."""
    out = {}
    for name in only:
        names = [f"{name} {k} {WHOM[k % len(WHOM)]}" for k in range(count)]

        def run(due: Sequence[str], name: str = name) -> Iterator[tuple[str, str, str]]:
            for case in due:
                _, number, whom = case.removeprefix(name).split(" ")
                yield (case, *trial(name, int(number), whom))

        out[name] = go_on(f"kills_{name.replace(' ', '_')}", names, run)
    return out
