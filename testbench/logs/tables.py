"""Readers of tables: CSV, whitespace text, MAT, Parquet and NetCDF files to named columns.

Every reader takes a file that exists and is not empty and returns a :class:`Table`. Columns are numbered from 1, as
manuals of recorded data number them. What a file says of itself (units, kind, provenance) is kept; nothing is guessed.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.errors import RecordError, nearest
from testbench.core.record import FORMAT, NEEDS_PYARROW, FloatArray, load_record
from testbench.logs.mat import mat_variables

MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
"""Cells of a text file, in lower case, that say that a sample was not taken."""
_NAME_AND_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")
_PART = 200  # lines of a text file that are looked through for the first row of numbers


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one file.

    Args:
        file: the file that was read, for messages.
        names: (m,) names of the columns, "" where the file gives none.
        units: (m,) units as the file states them, "" where it states none.
        cells: (m,) columns of n cells each, numbers or, from text files, text.
        lines: (n,) line of the file that each row stands in; empty for files that have no lines.
        stated: what a file of the testbench says of the record in it (kind, outcome, reason, provenance).
        others: name -> (k,) numbers of vectors whose length is not that of the columns.
    """

    file: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    cells: tuple[Sequence[str] | NDArray[Any], ...]
    lines: Sequence[int] = ()
    stated: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.cells[0]) if self.cells else 0

    def index(self, key: int | str) -> int:
        """Return the index, from 0, of the column called ``key``, or numbered ``key`` from 1.

        Raises:
            RecordError: there is no such column, or there are several of that name.
        """
        if isinstance(key, int):
            if key > len(self.names):
                raise RecordError(f"column {key} must exist in '{self.file}', which has {len(self.names)} columns")
            return key - 1
        found = [i for i, name in enumerate(self.names) if name == key]
        if len(found) != 1:
            named = [name for name in self.names if name]
            hint = "" if found else (nearest(key, named) or "; its columns have no names: give numbers, counted from 1")
            raise RecordError(f"exactly one column of '{self.file}' must be called '{key}', got {len(found)}{hint}")
        return found[0]

    def numbers(self, key: int | str) -> FloatArray:
        """Return a column as numbers (n,), NaN where the file holds none; ``cell`` gives what it holds there."""
        column = self.cells[self.index(key)]
        if isinstance(column, np.ndarray):
            return column.astype(np.float64)
        try:
            return np.array(column, dtype=np.float64)
        except ValueError:
            return np.array([_number(cell) for cell in column])

    def cell(self, key: int | str, row: int) -> str:
        """Return what the file holds in ``row``, counted from 0, as text."""
        return str(self.cells[self.index(key)][row])

    def place(self, row: int) -> str:
        """Return the file and the line, or the row counted from 1, in words."""
        return f"'{self.file}', " + (f"line {self.lines[row]}" if len(self.lines) else f"row {row + 1}")


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def read_table(
    path: Path | str,
    kind: str,
    variable: str | None = None,
    header: str = "auto",
    skip_rows: int = 0,
    delimiter: str | None = None,
) -> Table:
    """Read a file of format ``kind``: "csv", "text", "mat", "parquet" or "netcdf".

    Args:
        path: the file.
        kind: its format.
        variable: MAT only: the matrix or structure to read; needed if the file holds several.
        header: CSV and text: "auto" takes names (and units, if a second row of them follows) from the last rows before
            the numbers that have as many entries as these; "none" takes every row as numbers.
        skip_rows: CSV and text: lines to leave out at the beginning.
        delimiter: CSV: the character between cells; a comma if not given.

    Raises:
        RecordError: the file is missing, empty, cut short, of another format, or holds no samples.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"a record file must exist, got nothing at '{path}'")
    if path.stat().st_size == 0:
        raise RecordError(f"a record file must hold samples, got an empty file at '{path}'")
    readers: dict[str, Callable[[], Table]] = {
        "csv": lambda: _read_rows(path, header, skip_rows, delimiter or ","),
        "text": lambda: _read_rows(path, header, skip_rows, None),
        "mat": lambda: _read_mat(path, variable),
        "parquet": lambda: _read_parquet(path),
        "netcdf": lambda: _read_netcdf(path),
    }
    table = readers[kind]()
    if len(table) == 0:
        raise RecordError(f"a record file must hold samples, got none in '{path}'")
    return table


def _read_rows(path: Path, header: str, skip_rows: int, delimiter: str | None) -> Table:
    """Read CSV, or, with ``delimiter`` None, text between blanks. Lines that begin with # or % are never numbers."""
    content = path.read_bytes()
    if re.search(rb"[\x00-\x08\x0e-\x1f]", content):
        raise RecordError(f"'{path}' must be text (UTF-8), got binary data; check file and format")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # old files, for the degree sign in their header
    remarks, rows, lines = _split(path, text, skip_rows, delimiter)
    first = 0 if header == "none" else next((i for i, row in enumerate(rows[:_PART]) if _is_data(row)), len(rows))
    if first >= len(rows):
        raise RecordError(
            f"'{path}' must hold rows of numbers with decimal points, got none in its first {min(len(rows), _PART)} "
            "rows; check format and delimiter"
        )
    width, names, units = _header(
        [] if header == "none" else [row for row in remarks if not _is_data(row)] + rows[:first], rows[first]
    )
    for row, line in zip(rows[first:], lines[first:], strict=True):
        if len(row) < width or any(row[width:]):
            raise RecordError(
                f"every row must have {width} cells, got {len(row)} in line {line} of '{path}'; is the file cut short?"
            )
    columns = tuple(zip(*(row[:width] for row in rows[first:]), strict=True))
    return Table(path, names, units, columns, lines[first:])


