"""What `make test` tries of every command: some treatments, in a process that is forked from a warm one."""

import shutil
import tempfile
from pathlib import Path

from quick_drawing import quick_drawing
from studies.reliability.small import CASES
from studies.reliability.treatments import FAULTS, GONE, LOCKED, Trials, treatments

QUICK = ("export file", "plan new", "plan rehearse", "compare benchmark", "reproduce", "exercise list",
         "exercise start", "exercise roster", "exercise marks", "exercise check", "check", "list")  # fmt: skip
"""Cases of less than a second; the others are not run to their end here."""
WHOLE = ("stopped 1", "stopped 4", "<&-, >&-, 2>&-", GONE, LOCKED)
ABRUPT = (GONE, "damaged input 0")


def sampled(name: str, told: Path) -> None:
    """Write the faults of a sample of the trials of a command into a file."""
    kit = Path(tempfile.mkdtemp(prefix="reliability_kit_"))
    try:
        with quick_drawing():
            trials = Trials(kit)
            faults = []
            meant = treatments(CASES[name])
            for treatment in (t for t in (WHOLE if name in QUICK else ABRUPT) if t in meant):
                outcome, said = trials.trial(name, treatment)
                if outcome in FAULTS:
                    faults.append(f"{name}: {treatment}: {outcome}: {said}")
        told.write_text("\n".join(faults), encoding="utf-8")
    finally:
        shutil.rmtree(kit, ignore_errors=True)
