"""Tables as logs: SIDPAC's 90 columns, and plain tables whose columns carry the names of channels.

SIDPAC (V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, software) keeps a flight in a matrix
``fdata`` of 90 columns with fixed meanings, feet, degrees and g; a column that was not recorded is zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.channels import CHANNELS, UNITS, channel, unit_factor
from testbench.core.constants import DEG_RAD, LBF_N
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.layout import SUFFIXES
from testbench.logs.mat import read_mat
from testbench.logs.names import LARGEST, TIME_UNITS, Meaning, meaning
from testbench.logs.plausible import angles_against_rates
from testbench.logs.question import CRITERIA
from testbench.logs.signals import UNSTATED, Log, Rule, Topic, dropped_in_words, make_topic, scaled
from testbench.logs.tables import Table, read_table
from testbench.logs.times import clock_unit, find_clock, read_times
from testbench.logs.vectors import vectors_of
from testbench.logs.writers import log_of_matrices, log_of_table


class Told(NamedTuple):
    """What the user says of a table: the axes of its vectors (see vectors.py), channel -> the unit of its column."""

    axes: str | None = None
    units: Mapping[str, str] = {}


NOTHING = Told()
COLUMNS = 90
_ATTITUDE = {"theta": (0.51 * np.pi, 90.5), "phi": (4.0 * np.pi, 180.5), "psi": (8.0 * np.pi, 360.5)}
"""Angle -> the largest that it may be in rad, turns counted on, and in deg."""
_RATES = frozenset("pqr")
_TITLES = 3  # that are quoted
_TITLE = 60  # letters of one
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
           _CG if name in ("ax", "ay", "az") else "", in_si=True)
      for name, i, unit in _PLAIN),
    Rule("da", "fdata", ("15",), scaled(-DEG_RAD), "minus column 15, deg", _RIGHT_DOWN, in_si=True),
    Rule("thrust", "fdata", tuple(map(str, range(38, 42))), _sum, "sum of columns 38 to 41, lbf"),
)  # fmt: skip


def read_columns(path: Path | str, told: Told = NOTHING) -> tuple[Log, tuple[Rule, ...]]:
    """Read a table of any format that descriptions know; return it as a log, and the rules for its columns.

    A MAT file with a matrix ``fdata`` of 90 columns is SIDPAC's. Of any other table the columns whose names are those
    of channels, or common words for them, are taken, in the units that the header states, or those that are ``told``.

    Raises:
        RecordError: the file is damaged beyond use, has no column of times, or no column with a channel's name.
    """
    path = Path(path)
    kind = SUFFIXES[path.suffix.lower()]
    if kind == "mat":
        found = _sidpac(path)
        if found is not None:
            return found, RULES
        logged = log_of_matrices(path, read_mat(path))
        if logged is not None:
            return logged
    warnings: list[str] = []
    try:
        table = read_table(path, kind)
    except RecordError as error:
        if kind not in ("csv", "text"):
            raise
        table = _salvage(path, kind, error)
        lines = "1 line is damaged and was" if table.damaged == 1 else f"{table.damaged} lines are damaged and were"
        warnings.append(f"{lines} left out ({error.message})")
    return (None if warnings else log_of_table(path, table)) or _plain(path, table, warnings, told)


def _sidpac(path: Path) -> Log | None:
    content = read_mat(path)
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
    return Log(path, f"SIDPAC, variable {name}", {"fdata": topic}, warnings=tuple(dropped_in_words([lost])))


def _salvage(path: Path, kind: str, error: RecordError) -> Table:
    """Read a text table again without its damaged lines; raise ``error`` if there are none, or nothing else."""
    try:
        table = read_table(path, kind, lenient=True)
    except RecordError:
        raise error from None
    if table.damaged and len(table) > 1 and len(table.names) > 1:
        return table
    raise error


def _plain(path: Path, table: Table, warnings: list[str], told: Told) -> tuple[Log, tuple[Rule, ...]]:
    if table.stated.get("kind") == "truth":
        raise RecordError(f"a log must be measured, but '{path}' says of itself that it is a simulated truth")
    if len(table.names) == 1:
        named = f", '{table.names[0]}'" if table.names[0] else ""
        raise RecordError(
            f"'{path}' must hold times and at least one channel, but it has one column only{named}; if it has "
            f"more, their separator was not recognised: give delimiter in a description; {_to_describe(path)}"
        )
    clock = find_clock(table)
    if clock is None:
        raise RecordError(
            f"a column of '{path}' must be called t or time, or hold dates, got "
            f"{_listed(table.names) or ', '.join(('columns without names', *table.said))}; {_to_describe(path)}"
        )
    unit, assumed = clock_unit(table, clock)
    inputs = _inputs(table)
    vectors = vectors_of(table, told.axes)
    rules = list(vectors.rules)
    columns = {name: table.numbers(name) for name in table.names if name in vectors.columns}
    for i, called in enumerate(table.names):
        found = None if i == clock or i in inputs or called in vectors.columns else meaning(called, table.units[i])
        if found is None:
            continue
        key = called if called not in columns else f"{called} (column {i + 1})"
        columns[key] = table.numbers(i + 1)
        rules.append(_rule(path, found, key, table.units[i], told.units))
    own = _own_clocks(path, table, TIME_UNITS[unit], warnings, told.units)
    if not rules:
        raise RecordError(
            f"columns of '{path}' must carry names of channels ({', '.join(list(CHANNELS)[:12])}, ...), got "
            f"{_listed(table.names)}; {_to_describe(path)}"
        )
    held = list(dict.fromkeys(rule.channel for rule in (*rules, *own.rules)))
    for name in told.units:
        if name not in held:
            raise RecordError(f"--unit is for channels that '{path}' holds ({_listed(held)}), got {name}")
    if told.axes is not None and not vectors.rules:
        raise RecordError(f"--axes is for vectors (orientation.w, angular_velocity.x), '{path}' holds none")
    t = read_times(table, clock + 1, unit)
    if not np.isfinite(t).any():
        raise RecordError(
            f"times must be numbers, dates or times of the day, got '{table.cell(clock + 1, 0)}' in column "
            f"'{table.names[clock]}' of '{path}'; write them in one of these ways, or describe the table with rate_hz"
        )
    topic, lost = make_topic("", t, columns)
    rules, settled = _settled(rules, topic)
    unread = {name: len(table) for i, name in enumerate(table.names) if name and name not in columns and i != clock}
    unread |= {name: values.size for name, values in table.others.items() if name not in own.read}
    return (
        Log(
            path,
            ", ".join([f"table ({SUFFIXES[path.suffix.lower()]})", *table.said]),
            {"": topic, **own.topics},
            warnings=(*warnings, *dropped_in_words([lost])),
            unread=unread,
            reasons=own.reasons,
            assumed=tuple(filter(None, (assumed, vectors.assumed))),
            notes=(*_notes(table), *vectors.notes, *settled),
        ),
        (*rules, *own.rules),
    )


def _notes(table: Table) -> tuple[str, ...]:
    """Say which lines above the heading are no samples."""
    if not table.above:
        return ()
    count = len(table.above)
    shown = ", ".join(f"'{line[:_TITLE]}'" for line in table.above[:_TITLES]) + (", ..." if count > _TITLES else "")
    lines = "1 line above the heading is a title" if count == 1 else f"{count} lines above the heading are titles"
    return (f"{lines} and no samples: {shown}",)


class _Own(NamedTuple):
    """Vectors of another length than the columns: topics with clocks of their own, or why they cannot be used."""

    topics: dict[str, Topic]
    rules: list[Rule]
    reasons: dict[str, str]
    read: set[str]


def _own_clocks(path: Path, table: Table, factor: float, warnings: list[str], units: Mapping[str, str]) -> _Own:
    """Return the channels among the vectors of other lengths; ``alpha`` has its times in ``t_alpha`` or alike."""
    own = _Own({}, [], {}, set())
    labels = {label.lower(): label for label in table.others}
    for label, values in table.others.items():
        stated = table.others_units.get(label, "")
        found = meaning(label, stated)
        if found is None:
            continue
        names = [f"{a}_{b}" for t in ("t", "time") for a, b in ((t, label.lower()), (label.lower(), t))]
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
        own.rules.append(replace(_rule(path, found, label, stated, units), topic=label))
        warnings += dropped_in_words([lost])
    return own


def _inputs(table: Table) -> list[int]:
    """Return the columns, from 0, that hold inputs u beside outputs y, which are no velocities along body axes."""
    plain = [name.rpartition(".")[2] for name in table.names]
    if not any(name.split("[")[0].rstrip("0123456789_") == "y" for name in plain):
        return []
    return [i for i, name in enumerate(plain) if name == "u" and not table.units[i].strip()]


def _rule(path: Path, found: Meaning, column: str, stated: str, units: Mapping[str, str]) -> Rule:
    si = channel(found.channel).unit
    if found.channel in units:
        factor = unit_factor(found.channel, units[found.channel])
        return Rule(found.channel, "", (column,), scaled(factor), f"{units[found.channel]}, as told", in_si=True)
    if found.unit:
        said = f"{'minus ' if found.sign < 0.0 else ''}{found.unit}{' times full throw' if found.of_throw else ''}"
        return Rule(found.channel, "", (column,), scaled(found.factor), said, in_si=not found.of_throw)
    if stated.strip() and stated.strip() != "-":
        raise RecordError(
            f"the unit of column '{column}' in '{path}' must be one of {', '.join(UNITS.get(si, {si: 1.0}))}, "
            f"got '{stated}'"
        )
    assumed = f"{UNSTATED}: {si}"
    return Rule(found.channel, "", (column,), scaled(found.sign), f"{si}, as in the file", assumed, in_si=True)


def _settled(rules: list[Rule], topic: Topic) -> tuple[list[Rule], list[str]]:
    """Return the rules with the units that nobody stated and that the values leave no doubt of, and what told them.

    An angle of attitude that is larger than one in rad may be is in degrees. A rate is in the unit in which it is the
    slope of its angle; the rates of one table are in one unit.
    """
    said: list[str] = []
    first = {rule.channel: rule for rule in reversed(rules)}
    open_ = {name for name, rule in first.items() if rule.assumed.startswith(UNSTATED)}
    units: dict[str, str] = {}
    for name in open_ & _ATTITUDE.keys():
        x = topic.columns[first[name].fields[0]]
        x, (rad, deg) = x[np.isfinite(x)], _ATTITUDE[name]
        if x.size and rad < np.max(np.abs(x)) <= deg:
            units[name] = "deg"
            said.append(f"{name} is taken in deg, which no unit says: it reaches from {x.min():.4g} to {x.max():.4g}")
    signals = {}
    for name in {*_RATES, "theta", "phi"} & first.keys():
        rule = first[name]
        x = rule.convert(*(topic.columns[field] for field in rule.fields)) * (DEG_RAD if name in units else 1.0)
        ok = np.isfinite(x) & (np.abs(x) <= LARGEST)
        signals[name] = topic.t_s[ok], x[ok]
    for question in angles_against_rates({k: s for k, s in signals.items() if s[0].size > 1}, CRITERIA):
        if question.channel in open_ and question.channel not in units:
            alike = open_ & (_RATES if question.channel in _RATES else _ATTITUDE.keys())
            units |= dict.fromkeys(sorted(alike - units.keys()), question.unit)
            said.append(f"{', '.join(sorted(alike))}: taken in {question.unit}, which no unit says: {question.got}")
    out = []
    for rule in rules:
        if rule.channel in units and rule.assumed.startswith(UNSTATED):
            factor = unit_factor(rule.channel, units[rule.channel])
            rule = replace(rule, convert=scaled(factor), said=units[rule.channel], assumed="")
        out.append(rule)
    return out, said


def _listed(names: Sequence[str], most: int = 12) -> str:
    named = [name for name in names if name]
    return ", ".join(named[:most]) + (f" and {len(named) - most} more" if len(named) > most else "")


def _to_describe(path: Path) -> str:
    return (
        f"`testbench import '{path}' --describe {path.stem}.toml` writes a description to fill in: which column is "
        f"which channel, in which unit; then `testbench import {path.stem}.toml`"
    )