def _split(
    path: Path, text: str, skip_rows: int, delimiter: str | None
) -> tuple[list[list[str]], list[list[str]], list[int]]:
    """Return the cells of the remarks before the first other line, those of all other lines, and their numbers from 1.

    A heading written as a remark still names the columns.
    """
    remarks: list[list[str]] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    for n, line in islice(enumerate(text.splitlines(), start=1), skip_rows, None):
        plain = line.lstrip()
        is_remark = plain.startswith(("#", "%"))
        if not plain or (is_remark and rows):
            continue
        if is_remark:
            line = plain.lstrip(" \t#%")
        if delimiter is None:
            cells = line.split()
        else:
            try:
                cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
            except csv.Error as error:
                raise RecordError(f"line {n} of '{path}' must be CSV, got: {error}") from error
        if is_remark:
            remarks.append(cells)
        else:
            rows.append(cells)
            lines.append(n)
    while rows and not any(rows[-1]):  # spreadsheets leave lines of delimiters at the end
        rows.pop()
        lines.pop()
    return remarks, rows, lines


def _is_data(row: Sequence[str]) -> bool:
    """Say whether at least half of the cells that are not empty are numbers or missing; others may be text."""
    filled = [cell.lower() for cell in row if cell]
    numbers = sum(cell == "nan" or not np.isnan(_number(cell)) for cell in filled)
    return numbers > 0 and 2 * (numbers + sum(cell in MISSING and cell != "nan" for cell in filled)) >= len(filled)


def _header(rows: Sequence[Sequence[str]], data: Sequence[str]) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Return the number of columns, their names and their units, from the rows before the first row of numbers."""
    fitting: list[list[str]] = []
    for row in reversed(rows):
        if all(set(cell) <= set("-=_*") for cell in row):
            continue  # a line drawn under the names
        if len(_stripped(data)) <= len(_stripped(row)) <= len(data):
            fitting.append(_stripped(row))
        elif fitting:
            break
    if not fitting:
        return len(data), ("",) * len(data), ("",) * len(data)
    names = fitting[min(1, len(fitting) - 1)]
    units = fitting[0] if len(fitting) > 1 else []
    return _named(names, (units + [""] * len(names))[: len(names)])


def _stripped(row: Sequence[str]) -> list[str]:
    """Leave out empty cells at the end: a delimiter that ends each line makes no column."""
    last = max((i for i, cell in enumerate(row, start=1) if cell), default=0)
    return list(row[:last])


def _named(names: Sequence[str], units: Sequence[str]) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Take units out of names such as ``q [rad/s]``."""
    pairs = [
        (match[1], unit or match[2]) if (match := _NAME_AND_UNIT.fullmatch(name)) and match[1] else (name, unit)
        for name, unit in zip(names, units, strict=True)
    ]
    return len(pairs), tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)


