"""Run the study of reliability: ``python -m studies.reliability``; it goes on where it stopped.

python -m studies.reliability --only scenarios --only records   # one part, or some
python -m studies.reliability --share 0.1                        # a tenth of the cases
python -m studies.reliability --report                           # write results/reliability.md from the rows kept

Rows are kept in build/reliability; results/reliability.md says how many cases ran.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy

from studies.reliability import crashes, disk, kills, records, report, scenarios, sizes

KILLED = ("campaign", "plan", "gap --controls", "blind test")


def main() -> int:
    """Run the parts that are asked for, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.reliability", description=__doc__)
    parts = ("scenarios", "flown", "records", *KILLED, "disk", "crashes", "sizes")
    parser.add_argument("--only", action="append", choices=parts, help="part to run; may be given several times")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of each part")
    parser.add_argument("--report", action="store_true", help="write the table from the rows that are kept")
    asked = parser.parse_args()

    def some(count: int) -> int:
        return max(1, round(asked.share * count))

    run: dict[str, Callable[[], object]] = {
        "scenarios": lambda: scenarios.scenarios(some(scenarios.COUNT)),
        "records": lambda: records.records(some(records.COUNT)),
        "flown": lambda: scenarios.flown(scenarios.scenarios(some(scenarios.COUNT)), some(scenarios.FLOWN)),
        **{name: partial(kills.kills, [name], some(kills.COUNT)) for name in KILLED},
        "disk": lambda: disk.disk(some(disk.COUNT)),
        "crashes": crashes.crashes,
        "sizes": lambda: sizes.sizes(some(sizes.ROWS), some(sizes.RUNS)),
    }
    for part in [] if asked.report else asked.only or list(run):
        run[part]()
    print(report.write())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
