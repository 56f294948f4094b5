"""Telemetry of MAVLink (.tlog): what came over the radio, each message behind the time at which it arrived.

A ground station writes 8 bytes of microseconds since 1970 before each message; pymavlink decodes the messages
(https://mavlink.io/en/messages/common.html, ardupilotmega.html). Messages that hold the time since boot keep it,
and others have that of the last one that did, so that the radio's delay, which changes, does not shift one channel
against another. What a servo output drives is in the settings, which ground stations ask for as they connect.
"""

from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.core.door import read_bytes
from testbench.core.errors import MissingPackage, RecordError, missing
from testbench.core.record import FloatArray
from testbench.logs import ardupilot, px4
from testbench.logs.rates import too_slow
from testbench.logs.signals import (
    AT_IMU,
    Dropped,
    Log,
    Mode,
    Rule,
    Topic,
    dropped_in_words,
    make_topic,
    modes_of,
    scaled,
)

NEEDS_PYMAVLINK = ("MAVLink needs pymavlink", "logs")
_ONE, _CENTI, _MILLI_G = scaled(1.0), scaled(0.01), scaled(1e-3 * G0_M_S2)
_AIRSPEED = "true airspeed is the airspeed shown, which is indicated: right at sea level, 5 % too low at 1000 m"
_VANE = "the vane measures the flow at the centre of gravity"
_ARRIVED = "its times are those of the messages before it: it holds none"


def _imu(topic: str, milli: bool) -> list[Rule]:
    rates, forces = (scaled(1e-3), _MILLI_G) if milli else (_ONE, _ONE)
    units = ("mrad/s", "1/1000 g") if milli else ("rad/s", "m/s2")
    out = [Rule(n, topic, (f"{axis}gyro",), rates, units[0]) for n, axis in zip("pqr", "xyz", strict=True)]
    return out + [Rule(f"a{axis}", topic, (f"{axis}acc",), forces, units[1], AT_IMU) for axis in "xyz"]


def _from_north(speed: FloatArray, direction: FloatArray) -> FloatArray:
    return np.asarray(-speed * np.cos(DEG_RAD * direction))


def _from_east(speed: FloatArray, direction: FloatArray) -> FloatArray:
    return np.asarray(-speed * np.sin(DEG_RAD * direction))