def _read_mat(path: Path, variable: str | None) -> Table:
    """Read a matrix, the fields of a structure, or all vectors of a MAT file (version 5, MATLAB's ``save -v7``)."""
    whole = path.read_bytes()
    if whole.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise RecordError(f"'{path}' must be a MAT file of version 5, got version 7.3; in MATLAB: save(..., '-v7')")
    if not whole.startswith(b"MATLAB 5.0"):
        raise RecordError(f"'{path}' must be a MAT file of version 5, got a file that does not begin as one")
    try:
        content = mat_variables(whole)
    except ValueError as error:
        raise RecordError(f"'{path}' must be a complete MAT file, but it is damaged: {_one_line(error)}") from error
    stated = _stated(content["testbench"]) if isinstance(content.get("testbench"), str) else {}
    units = content["units"] if stated and isinstance(content.get("units"), dict) else {}
    units = {name: unit for name, unit in units.items() if isinstance(unit, str)}  # a damaged file holds others
    if variable is not None:
        if variable not in content:
            raise RecordError(f"'{path}' must hold the variable '{variable}', got none{nearest(variable, content)}")
        content = content[variable] if isinstance(content[variable], dict) else {variable: content[variable]}
    arrays = {k: v for k, v in content.items() if isinstance(v, np.ndarray) and v.ndim == 2}
    matrices = {k: v for k, v in arrays.items() if min(v.shape) > 1}
    if len(matrices) == 1 and (variable or all(v.size == 1 for k, v in arrays.items() if k not in matrices)):
        matrix = next(iter(matrices.values()))
        blank = ("",) * matrix.shape[1]
        return Table(path, blank, blank, tuple(matrix.T), stated=stated)
    vectors = {k: v.ravel() for k, v in arrays.items() if min(v.shape) == 1}
    longest = max((v.size for v in vectors.values()), default=0)
    if matrices or (longest < 2 and "t" not in vectors):
        names = ", ".join(sorted(content))
        raise RecordError(f"which variable of '{path}' holds the samples must be said; give variable = one of {names}")
    columns = {k: v for k, v in vectors.items() if v.size == longest}
    others = {k: v for k, v in vectors.items() if 1 < v.size < longest}
    cells, stated_units = tuple(columns.values()), tuple(units.get(k, "") for k in columns)
    return Table(path, tuple(columns), stated_units, cells, stated=stated, others=others)


def _stated(text: str) -> dict[str, Any]:
    """Return the facts that ``FlightRecord.save_mat`` and ``save_parquet`` wrote as JSON, nothing for other text."""
    try:
        facts = json.loads(text)
        return {**facts, "provenance": json.loads(facts["provenance"])} if facts["format"] == FORMAT else {}
    except (ValueError, KeyError, TypeError):
        return {}


def _read_parquet(path: Path) -> Table:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordError(f"'{path}' cannot be read: {NEEDS_PYARROW}") from error
    try:
        content = pq.ParquetFile(path).read()
        columns, units = [], []
        for i, column in enumerate(content.schema):
            values, unit = content.column(i), (column.metadata or {}).get(b"unit", b"").decode()
            if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
                values, unit = values.cast(pa.int64()), column.type.unit
            if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
                columns.append(values.cast(pa.float64(), safe=False).to_numpy())
            else:
                columns.append([str(value) for value in values.to_pylist()])
            units.append(unit)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RecordError(f"'{path}' must be a complete Parquet file, but it is not: {_one_line(error)}") from error
    stated = _stated((content.schema.metadata or {}).get(b"testbench", b"").decode())
    return Table(path, tuple(content.column_names), tuple(units), tuple(columns), stated=stated)


def _read_netcdf(path: Path) -> Table:
    """Read a record of the testbench, or the variables along the commonest dimension of any NetCDF file."""
    import h5py  # type: ignore[import-untyped]
    import xarray as xr

    with path.open("rb") as file:
        classic = file.read(3) == b"CDF"
    try:
        if not classic:
            with h5py.File(path, "r") as content:  # before xarray, whose reader is noisy about damaged files
                ours = content.attrs.get("format") == FORMAT
            if ours:
                return _table_of_record(path)
        how: dict[str, Any] = {"engine": "scipy", "mmap": False} if classic else {"engine": "h5netcdf"}
        with xr.open_dataset(path, decode_times=False, **how) as dataset:
            stored = dataset.load()
    except (OSError, ValueError, KeyError, RuntimeError, TypeError, IndexError, EOFError) as error:
        raise RecordError(f"'{path}' must be a complete NetCDF file, but it is not: {_one_line(error)}") from error
    series = {str(name): v for name, v in stored.variables.items() if v.ndim == 1 and v.dtype.kind in "fiub"}
    along = [v.dims[0] for v in series.values()]
    if not along:
        raise RecordError(f"'{path}' must hold variables along a time dimension, got none")
    time = max(dict.fromkeys(along), key=along.count)
    columns = {name: v for name, v in series.items() if v.dims[0] == time}
    units = tuple(str(v.attrs.get("units", "")) for v in columns.values())
    return Table(path, tuple(columns), units, tuple(v.values for v in columns.values()))


def _table_of_record(path: Path) -> Table:
    record = load_record(path)
    data = np.where(record.valid, record.data, np.nan)
    units = ("s", *(channel(name).unit for name in record.channels))
    stated = {"kind": record.kind, "outcome": record.outcome, "reason": record.reason}
    facts = {**stated, "provenance": dict(record.provenance)}
    return Table(path, ("t", *record.channels), units, (record.t_s, *data.T), stated=facts)


def _one_line(error: BaseException) -> str:
    return (str(error).strip("'\"").splitlines() or [type(error).__name__])[0]
