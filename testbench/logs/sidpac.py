"""Tables as logs: SIDPAC's 90 columns, and plain tables whose columns carry the names of channels.

SIDPAC (V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, software) keeps a flight in a matrix
``fdata`` of 90 columns with fixed meanings, feet, degrees and g; a column that was not recorded is zero.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.channels import CHANNELS, SURFACES, UNITS, channel, unit_factor
from testbench.core.constants import DEG_RAD, LBF_N
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.blackbox import read_blackbox
from testbench.logs.catalogue import writer_of
from testbench.logs.layout import SUFFIXES
from testbench.logs.mat import read_mat
from testbench.logs.names import INDICATED, TIME_UNITS, Meaning, meaning
from testbench.logs.ros import read_bag
from testbench.logs.signals import MIN_SAMPLES, UNSTATED, Log, Rule, Topic, dropped_in_words, make_topic, scaled
from testbench.logs.tables import Table, read_table
from testbench.logs.text import TextForm
from testbench.logs.times import clock_unit, find_clock, holds_stamps, read_times
from testbench.logs.topics import is_px4_file, log_of_matrices, log_of_table, log_of_tables
from testbench.logs.vectors import vectors_of


class Told(NamedTuple):
    """What the user says of a table.

    Attributes:
        axes: "frd" or "flu", those of its vectors (see vectors.py).
        units: channel -> unit of its column, for a table that states none, or a wrong one.
        part: which record of a description, or flight of a blackbox, if it has several.

    Example:
        >>> import testbench as tb
        >>> tb.Told(axes="flu", units={"alpha": "deg"}).axes
        'flu'
    """

    axes: str | None = None
    units: Mapping[str, str] = {}
    part: str | None = None


NOTHING = Told()
COLUMNS = 90
_MOTOR = re.compile(r"(?i)motors?[\[_ ]?\d\]?")
_ROTORS = 3  # motors that are logged of what has no surfaces: it is carried by them
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


def read_folder(folder: Path, told: Told = NOTHING) -> tuple[Log, tuple[Rule, ...]]:
    """Read a folder of tables (CSV) as one log, each table a topic with a clock of its own; return it and its rules.

    Files of PX4's and ArduPilot's topics are told by their names and columns. Of others every table is read as one is
    alone; a column ``measured``, ``data`` or ``value`` is what the file's own name ends in (``nav_info-pitch.csv``).

    Raises:
        RecordError: no table holds a channel, or their clocks share no time.
    """
    files = sorted(folder.glob("*.csv"))
    read = list(filter(is_px4_file, files)) or files  # of the tables that ulog2csv makes most say nothing of motion
    unread = dict.fromkeys((path.name for path in files if path not in read), 1)
    return _of_tables(folder, {path.stem: read_table(path, "csv") for path in read}, unread, told)


def read_recording(path: Path, told: Told = NOTHING) -> tuple[Log, tuple[Rule, ...]]:
    """Read a recording of ROS as one log, each topic with a clock of its own; return it and its rules.

    Raises:
        RecordError: it is damaged, no topic holds a channel, or their clocks share no time.
        MissingPackage: rosbags is not installed.
    """
    bag = read_bag(path)
    log, rules = _of_tables(path, bag.tables, bag.unread, told)
    cut = () if bag.whole else ("the recording has no end, as one that is being written: what is whole was read",)
    kind = f"a recording of ROS ({len(bag.tables)} topics read)"
    return replace(log, kind=kind, warnings=(*log.warnings, *cut)), rules


def read_recorder(path: Path, told: Told = NOTHING) -> tuple[Log, tuple[Rule, ...]]:
    """Read a flight of a blackbox of Betaflight or iNav as the table that blackbox_decode makes of it; and its rules.

    Raises:
        RecordError: it is damaged beyond use, or has no flight of the number ``told.part``.
        MissingPackage: orangebox is not installed.
    """
    flight = read_blackbox(path, told.part)
    log, rules = _plain(path, flight.table, list(flight.warnings), told)
    facts = {**log.facts, **flight.facts}
    kind = f"a recording of {flight.facts.get('firmware', 'Betaflight or iNav')} (blackbox)"
    unread = {**log.unread, **flight.unread}
    notes = (*flight.notes, *log.notes)
    return replace(log, kind=kind, facts=facts, parameters=flight.parameters, unread=unread, notes=notes), rules


def _of_tables(
    place: Path, tables: Mapping[str, Table], unread: Mapping[str, int], told: Told
) -> tuple[Log, tuple[Rule, ...]]:
    found = log_of_tables(place, tables)
    if found is not None:
        return replace(found[0], unread={**found[0].unread, **unread}), found[1]
    logs: dict[str, tuple[Log, tuple[Rule, ...]]] = {}
    refused: dict[str, RecordError] = {}
    for name, table in tables.items():
        if len(table) < MIN_SAMPLES:  # said once, as a home position is
            refused[table.file.name] = RecordError(f"it holds {len(table)} of at least {MIN_SAMPLES} samples")
            continue
        try:
            logs[name] = _plain(table.file, _after_its_file(table), [], told)
        except RecordError as error:
            refused[table.file.name] = error
    if not logs:
        raise RecordError(
            f"'{place}' must hold the topics of one log (as CSV NAME_vehicle_attitude_0.csv, IMU.csv, "
            f"NAME-imu-data.csv), got {len(tables)} others: {_listed(list(tables))}"
            + "".join(f"; {error.message}" for error in list(refused.values())[:1])
        )
    spans = {name: log.topics[""].t_s[[0, -1]] for name, (log, _) in logs.items()}
    start, end = max(a for a, _ in spans.values()), min(b for _, b in spans.values())
    if start >= end:
        late = max(spans, key=lambda name: spans[name][0])
        raise RecordError(
            f"the tables in '{place}' must share a time, but '{tables[late].file.name}' begins after others have ended"
        )
    main = max(logs, key=lambda name: logs[name][0].topics[""].t_s.size)
    first = logs[main][0]
    whole = Log(
        place,
        f"a folder of {len(logs)} tables",
        {name: replace(log.topics[""], name=name) for name, (log, _) in logs.items()},
        warnings=tuple(text for log, _ in logs.values() for text in log.warnings),
        unread={
            **{f"{name}.{key}": n for name, (log, _) in logs.items() for key, n in log.unread.items()},
            **dict.fromkeys(refused, 1),
            **unread,
        },
        reasons={name: error.message for name, error in refused.items()},
        assumed=tuple(dict.fromkeys(text for log, _ in logs.values() for text in log.assumed)),
        notes=tuple(dict.fromkeys(text for log, _ in logs.values() for text in log.notes)),
        vehicle=first.vehicle,
    )
    by_rate = sorted(logs, key=lambda name: -logs[name][0].topics[""].t_s.size)  # of two sources the denser one
    return whole, tuple(replace(rule, topic=name) for name in by_rate for rule in logs[name][1] if not rule.topic)


_OF_ITS_FILE = ("measured", "data", "value")


def _after_its_file(table: Table) -> Table:
    """Return a table whose column ``measured`` is called as the file's own name ends, if that is a channel's name."""
    own = re.split(r"[-_.]", table.file.stem)[-1]
    if meaning(own) is None:
        return table
    names = tuple(own if name.rpartition(".")[2] in _OF_ITS_FILE else name for name in table.names)
    return replace(table, names=names) if names.count(own) == 1 else table


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
        table = read_table(path, kind, form=TextForm(lenient=True))
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
    writer = writer_of(table)
    clock = writer.clock(table) if writer is not None else None
    clock = find_clock(table) if clock is None else clock
    if clock is None:
        raise RecordError(
            f"a column of '{path}' must be called t or time, or hold dates, got "
            f"{_listed(table.names) or ', '.join(('columns without names', *table.said))}; {_to_describe(path)}"
        )
    unit, assumed = clock_unit(table, clock)
    if writer is not None and writer.time is not None and not holds_stamps(table.cells[clock]):
        unit, assumed = writer.time.unit, ""
    inputs = _inputs(table)
    vectors = vectors_of(table, told.axes)
    rules = list(vectors.rules)
    columns = {name: table.numbers(name) for name in table.names if name in vectors.columns}
    meant = writer.meanings(table) if writer is not None else {}
    reasons: dict[str, str] = {}
    of_writer = {found.channel for found in meant.values() if found is not None}
    late: list[Rule] = []  # a true airspeed, and what the writer calls a channel, come first
    for i, called in enumerate(table.names):
        if i == clock or i in inputs or called in vectors.columns:
            continue
        found = meant[i] if i in meant else meaning(called, table.units[i])
        if found is None:
            continue
        if why := _foreign_unit(found, table.units[i]):
            reasons[called] = why
            continue
        key = called if called not in columns else f"{called} (column {i + 1})"
        columns[key] = table.numbers(i + 1)
        after = INDICATED in found.assumed or (i not in meant and found.channel in of_writer)
        (late if after else rules).append(_rule(found, key, told.units))
    rules += late
    own = _own_clocks(path, table, TIME_UNITS[unit], warnings, told.units)
    if not rules and reasons:
        name, why = next(iter(reasons.items()))
        raise RecordError(f"the unit of column '{name}' in '{path}' {why.removeprefix('its unit ')}")
    if not rules:
        raise RecordError(
            f"columns of '{path}' must carry names of channels ({', '.join(list(CHANNELS)[:12])}, ...), got "
            f"{_listed(table.names)}; {_to_describe(path)}"
        )
    held = list(dict.fromkeys(rule.channel for rule in (*rules, *own.rules)))
    for name in told.units:
        if name not in held:
            raise RecordError(f"--unit is for channels that '{path}' holds ({_listed(held)}), got {name}")
    t = read_times(table, clock + 1, unit)
    if not np.isfinite(t).any():
        raise RecordError(
            f"times must be numbers, dates or times of the day, got '{table.cell(clock + 1, 0)}' in column "
            f"'{table.names[clock]}' of '{path}'; write them in one of these ways, or describe the table with rate_hz"
        )
    topic, lost = make_topic("", t, columns)
    unread = {name: len(table) for i, name in enumerate(table.names) if name and name not in columns and i != clock}
    unread |= {name: values.size for name, values in table.others.items() if name not in own.read}
    written = [f"as {writer.title} writes it"] if writer is not None else []
    motors = len({name for name in table.names if _MOTOR.fullmatch(name.strip())})
    vehicle = "rotorcraft" if motors >= _ROTORS and not any(r.channel in SURFACES for r in rules) else ""
    return (
        Log(
            path,
            ", ".join([f"table ({SUFFIXES.get(path.suffix.lower(), 'topic')})", *written, *table.said]),
            {"": topic, **own.topics},
            warnings=(*warnings, *dropped_in_words([lost])),
            unread=unread,
            reasons={**own.reasons, **reasons},
            assumed=tuple(filter(None, (assumed, vectors.assumed))),
            notes=(*_notes(table), *vectors.notes),
            vehicle=(writer.vehicle if writer is not None else "") or vehicle,
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
        if why := _foreign_unit(found, stated):
            own.reasons[label] = why
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
        own.rules.append(_rule(found, label, units, label))
        warnings += dropped_in_words([lost])
    return own


def _inputs(table: Table) -> list[int]:
    """Return the columns, from 0, that hold inputs u beside outputs y, which are no velocities along body axes."""
    plain = [name.rpartition(".")[2] for name in table.names]
    if not any(name.split("[")[0].rstrip("0123456789_") == "y" for name in plain):
        return []
    return [i for i, name in enumerate(plain) if name == "u" and not table.units[i].strip()]


def _rule(found: Meaning, column: str, units: Mapping[str, str], topic: str = "") -> Rule:
    si = channel(found.channel).unit
    if found.channel in units:
        factor = unit_factor(found.channel, units[found.channel])
        return Rule(found.channel, topic, (column,), scaled(factor), f"{units[found.channel]}, as told", in_si=True)
    if found.unit:
        return Rule(found.channel, topic, (column,), found.convert, found.said, found.assumed, in_si=not found.of_throw)
    assumed = "; ".join(filter(None, [f"{UNSTATED}: {si}", found.assumed]))
    return Rule(found.channel, topic, (column,), scaled(found.scale), f"{si}, as in the file", assumed, in_si=True)


def _foreign_unit(found: Meaning, stated: str) -> str:
    """Say that a stated unit is none of the channel's, "" if it is one, or none is stated."""
    if found.unit or not stated.strip().strip("-"):
        return ""
    si = channel(found.channel).unit
    return f"its unit must be one of {', '.join(UNITS.get(si, {si: 1.0}))}, got '{stated}'"


def _listed(names: Sequence[str], most: int = 12) -> str:
    named = [name for name in names if name]
    return ", ".join(named[:most]) + (f" and {len(named) - most} more" if len(named) > most else "")


def _to_describe(path: Path) -> str:
    return (
        f"`testbench import '{path}' --describe {path.stem}.toml` writes a description to fill in: which column is "
        f"which channel, in which unit; then `testbench import {path.stem}.toml`"
    )
