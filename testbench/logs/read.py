"""Read recorded flights: files of several formats become records of kind "measured", as a description says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import unit_factor
from testbench.core.door import sha256
from testbench.core.errors import RecordError, excerpt, located
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.layout import ChannelColumn, Recorded, RecordFile, TimeColumn, find_data_folder
from testbench.logs.names import LARGEST, MISSING, clock_called, stated_unit, time_unit
from testbench.logs.tables import Table, read_table
from testbench.logs.text import TextForm
from testbench.logs.times import holds_stamps, read_times

_SLACK_S = 1e-6  # times printed with few digits still meet the end of a segment
_GAP = 1.5  # a step this many times the usual one means that samples were lost


def read_records(description: Recorded, data_folder: Path | str | None = None) -> list[tuple[str, str, FlightRecord]]:
    """Read the records that ``description`` describes.

    Args:
        description: which file and column hold which channel in which unit.
        data_folder: the folder of the files; by default TESTBENCH_FLIGHT_DATA, else the description's own.

    Returns:
        Name, use and record of every segment, in the order of the description, in SI units and radians, of kind
        "measured". Provenance holds the file, its SHA-256, the segment in s, the source and the rights.

    Raises:
        RecordError: a file or the folder is missing or damaged, a column does not exist, its unit is not the one that
            the file states, a sample used is not a number, or the time jumps. The message names file, column and line.

    Example:
        >>> import testbench as tb
        >>> for name, use, record in tb.read_records(tb.load_description("attas_full"), data):  # doctest: +SKIP
        ...     print(name, use, record.channels)
    """
    folder = find_data_folder(description, data_folder)
    absent = [record.file for record in description.record if not (folder / record.file).is_file()]
    if absent:
        raise RecordError(
            f"the data folder '{folder}' must hold {', '.join(dict.fromkeys(absent))}, but it does not; "
            f"they are described as: {excerpt(description.rights)}"
        )
    out = []
    for i, spec in enumerate(description.record):
        with located(description.file, f"record[{i}]"):
            out += _read_file(description, spec, folder / spec.file)
    return out


def _read_file(description: Recorded, spec: RecordFile, path: Path) -> list[tuple[str, str, FlightRecord]]:
    form = TextForm(spec.header, spec.skip_rows, spec.delimiter, spec.decimal)
    table = read_table(path, spec.kind_of_file, spec.variable, form)
    if table.stated.get("kind") == "truth":
        raise RecordError(
            f"a recorded flight must be measured, but '{path}' says of itself that it is a simulated truth"
        )
    t = _times(table, description.time)
    provenance: dict[str, Any] = {
        "description": description.name,
        "file": spec.file,
        "sha256": sha256(path, "log"),
        "source": description.source,
        "rights": description.rights,
    }
    if table.stated.get("provenance"):
        provenance["recorded"] = table.stated["provenance"]
    out: list[tuple[str, str, FlightRecord]] = []
    for name, segment in zip(spec.parts, spec.segments or (None,), strict=True):
        rows = _rows(table, t, segment)
        columns = [_channel(table, column, rows, t) for column in description.channel]
        record = FlightRecord(
            t_s=t[rows],
            channels=description.channels,
            data=np.column_stack([values for values, _ in columns]),
            kind="measured",
            valid=np.column_stack([valid for _, valid in columns]),
            provenance={**provenance, "segment_s": [float(t[rows.start]), float(t[rows.stop - 1])]},
            outcome=table.stated.get("outcome", "completed"),
            reason=table.stated.get("reason", ""),
        )
        out.append((name, spec.use, record))
    return out


def _times(table: Table, clock: TimeColumn) -> FloatArray:
    """Return the time of every row, s."""
    if clock.column is None:
        assert clock.rate_hz is not None  # the schema asks for one of the two
        return np.arange(len(table)) / clock.rate_hz - clock.zero_s
    i = table.index(clock.column)
    if not holds_stamps(table.cells[i]):
        stated = time_unit(table.units[i]) or clock_called(table.names[i])[1]
        _check_unit(table, clock.column, clock.unit, stated, "time")
    t = read_times(table, clock.column, clock.unit) - clock.zero_s
    if not np.isfinite(t).all():
        row = int(np.argmin(np.isfinite(t)))
        raise RecordError(
            f"times must be finite numbers, got '{table.cell(clock.column, row)}' in column {clock.column!r} of "
            f"{table.place(row)}; correct the file, leave the rows out (skip_rows), or give rate_hz in place of column"
        )
    return t


def _rows(table: Table, t: FloatArray, segment: tuple[float, float] | None) -> slice:
    """Return the rows of a segment, after checking that time runs on in it without a jump."""
    inside = np.arange(t.size)
    if segment is not None:
        inside = np.flatnonzero((t >= segment[0] - _SLACK_S) & (t <= segment[1] + _SLACK_S))
        if inside.size < 2:
            raise RecordError(
                f"a segment must hold at least 2 samples, got {inside.size} in [{segment[0]:g}, {segment[1]:g}] s; "
                f"'{table.file}' runs from {t.min():g} to {t.max():g} s"
            )
    rows = slice(int(inside[0]), int(inside[-1]) + 1)
    steps = np.diff(t[rows])
    usual = float(np.median(steps)) if steps.size else 1.0
    wrong = np.flatnonzero((steps <= 0.0) | (steps > _GAP * abs(usual)))
    if wrong.size:
        row = rows.start + int(wrong[0])
        kind = "jumps back" if steps[wrong[0]] < 0.0 else "stands still" if steps[wrong[0]] == 0.0 else "has a gap"
        raise RecordError(
            f"time must run on evenly, but it {kind} from t = {t[row]:.6g} to {t[row + 1]:.6g} s in "
            f"{table.place(row + 1)} (usual step {usual:.4g} s); {_advice(t, rows, kind)}"
        )
    return rows


def _advice(t: FloatArray, rows: slice, kind: str) -> str:
    """Say how to cut the rows where time jumps, if that can be done by time."""
    if kind == "has a gap":
        part = t[rows]
        steps = np.diff(part)
        cuts = np.flatnonzero(steps > _GAP * np.median(steps))
        if np.all(steps > 0.0) and cuts.size < 6:
            starts, ends = np.r_[0, cuts + 1], np.r_[cuts, part.size - 1]
            pieces = [f"[{part[a]:.6g}, {part[b]:.6g}]" for a, b in zip(starts, ends, strict=True) if b > a]
            return f"cut it: segments = [{', '.join(pieces)}]"
        return "cut it into segments that exclude the gaps"
    if kind == "stands still":
        return "if the times are rounded, give rate_hz in place of column"
    return "cut it into segments that do not overlap in time, or split the file where the clock was set back"


def _channel(table: Table, spec: ChannelColumn, rows: slice, t: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the SI samples of one channel in ``rows`` and whether each was really taken."""
    keys = [spec.column] if spec.minus_column is None else [spec.column, spec.minus_column]
    parts = []
    for key in keys:
        stated = stated_unit(spec.name, table.units[table.index(key)])
        _check_unit(table, key, spec.unit, stated, f"channel '{spec.name}'")
        parts.append(_samples(table, spec, key, rows, t))
    raw = parts[0] if len(parts) == 1 else parts[0] - parts[1]
    valid = np.isfinite(raw)
    values = unit_factor(spec.name, spec.unit) * (spec.scale * raw + spec.offset)
    if valid.all():
        return values, valid
    if not valid.any():
        raise RecordError(f"channel '{spec.name}' must hold samples, but every one in '{table.file}' is missing here")
    last = np.maximum.accumulate(np.where(valid, np.arange(valid.size), -1))
    return values[np.where(last < 0, int(np.argmax(valid)), last)], valid


