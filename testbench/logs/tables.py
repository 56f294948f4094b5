"""Readers of tables: CSV, whitespace text, MAT, Parquet and NetCDF files to named columns.

Every reader takes a file that exists and is not empty and returns a :class:`Table`. Columns are numbered from 1, as
manuals of recorded data number them. What a file says of itself (units, kind, provenance) is kept; nothing is guessed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.door import NUMBER, memory_of, open_file, opened, require_room
from testbench.core.errors import RecordError, given, missing, nearest
from testbench.core.files import parsed
from testbench.core.record import FORMAT, NEEDS_PYARROW, FloatArray, load_record
from testbench.logs.foreign import HEAD, refuse_foreign
from testbench.logs.mat import StructArray, read_mat
from testbench.logs.names import TIME_UNITS, clock_called, time_unit
from testbench.logs.structures import follow, series
from testbench.logs.text import Cells, TextForm, numbers, read_text

_ZONE = re.compile(r"\s*(Z|UTC|GMT|[+-]00:?00)$")  # of dates that times count from
_TEXT = 100  # bytes of a cell that is text, in a list


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
        decimal: the decimal sign of text.
        said: how the file was read where that is not the usual way (separator, encoding), in words.
        damaged: number of damaged lines that were left out.
        above: lines of text above the heading that name no column.
        root: path of the structure whose fields the columns are; a column may be called by its whole path.
        others: name -> (k,) numbers of vectors whose length is not that of the columns; times of ``q`` among them are
            called ``t_q``.
        others_units: name -> unit of these, as the file states it.
    """

    file: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    cells: tuple[Sequence[str] | NDArray[Any], ...]
    lines: Sequence[int] = ()
    stated: Mapping[str, Any] = field(default_factory=dict)
    decimal: str = "."
    said: tuple[str, ...] = ()
    damaged: int = 0
    above: tuple[str, ...] = ()
    root: str = ""
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    others_units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given((*self.names, *self.units, *self.others_units.values()))

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
        found = [i for i, name in enumerate(self.names) if key in (name, f"{self.root}.{name}")]
        if len(found) != 1:
            named = [name for name in self.names if name]
            hint = "" if found else (nearest(key, named) or "; its columns have no names: give numbers, counted from 1")
            raise RecordError(f"exactly one column of '{self.file}' must be called '{key}', got {len(found)}{hint}")
        return found[0]

    def numbers(self, key: int | str) -> FloatArray:
        """Return a column as numbers (n,), NaN where the file holds none; ``cell`` gives what it holds there.

        Raises:
            RecordError: there is no such column, or its numbers have separators of thousands.
        """
        column = self.cells[self.index(key)]
        if isinstance(column, np.ndarray):
            return column.astype(np.float64)
        return numbers(column, self.decimal, f"column {key!r} of '{self.file}'")

    def cell(self, key: int | str, row: int) -> str:
        """Return what the file holds in ``row``, counted from 0, as text."""
        return str(self.cells[self.index(key)][row])

    def place(self, row: int) -> str:
        """Return the file and the line, or the row counted from 1, in words."""
        return f"'{self.file}', " + (f"line {self.lines[row]}" if len(self.lines) else f"row {row + 1}")


_ANY_FORM = TextForm()


