"""Tables written as text: encoding, separator and decimal sign are recognised, the header gives names and units.

A separator and a decimal sign are chosen together: those under which most cells of the first rows are numbers. Lines
that begin with # or % are never numbers; before the first other line they may hold the header.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.door import read_bytes, require_room
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.names import MISSING, clock_called, meaning, plain_unit, split_unit, time_unit
from testbench.logs.times import is_stamp

_PART = 200  # lines that are looked through for the first row of numbers
_SAMPLE = 50  # rows by which separator and decimal sign are told
_WORSE = 0.75  # of the share of numbers under the best choice: below it a choice that was given is refused
_IN_MEMORY = 5  # bytes for each byte of a table, whose cells are texts of their own
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_THOUSANDS = {
    ".": re.compile(r"[+-]?\d{1,3}(?:[,'’ \u00a0\u202f]\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?\d{1,3}(?:[.'’ \u00a0\u202f]\d{3})+(?:,\d*)?"),
}
_NAMES = {",": "a comma", ";": "';'", "\t": "a tab", "|": "'|'", None: "blanks"}


class Cells(NamedTuple):
    """Header and cells of a text file."""

    # names, units: (m,) of the columns, "" where none is given
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]  # (m,) columns of n cells
    lines: list[int]  # (n,) line of each row, counted from 1
    decimal: str  # the decimal sign of the numbers
    said: tuple[str, ...]  # what was recognised that a plain CSV does not have, in words
    damaged: int  # number of lines left out, where ``lenient``
    above: tuple[str, ...] = ()  # lines above the heading that name no column and hold no samples, such as a title


class TextForm(NamedTuple):
    """How a table is written as text, as far as it is not recognised."""

    # "auto" takes names (and units, if a second row of them follows) from the last rows before the numbers that have as
    # many entries as these; "none" takes every row as numbers
    header: str = "auto"
    skip_rows: int = 0  # lines to leave out at the beginning
    delimiter: str | None = None  # character between cells, recognised if not given
    decimal: str | None = None  # "." or ",", recognised if not given
    lenient: bool = False  # leave damaged lines out and count them


class _Lines(NamedTuple):
    """Remarks before the first other line, and all other lines with their numbers from 1."""

    remarks: list[str]
    rows: list[str]
    numbers: list[int]


def read_text(path: Path, blanks: bool, form: TextForm) -> Cells:
    """Read a table written as text.

    Args:
        path: the file.
        blanks: True if blanks between cells are the usual thing for this format, False if commas are.
        form: what is known of it.

    Raises:
        RecordError: the file is binary, holds no rows of numbers, or a row has another number of cells than the first.
        SizeError: it takes more memory than the limit of :mod:`testbench.core.door`.
    """
    header, skip_rows, delimiter, decimal, lenient = form
    require_room(f"the table '{path}'", _IN_MEMORY * path.stat().st_size, "cut it into parts")
    text, encoding = _decode(path, lenient)
    lines = _lines(text, skip_rows)
    delimiter, decimal = _separators(path, lines.rows[:_PART], blanks, delimiter, decimal)
    cells = [_cells(path, n, line, delimiter) for n, line in zip(lines.numbers, lines.rows, strict=True)]
    numbers = list(lines.numbers)
    while cells and not any(cells[-1]):  # spreadsheets leave lines of delimiters at the end
        cells.pop()
        numbers.pop()
    torn = {i for i, line in enumerate(lines.rows[:_PART]) if _is_broken(line, delimiter, decimal)}
    first = 0 if header == "none" else _first_row(path, lines.rows, cells, torn, delimiter, decimal)
    if first >= len(cells):
        raise RecordError(_no_numbers(path, cells, lines))
    broken = sorted(i for i in torn if i < first)
    remarks: list[str] = []
    heads: list[str] = []
    if header != "none":
        remarks = [r for r in lines.remarks if not _is_data(_cells(path, 0, r, delimiter), decimal)]
        heads = remarks + [line for i, line in enumerate(lines.rows[:first]) if i not in broken]
    rows = cells[first:]
    usual = _usual(rows)
    width, names, units, top = _header([_Head(path, line, delimiter) for line in heads], usual)
    above = tuple(line.strip() for line in heads[len(remarks) : top]) if header != "none" else ()
    if broken and not lenient:
        raise RecordError(
            f"every row must have {width} cells, got {len(cells[broken[0]])} in line {numbers[broken[0]]} of '{path}', "
            "where a quote is not closed"
        )
    numbers = numbers[first:]
    lost = "" if any(names) or not heads else _lost_heading(path, heads, delimiter, decimal, usual)
    whole = len(rows)
    if lenient:
        keep = _undamaged(rows, width)
        rows, numbers = [rows[i] for i in keep], [numbers[i] for i in keep]
    for row, line in zip(rows, numbers, strict=True):
        if len(row) < width or any(row[width:]):
            short = "; is the file cut short?" if line == numbers[-1] else ""
            raise RecordError(f"every row must have {width} cells, got {len(row)} in line {line} of '{path}'{short}")
    said = [encoding] if encoding else []
    if delimiter != (None if blanks else ",") and width > 1:
        said.append(f"cells separated by {_NAMES.get(delimiter, repr(delimiter))}")
    if decimal == ",":
        said.append("decimal comma")
    said += [lost] if lost else []
    columns = tuple(zip(*(row[:width] for row in rows), strict=True))
    return Cells(names, units, columns, numbers, decimal, tuple(said), whole - len(rows) + len(broken), above)


def numbers(cells: Sequence[str], decimal: str, where: str) -> FloatArray:
    """Return text as numbers (n,), NaN where it is none.

    Args:
        cells: (n,) text.
        decimal: the decimal sign.
        where: column and file, for the message.

    Raises:
        RecordError: a number is written with separators of thousands, or with a decimal point among decimal commas.
    """
    plain = cells
    if decimal == ",":
        for cell in cells:
            if "." in cell and re.fullmatch(r"\s*[+-]?[\d.]+(?:,\d*)?(?:[eE][+-]?\d+)?\s*", cell):
                raise RecordError(_thousands(cell, where, decimal))
        plain = [cell.replace(",", ".") for cell in cells]
    try:
        return np.array(plain, dtype=np.float64)
    except ValueError:
        pass
    for cell in cells:
        if _THOUSANDS[decimal].fullmatch(cell.strip()):
            raise RecordError(_thousands(cell, where, decimal))
    return np.array([_number(cell) for cell in plain])


def _thousands(cell: str, where: str, decimal: str) -> str:
    return (
        f"numbers must be written without separators of thousands, got '{cell}' in {where} (the decimal sign is "
        f"'{decimal}'); write the file without them, or give decimal in a description if that is not the decimal sign"
    )


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _decode(path: Path, lenient: bool) -> tuple[str, str]:
    """Return the text of a file, and its encoding in words if it is none that a reader expects."""
    content = read_bytes(path, "log")
    said, text = "", None
    for mark, code in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if content.startswith(mark):
            text, said = content.decode(code, "replace"), "UTF-16"
    head = content[:400]
    if text is None and len(head) >= 8:  # UTF-16 without a mark: every other byte of plain text is zero
        for code, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
            if zeros.count(0) > 0.9 * len(zeros) and head.count(0) < 0.6 * len(head):
                text, said = content.decode(code, "replace"), "UTF-16"
    if text is None:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("latin-1")  # old files, for the degree sign in their header
    binary = None if lenient else _BINARY.search(text)
    if binary:
        raise RecordError(
            f"'{path}' must be text, got binary data at character {binary.start() + 1}; is it damaged, or a "
            "file of another format, which its suffix (or format in a description) must say?"
        )
    return text, said


def _lines(text: str, skip_rows: int) -> _Lines:
    found = _Lines([], [], [])
    for n, line in islice(enumerate(text.splitlines(), start=1), skip_rows, None):
        plain = line.strip(" \r\n")
        if not plain.strip() or (plain.startswith(("#", "%")) and found.rows):
            continue
        if plain.startswith(("#", "%")):
            found.remarks.append(plain.lstrip(" \t#%"))
        elif n == skip_rows + 1 and re.fullmatch(r"sep=.", plain):
            continue  # a word of spreadsheets to themselves
        else:
            found.rows.append(line)
            found.numbers.append(n)
    return found


def _cells(path: Path, n: int, line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    if '"' not in line:  # three times as fast
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as error:
        raise RecordError(f"line {n} of '{path}' must be CSV, got: {error}") from error


def _first_row(
    path: Path,
    lines: Sequence[str],
    cells: Sequence[Sequence[str]],
    torn: Collection[int],
    delimiter: str | None,
    decimal: str,
) -> int:
    """Return the index of the first row of numbers, their count if there is none.

    A title such as ``Flight 12, 2024`` is half a row of numbers, too. It is none if names of channels follow it, or
    rows of another width.
    """
    data = [i for i, row in enumerate(cells[:_PART]) if _is_data(row, decimal) and i not in torn]
    if not data:
        return len(cells)
    heads = {i: _Head(path, line, delimiter) for i, line in enumerate(lines[: data[-1]]) if i not in data}

    def named(i: int, row: Sequence[str]) -> bool:
        """Say whether a line names columns of the row."""
        names = heads[i].cut(len(_stripped(row)), len(row)) if i in heads else None
        return names is not None and _as_names(names) > 0

    def titles(end: int) -> bool:
        """Say whether no row above ``end`` is one of the table of which that is the first."""
        above = (_stripped(cells[i]) for i in data if i < end)
        whole = (row for row in above if all(_is_taken(cell, decimal) for cell in row if cell))
        return all(len(row) != len(_stripped(cells[end])) for row in whole)

    if any(named(i, cells[data[0]]) for i in range(data[0])):
        return data[0]
    for first, before in zip(data[1:], data, strict=False):
        if any(named(i, cells[first]) for i in range(before + 1, first)) and titles(first):
            return first
    usual = Counter(len(cells[i]) for i in data).most_common(1)[0][0]
    first = next(i for i in data if len(cells[i]) == usual)
    texts = (any(cell and not _is_taken(cell, decimal) for cell in cells[i]) for i in data if i < first)
    return first if all(texts) else data[0]


def _usual(rows: Sequence[Sequence[str]]) -> Sequence[str]:
    """Return a row with as many cells as most of the first ones have: the first, unless it is damaged."""
    width = Counter(len(row) for row in rows[:_SAMPLE]).most_common(1)[0][0]
    usual = next(row for row in rows if len(row) == width)
    return rows[0] if len(_stripped(rows[0])) == len(_stripped(usual)) else usual


def _separators(
    path: Path, lines: Sequence[str], blanks: bool, delimiter: str | None, decimal: str | None
) -> tuple[str | None, str]:
    """Return the separator and the decimal sign under which most cells of the first rows are numbers.

    Raises:
        RecordError: one of them was given, and other ones make many more cells numbers.
    """
    usual: list[str | None] = [None, ","] if blanks else [","]
    marks = [delimiter] if delimiter else [*usual, ";", "\t", "|", *([] if blanks else [None])]
    signs = [decimal] if decimal else [".", ","]
    quoted = any('"' in line for line in lines)  # "0,02","1,5": a comma may be both
    pairs = [(mark, sign) for mark in marks for sign in signs if mark != sign or quoted]
    scores = [_score(lines, mark, sign) for mark, sign in pairs]
    if not pairs:
        raise RecordError(f"delimiter and decimal must differ, got '{delimiter}' for both ('{path}')")
    best = pairs[int(np.argmax(scores))]
    if delimiter or decimal:
        free = _separators(path, lines, blanks, None, None)
        if max(scores) < _WORSE * _score(lines, *free):
            raise RecordError(
                f"the cells of '{path}' must be numbers with the delimiter and decimal given, but most are only with "
                f"{_NAMES.get(free[0], repr(free[0]))} between cells and decimal = '{free[1]}'; correct or leave out "
                "the keys delimiter and decimal"
            )
    return best


def _score(lines: Sequence[str], delimiter: str | None, decimal: str) -> float:
    """Return the share of cells that are numbers, in rows of as many cells as most; a single column counts little."""
    try:
        rows = [_cells(Path(), 0, line, delimiter) for line in lines]
    except RecordError:
        return 0.0
    first = next((i for i, row in enumerate(rows) if _is_data(row, decimal)), len(rows))
    rows = rows[first : first + _SAMPLE]
    if not rows:
        return 0.0
    width = Counter(map(len, rows)).most_common(1)[0][0]
    shares = []
    for row in rows:
        filled = [cell for cell in row if cell]
        good = sum(_is_taken(cell, decimal) for cell in filled)
        shares.append(good / len(filled) if filled and len(row) == width else 0.0)
    return round(float(np.mean(shares)), 6) * (1.0 if width > 1 else 0.1)


def _is_taken(cell: str, decimal: str) -> bool:
    """Say whether a cell is a number, a date or a time of the day."""
    if decimal == ",":
        if ("." in cell and not is_stamp(cell)) or cell.endswith(","):
            return False
        cell = cell.replace(",", ".")
    return cell.lower() == "nan" or not np.isnan(_number(cell)) or is_stamp(cell)


def _is_data(row: Sequence[str], decimal: str) -> bool:
    """Say whether at least half of the cells that are not empty are numbers or missing; others may be text."""
    filled = [cell for cell in row if cell]
    taken = sum(_is_taken(cell, decimal) for cell in filled)
    missing = sum(cell.lower() in MISSING and cell.lower() != "nan" for cell in filled)
    return taken > 0 and 2 * (taken + missing) >= len(filled)


def _is_broken(line: str, delimiter: str | None, decimal: str) -> bool:
    """Say whether a line before the numbers is a row of them whose quote is not closed: one cell takes the rest."""
    return (
        delimiter is not None
        and line.count('"') % 2 == 1
        and _is_data([cell.strip(' "') for cell in line.split(delimiter)], decimal)
    )


def _no_numbers(path: Path, cells: Sequence[Sequence[str]], lines: _Lines) -> str:
    if not lines.rows:
        return f"'{path}' must hold rows of numbers, but it holds nothing but blank lines and remarks"
    shown = next((line for line in reversed(lines.rows[:_PART]) if line.strip()), "")
    if len(lines.rows) <= 2 and any(clock_called(c)[0] or meaning(c) for row in cells for c in row):
        return f"'{path}' must hold rows of numbers, but it has a header only, '{shown.strip()[:60]}'; export it again"
    return (
        f"'{path}' must hold rows of numbers, got none in its first {min(len(lines.rows), _PART)} rows, of which the "
        f"last reads '{shown.strip()[:60]}'; check format and delimiter"
    )


def _lost_heading(path: Path, heads: Sequence[str], delimiter: str | None, decimal: str, row: Sequence[str]) -> str:
    """Say why the nearest line with names of channels or times does not name the columns; "" if there is none.

    Raises:
        RecordError: it has half as many cells as the rows between commas: their numbers have decimal commas, too.
    """
    cut = (_stripped(_cells(path, 0, line, delimiter)) for line in reversed(heads))
    named = next((cells for cells in cut if len(cells) > 1 and _as_names(cells)), None)
    if named is None:
        return ""
    twice = len(row) in (2 * len(named), 2 * len(named) - 1) and not any("." in cell for cell in row)
    if delimiter == "," and decimal == "." and twice:
        raise RecordError(
            f"'{path}' has {len(named)} names and {len(row)} cells in each row: its numbers seem to have decimal "
            "commas, which cannot be told from the commas between cells; export it with ';' between cells, or with "
            "decimal points"
        )
    return f"its heading has {len(named)} names and its rows {len(row)} cells, so that it names none"


def _undamaged(rows: Sequence[Sequence[str]], width: int) -> list[int]:
    return [
        i
        for i, row in enumerate(rows)
        if len(row) >= width and not any(row[width:]) and not any("\ufffd" in c or _BINARY.search(c) for c in row)
    ]


class _Head:
    """A line before the numbers, and the ways to cut it into names."""

    def __init__(self, path: Path, line: str, delimiter: str | None) -> None:
        self.plain = _cells(path, 0, line, delimiter)
        self.ways = [_stripped(self.plain)]
        if delimiter is None:
            joined = re.sub(r"\s+(?=[\[(])", "\u2007", line.strip())  # a unit in brackets belongs to the word before it
            wide = re.split(r"\s{2,}|\t", line.strip())
            units = re.findall(r".*?(?:\[[^\]]*\]|\([^)]*\))", line.strip())
            self.ways += [[c.replace("\u2007", " ") for c in joined.split()], wide, [c.strip() for c in units]]
            self.ways = [[cell.strip("\"'") for cell in way] for way in self.ways]

    def cut(self, least: int, most: int) -> list[str] | None:
        """Return the first way that gives at least ``least`` and at most ``most`` cells."""
        return next((list(way) for way in self.ways if least <= len(way) <= most), None)


def _header(heads: Sequence[_Head], data: Sequence[str]) -> tuple[int, tuple[str, ...], tuple[str, ...], int]:
    """Return the number of columns, their names and units, and which of the lines before the numbers says so first."""
    fitting = _fitting(heads, len(_stripped(data)), len(data))
    if not fitting and len(data) > 1 and is_stamp(f"{data[0]} {data[1]}") and not is_stamp(data[0]):
        parted = _fitting(heads, len(data) - 1, len(data) - 1)
        fitting = [(i, ["date", *row]) for i, row in parted]  # one name for both
    if not fitting:
        return len(data), ("",) * len(data), ("",) * len(data), len(heads)
    if len(fitting) > 1 and (_as_names(fitting[0][1]) > _as_units(fitting[0][1])):
        above = fitting[1][1]
        words = _as_units(above) <= _as_names(above)  # else a row of units above the names
        fitting = fitting[:1] if words else [fitting[1], fitting[0]]
    top, names = fitting[min(1, len(fitting) - 1)]
    units = fitting[0][1] if len(fitting) > 1 else []
    return *_named(names, (units + [""] * len(names))[: len(names)]), top


def _fitting(heads: Sequence[_Head], least: int, most: int) -> list[tuple[int, list[str]]]:
    """Return index and cells of the rows next above the numbers that have as many cells as these, nearest first."""
    fitting: list[tuple[int, list[str]]] = []
    for i, head in reversed(list(enumerate(heads))):
        if all(set(cell) <= set("-=_*") for cell in head.plain):
            continue  # a line drawn under the names
        row = head.cut(least, most)
        if row is not None:
            fitting.append((i, row))
        elif fitting:
            break
    return fitting


def _as_names(row: Sequence[str]) -> int:
    return sum(clock_called(cell)[0] or meaning(cell) is not None for cell in row)


def _as_units(row: Sequence[str]) -> int:
    return sum(cell == "-" or bool(plain_unit(cell) or time_unit(cell)) for cell in row)


def _stripped(row: Sequence[str]) -> list[str]:
    """Leave out empty cells at the end: a delimiter that ends each line makes no column."""
    last = max((i for i, cell in enumerate(row, start=1) if cell), default=0)
    return list(row[:last])


def _named(names: Sequence[str], units: Sequence[str]) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Take units out of names such as ``q [rad/s]``; a row of units may have brackets of its own."""
    pairs = [
        (split_unit(name)[0], unit.strip("[]() ") or split_unit(name)[1])
        for name, unit in zip(names, units, strict=True)
    ]
    return len(pairs), tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)
