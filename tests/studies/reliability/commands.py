"""Every command, treated in every way: four parts of the study, which run side by side."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from quick_drawing import quick_drawing
from studies.reliability.cases import Row, go_on, rows_of
from studies.reliability.small import CASES
from studies.reliability.treatments import Trials, treatments
from studies.reliability.warm import warm

PARTS = 4  # the same on every machine, so that a study goes on elsewhere


def part_of(part: int) -> str:
    """Return the name of the file that keeps the rows of a part of the commands."""
    return f"commands_{part}"


def names(cases: Sequence[str], share: float = 1.0) -> list[str]:
    """Return the trials of some cases, "command: treatment"; the first of each kind if a share is asked for."""
    out = []
    for name in cases:
        kinds: dict[str, list[str]] = {}
        for treatment in treatments(CASES[name]):
            kinds.setdefault(treatment.rstrip("0123456789"), []).append(treatment)
        out += [f"{name}: {t}" for some in kinds.values() for t in some[: max(1, round(share * len(some)))]]
    return out


@contextlib.contextmanager
def begun() -> Iterator[Trials]:
    """Import what commands import, and give trials, which keep what their cases read until the block's end."""
    warm()
    kit = Path(tempfile.mkdtemp(prefix="reliability_kit_"))
    try:
        with quick_drawing():  # a Python of its own renders figures
            yield Trials(kit)
    finally:
        shutil.rmtree(kit, ignore_errors=True)


def treated(trials: Trials, due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (name, outcome, said) of trials."""
    for case in due:
        try:
            yield (case, *trials.trial(*case.split(": ")))
        except AssertionError as error:  # what a trial starts from cannot be made
            yield case, "not begun", str(error)


def run(due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (name, outcome, said) of trials that begin here and now."""
    with begun() as trials:
        yield from treated(trials, due)


def commands(part: int, share: float = 1.0) -> list[Row]:
    """Treat the commands of a part; a new command moves others to another part, where their rows do not follow."""
    elsewhere = {row["case"] for other in range(PARTS) if other != part for row in rows_of(part_of(other))}
    due = [name for name in names(list(CASES)[part::PARTS], share) if name not in elsewhere]
    return go_on(part_of(part), due, run)


def rows() -> list[Row]:
    """Return the rows that are kept of all commands."""
    return [row for part in range(PARTS) for row in rows_of(part_of(part))]
