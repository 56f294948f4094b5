"""Cases of the study that go on where they stopped: one row for each in results/reliability/PART.csv."""

import csv
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from clock import since
from tables import read_rows

ROOT = Path(__file__).resolve().parents[3]
KEPT = ROOT / "results" / "reliability"
COLUMNS = ("case", "outcome", "said", "load")
Row = dict[str, str]


def rows_of(part: str) -> list[Row]:
    """Return the rows of a part that are kept."""
    return read_rows(KEPT / f"{part}.csv")


def go_on(part: str, names: Sequence[str], run: Callable[[Sequence[str]], Iterable[tuple[str, str, str]]]) -> list[Row]:
    """Run the cases of a part that have no row yet, and return the rows of all.

    Args:
        part: names the file that keeps the rows.
        names: of all cases.
        run: is given the names that are due and yields (name, outcome, what was said) of each.
    """
    KEPT.mkdir(parents=True, exist_ok=True)
    path = KEPT / f"{part}.csv"
    rows = [row for row in rows_of(part) if row["case"] in set(names)]
    done = {row["case"] for row in rows}
    due = [name for name in names if name not in done]
    begun = time.monotonic()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not file.tell():
            writer.writeheader()
        for k, (name, outcome, said) in enumerate(run(due) if due else (), 1):
            said = re.sub(
                r"/\S*/reliability_\w+/", "", " ".join(said.split())
            )  # rows are the same wherever they are made
            row = {"case": name, "outcome": outcome, "said": said[:300],
                   "load": f"{os.getloadavg()[0]:.1f}"}  # fmt: skip
            writer.writerow(row)
            file.flush()
            rows.append(row)
            if k == len(due) or k % 20 == 0:
                found = ", ".join(f"{n} {o}" for o, n in sorted(Counter(r["outcome"] for r in rows).items()))
                took_s = since(begun, time.monotonic)
                print(f"{part}: {len(rows)} of {len(names)} in {took_s:.0f} s: {found}", flush=True)
    return rows


def in_batches(names: Sequence[str], most: int) -> Iterator[Sequence[str]]:
    """Return the names in batches."""
    for at in range(0, len(names), most):
        yield names[at : at + most]


def quiet_main(arguments: Sequence[str], out: Path) -> tuple[int, str]:
    """Run ``testbench ARGUMENTS`` in this process; return its exit status and what it wrote, and let faults pass."""
    import one_tree  # noqa: F401 (the tree of commands is the same in each case)

    from testbench import cli

    kept = os.dup(1), os.dup(2)
    stdout, stderr, argv = sys.stdout, sys.stderr, sys.argv
    with out.open("w+", encoding="utf-8", errors="surrogateescape") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        sys.stdout = sys.stderr = file
        sys.argv = ["testbench", *arguments]
        try:
            cli.main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
        finally:
            sys.stdout, sys.stderr, sys.argv = stdout, stderr, argv
            for old, new in zip(kept, (1, 2), strict=True):
                os.dup2(old, new)
                os.close(old)
    return status, out.read_text(encoding="utf-8", errors="replace")
