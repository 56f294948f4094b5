"""Paparazzi logs: the .data file holds a line per message, the .log file beside it (XML) names their fields.

A line is ``time aircraft MESSAGE field field ...``; an array is one field with commas (Paparazzi UAV, wiki, "Logs").
The XML holds the message definitions with units and the airframe with the order of its commands, so nothing here
depends on the version of Paparazzi.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from testbench.core.channels import channel, unit_factor
from testbench.core.door import read_text, read_xml
from testbench.core.errors import RecordError
from testbench.logs.names import stated_unit
from testbench.logs.signals import Log, Rule, Topic, dropped_in_words, make_topic, modes_of, scaled

_LINE = re.compile(rb"(?:^|\n)\s*\d+(?:\.\d+)?\s+\d+\s+[A-Z][A-Z0-9_]{2,}(?=[ \r\n])")
_FULL = 9600.0  # a command at full deflection (MAX_PPRZ)
# By preference. The unit stands in the definitions; the one here is that of the field where they state none.
_SOURCES = (
    ("phi", "ATTITUDE", "phi", "rad"), ("theta", "ATTITUDE", "theta", "rad"), ("psi", "ATTITUDE", "psi", "rad"),
    ("p", "IMU_GYRO_SCALED", "gp", "rad/s"), ("q", "IMU_GYRO_SCALED", "gq", "rad/s"),
    ("r", "IMU_GYRO_SCALED", "gr", "rad/s"), ("p", "IMU_GYRO", "gp", "rad/s"), ("q", "IMU_GYRO", "gq", "rad/s"),
    ("r", "IMU_GYRO", "gr", "rad/s"),
    ("ax", "IMU_ACCEL_SCALED", "ax", "m/s2"), ("ay", "IMU_ACCEL_SCALED", "ay", "m/s2"),
    ("az", "IMU_ACCEL_SCALED", "az", "m/s2"), ("ax", "IMU_ACCEL", "ax", "m/s2"), ("ay", "IMU_ACCEL", "ay", "m/s2"),
    ("az", "IMU_ACCEL", "az", "m/s2"),
    ("V", "AIR_DATA", "tas", "m/s"), ("V", "AIRSPEED", "airspeed", "m/s"), ("V", "AIR_DATA", "airspeed", "m/s"),
    ("qbar", "AIR_DATA", "diff_p", "Pa"), ("alpha", "AOA", "angle", "rad"), ("beta", "SIDESLIP", "angle", "rad"),
    ("h", "AIR_DATA", "amsl_baro", "m"), ("h", "GPS", "alt", "m"), ("Vg", "GPS", "speed", "m/s"),
)  # fmt: skip
_MODES = {0: "MANUAL", 1: "AUTO1", 2: "AUTO2", 3: "HOME", 4: "NOGPS", 5: "FAILSAFE"}  # of PPRZ_MODE, fixed wings
_FLOWN = {"manual": "MANUAL", "stabilised": "AUTO1", "automatic": "AUTO2 HOME NOGPS FAILSAFE"}
_COMMANDS = {"PITCH": ("de_cmd", -1.0), "ROLL": ("da_cmd", 1.0), "YAW": ("dr_cmd", -1.0), "THROTTLE": ("thr_cmd", 1.0)}


class _Field(NamedTuple):
    name: str
    unit: str
    factor: float  # takes what is logged to ``unit``


def is_paparazzi(head: bytes) -> bool:
    """Say whether the first bytes of a file are lines of Paparazzi messages."""
    first = head.lstrip()[:2000]
    return not first.startswith(b"FMT") and len(_LINE.findall(first)) >= min(3, max(1, first.count(b"\n")))


def read_paparazzi(path: Path) -> tuple[Log, tuple[Rule, ...]]:
    """Read a .data file with the definitions of the .log file beside it; return the log and the rules for it.

    Raises:
        RecordError: the definitions are missing or damaged, or no message with numbers is known.
    """
    beside = path.with_suffix(".log")
    if beside == path or not beside.is_file():
        raise RecordError(
            f"'{path}' is a log of Paparazzi, whose fields are named in the .log file (XML) written with it; put "
            f"'{path.with_suffix('.log').name}' beside it, or export the messages that you need as CSV with a header"
        )
    definitions = read_xml(beside, "definitions", bare=True)  # flight plans in it hold &&
    fields = _fields(definitions)
    topics, unread, warnings, number = _topics(path, fields)
    every = list(definitions.iterfind(".//aircraft"))  # a ground station lists all that it knows
    aircraft = next((each for each in every if _said(each, "ac_id") == number), every[0] if every else None)
    own = aircraft if aircraft is not None and aircraft.find(".//commands/axis") is not None else definitions
    commands = [_said(axis, "name").upper() for axis in own.iterfind(".//commands/axis")]
    if not topics:
        raise RecordError(f"'{beside}' must define the messages of '{path.name}', but it defines none of them")
    rules = tuple(
        Rule(name, topic, (column,), scaled(known.factor * unit_factor(name, unit)), unit)
        for name, topic, column, usual in _SOURCES
        for known in fields.get(topic, ())
        if known.name == column and (unit := stated_unit(name, known.unit) or ("" if known.unit else usual))
    )
    facts = {"commands": " ".join(commands).lower()} if commands else {}
    facts |= {"aircraft": _said(aircraft, "name")} if aircraft is not None else {}
    vehicle = "rotorcraft" if any(_said(each, "name") == "rotorcraft" for each in own.iter("firmware")) else ""
    modes = modes_of(topics.pop("PPRZ_MODE", None), "ap_mode", _MODES, _FLOWN)
    log = Log(path, "Paparazzi messages", topics, facts, {}, tuple(warnings), unread, modes=modes, vehicle=vehicle)
    return log, (*rules, *_command_rules(commands))


def _fields(definitions: ElementTree.Element) -> dict[str, list[_Field]]:
    """Return message -> its fields, from the class of telemetry before any other."""
    groups = [*definitions.iter("msg_class"), *definitions.iter("class"), definitions]
    groups.sort(key=lambda group: _said(group, "name").lower() != "telemetry")
    out: dict[str, list[_Field]] = {}
    for group in groups:
        for message in group.iter("message"):
            name = _said(message, "name").upper()
            out.setdefault(name, [_field(field) for field in message.iter("field")])
    return out


def _field(field: ElementTree.Element) -> _Field:
    name, unit = _said(field, "name"), _said(field, "unit")
    try:
        return _Field(name, _said(field, "alt_unit") or unit, float(_said(field, "alt_unit_coef")))
    except ValueError:
        return _Field(name, unit, 1.0)


def _said(element: ElementTree.Element, attribute: str) -> str:
    """Return an attribute, "" if it is not there; some versions write their names in capitals."""
    return str(element.get(attribute, element.get(attribute.upper(), "")))


def _topics(path: Path, fields: dict[str, list[_Field]]) -> tuple[dict[str, Topic], dict[str, int], list[str], str]:
    """Return the messages that a rule may use, the number of the others, what was left out, and whose they are."""
    used = {source[1] for source in _SOURCES} | {"COMMANDS", "PPRZ_MODE"}
    lines = [line.split() for line in read_text(path, "log", errors="replace").splitlines()]
    lines = [words for words in lines if len(words) > 2]
    craft = Counter(words[1] for words in lines).most_common(1)
    rows: dict[str, list[list[str]]] = defaultdict(list)
    unread: Counter[str] = Counter()
    for words in lines:
        if words[1] != craft[0][0]:
            continue
        if words[2] in used and words[2] in fields:
            rows[words[2]].append(words)
        else:
            unread[words[2]] += 1
    others = len(lines) - sum(words[1] == craft[0][0] for words in lines) if craft else 0
    warnings = [f"{others} messages of other aircraft than number {craft[0][0]} were left out"] if others else []
    topics, dropped = {}, []
    for name, messages in rows.items():
        table = [_numbers(words) for words in messages]
        width = Counter(map(len, table)).most_common(1)[0][0]
        values = np.array([row for row in table if len(row) == width], dtype=np.float64)
        labels = [field.name for field in fields[name]]
        if name == "COMMANDS":
            labels = [f"values[{i}]" for i in range(width - 1)]
        columns = dict(zip(labels, values[:, 1:].T, strict=False))
        topics[name], lost = make_topic(name, values[:, 0], columns)
        damaged = len(table) - len(values)
        dropped.append(lost)
        warnings += [f"{name}: {damaged} messages are damaged and were left out"] if damaged else []
    return topics, dict(unread), [*warnings, *dropped_in_words(dropped)], craft[0][0] if craft else ""


def _numbers(words: list[str]) -> list[float]:
    """Return time and fields of a message, the entries of arrays one after the other, NaN for text."""
    out = []
    for cell in (words[0], *(part for word in words[3:] for part in word.split(","))):
        try:
            out.append(float(cell))
        except ValueError:
            out.append(float("nan"))
    return out


def _command_rules(commands: list[str]) -> list[Rule]:
    """Return the rules for the commands, in the order that the airframe gives them; pitch up is elevator up."""
    return [
        Rule(
            name,
            "COMMANDS",
            (f"values[{i}]",),
            scaled(sign / _FULL),
            f"{axis.lower()} / 9600"
            + (" * -1" if sign < 0.0 else "")
            + (" * throw" if channel(name).unit == "rad" else ""),
            "" if axis == "THROTTLE" else f"a positive {axis.lower()} command moves the aircraft {_MOVES[axis]}",
        )
        for i, axis in enumerate(commands)
        if axis in _COMMANDS
        for name, sign in [_COMMANDS[axis]]
    ]


_MOVES = {"PITCH": "nose up", "ROLL": "right wing down", "YAW": "nose right"}