RULES = (
    *(Rule(n, "ATTITUDE", (f,), _ONE, unit) for n, f, unit in (
        ("p", "rollspeed", "rad/s"), ("q", "pitchspeed", "rad/s"), ("r", "yawspeed", "rad/s"), ("phi", "roll", "rad"),
        ("theta", "pitch", "rad"), ("psi", "yaw", "rad"))),
    *_imu("HIGHRES_IMU", False),
    *(rule for topic in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2") for rule in _imu(topic, True)),
    Rule("V", "VFR_HUD", ("airspeed",), _ONE, "m/s", f"{_AIRSPEED}; {_ARRIVED}"),
    Rule("h", "GLOBAL_POSITION_INT", ("alt",), scaled(1e-3), "mm above sea level"),
    Rule("h", "VFR_HUD", ("alt",), _ONE, "m above sea level", _ARRIVED),
    Rule("hdot", "GLOBAL_POSITION_INT", ("vz",), scaled(-0.01), "cm/s, minus the velocity downwards"),
    Rule("hdot", "LOCAL_POSITION_NED", ("vz",), scaled(-1.0), "m/s, minus the velocity downwards"),
    Rule("hdot", "VFR_HUD", ("climb",), _ONE, "m/s", _ARRIVED),
    Rule("Vg", "GLOBAL_POSITION_INT", ("vx", "vy"), lambda x, y: 0.01 * np.hypot(x, y), "cm/s, length of vx, vy"),
    Rule("Vg", "VFR_HUD", ("groundspeed",), _ONE, "m/s", _ARRIVED),
    Rule("north", "LOCAL_POSITION_NED", ("x",), _ONE, "m, from the local origin"),
    Rule("east", "LOCAL_POSITION_NED", ("y",), _ONE, "m, from the local origin"),
    Rule("qbar", "SCALED_PRESSURE", ("press_diff",), scaled(100.0), "hPa",
         "incompressible: qbar is the differential pressure"),
    Rule("alpha", "AOA_SSA", ("AOA",), scaled(DEG_RAD), "deg", _VANE),
    Rule("beta", "AOA_SSA", ("SSA",), scaled(DEG_RAD), "deg", _VANE),
    Rule("wind_north", "WIND", ("speed", "direction"), _from_north, "m/s from deg, estimated", _ARRIVED),
    Rule("wind_east", "WIND", ("speed", "direction"), _from_east, "m/s from deg, estimated", _ARRIVED),
    Rule("wind_north", "WIND_COV", ("wind_x",), _ONE, "m/s, estimated"),
    Rule("wind_east", "WIND_COV", ("wind_y",), _ONE, "m/s, estimated"),
)  # fmt: skip
"""What needs no setting of the autopilot, by preference. ArduPilot's RAW_IMU is in the units of SCALED_IMU."""
_THROTTLE = Rule("thr_cmd", "VFR_HUD", ("throttle",), scaled(PERCENT), "%", _ARRIVED)
_SERVOS, _DEMANDS, _BEAT, _STATE = "SERVO_OUTPUT_RAW", "ACTUATOR_CONTROL_TARGET", "HEARTBEAT", "EXTENDED_SYS_STATE"
_READ = {rule.topic for rule in RULES} | {_SERVOS, _DEMANDS, _BEAT, _STATE, "PARAM_VALUE", "STATUSTEXT"}
_OUTPUTS = 16
_ARDUPILOT, _PX4, _NOT_A_VEHICLE = 3, 12, 8  # MAV_AUTOPILOT
_FIRMWARE = {1: "ArduPlane", **dict.fromkeys((2, 3, 4, 13, 14, 15, 29), "ArduCopter"), 10: "Rover", 11: "Rover"}
_BY_PX4 = {
    "manual": "MANUAL", "stabilised": "STABILIZED ACRO RATTITUDE ALTCTL POSCTL",
    "automatic": "MISSION LOITER RTL LAND TAKEOFF OFFBOARD FOLLOWME RTGS",
}  # fmt: skip
_ROTARY, _VTOLS = (2, 3, 4, 13, 14, 15, 29), range(19, 26)  # MAV_TYPE
_ON_GROUND, _HOVERS, _CHANGES = 1, 3, (1, 2)  # MAV_LANDED_STATE, MAV_VTOL_STATE
_UNIX_US = 1e15  # a clock that counts from 1970
_BETTER = "SR0_EXTRA1, SR0_RC_CHAN and SR0_RAW_SENS set how often messages are sent; the log on board has more"


_ARRIVED_S, _BOOT_S = "arrived", "since boot"  # of each message, s; the latter of the last one that held it


def dialect() -> Any:
    """Return pymavlink's messages of ArduPilot, which hold the common ones.

    Raises:
        MissingPackage: pymavlink is not installed.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ImportError as error:
        raise MissingPackage(missing(*NEEDS_PYMAVLINK)) from error
    return ardupilotmega


def values_of(message: Any) -> dict[str, float]:
    """Return channel -> value, SI, of one message as pymavlink decodes it; {} of one that no rule knows."""
    kind = message.get_type()
    own = (rule for rule in RULES if rule.topic == kind)
    return {rule.channel: float(rule.convert(*(np.float64(getattr(message, f)) for f in rule.fields))) for rule in own}


def read_tlog(path: Path | str) -> tuple[Log, tuple[Rule, ...]]:
    """Read a telemetry log; return it and its rules.

    Raises:
        RecordError: it holds no vehicle, or nothing of its motion.
        MissingPackage: pymavlink is not installed.
    """
    path = Path(path)
    found = _Telemetry(read_bytes(path, "log"), dialect())
    if _BEAT not in found.held:
        raise RecordError(
            f"'{path}' must hold the heartbeat of a vehicle, but none came among its {found.counts.total()} messages"
        )
    topics, lost = found.topics()
    if not {rule.topic for rule in RULES} & topics.keys():
        raise RecordError(
            f"'{path}' must hold messages of a flight ({', '.join(dict.fromkeys(r.topic for r in RULES))}), but it "
            f"holds {', '.join(sorted(found.counts))}"
        )
    damage = [f"{found.skipped} bytes belong to no whole message and were left out"] if found.skipped else []
    unread = {name: n for name, n in found.counts.items() if name not in _READ}
    others = sorted(found.others)
    notes = [f"messages of system {found.system} are read; {others} sent some, too"] if others else []
    kind = "telemetry of MAVLink"
    said = (*damage, *dropped_in_words(lost))
    log = Log(path, kind, topics, {}, found.parameters, said, unread, notes=tuple(notes))
    return _with_settings(log, found)


@dataclass(eq=False)
class _Telemetry:
    """The messages of a log that are read: those of the first vehicle that is heard."""

    whole: bytes
    of: Any
    system: int = 0
    skipped: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    others: set[int] = field(default_factory=set)
    held: dict[str, dict[str, array[float]]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)
    boot_s: float = np.nan

    def __post_init__(self) -> None:
        early: list[tuple[float, Any]] = []  # before it is known whose heartbeat is that of a vehicle
        for arrived_s, message in self._decoded():
            early.append((arrived_s, message))
            if not self.system and _beats(message):
                self.system = message.get_srcSystem()
            if self.system:
                for one in early:
                    self._take(*one)
                early.clear()

    def _take(self, arrived_s: float, message: Any) -> None:
        kind = message.get_type()
        if message.get_srcSystem() != self.system:
            return
        if kind == "PARAM_VALUE":
            self.parameters[str(message.param_id)] = float(message.param_value)
        elif kind == "STATUSTEXT":
            self.texts.append(str(message.text))
        elif kind != _BEAT or _beats(message):
            self.boot_s = 1e-3 * getattr(message, "time_boot_ms", 1e3 * self.boot_s)
            columns = self.held.setdefault(kind, {})
            values: dict[str, Any] = {_ARRIVED_S: arrived_s, _BOOT_S: self.boot_s}
            for name in message.fieldnames:  # those of a vector have [0] and so on behind
                value = getattr(message, name)
                values |= {f"{name}[{i}]": x for i, x in enumerate(value)} if isinstance(value, list) else {name: value}
            for name, value in values.items():
                if isinstance(value, int | float):
                    columns.setdefault(name, array("d")).append(value)

    def _decoded(self) -> Iterator[tuple[float, Any]]:
        """Yield the messages that are read, with the times at which they arrived, s; count the bytes that are none.

        A message is a time, a head, a body, and a sum that is right.
        """
        whole, at = self.whole, 0
        link = self.of.MAVLink(None)
        while at + 20 <= len(whole):
            second = whole[at + 8] == 0xFD
            size = whole[at + 9] + (12 if second else 8) + (13 if second and whole[at + 10] & 1 else 0)
            number = int.from_bytes(whole[at + 15 : at + 18], "little") if second else whole[at + 13]
            known = self.of.mavlink_map.get(number)
            sender = whole[at + (13 if second else 11)]
            if whole[at + 8] not in (0xFD, 0xFE) or known is None or at + 8 + size > len(whole):
                at, self.skipped = at + 1, self.skipped + 1
                continue
            name = str(known.msgname)
            wanted = name in _READ and self.system in (0, sender)
            try:
                message = link.decode(bytearray(whole[at + 8 : at + 8 + size])) if wanted else None
            except (self.of.MAVError, struct.error):
                at, self.skipped = at + 1, self.skipped + 1
                continue
            self.counts[name] += self.system in (0, sender)
            self.others |= {sender} - {self.system} if self.system else set()
            if message is not None:
                yield 1e-6 * int.from_bytes(whole[at : at + 8], "big"), message
            at += 8 + size
        self.skipped += len(whole) - at

    def topics(self) -> tuple[dict[str, Topic], list[Dropped | None]]:
        """Return the topics, on the clock of the vehicle where a message holds it, and what was left out of them."""
        held = {kind: {name: np.array(x) for name, x in columns.items()} for kind, columns in self.held.items()}
        last = {kind: columns.pop(_BOOT_S) for kind, columns in held.items()}
        arrived = {kind: columns.pop(_ARRIVED_S) for kind, columns in held.items()}
        boots = {kind: clock for kind, columns in held.items() if (clock := _clock(columns)) is not None}
        start = min(float(t[0]) for t in arrived.values())
        since_boot = {kind: t for kind, t in boots.items() if not np.any(t > 1e-6 * _UNIX_US)}
        late = min((float(np.min(arrived[kind] - t)) for kind, t in since_boot.items()), default=0.0)
        topics: dict[str, Topic] = {}
        lost: list[Dropped | None] = []
        for kind, columns in held.items():
            t = np.where(np.isfinite(last[kind]), last[kind] + late, arrived[kind])
            if kind in boots:
                own = boots[kind]
                t = own + (np.min(arrived[kind] - own) if np.any(own > 1e-6 * _UNIX_US) else late)
            topic, dropped = make_topic(kind, t - start, columns)
            lost.append(dropped)
            if topic.t_s.size:
                topics[kind] = topic
        return topics, lost


def _beats(message: Any) -> bool:
    """Say whether a message is the heartbeat of a vehicle, not that of a ground station, a camera or a radio."""
    return message.get_type() == _BEAT and message.autopilot != _NOT_A_VEHICLE


def _clock(columns: Mapping[str, NDArray[Any]]) -> FloatArray | None:
    """Return the times that messages hold themselves, s; None if they do not, or one of them was not set."""
    for name, unit in (("time_boot_ms", 1e-3), ("time_usec", 1e-6)):
        if name in columns and np.all(columns[name] > 0.0):
            return np.asarray(unit * columns[name])
    return None


def _with_settings(log: Log, found: _Telemetry) -> tuple[Log, tuple[Rule, ...]]:
    """Return the log with its vehicle and modes, and the rules for it by the settings that came with it."""
    beats = log.topics[_BEAT]
    autopilot, kind = (int(beats.columns[name][0]) for name in ("autopilot", "type"))
    rules: list[Rule] = list(RULES)
    if autopilot == _ARDUPILOT:
        said = next((text for text in found.texts if any(word in text for word in set(_FIRMWARE.values()))), "")
        modes = Topic("MODE", beats.t_s, {"ModeNum": beats.columns["custom_mode"]})
        software = said or _FIRMWARE.get(kind, "")
        log = replace(log, facts={"software": software} if software else {}, topics={**log.topics, "MODE": modes})
        log = ardupilot.flown(log)
        if log.vehicle in ("", "fixed wing", "VTOL"):
            rules += map(_of_outputs, ardupilot.servo_rules(log, named=True))
            rules += [_THROTTLE, *map(_of_outputs, ardupilot.servo_rules(log, named=False))]
    else:
        rules = [rule for rule in rules if rule.topic != "RAW_IMU"]  # in units that only its driver knows
        vehicle = "rotorcraft" if kind in _ROTARY else "VTOL" if kind in _VTOLS else ""
        log = replace(log, vehicle=vehicle or ("fixed wing" if kind == 1 else ""))
        rules += [*px4.command_rules(_DEMANDS, "controls[{}]"), _THROTTLE]
        if autopilot == _PX4:
            log = replace(log, modes=_px4_modes(beats))
    state = log.topics.get(_STATE)
    flags = dict(log.flags)
    if state is not None:
        flags["landed"] = (state.t_s, state.columns["landed_state"] == _ON_GROUND)
        if log.vehicle == "VTOL":
            flags["hover"] = (state.t_s, state.columns["vtol_state"] == _HOVERS)
            flags["transition"] = (state.t_s, np.isin(state.columns["vtol_state"], _CHANGES))
    notes = (*log.notes, *too_slow(log, rules, _BETTER))
    kept = {name: topic for name, topic in log.topics.items() if name not in (_BEAT, _STATE)}
    return replace(log, flags=flags, notes=notes, topics=kept), tuple(rules)


def _of_outputs(rule: Rule) -> Rule:
    """Return a rule for servo outputs of a log on board as one for the same outputs in telemetry."""
    fields = tuple(f"servo{name[1:]}_raw" for name in rule.fields if int(name[1:]) <= _OUTPUTS)
    return replace(rule, topic=_SERVOS, fields=fields if len(fields) == len(rule.fields) else ("",))


def _px4_modes(beats: Topic) -> tuple[Mode, ...]:
    from pymavlink import mavutil

    each = np.column_stack([beats.columns["base_mode"], beats.columns["custom_mode"]])
    kinds, numbers = np.unique(each, axis=0, return_inverse=True)
    names = {i: str(mavutil.interpret_px4_mode(int(a), int(b))) for i, (a, b) in enumerate(kinds.tolist())}
    return modes_of(Topic("MODE", beats.t_s, {"number": numbers.ravel()}), "number", names, _BY_PX4)