def read_table(path: Path | str, kind: str, variable: str | None = None, form: TextForm = _ANY_FORM) -> Table:
    """Read a file of format ``kind``: "csv", "text", "mat", "parquet" or "netcdf".

    Args:
        path: the file.
        kind: its format.
        variable: MAT only: the matrix or structure to read, or the path of one inside a structure
            (``data.flight``, ``data(2)``); needed if the file holds several.
        form: CSV and text: what is known of how they are written.

    Raises:
        RecordError: the file is missing, empty, cut short, of another format, or holds no samples.
        SizeError: it takes more memory than the limit of :mod:`testbench.core.door`.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"a record file must exist, got nothing at '{path}'")
    if path.stat().st_size == 0:
        raise RecordError(f"a record file must hold samples, got an empty file at '{path}'")
    readers: dict[str, Callable[[], Table]] = {
        "csv": lambda: _of_text(path, read_text(path, False, form)),
        "text": lambda: _of_text(path, read_text(path, True, form)),
        "mat": lambda: _read_mat(path, variable),
        "parquet": lambda: _read_parquet(path),
        "netcdf": lambda: _read_netcdf(path),
    }
    with open_file(path, "log") as file:
        refuse_foreign(path, file.read(HEAD), kind)
    table = readers[kind]()
    if len(table) == 0:
        raise RecordError(f"a record file must hold samples, got none in '{path}'")
    return table


def _of_text(path: Path, found: Cells) -> Table:
    return Table(
        path,
        found.names,
        found.units,
        found.columns,
        found.lines,
        decimal=found.decimal,
        said=found.said,
        damaged=found.damaged,
        above=found.above,
    )


def _read_mat(path: Path, variable: str | None) -> Table:
    """Read a matrix, the fields of a structure, or all vectors of a MAT file."""
    content = read_mat(path)
    stated = _stated(content["testbench"]) if isinstance(content.get("testbench"), str) else {}
    value = content if variable is None else follow(content, variable, path)
    arrays = {k: v for k, v in content.items() if isinstance(v, np.ndarray) and v.ndim == 2 and v.size}
    matrices = {k: v for k, v in arrays.items() if min(v.shape) > 1}
    if variable is None and len(matrices) == 1 and not any(
        isinstance(v, Mapping | StructArray) or (k in arrays and k not in matrices and arrays[k].size > 1)
        for k, v in content.items()
    ):  # fmt: skip
        value = next(iter(matrices.values()))
    if isinstance(value, np.ndarray) and value.ndim == 2 and min(value.shape, default=0) > 1:
        blank = ("",) * value.shape[1]
        return Table(path, blank, blank, tuple(value.T), stated=stated)
    if isinstance(value, np.ndarray):
        value, variable = {str(variable).rpartition(".")[2]: value}, None
    found = series(value, variable or "", path)
    names = tuple(found.columns)
    units = tuple(found.units[name] for name in names)
    columns = tuple(found.columns.values())
    apart = {name: found.units[name] for name in found.others if name in found.units}
    return Table(path, names, units, columns, stated=stated, root=found.root, others=found.others, others_units=apart)


def _stated(text: str) -> dict[str, Any]:
    """Return the facts that ``FlightRecord.save_mat`` and ``save_parquet`` wrote as JSON, nothing for other text."""
    try:
        facts = json.loads(text)
        return {**facts, "provenance": json.loads(facts["provenance"])} if facts["format"] == FORMAT else {}
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}


def _read_parquet(path: Path) -> Table:
    try:
        import pyarrow as pa
        import pyarrow.compute as pc
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordError(f"'{path}' cannot be read: {missing(*NEEDS_PYARROW)}") from error
    with parsed(path, "a complete Parquet file"):
        file = pq.ParquetFile(path)
        width = sum(NUMBER if pa.types.is_primitive(kind) else _TEXT for kind in file.schema_arrow.types)
        require_room(f"the table of '{path}'", file.metadata.num_rows * width, "cut it into parts")
        content = file.read()
        columns, units = [], []
        for i, column in enumerate(content.schema):
            values, unit = content.column(i), (column.metadata or {}).get(b"unit", b"").decode()
            if pa.types.is_duration(column.type):
                values, unit = values.cast(pa.int64()), column.type.unit
            if pa.types.is_timestamp(column.type):  # from the first on: as numbers of 1970 they would lose digits
                first = next((value for value in values.to_pylist() if value is not None), None)
                zero = pa.scalar(first, column.type)
                values, unit = values.cast(pa.int64()), f"{column.type.unit} since {first}"
                values = pc.subtract(values, zero.cast(pa.int64()))
            if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
                columns.append(values.cast(pa.float64(), safe=False).to_numpy())
            else:
                columns.append([str(value) for value in values.to_pylist()])
            units.append(unit)
        stated = _stated((content.schema.metadata or {}).get(b"testbench", b"").decode())
    return Table(path, tuple(content.column_names), tuple(units), tuple(columns), stated=stated)


def _read_netcdf(path: Path) -> Table:
    """Read a record of the testbench, or the variables along the commonest dimension of any NetCDF file."""
    import xarray as xr

    with open_file(path, "log") as file:
        classic = file.read(3) == b"CDF"
    with parsed(path, "a complete NetCDF file"):
        size = path.stat().st_size
        if not classic:
            with opened(path) as content:  # before xarray, whose reader is noisy about damaged files
                ours = str(content.attrs.get("format")) == FORMAT
                held = [item for item in content.values() if getattr(item, "ndim", 0) == 1]
                size = memory_of(held) if not ours else 0  # before xarray, which reads the dimensions at once
            if ours:
                return _table_of_record(path)
        require_room(f"the variables of '{path}'", size, "cut it into parts")
        how: dict[str, Any] = (
            {"engine": "scipy", "mmap": False} if classic else {"engine": "h5netcdf", "phony_dims": "sort"}
        )
        with xr.open_dataset(path, decode_times=False, **how) as dataset:
            rows = {str(name): v for name, v in dataset.variables.items() if v.ndim == 1 and v.dtype.kind in "fiub"}
            series = {name: v.load() for name, v in rows.items()}
    along = [v.dims[0] for v in series.values()]
    if not along:
        raise RecordError(f"'{path}' must hold variables along a time dimension, got none")
    time = max(dict.fromkeys(along), key=along.count)
    columns = {name: v for name, v in series.items() if v.dims[0] == time}
    units = tuple(str(v.attrs.get("units", "")) for v in columns.values())
    others, stated = _along_others(series, str(time))
    table = Table(path, tuple(columns), units, tuple(v.values for v in columns.values()))
    return replace(table, others=others, others_units=stated)


def _along_others(series: Mapping[str, Any], time: str) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Return the variables of NetCDF along other dimensions than ``time``, each with its times ``t_NAME``, and units.

    Times are those of the coordinate of their dimension, in the unit of the times of ``time`` and from its date on.
    """
    others: dict[str, FloatArray] = {}
    stated: dict[str, str] = {}
    main = _clock_of(series, time)
    for name, v in series.items():
        along = str(v.dims[0])
        if along == time or v.size < 2:
            continue
        if clock_called(name)[0] or name == along or time_unit(str(v.attrs.get("units", ""))):
            continue
        others[name], stated[name] = v.values.astype(np.float64), str(v.attrs.get("units", ""))
        own = _clock_of(series, along)
        if main is not None and own is not None:
            apart = (
                0.0 if None in (main.start, own.start) else (own.start - main.start) / np.timedelta64(1, "ns") * 1e-9
            )
            others[f"t_{name}"] = (own.values * own.unit_s + float(apart)) / main.unit_s
    return others, stated


