"""Tables as logs: SIDPAC's 90 columns, and plain tables whose columns carry the names of channels.

SIDPAC (V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, software) keeps a flight in a matrix
``fdata`` of 90 columns with fixed meanings, feet, degrees and g; a column that was not recorded is zero.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.channels import CHANNELS, UNITS, channel, unit_factor
from testbench.core.constants import DEG_RAD, LBF_N
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.layout import SUFFIXES, TIME_UNITS
from testbench.logs.mat import mat_variables
from testbench.logs.plausible import clock_unit
from testbench.logs.signals import Log, Rule, Topic, make_topic, scaled
from testbench.logs.tables import Table, read_table

COLUMNS = 90
_CG = "columns 11 to 13 are reduced to the centre of gravity, as SIDPAC has it"
_RIGHT_DOWN = "SIDPAC counts aileron positive right trailing edge down, which rolls left (from memory)"


def _sum(*thrusts: FloatArray) -> FloatArray:
    return LBF_N * np.sum(thrusts, axis=0)


_PLAIN = (
    ("V", 2, "ft/s"), ("beta", 3, "deg"), ("alpha", 4, "deg"), ("p", 5, "deg/s"), ("q", 6, "deg/s"), ("r", 7, "deg/s"),
    ("phi", 8, "deg"), ("theta", 9, "deg"), ("psi", 10, "deg"), ("ax", 11, "g"), ("ay", 12, "g"), ("az", 13, "g"),
    ("de", 14, "deg"), ("dr", 16, "deg"), ("qbar", 27, "psf"), ("h", 30, "ft"), ("pdot", 42, "deg/s2"),
    ("qdot", 43, "deg/s2"), ("rdot", 44, "deg/s2"), ("u", 74, "ft/s"), ("v", 75, "ft/s"), ("w", 76, "ft/s"),
)  # fmt: skip
RULES = (
    *(Rule(name, "fdata", (str(i),), scaled(unit_factor(name, unit)), f"column {i}, {unit}",
           _CG if name in ("ax", "ay", "az") else "")
      for name, i, unit in _PLAIN),
    Rule("da", "fdata", ("15",), scaled(-DEG_RAD), "minus column 15, deg", _RIGHT_DOWN),
    Rule("thrust", "fdata", tuple(map(str, range(38, 42))), _sum, "sum of columns 38 to 41, lbf"),
)  # fmt: skip

_NAMES = {
    "airspeed": "V", "tas": "V", "aoa": "alpha", "angle_of_attack": "alpha", "aos": "beta", "sideslip": "beta",
    "roll_rate": "p", "pitch_rate": "q", "yaw_rate": "r", "roll": "phi", "bank": "phi", "pitch": "theta", "yaw": "psi",
    "heading": "psi", "altitude": "h", "elevator": "de", "aileron": "da", "rudder": "dr", "throttle": "thr",
    "dynamic_pressure": "qbar",
    # as DLR's records and the book of R. V. Jategaonkar name them
    "tascg": "V", "alfcg": "alpha", "betcg": "beta", "the": "theta", "delv": "de", "dail": "da", "drud": "dr",
    "pdyn": "qbar", "axcg": "ax", "aycg": "ay", "azcg": "az",
}  # fmt: skip
_ANY_CASE = {name.lower(): name for name in CHANNELS if name.lower() not in ("u", "v", "h")}  # V and v are two channels
CLOCKS = ("t", "time", "t_s", "time_s", "timestamp", "times")
"""Names of a column of times, in lower case."""


def read_columns(path: Path | str) -> tuple[Log, tuple[Rule, ...]]:
    """Read a table of any format that descriptions know; return it as a log, and the rules for its columns.

    A MAT file with a matrix ``fdata`` of 90 columns is SIDPAC's. Of any other table the columns whose names are those
    of channels, or common words for them, are taken, in the units that the header states.

    Raises:
        RecordError: the file is damaged beyond use, has no column of times, or no column with a channel's name.
    """
    path = Path(path)
    kind = SUFFIXES[path.suffix.lower()]
    if kind == "mat":
        found = _sidpac(path)
        if found is not None:
            return found, RULES
    warnings: list[str] = []
    try:
        table = read_table(path, kind)
    except RecordError as error:
        if kind not in ("csv", "text"):
            raise
        table = _salvage(path, kind, error, warnings)
    return _plain(path, table, warnings)


def _sidpac(path: Path) -> Log | None:
    try:
        content = mat_variables(path.read_bytes())
    except ValueError:
        return None  # the common reader says what is wrong
    shapes = {k: v.shape for k, v in content.items() if isinstance(v, np.ndarray) and v.ndim == 2}
    wide = [k for k, shape in shapes.items() if shape[1] == COLUMNS and shape[0] > 1]
    if "fdata" not in wide and len(wide) != 1:
        return None
    name = "fdata" if "fdata" in wide else wide[0]
    matrix = content[name]
    columns = {str(i + 1): matrix[:, i] for i in range(1, COLUMNS)}
    topic, lost = make_topic("fdata", matrix[:, 0], columns)
    if topic.t_s.size < 2:
        raise RecordError(f"column 1 of '{name}' in '{path}' must be time in s, running on, got none that does")
    return Log(path, f"SIDPAC, variable {name}", {"fdata": topic}, warnings=(lost,) if lost else ())


def _salvage(path: Path, kind: str, error: RecordError, warnings: list[str]) -> Table:
    """Read a text table again without the lines that have another number of cells than most."""
    text = path.read_bytes().decode("utf-8", "replace")
    delimiter = "," if kind == "csv" else None
    lines = [line for line in text.splitlines() if line.strip()]
    widths = [len(line.rstrip(", ").split(delimiter)) for line in lines]
    usual = Counter(widths).most_common(1)
    good = [
        line for line, n in zip(lines, widths, strict=True) if usual and n == usual[0][0] and "\ufffd" not in line
        and "\x00" not in line
    ]  # fmt: skip
    if usual and usual[0][0] > 1 and 2 < len(good) < len(lines):
        with tempfile.TemporaryDirectory() as folder:
            part = Path(folder) / path.name
            part.write_text("\n".join(good) + "\n", encoding="utf-8")
            try:
                table = read_table(part, kind)
            except RecordError:
                raise error from None
        warnings.append(f"{len(lines) - len(good)} lines are damaged and were left out ({error.message})")
        return table
    raise error


def _plain(path: Path, table: Table, warnings: list[str]) -> tuple[Log, tuple[Rule, ...]]:
    if table.stated.get("kind") == "truth":
        raise RecordError(f"a log must be measured, but '{path}' says of itself that it is a simulated truth")
    labels = [name.strip().lower().replace(" ", "_") for name in table.names]
    clock = next((i for i, label in enumerate(labels) if label in CLOCKS), None)
    if clock is None:
        raise RecordError(
            f"a column of '{path}' must be called {' or '.join(CLOCKS[:2])}, got "
            f"{_listed(table.names) or 'columns without names'}; {_to_describe(path)}"
        )
    times = table.numbers(clock + 1)
    unit = table.units[clock].strip().lower() or clock_unit(times)
    guessed = "" if table.units[clock].strip() or unit == "s" else (
        f"times are in {unit}: their usual step is {np.median(np.diff(times)):g}, and '{table.names[clock]}' states no "
        "unit"
    )  # fmt: skip
    if unit not in TIME_UNITS:
        raise RecordError(f"the unit of time in '{path}' must be one of {', '.join(TIME_UNITS)}, got '{unit}'")
    rules, columns = [], {}
    for i, column in enumerate(table.names):
        name = channel_called(column)
        if i == clock or name is None:
            continue
        key = column if column not in columns else f"{column} (column {i + 1})"
        columns[key] = table.numbers(i + 1)
        rules.append(_rule(path, name, key, table.units[i]))
    own = _own_clocks(path, table, TIME_UNITS.get(unit, 1.0), warnings)
    if not rules:
        raise RecordError(
            f"columns of '{path}' must carry names of channels ({', '.join(list(CHANNELS)[:12])}, ...), got "
            f"{_listed(table.names)}; {_to_describe(path)}"
        )
    topic, lost = make_topic("", TIME_UNITS[unit] * times, columns)
    unread = {name: len(table) for i, name in enumerate(table.names) if name and name not in columns and i != clock}
    unread |= {name: values.size for name, values in table.others.items() if name not in own.read}
    said = (*warnings, lost) if lost else tuple(warnings)
    kind = f"table ({SUFFIXES[path.suffix.lower()]})"
    topics = {"": topic, **own.topics}
    assumed = (guessed,) if guessed else ()
    return Log(path, kind, topics, warnings=said, unread=unread, reasons=own.reasons, assumed=assumed), (
        *rules,
        *own.rules,
    )


class _Own(NamedTuple):
    """Vectors of another length than the columns: topics with clocks of their own, or why they cannot be used."""

    topics: dict[str, Topic]
    rules: list[Rule]
    reasons: dict[str, str]
    read: set[str]


def _own_clocks(path: Path, table: Table, factor: float, warnings: list[str]) -> _Own:
    """Return the channels among the vectors of other lengths; ``alpha`` has its times in ``t_alpha`` or alike."""
    own = _Own({}, [], {}, set())
    labels = {label.lower(): label for label in table.others}
    for label, values in table.others.items():
        name = channel_called(label)
        if name is None:
            continue
        names = [f"{a}_{b}" for t in CLOCKS for a, b in ((t, label.lower()), (label.lower(), t))]
        clock = next((labels[key] for key in names if key in labels), None)
        times = table.others[clock] if clock else None
        if clock is None or times is None or times.size != values.size:
            got = "none" if times is None else f"{times.size} samples there"
            own.reasons[label] = (
                f"it has {values.size} samples and the times {len(table)}; its own times must be called t_{label}, "
                f"got {got}"
            )
            continue
        own.topics[label], lost = make_topic(label, factor * times, {label: values})
        own.read.update((label, clock))
        own.rules.append(replace(_rule(path, name, label, ""), topic=label))
        if lost:
            warnings.append(lost)
    return own


def channel_called(column: str) -> str | None:
    """Return the channel that a column is called by, its own name or a common word for it, or None."""
    label = column.strip().lower().replace(" ", "_")
    return column if column in CHANNELS else _NAMES.get(label, _ANY_CASE.get(label))


def stated_unit(name: str, stated: str) -> str:
    """Return the unit of channel ``name`` that a file states, as the channel table writes it; "" if it is none."""
    plain = stated.strip().lower().replace("^", "").replace("sec", "s").replace("²", "2").replace("°", "deg")
    si = channel(name).unit
    return {unit.lower(): unit for unit in UNITS.get(si, {si: 1.0})}.get(plain, "")


def _rule(path: Path, name: str, column: str, stated: str) -> Rule:
    si = channel(name).unit
    if not stated.strip() or stated.strip() == "-":
        said, assumed = f"{si}, as in the file", f"the file states no unit: {si}"
        return Rule(name, "", (column,), scaled(1.0), said, assumed, in_si=True)
    unit = stated_unit(name, stated)
    if not unit:
        raise RecordError(
            f"the unit of column '{column}' in '{path}' must be one of {', '.join(UNITS.get(si, {si: 1.0}))}, "
            f"got '{stated}'"
        )
    return Rule(name, "", (column,), scaled(unit_factor(name, unit)), unit, in_si=True)


def _listed(names: Sequence[str], most: int = 12) -> str:
    named = [name for name in names if name]
    return ", ".join(named[:most]) + (f" and {len(named) - most} more" if len(named) > most else "")


def _to_describe(path: Path) -> str:
    return (
        f"`testbench import '{path}' --describe {path.stem}.toml` writes a description to fill in: which column is "
        f"which channel, in which unit; then `testbench import {path.stem}.toml`"
    )
