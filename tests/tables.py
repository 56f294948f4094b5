"""Tables of studies and benchmarks: CSV files that a study that goes on where it stopped reads, and writes again."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table, all cells as text; none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, columns: Iterable[str], rows: Iterable[Mapping[str, Any] | Sequence[Any]]) -> None:
    """Write a table; a row is its cells in order, or by column, where a cell may be missing."""
    heads = list(columns)
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(heads)
        table.writerows([row.get(c, "") for c in heads] if isinstance(row, Mapping) else row for row in rows)
