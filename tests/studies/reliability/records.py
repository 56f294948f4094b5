"""Mutated records of every format through the commands that read them; what is read is held against the original."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from fuzz import inputs
from fuzz.mutations import damaged, of_text
from fuzz.test_mutated_files import TEXTS, rng_of
from studies.reliability.cases import Row, go_on, quiet_main
from studies.reliability.scenarios import LONGEST_S, run_cases

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.questions.importing.ask import Imported, import_log

COUNT = 600  # of each format
BATCH = 130  # ten of each format in one process, which imports what it needs once
WRONG = 0.5  # of the samples of a channel that differ from the original's: no damage of some bytes does that


@cache
def originals() -> dict[str, tuple[str, bytes, Imported]]:
    """Return format -> (suffix, content, what is read of it)."""
    with tempfile.TemporaryDirectory() as place:
        out = {}
        for name, (suffix, content) in inputs.logs(Path(place)).items():
            path = Path(place, f"whole{suffix}")
            path.write_bytes(content)
            out[name] = (suffix, content, import_log(path))
    return out


def judged(case: str, folder: Path) -> tuple[str, str]:
    """Return what became of a mutant: refused, or read, and whether most of what was read is the original's."""
    name, _, seed = case.rpartition(" ")
    suffix, content, whole = originals()[name]
    path = folder / f"log{suffix}"
    path.write_bytes((of_text if name in TEXTS else damaged)(content, rng_of(f"reliability {name}", int(seed))))
    commands(path, folder, int(seed))
    try:
        found = import_log(path)
    except Refusal as error:
        return "refused", str(error)
    wrong = differing(whole.record, found.record)
    if not wrong:
        return "read", ""
    asked = [text for text in found.asked if text not in whole.asked]  # what is asked of the whole one says nothing
    told = [*found.log.warnings, *found.log.notes]
    outcome = "read with a question" if asked else "read with a warning" if told else "to be looked at"
    return outcome, "; ".join([*wrong, "|", *asked, *told])


def commands(path: Path, folder: Path, seed: int) -> None:
    """Read a file by one command of those that read it, in turn.

    Raises:
        AssertionError: the command ended with a traceback, another status than 0, 2 or 3, or controls of a terminal.
    """
    words = [
        ["import", str(path), "-o", str(folder / "out")],
        ["import", str(path), "--describe", str(folder / "d.toml")],
        ["identify" if seed % 60 == 2 else "import", str(path), "-o", str(folder / "out")],  # seconds, not hundredths
        ["check", str(path)],
        ["export", str(path), "--to", "csv", "-o", str(folder / "e.csv")],
        ["import", str(path), "--strict"],
    ][seed % 6]
    status, said = quiet_main(words, folder / "said")
    assert status in (0, 2, 3), f"{words[0]} ended with {status}"
    assert "Traceback" not in said, f"{words[0]}: {said[-200:]}"
    steering = sorted({c for c in said if not c.isprintable() and c not in "\n\t"} - set("\u200b\xa0"))
    assert not steering, f"{words[0]}: controls {steering} in what is printed"


def differing(whole: FlightRecord, read: FlightRecord) -> list[str]:
    """Return the channels most samples of which differ from the original's at the same time, or near it.

    Time counts from the first sample: where the first rows are lost, all begins so much later, and earlier where one
    has a time before them.
    """
    wrong = _apart(whole, read, 0.0)
    over_s = read.t_s[-1] - whole.t_s[-1]
    shifts = np.arange(-max(over_s, 1.0), 0.1 - over_s, 0.25 * (whole.t_s[1] - whole.t_s[0])) if wrong else ()
    for lost_s in shifts:  # with any of them, what is read ends where the original ends, or before
        found = _apart(whole, read, float(lost_s))
        wrong = found if len(found) < len(wrong) else wrong
        if not wrong:
            break
    return wrong


def _apart(whole: FlightRecord, read: FlightRecord, lost_s: float) -> list[str]:
    out = []
    for name in sorted(set(whole.channels) & set(read.channels)):
        a, b = whole.channels.index(name), read.channels.index(name)
        valid, t_s = whole.valid[:, a], read.t_s + lost_s
        inside = read.valid[:, b] & (t_s >= whole.t_s[0]) & (t_s <= whole.t_s[-1])
        if valid.sum() < 2 or inside.sum() < 10:
            continue
        there = np.interp(t_s[inside], whole.t_s[valid], whole.data[valid, a])
        near = 0.02 * max(np.ptp(whole.data[valid, a]), 1e-9) + 1e-6 * np.abs(there)
        off = read.data[inside, b] - there
        if name in ("phi", "psi"):
            off = (off + np.pi) % (2.0 * np.pi) - np.pi  # a turn more is the same heading
        share = float(np.mean(np.abs(off) > near))
        if share > WRONG:
            out.append(f"{name}: {share:.0%} of the samples")
    return out


def records(count: int = COUNT) -> list[Row]:
    """Read ``count`` mutants of each format."""
    names = [f"{name} {seed}" for seed in range(count) for name in originals()]
    return go_on("records", names, lambda due: run_cases(due, judged, LONGEST_S, 1.0, BATCH))
