"""The times of a table in s: numbers in a unit, dates as ISO 8601 writes them, and times of the day.

Dates and times of the day are counted from their first sample. A time of the day that falls back by more than half a
day has passed midnight. Where a date is written in another order than ISO's (01.05.2024, 5/1/2024) only its time of the
day is used, so that day and month cannot be taken for each other.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.names import MISSING, TIME_UNITS, clock_called, time_unit

if TYPE_CHECKING:
    from testbench.logs.tables import Table

_DATE = r"(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4})"
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2}))?(?:(?:[.,]|:(?=\d{3}(?!\d)))(\d+))?\s*([AaPp][Mm])?"
_ZONE = r"(Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
_STAMP = re.compile(rf"\s*(?:{_DATE}[T\s_]+)?{_CLOCK}\s*{_ZONE}\s*")
_DAY, _HOUR = 86400.0, 3600.0
_LIKELY_HZ = 50.0  # the usual rate of a record, by which the unit of whole numbers without one is told
_MOST_HZ, _LEAST_HZ = 5000.0, 0.5
_TOO_QUICK_HZ = 2e4  # no flight is recorded so often: numbers that near each other are no seconds
_DAY_NUMBERS = ((36500.0, 55000.0), (730000.0, 750000.0))  # days since 1900 and since year 0, of 2000 to about 2050


def is_stamp(cell: str) -> bool:
    """Say whether a cell holds a date with a time, or a time of the day."""
    return _STAMP.fullmatch(cell) is not None


def holds_stamps(cells: Sequence[str] | NDArray[np.generic]) -> bool:
    """Say whether a column of text holds dates or times of the day, by its first hundred cells that are not empty."""
    if isinstance(cells, np.ndarray):
        return False
    filled = [cell for cell in cells[:100] if cell.strip().lower() not in MISSING]
    return bool(filled) and 2 * sum(map(is_stamp, filled)) > len(filled)


def read_times(table: Table, key: int | str, unit: str) -> FloatArray:
    """Return the times (n,) of column ``key``, in s, NaN where a cell holds none.

    Args:
        table: the table.
        key: name of the column, or its number from 1.
        unit: unit of numbers, one of :data:`~testbench.logs.names.TIME_UNITS`; dates and times of the day need none.

    Raises:
        RecordError: there is no such column, or it holds times of the day to the second for several rows a second.
    """
    cells = table.cells[table.index(key)]
    if isinstance(cells, np.ndarray) or not holds_stamps(cells):
        return table.numbers(key) * TIME_UNITS[unit]
    t = _stamps(cells)
    given = t[np.isfinite(t)]
    if given.size > 2 and np.median(np.diff(given)) == 0.0:
        raise RecordError(
            f"times must tell rows apart, but column {key!r} of '{table.file}' repeats '{table.cell(key, 0)}': it is "
            f"written to the second for {given.size / max(1.0, float(np.ptp(given))):.3g} rows a second; write the "
            "file with fractions of a second, or give rate_hz in place of column in a description"
        )
    return t


def _stamps(cells: Sequence[str]) -> FloatArray:
    """Return dates or times of the day as s from the first one, NaN for other text."""
    t = np.full(len(cells), np.nan)
    days: dict[tuple[str, str, str], float] = {}
    origin: float | None = None
    period = 0.0
    for i, cell in enumerate(cells):
        match = _STAMP.fullmatch(cell)
        if match is None:
            continue
        year, month, day, first, second, third, fraction, half, zone = match.groups()
        part = float(f"0.{fraction}") if fraction else 0.0
        if third is None and fraction:  # minutes and seconds, as spreadsheets show them
            t[i], period = 60.0 * int(first) + int(second) + part, _HOUR
            continue
        hour = int(first) % 12 + 12 * (half.lower() == "pm") if half else int(first)
        clock = 3600 * hour + 60 * int(second) + int(third or 0) - _offset_s(zone)
        if year is None:
            t[i], period = clock + part, _DAY
            continue
        if (year, month, day) not in days:
            days[year, month, day] = _day_s(int(year), int(month), int(day))
        if origin is None:
            origin = days[year, month, day] + clock
        t[i] = (days[year, month, day] + clock - origin) + part  # whole seconds first: fractions keep their digits
    taken = np.flatnonzero(np.isfinite(t))
    if period and taken.size:
        t[taken] += period * np.cumsum(np.diff(t[taken], prepend=t[taken[0]]) < -0.5 * period)
    return t - t[taken[0]] if taken.size else t


def _day_s(year: int, month: int, day: int) -> float:
    try:
        return _DAY * date(year, month, day).toordinal()
    except ValueError:
        return float("nan")  # there is no such day


def _offset_s(zone: str | None) -> int:
    if not zone or zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "")
    return (3600 * int(digits[:2]) + 60 * int(digits[2:])) * (-1 if zone[0] == "-" else 1)


def find_clock(table: Table) -> int | None:
    """Return the index, from 0, of the column of times: one that is called so, else one that holds dates; else None.

    Of several columns that are called times the first that holds numbers or times, and tells rows apart, counts.
    """
    called = [i for i, name in enumerate(table.names) if clock_called(name, table.units[i])[0]]
    held = [i for i in called if holds_stamps(table.cells[i]) or np.isfinite(table.numbers(i + 1)).any()]
    held += [i for i, cells in enumerate(table.cells) if i not in called and _is_time(table, i, cells)]
    return next((i for i in held if not _repeats(table.cells[i])), next(iter(held or called), None))


def _repeats(cells: Sequence[str] | NDArray[np.generic]) -> bool:
    """Say whether more cells repeat the one before than not, as times to the second do."""
    some = list(cells[:200])
    return len(some) > 1 and 2 * sum(a == b for a, b in pairwise(some)) > len(some)


def _is_time(table: Table, i: int, cells: Sequence[str] | NDArray[np.generic]) -> bool:
    return holds_stamps(cells) or " since " in table.units[i]  # a type of times in Parquet and NetCDF


def clock_unit(table: Table, i: int) -> tuple[str, str]:
    """Return the unit of the times in column ``i``, from 0, and what was assumed for it ("" if nothing was).

    The file states the unit, or the name does (``time_us``). Whole numbers without one, 2 or more apart, are taken in
    the unit that gives the rate nearest to 50 Hz, and that is said. Day numbers of this century that would be seconds
    of more than 20 kHz are days. Any other numbers are seconds.

    Raises:
        RecordError: the unit that the file states is none of time.
    """
    stated, cells = table.units[i].strip(), table.cells[i]
    if holds_stamps(cells):
        return "s", ""
    if stated and stated != "-":
        if unit := time_unit(stated):
            return unit, ""
        raise RecordError(
            f"the unit of time in '{table.file}' must be one of {', '.join(TIME_UNITS)}, got '{stated}' for column "
            f"'{table.names[i]}'; correct the header, or describe the table and give unit there"
        )
    if unit := clock_called(table.names[i])[1]:
        return unit, ""
    t = table.numbers(i + 1)
    t = t[np.isfinite(t)]
    step = float(np.median(np.diff(t))) if t.size > 2 else 0.0
    if 0.0 < step < 1.0 / _TOO_QUICK_HZ and any(low < t[0] < high for low, high in _DAY_NUMBERS):
        return "d", (
            f"the file states no unit for column '{table.names[i]}', whose numbers are {step:.3g} apart: taken as "
            f"days, as of MATLAB's datenum or a spreadsheet, which makes {1.0 / (TIME_UNITS['d'] * step):.4g} Hz"
        )
    if step < 2.0 or np.any(t != np.rint(t)):
        return "s", ""
    rates = {unit: 1.0 / (TIME_UNITS[unit] * step) for unit in ("ms", "us", "ns")}
    likely = {unit: rate for unit, rate in rates.items() if _LEAST_HZ <= rate <= _MOST_HZ}
    if not likely:
        return "s", ""
    best = min(likely, key=lambda unit: abs(np.log(likely[unit] / _LIKELY_HZ)))
    return best, (
        f"the file states no unit for column '{table.names[i]}', whose whole numbers are {step:.6g} apart: taken as "
        f"{best}, which makes {likely[best]:.4g} Hz; if it is another unit, give it in the header, as "
        f"{table.names[i]}_s, or in a description"
    )