def _samples(table: Table, spec: ChannelColumn, key: int | str, rows: slice, t: FloatArray) -> FloatArray:
    """Return a column in the file's unit, NaN where a sample is missing and may be."""
    raw = table.numbers(key)[rows]
    bad = np.flatnonzero(~(np.abs(raw) <= LARGEST))
    for row in (int(i) + rows.start for i in bad):
        cell = table.cell(key, row)
        garbage = isinstance(table.cells[table.index(key)], tuple | list) and cell.lower() not in (
            *MISSING,
            "inf",
            "-inf",
        )
        if spec.missing == "error" or garbage:
            fix = "" if garbage else " or, if samples may be missing, give the channel missing = 'mask'"
            law = f"at most {LARGEST:g} in size" if np.isfinite(raw[row - rows.start]) else "finite numbers"
            raise RecordError(
                f"samples must be {law}, got '{cell}' in column {key!r} (channel '{spec.name}') of "
                f"{table.place(row)}, t = {t[row]:.6g} s; leave that time out of segments{fix}"
            )
    raw[bad] = np.nan
    return raw


def _check_unit(table: Table, key: int | str, unit: str, stated: str, what: str) -> None:
    """Check that the file, where it states the unit of a column, states the one that the description gives."""
    if stated and stated != unit:
        i = table.index(key)
        raise RecordError(
            f"the unit of {what} must be the one that '{table.file}' states for column {key!r}, "
            f"'{table.units[i] or table.names[i]}', got '{unit}'; correct unit, or, if the file is wrong, keep its "
            "unit and correct the values with scale"
        )
