"""Run the study of reliability: ``python -m studies.reliability``; it goes on where it stopped.

Parts that do not wait for each other run side by side, one on each core.

python -m studies.reliability --only scenarios --only records   # one part, or some
python -m studies.reliability --command "gap new" --command run  # some commands alone, treated here and now, row by row
python -m studies.reliability --share 0.1                        # a tenth of the cases
python -m studies.reliability --report                           # write results/reliability.md from the rows kept

Rows are kept in results/reliability; results/reliability.md says how many cases ran.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

from studies.reliability import commands, crashes, kinds, records, report, scenarios, sizes
from studies.reliability.small import CASES

COMMANDS = [commands.part_of(part) for part in range(commands.PARTS)]
LANES = (
    *((part,) for part in COMMANDS),
    ("scenarios", "flown"),
    ("records",),
    ("kinds", "nonsense", "crashes", "sizes"),
)
"""What runs one after the other, the longest first."""


def main() -> int:
    """Run the parts that are asked for, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.reliability", description=__doc__)
    parts = [part for lane in LANES for part in lane]
    parser.add_argument("--only", action="append", choices=parts, help="part to run; may be given several times")
    parser.add_argument("--command", action="append", choices=list(CASES), help="show what becomes of one, keep no row")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of each part")
    parser.add_argument("--lane", action="store_true", help="one after the other in this process, without the table")
    parser.add_argument("--report", action="store_true", help="write the table from the rows that are kept")
    asked = parser.parse_args()
    if asked.command:
        faults = 0
        for case, outcome, said in commands.run(commands.names(asked.command, asked.share)):
            print(f"{case}: {outcome}: {' '.join(said.split())}", flush=True)
            faults += outcome in report.FAULTS
        return min(faults, 1)

    def some(count: int) -> int:
        return max(1, round(asked.share * count))

    run: dict[str, Callable[[], object]] = {
        "scenarios": lambda: scenarios.scenarios(some(scenarios.COUNT)),
        "kinds": lambda: kinds.kinds(some(kinds.COUNT)),
        "nonsense": kinds.nonsense,
        "records": lambda: records.records(some(records.COUNT)),
        "flown": lambda: scenarios.flown(scenarios.scenarios(some(scenarios.COUNT)), some(scenarios.FLOWN)),
        **{part: partial(commands.commands, number, asked.share) for number, part in enumerate(COMMANDS)},
        "crashes": crashes.crashes,
        "sizes": lambda: sizes.sizes(some(sizes.ROWS), some(sizes.RUNS)),
    }
    due = [] if asked.report else asked.only or list(run)
    lanes = [lane for all_ in LANES if (lane := [part for part in all_ if part in due])]
    if asked.lane or len(lanes) < 2:
        for part in due:
            run[part]()
        failed = 0
    else:
        with ThreadPoolExecutor(os.cpu_count()) as cores:
            failed = max(cores.map(partial(_lane, share=asked.share), lanes))
    if not asked.lane:
        print(report.write())
    return failed


def _lane(parts: Sequence[str], share: float) -> int:
    """Run some parts in a process of their own; return its exit status."""
    only = [word for part in parts for word in ("--only", part)]
    command = [sys.executable, "-m", "studies.reliability", "--lane", "--share", str(share), *only]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
