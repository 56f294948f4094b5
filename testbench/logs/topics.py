"""Tables that other programs make of the logs of autopilots: one file, or one matrix, for each topic.

mavlogdump (pymavlink) and Mission Planner (.mat) keep the names of ArduPilot's messages, ulog2csv (pyulog) those of
PX4's topics. So the rules for these logs are the rules for the tables. A folder of such tables is one log.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS
from testbench.core.record import FloatArray
from testbench.logs import ardupilot, px4
from testbench.logs.mat import CellArray
from testbench.logs.names import meaning
from testbench.logs.signals import Dropped, Log, Rule, Topic, dropped_in_words, make_topic
from testbench.logs.tables import Table

_CLOCK = "TimeUS"
_MICRO = 1e-6
_LABEL = "_label"
_PX4_FILE = re.compile(rf"(?:.*_)?({'|'.join(sorted(px4.COLUMNS, key=len, reverse=True))})_(\d+)")
_INSTANCE = ("I", "Instance", "C")  # of sensors, and of the cores of the filter
_PARAMETERS = "PARM"
_MOST = 3  # topics that a note lists

_Columns = dict[str, NDArray[Any]]


def log_of_table(path: Path, table: Table) -> tuple[Log, tuple[Rule, ...]] | None:
    """Return a table as the log that it was made of, and its rules; None if it is of none of these writers."""
    topics = dict(_px4_topic(path.stem, table)) or dict(_ardupilot_topics(table, path.stem))
    if not topics:
        return None
    columns = {name for _, held in topics.values() for name in held}
    used = {field for rule in ardupilot.RULES for field in rule.fields} | {"C1", "Ail"}
    if not _PX4_FILE.fullmatch(path.stem) and (not columns & used or any(map(_is_control, table.names))):
        return None  # a table of somebody's own, whose times are called as ArduPilot's
    beside = [other for other in sorted(path.parent.glob("*.csv")) if other != path and _PX4_FILE.fullmatch(other.stem)]
    notes = []
    if _PX4_FILE.fullmatch(path.stem) and beside:
        notes.append(
            f"the folder holds {len(beside)} more topics of the log: `testbench import {path.parent}` reads all"
        )
    return _log(path, topics, {}, notes)


def is_px4_file(path: Path) -> bool:
    """Say whether a table is called as ulog2csv calls one of a topic that is read."""
    return _PX4_FILE.fullmatch(path.stem) is not None


def log_of_tables(place: Path, tables: Mapping[str, Table]) -> tuple[Log, tuple[Rule, ...]] | None:
    """Return tables, a topic of one log each, as that log, and its rules.

    None if none of them is a topic of PX4 or a message of ArduPilot.

    Args:
        place: the folder or the recording that they are of.
        tables: name -> table.
    """
    topics: dict[str, tuple[FloatArray, _Columns]] = {}
    unread: dict[str, int] = {}
    for name, table in tables.items():
        found = dict(_px4_topic(name, table)) or dict(_ardupilot_topics(table, name))
        topics |= found
        unread |= {} if found else {table.file.name: len(table)}
    return _log(place, topics, {}, [], unread) if topics else None


def log_of_matrices(path: Path, content: Mapping[str, Any]) -> tuple[Log, tuple[Rule, ...]] | None:
    """Return what Mission Planner makes of a log (.mat: a matrix a message, its columns in NAME_label) as that log."""
    topics: dict[str, tuple[FloatArray, _Columns]] = {}
    unread: dict[str, int] = {}
    for key, matrix in content.items():
        kind, _, number = key.partition("_")
        labels = content.get(f"{key}{_LABEL}", content.get(f"{kind}{_LABEL}"))
        if not isinstance(labels, CellArray) or not isinstance(matrix, np.ndarray) or matrix.ndim != 2:
            continue
        if matrix.shape[1] != len(labels.items):
            continue
        columns = {str(name): matrix[:, i] for i, name in enumerate(labels.items)}
        if kind in ardupilot.COLUMNS and _CLOCK in columns:
            topics |= dict(_by_instance(f"{kind}#{number}" if number not in ("", "0") else kind, columns))
        else:
            unread[key] = matrix.shape[0]
    settings = content.get(_PARAMETERS)
    parameters: dict[str, float] = {}
    if isinstance(settings, CellArray):
        n = settings.shape[0]
        pairs = zip(settings.items[:n], settings.items[n : 2 * n], strict=False)
        parameters = {str(name): float(np.ravel(value)[0]) for name, value in pairs if np.size(value) == 1}
    return _log(path, topics, parameters, [], unread) if topics else None


def _log(
    path: Path,
    found: Mapping[str, tuple[FloatArray, _Columns]],
    parameters: Mapping[str, float],
    notes: Sequence[str],
    unread: Mapping[str, int] | None = None,
) -> tuple[Log, tuple[Rule, ...]]:
    topics: dict[str, Topic] = {}
    lost: list[Dropped | None] = []
    for name, (t, columns) in found.items():
        topics[name], dropped = make_topic(name, t, columns)
        lost.append(dropped)
    of_px4 = any(name.partition("#")[0] in px4.COLUMNS for name in topics)
    kind = "topics of PX4 as tables (ulog2csv)" if of_px4 else "messages of ArduPilot as tables"
    if not parameters:
        suffix = ".ulg" if of_px4 else ".bin"
        notes = [*notes, f"the tables hold no settings: the log itself ({suffix}) states what each output drives"]
    said = tuple(dropped_in_words(lost))
    log = Log(path, kind, topics, {}, parameters, said, unread or {}, notes=tuple(notes))
    return px4.px4_rules(log) if of_px4 else ardupilot.ardupilot_rules(log)


def _is_control(name: str) -> bool:
    found = meaning(name)
    return found is not None and found.channel.removesuffix("_cmd") in CONTROLS


def _px4_topic(name: str, table: Table) -> Iterator[tuple[str, tuple[FloatArray, _Columns]]]:
    match = _PX4_FILE.fullmatch(name)
    if match is None or px4.CLOCK not in table.names:
        return
    columns = {name: table.numbers(i + 1) for i, name in enumerate(table.names)}
    clock = px4.sampled(columns.pop(px4.CLOCK), columns.pop(px4.SAMPLED, None))
    number = int(match[2])
    yield match[1] + (f"#{number}" if number else ""), (_MICRO * clock, columns)


def _ardupilot_topics(table: Table, stem: str = "") -> Iterator[tuple[str, tuple[FloatArray, _Columns]]]:
    """Yield the messages in a table: its columns are called IMU.GyrX, or GyrX where there is one type only."""
    groups: dict[str, _Columns] = {}
    for i, name in enumerate(table.names):
        kind, dot, column = name.rpartition(".")
        if _CLOCK in table.names or (dot and f"{kind}.{_CLOCK}" in table.names):
            groups.setdefault(kind, {})[column] = table.numbers(i + 1)
    for kind, columns in groups.items():
        known = kind or _type_of(stem, columns)
        if known.partition("[")[0] in ardupilot.COLUMNS:
            yield from _by_instance(known, columns)


def _type_of(stem: str, columns: Mapping[str, Any]) -> str:
    """Return the type of message that a table holds: that of the file's name, else that which most columns fit."""
    last = re.split(r"[._-]", stem)[-1]
    if last in ardupilot.COLUMNS:
        return last
    held = {kind: len(set(names) & columns.keys()) for kind, names in ardupilot.COLUMNS.items()}
    return max(held, key=lambda kind: held[kind]) if any(held.values()) else ""


def _by_instance(kind: str, columns: _Columns) -> Iterator[tuple[str, tuple[FloatArray, _Columns]]]:
    """Yield the instances in the rows of one type of message, each sample once."""
    kind = kind.replace("[", "#").rstrip("]").removesuffix("#0")
    clock = np.asarray(columns[_CLOCK], dtype=np.float64)
    of = next((columns[name] for name in _INSTANCE if name in columns), np.zeros(clock.size))
    taken = np.isfinite(clock)
    for number in np.unique(of[taken & np.isfinite(of)]).tolist():
        rows = np.flatnonzero(taken & (of == number))
        rows = rows[np.diff(clock[rows], prepend=-np.inf) != 0.0]
        name = f"{kind}#{number:g}" if number and "#" not in kind else kind
        yield name, (_MICRO * clock[rows], {key: column[rows] for key, column in columns.items()})
