"""Tables: each is one object that becomes HTML, CSV and JSON with the same numbers."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from testbench.core.escape import csv_cell
from testbench.page.labels import number

if TYPE_CHECKING:
    import pandas as pd

Value = str | float | int | bool | None
MISSING = "–"
"""A missing value, as the page shows it."""
LONGEST = 160
"""Characters of a cell that stand in it on the page; what is longer is a note below the table."""
_BEGINNING = 50  # characters of it that the cell keeps
SHEET_PT = 516.0
"""Width of what is printed on A4, points: 210 mm less the margins of the style sheet."""
_LETTER_PT, _BOLD_PT, _PAD_PT = 4.8, 5.2, 6.7  # of a cell in print: 7.5 points, of a broad sans-serif
_UNBROKEN, _SHORT_TEXT, _TEXT_PT = 16, 24, 53.0  # letters that stand in one line; above the second, least width of text


@dataclass(frozen=True)
class Column:
    """One column: ``key`` names it in files, ``head`` and ``unit`` on the page, ``group`` spans neighbours.

    ``decimals`` fixes the places behind the point; None gives ``digits`` significant ones. ``given`` marks a column of
    values that were chosen, not found: they are shown without trailing zeros. ``common`` is how all texts of the column
    begin: the page leaves it out, for the caption tells it; files keep it.

    ``get`` says which value of an item stands in the column, for :meth:`Table.of`: a path of attributes such as
    "rms.low", "" for the key, where None on the way is a missing value; or what returns the value.
    """

    key: str
    head: str
    unit: str = ""
    group: str = ""
    decimals: int | None = None
    digits: int = 3
    given: bool = False
    common: str = ""
    get: str | Callable[[Any], Value] = field(default="", compare=False)

    def of(self, item: Any) -> Value:
        """Return the value of an item that stands in the column."""
        if not isinstance(self.get, str):
            return self.get(item)
        for name in (self.get or self.key).split("."):
            item = None if item is None else getattr(item, name)
        value: Value = item
        return value

    def text(self, value: Value) -> str:
        """Return ``value`` as the page shows it; what is missing becomes a dash."""
        if _missing(value):
            return MISSING
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, float):
            if self.given:
                text = f"{value:.{self.digits}g}".replace("-", "−")
                return number(value, self.digits) if "e" in text else text
            if self.decimals is not None and math.isfinite(value) and abs(value) < 1e6:
                return f"{value:z.{self.decimals}f}".replace("-", "−")  # z: no minus before nothing but zeros
            return number(value, self.digits)
        return str(value).removeprefix(self.common)


@dataclass(frozen=True)
class Table:
    """A table of a report; ``rows`` hold one value per column."""

    name: str  # short, fit for a file name
    title: str  # what it shows
    caption: str  # how to read it
    columns: tuple[Column, ...]  # at least one
    rows: tuple[tuple[Value, ...], ...]  # values in the order of the columns
    total: bool = False  # the last row is a mean or sum and is set off
    wide: bool = False  # long text in cells; the page lets it wrap

    @classmethod
    def of(
        cls, name: str, title: str, caption: str, columns: Sequence[Column], items: Iterable[Any], **more: Any
    ) -> Table:
        """Return a table with a row for each item, whose columns say what they show of it; ``more`` as of a table."""
        return cls(name, title, caption, tuple(columns), tuple(tuple(c.of(x) for c in columns) for x in items), **more)

    def only(self, *keys: str) -> Table:
        """Return the table with these columns alone, in its own order."""
        kept = [k for k, column in enumerate(self.columns) if column.key in keys]
        rows = tuple(tuple(row[k] for k in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in kept), rows=rows)

    def first(self, count: int) -> Table:
        """Return the table with its first rows alone."""
        return replace(self, rows=self.rows[:count])

    def without(self, *keys: str) -> Table:
        """Return the table without these columns."""
        return self.only(*(column.key for column in self.columns if column.key not in keys))

    def groups(self) -> list[tuple[str, int]]:
        """Return (group, number of columns) of the upper heading row; empty if no column belongs to a group."""
        out: list[tuple[str, int]] = []
        for column in self.columns:
            if out and out[-1][0] == column.group:
                out[-1] = (column.group, out[-1][1] + 1)
            else:
                out.append((column.group, 1))
        return out if any(name for name, _ in out) else []

    def numeric(self) -> list[bool]:
        """Return for every column whether it holds numbers, which stand to the right."""
        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return [
            any(_is_number(v) for v in values) and all(v is None or _is_number(v) for v in values) for values in columns
        ]

    def cells(self) -> list[list[tuple[str, bool]]]:
        """Return (text, stands to the right) of every cell."""
        numeric = self.numeric()
        return [
            [(c.text(v), right) for c, v, right in zip(self.columns, row, numeric, strict=True)] for row in self.rows
        ]

    def remarks(self) -> dict[str, tuple[int, str]]:
        """Return (number from 1, its first words) of each text that is too long for a cell; equal texts are one."""
        texts = [str(v) for row in self.rows for v in row[1:] if isinstance(v, str) and len(v) > LONGEST]
        return {
            text: (k, f"{text[:_BEGINNING].rsplit(' ', 1)[0].rstrip(' ,;:(')} …")
            for k, text in enumerate(dict.fromkeys(texts), 1)
        }

    def sheets(self) -> list[Table]:
        """Return the table as a sheet of A4 takes it: itself, or parts that stand below each other.

        Each begins with the first columns, those before the first group. Columns of a group stay together if they fit.
        """
        widths = [self._least_pt(k) for k in range(len(self.columns))]
        if sum(widths) <= SHEET_PT:
            return [self]
        groups = self.groups()
        first = groups[0][1] if groups and not groups[0][0] else 1
        while first > 1 and sum(widths[:first]) > SHEET_PT / 2.0:
            first -= 1
        room = SHEET_PT - sum(widths[:first])
        parts = _filled(_filled([[k] for k in range(first, len(widths))], widths, room, self._one_group), widths, room)
        return [self._part([*range(first), *part]) for part in parts]

    def _one_group(self, a: int, b: int) -> bool:
        return self.columns[a].group == self.columns[b].group != ""

    def _part(self, kept: list[int]) -> Table:
        rows = tuple(tuple(row[k] for k in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in kept), rows=rows)

    def _least_pt(self, k: int) -> float:
        """Return about the least width of a column in print, points: words of its head, and cells as the page wraps."""
        column = self.columns[k]
        texts = [column.text(row[k]) for row in self.rows]
        words = [w for text in texts for w in (text.split() if k == 0 or len(text) > _UNBROKEN else [text])]
        cell = _LETTER_PT * max(map(len, words), default=0)
        if any(len(text) > (_UNBROKEN if k == 0 else _SHORT_TEXT) for text in texts):
            cell = max(cell, _TEXT_PT)
        head = _BOLD_PT * max(map(len, f"{column.head} {column.unit}".split()), default=0)
        return _PAD_PT + max(head, cell)

    def heads(self) -> list[str]:
        """Return the column names that files carry, with units."""
        return [c.key + (f" [{c.unit}]" if c.unit else "") for c in self.columns]

    def to_csv(self) -> str:
        """Return the table as CSV with a header line; all digits of numbers, missing ones left empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([csv_cell(head) for head in self.heads()])
        writer.writerows([[_written(v) for v in row] for row in self.rows])
        return out.getvalue()

    def to_dict(self) -> dict[str, Any]:
        """Return title, caption, units and rows as JSON values; a number that is not finite becomes None."""
        return {
            "title": self.title,
            "caption": self.caption,
            "units": {c.key: c.unit for c in self.columns if c.unit},
            "rows": [{c.key: _json(v) for c, v in zip(self.columns, row, strict=True)} for row in self.rows],
        }

    def to_json(self) -> str:
        """Return what :meth:`to_dict` does, as text."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"

    def to_pandas(self) -> pd.DataFrame:
        """Return the table with all digits of its numbers, as the CSV beside a page has it."""
        import pandas as pd

        return pd.DataFrame([list(row) for row in self.rows], columns=self.heads())


def _filled(
    blocks: list[list[int]], widths: list[float], room: float, joined: Callable[[int, int], bool] = lambda a, b: True
) -> list[list[int]]:
    """Return blocks of columns joined, from the left, while they are ``joined`` by their ends and have room."""
    out: list[list[int]] = []
    for block in blocks:
        if out and joined(out[-1][-1], block[0]) and sum(widths[k] for k in (*out[-1], *block)) <= room:
            out[-1] += block
        else:
            out.append(list(block))
    return out


def _written(value: Value) -> Value:
    return "" if _missing(value) else csv_cell(value) if isinstance(value, str) else value


def _missing(value: Value) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _is_number(value: Value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _json(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value