class _Coordinate(NamedTuple):
    """Times of a dimension: numbers, their unit in s, and the date that they count from, None if there is none."""

    values: FloatArray
    unit_s: float
    start: Any


def _clock_of(series: Mapping[str, Any], along: str) -> _Coordinate | None:
    """Return the times of a dimension: its own coordinate, else the first variable along it that is called so."""
    called = [n for n, v in series.items() if v.dims[0] == along and (n == along or clock_called(n)[0])]
    for name in sorted(called, key=lambda n: n != along):
        stated = str(series[name].attrs.get("units", ""))
        unit = time_unit(stated) or clock_called(name)[1] or ("" if stated else "s")
        if not unit:
            continue
        _, _, date = stated.partition(" since ")
        try:
            start = np.datetime64(_ZONE.sub("", date.strip()).replace(" ", "T"), "ns") if date else None
        except ValueError:
            continue
        return _Coordinate(series[name].values.astype(np.float64), TIME_UNITS[unit], start)
    return None


def _table_of_record(path: Path) -> Table:
    record = load_record(path)
    data = np.where(record.valid, record.data, np.nan)
    units = ("s", *(channel(name).unit for name in record.channels))
    stated = {"kind": record.kind, "outcome": record.outcome, "reason": record.reason}
    facts = {**stated, "provenance": dict(record.provenance)}
    return Table(path, ("t", *record.channels), units, (record.t_s, *data.T), stated=facts)
