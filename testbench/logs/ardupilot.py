"""How ArduPilot's messages become channels: which sensor, which filter, and what the servo outputs mean.

Facts: ArduPilot's documentation of log messages, of SERVOn_FUNCTION and of elevon and V-tail mixing; ArduPlane's mixer
(servos.cpp). Frames: body forward-right-down, angles in degrees, servo pulses in microseconds. A demand of 4500 is full
throw, positive for rolling right, nose up, nose right. A servo that is not reversed moves its surface up (a rudder:
right) as its pulse grows; the left elevon is elevator minus aileron, the right one elevator plus aileron, the left
V-tail elevator plus rudder, the right one elevator minus rudder. Flaperons move as ailerons do, flaps apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.core.record import FloatArray
from testbench.logs.rates import too_slow
from testbench.logs.signals import AT_IMU, Log, Mode, Rule, Topic, filters, modes_of, placed, scaled, without

_VANE = "the vane measures the flow at the centre of gravity"
_DEMAND = "4500 is full command, positive nose up, right wing down, nose right"
_ONE, _MINUS, _DEG = scaled(1.0), scaled(-1.0), scaled(DEG_RAD)

RULES = (
    *(Rule(n, "IMU", (f"Gyr{a}",), _ONE, "rad/s, as logged", takes="rad/s") for n, a in zip("pqr", "XYZ", strict=True)),
    *(Rule(n, "GYR", (f"Gyr{a}",), _ONE, "rad/s, as logged", takes="rad/s") for n, a in zip("pqr", "XYZ", strict=True)),
    *(Rule(n, "ATT", (f,), _DEG, "deg", takes="deg") for n, f in (("phi", "Roll"), ("theta", "Pitch"), ("psi", "Yaw"))),
    *(Rule(f"a{a.lower()}", "IMU", (f"Acc{a}",), _ONE, "m/s2, as logged", AT_IMU, takes="m/s/s") for a in "XYZ"),
    *(Rule(f"a{a.lower()}", "ACC", (f"Acc{a}",), _ONE, "m/s2, as logged", AT_IMU, takes="m/s/s") for a in "XYZ"),
    Rule("alpha", "AOA", ("AOA",), _DEG, "deg", _VANE, takes="deg"),
    Rule("beta", "AOA", ("SSA",), _DEG, "deg", _VANE, takes="deg"),
    Rule("V", "ARSP", ("Airspeed",), _ONE, "m/s, airspeed as logged", "true airspeed is the airspeed logged, which is "
         "indicated: right at sea level, 5 % too low at 1000 m", takes="m/s"),
    Rule("qbar", "ARSP", ("DiffPress",), _ONE, "Pa", "incompressible: qbar is the differential pressure", takes="Pa"),
    Rule("h", "POS", ("Alt",), _ONE, "m above sea level", takes="m"),
    Rule("h", "BARO", ("Alt",), _ONE, "m, barometric", "the height counts from where the autopilot started", takes="m"),
    Rule("h", "GPS", ("Alt",), _ONE, "m above sea level, by the receiver", takes="m"),
    *(Rule("hdot", k, ("VD",), _MINUS, "m/s, minus the velocity downwards", takes="m/s")
      for k in ("XKF1", "NKF1", "EKF1")),
    Rule("hdot", "GPS", ("VZ",), _MINUS, "m/s, minus the velocity downwards", takes="m/s"),
    Rule("Vg", "GPS", ("Spd",), _ONE, "m/s", takes="m/s"),
    *(Rule(n, k, (f,), _ONE, "m, from the origin of the filter", takes="m") for k in ("XKF1", "NKF1")
      for n, f in (("north", "PN"), ("east", "PE"))),
    *(Rule(n, k, (f,), _ONE, "m/s, estimated by ArduPilot", takes="m/s") for k in ("XKF2", "NKF2")
      for n, f in (("wind_north", "VWN"), ("wind_east", "VWE"))),
)  # fmt: skip
"""What needs no setting of the autopilot, by preference."""
_AETR = (("de", "Elev", -1.0), ("da", "Ail", 1.0), ("dr", "Rudd", -1.0))
_OUTPUTS = {"RCOU": range(1, 15), "RCO2": range(15, 19), "RCO3": range(19, 33)}
_CHOICE = {"IMU": ("GH", "AH"), "ARSP": ("U", "H", "Pri"), "GPS": ("U", "Status"), "BARO": ("H", "Health"),
           "XKF4": ("PI",), "NKF4": ("PI",)}  # fmt: skip
"""What says which instance is healthy, in use or first."""
COLUMNS: Mapping[str, tuple[str, ...]] = {
    **{kind: tuple({f for rule in RULES if rule.topic == kind for f in rule.fields} | set(_CHOICE.get(kind, ())))
       for kind in (*dict.fromkeys(rule.topic for rule in RULES), "XKF4", "NKF4")},
    "AETR": ("Elev", "Ail", "Rudd", "Thr"),
    "MODE": ("ModeNum", "Mode"),
    **{kind: tuple(f"C{i}" for i in outputs) for kind, outputs in _OUTPUTS.items()},
}  # fmt: skip
"""Type of message -> the columns of it that are read."""

_UNITS = {"rad/s": {"deg/s": DEG_RAD}, "deg": {"rad": 1.0 / DEG_RAD, "degheading": 1.0}, "m/s": {"km/h": 1.0 / 3.6},
          "m/s/s": {"G": G0_M_S2, "m/s2": 1.0, "m/s^2": 1.0}, "m": {"ft": 0.3048}, "Pa": {"hPa": 100.0}}  # fmt: skip
"""Unit that a rule takes -> other units that a log may state for it -> factor."""


@dataclass(frozen=True)
class Mix:
    """How servos make a surface: its channel, parts of the servos by SERVOn_FUNCTION, the words."""

    surface: str
    parts: Mapping[int, float]
    said: str


MIXES = (
    Mix("de", {19: 1.0}, "elevator"),
    Mix("de", {77: 0.5, 78: 0.5}, "half the sum of the elevons"),
    Mix("de", {79: 0.5, 80: 0.5}, "half the sum of the V-tail's surfaces"),
    Mix("da", {4: 1.0}, "aileron"),
    Mix("da", {77: -0.5, 78: 0.5}, "half the difference of the elevons, right minus left"),
    Mix("da", {24: 0.5, 25: 0.5}, "mean of the flaperons, in which flaps cancel"),
    Mix("dr", {21: 1.0}, "rudder"),
    Mix("dr", {79: 0.5, 80: -0.5}, "half the difference of the V-tail's surfaces, left minus right"),
    Mix("thr", {70: 1.0}, "throttle"),
    Mix("thr", {73: 0.5, 74: 0.5}, "mean of the left and right throttles"),
)
"""By preference: a surface of its own before one that is mixed. Signs are those of the demands."""
_SPLIT = (16, 17, 86, 87)  # left and right outer, left and right inner surfaces of split elevons
_IMUS = 3  # of which positions are set
_IN_USE = 0.5  # of the time that a sensor says it is in use: below it another one is looked for
_SIGN = {"de": -1.0, "da": 1.0, "dr": -1.0, "thr": 1.0}
"""From the demand, positive nose up, right wing down, nose right, to the channel table."""
_USUAL = {"da": 1, "de": 2, "thr": 3, "dr": 4}
"""The output that drives a surface where no setting says so."""

_FILTERS = {"INS_GYRO_FILTER": ("IMU", "p q r"), "INS_ACCEL_FILTER": ("IMU", "ax ay az")}
"""Low passes of second order before IMU is logged (AP_InertialSensor); GYR and ACC are raw."""


def split_mixes(full_span: bool, pitch: bool) -> Iterator[Mix]:
    """Return the mixes of split elevons (differential spoilers): inner and outer surface on each wing.

    The rudder's demand opens the pair of one wing, the outer surface upwards, the inner one downwards: it cancels in
    their sum. Without ``full_span`` only the outer surface follows elevator and aileron, so their sum is that surface.
    """
    half = 0.25 if full_span else 0.5
    if pitch:
        yield Mix("de", dict.fromkeys(_SPLIT, half), "mean of the split elevons, in which the rudder's part cancels")
    yield Mix(
        "da", {16: -half, 86: -half, 17: half, 87: half}, "half the difference of the split elevons, right minus left"
    )
    yield Mix(
        "dr",
        {16: -0.5, 86: 0.5, 17: 0.5, 87: -0.5} if full_span else {86: 1.0, 87: -1.0},
        "how much further the split elevons of the right wing open than those of the left",
    )


def ardupilot_rules(log: Log) -> tuple[Log, tuple[Rule, ...]]:
    """Return the log with what it says on its own sensors, and the rules for it by its own settings.

    Servo outputs count where the settings name what they drive, because limits and mixing are in them; else the demands
    of AETR; else the usual outputs, which is said. The sensors and the lane of the filter that the autopilot used are
    preferred.
    """
    preferred, notes = _preferred(log)
    log = flown(replace(log, preferred={**log.preferred, **preferred}, notes=(*log.notes, *notes)))
    rules = tuple(_ordered(log))
    if log.vehicle in ("", "fixed wing", "VTOL"):  # the outputs of others are motors, wheels and fins
        rules = (*rules, *servo_rules(log, True), *_demands(log), *servo_rules(log, False))
    strange: list[str] = []
    known = [adapted for rule in rules if (adapted := _in_unit(log, rule, strange)) is not None]
    notes = [*strange, *too_slow(log, known, _BETTER)]
    places = {i: placed(log.parameters, f"INS_POS{i + 1}_") for i in range(_IMUS)}
    imu = {i: place for i, place in places.items() if place}
    return replace(log, notes=(*log.notes, *notes), imu_m=imu, filtered_hz=filters(log.parameters, _FILTERS)), tuple(
        known
    )


def flown(log: Log) -> Log:
    """Return the log with its vehicle, by firmware and settings, its modes, and where it hovers."""
    vehicle, said = _vehicle(log)
    modes = _modes(log, vehicle)
    lift = (np.array([m.t_s for m in modes]), np.array([m.name.startswith("Q") for m in modes]))  # QHOVER, QLAND, ...
    return replace(
        log,
        vehicle=vehicle,
        modes=modes,
        flags={"hover": lift} if vehicle == "VTOL" and modes else {},
        topics=without(log, ("MODE",)),
        facts={**log.facts, **({"vehicle": said} if said else {})},
    )


_FIRMWARE = {"Copter": "rotorcraft", "Plane": "fixed wing", "Rover": "other", "Sub": "other", "Blimp": "other",
             "AntennaTracker": "other", "Heli": "rotorcraft"}  # fmt: skip
_FRAMES = ("", "quadrotor", "hexarotor", "octorotor", "octaquad", "Y6", "helicopter", "tricopter", "single copter",
           "coaxial copter", "bicopter", "dodeca-hexa", "dual helicopter", "deca", "scripted", "dynamic")  # fmt: skip
_PLANE_MODES = (
    "MANUAL CIRCLE STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE - AUTO RTL LOITER TAKEOFF AVOID_ADSB "
    "GUIDED INITIALISING QSTABILIZE QHOVER QLOITER QLAND QRTL QAUTOTUNE QACRO THERMAL LOITER_ALT_QLAND "
    "AUTOLAND"
)
_COPTER_MODES = (
    "STABILIZE ACRO ALT_HOLD AUTO GUIDED LOITER RTL CIRCLE POSITION LAND OF_LOITER DRIFT - SPORT FLIP "
    "AUTOTUNE POSHOLD BRAKE THROW AVOID_ADSB GUIDED_NOGPS SMART_RTL FLOWHOLD FOLLOW ZIGZAG SYSTEMID "
    "AUTOROTATE AUTO_RTL TURTLE"
)
"""Modes by their numbers, from 0."""
_FLOWN = {
    "manual": "MANUAL", "stabilised": "STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE QSTABILIZE QHOVER QLOITER "
    "QAUTOTUNE QACRO ALT_HOLD LOITER POSHOLD DRIFT SPORT FLIP BRAKE FLOWHOLD SYSTEMID ZIGZAG",
    "automatic": "CIRCLE AUTO RTL TAKEOFF AVOID_ADSB GUIDED QLAND QRTL THERMAL LOITER_ALT_QLAND AUTOLAND LAND THROW "
    "SMART_RTL GUIDED_NOGPS FOLLOW AUTO_RTL AUTOROTATE POSITION",
}  # fmt: skip


def _vehicle(log: Log) -> tuple[str, str]:
    """Return what flew, one of VEHICLES, and the words for it, by firmware and settings; "" if neither tells."""
    settings, software = log.parameters, log.facts.get("software", "")
    kind = next((vehicle for word, vehicle in _FIRMWARE.items() if word in software), "")
    if not kind and {"MOT_SPIN_ARM", "MOT_THST_EXPO"} & settings.keys():
        kind = "rotorcraft"
    if settings.get("Q_ENABLE", 0.0) > 0.0 and kind in ("", "fixed wing"):
        return "VTOL", f"QuadPlane, {_frame(settings, 'Q_FRAME_CLASS') or 'lift motors'} (Q_ENABLE)"
    if kind == "rotorcraft":
        return kind, _frame(settings, "FRAME_CLASS") or "rotorcraft"
    return kind, ""


def _frame(settings: Mapping[str, float], key: str) -> str:
    number = int(settings.get(key, 0.0))
    return f"{_FRAMES[number]} ({key} {number})" if 0 < number < len(_FRAMES) else ""


def _modes(log: Log, vehicle: str) -> tuple[Mode, ...]:
    topic = log.topics.get("MODE")
    column = "ModeNum" if topic is not None and "ModeNum" in topic.columns else "Mode"
    names = _COPTER_MODES if vehicle == "rotorcraft" else _PLANE_MODES if vehicle in ("fixed wing", "VTOL") else ""
    return modes_of(topic, column, dict(enumerate(names.split())), {**_FLOWN, **_LOITERS.get(vehicle, {})})


_LOITERS = {vehicle: {"automatic": f"{_FLOWN['automatic']} LOITER"} for vehicle in ("fixed wing", "VTOL")}
"""A plane circles by itself in LOITER; a copter is flown by its pilot there."""

_BETTER = (
    "LOG_BITMASK: bit 0 (fast attitude) or 20 (attitude at the loop's rate), 13 (servo outputs), 19 (raw inertial "
    "data: GYR and ACC at the sensor's rate); SCHED_LOOP_RATE bounds all but the last"
)


def _ordered(log: Log) -> list[Rule]:
    """Put the raw inertial data first where they were logged faster than those of IMU."""
    slow, fast = (log.topics.get(kind) for kind in ("IMU", "GYR"))
    if fast is None or (slow is not None and slow.t_s.size >= fast.t_s.size):
        return list(RULES)
    return sorted(RULES, key=lambda rule: rule.topic not in ("GYR", "ACC"))  # stable: the rest keeps its order


def _preferred(log: Log) -> tuple[dict[str, tuple[str, str]], list[str]]:
    """Return topic -> the instance that the autopilot used, where it is not the first, and sentences on it."""
    wanted: dict[str, tuple[int, str]] = {}
    notes = []
    for kind in ("XKF", "NKF"):
        core, share = _most(topic.columns.get("PI") for topic in _instances(log, f"{kind}4"))
        if core or share < 1.0:
            said = f"the autopilot flew by core {core} of {kind} for {100.0 * share:.3g} % of the time"
            notes.append(said)
            wanted |= {f"{kind}1": (core, said), f"{kind}2": (core, said)}
            wanted |= {sensor: (_unit(log, core), said) for sensor in ("IMU", "GYR", "ACC")}
    first, share = _most(topic.columns.get("Pri") for topic in _instances(log, "ARSP"))
    if first or share < 1.0:
        wanted["ARSP"] = (first, f"the log calls airspeed {first} the first for {100.0 * share:.3g} % of the time")
        notes.append(wanted["ARSP"][1])
    for kind in ("ARSP", "GPS"):
        use = {t.name: float(np.mean(t.columns["U"] != 0)) for t in _instances(log, kind) if "U" in t.columns}
        taken = kind if kind not in wanted else _named(kind, wanted[kind][0])
        if use and use.get(taken, 1.0) < _IN_USE:
            said = f"{taken} was in use for {100.0 * use[taken]:.3g} % of the time, by its own flag"
            notes.append(said)
            best = max(use, key=lambda name: use[name])
            if use[best] > use[taken]:
                wanted[kind] = (int(best.partition("#")[2] or 0), said)
    named = {kind: (_named(kind, number), said) for kind, (number, said) in wanted.items()}
    return {kind: value for kind, value in named.items() if value[0] in log.topics and value[0] != kind}, notes


def _instances(log: Log, kind: str) -> list[Topic]:
    return [topic for name, topic in sorted(log.topics.items()) if name.partition("#")[0] == kind]


def _named(kind: str, number: int) -> str:
    return f"{kind}#{number}" if number else kind


def _most(columns: Iterable[NDArray[Any] | None]) -> tuple[int, float]:
    """Return the number that the first column holds most often, and its share; 0 and 1 without a column."""
    column = next((c for c in columns if c is not None and c.size), None)
    if column is None:
        return 0, 1.0
    counts = np.bincount(np.clip(column.astype(np.int64), 0, 255))
    return int(counts.argmax()), float(counts.max() / column.size)


def _unit(log: Log, core: int) -> int:
    """Return the inertial unit of a core: the cores are given to the units that the mask holds, in turn."""
    mask = int(log.parameters.get("EK3_IMU_MASK", 0.0))
    held = [i for i in range(8) if mask >> i & 1]
    return held[core] if core < len(held) else core


def _in_unit(log: Log, rule: Rule, notes: list[str]) -> Rule | None:
    """Return the rule for the unit that the log states; None if that unit is of another kind."""
    topic = next(iter(_instances(log, rule.topic)), None)
    stated = topic.units.get(rule.fields[0], "") if topic is not None and rule.takes else ""
    if stated in ("", "UNKNOWN", rule.takes, "instance"):
        return rule
    factor = _UNITS[rule.takes].get(stated)
    if factor is None:
        notes.append(
            f"{rule.topic}.{rule.fields[0]} is not read as {rule.channel}: the log states its unit as {stated}, "
            f"{rule.takes} is known"
        )
        return None
    if factor == 1.0:
        return rule
    return replace(rule, convert=partial(_after, rule, factor), said=f"{rule.said}; the log states {stated}")


def _after(rule: Rule, factor: float, x: FloatArray) -> FloatArray:
    return rule.convert(factor * x)


def _demands(log: Log) -> Iterator[Rule]:
    """Return the rules for the demands before mixing."""
    settings = log.parameters
    functions = {settings.get(f"SERVO{i}_FUNCTION") for i in range(1, 33)}
    gain = settings.get("MIXING_GAIN", 0.5)
    for name, column, sign in _AETR:
        mixed = [m for m in MIXES if m.surface == name and functions >= set(m.parts)][:1]
        halved = bool(mixed) and bool(set(mixed[0].parts) & {77, 78, 79, 80})
        factor, said = sign / 4500.0, f"{'minus ' if sign < 0.0 else ''}the demand / 4500 times full throw"
        if halved:
            factor, said = factor * gain, f"{said} and MIXING_GAIN, {gain:g}"
        yield Rule(f"{name}_cmd", "AETR", (column,), scaled(factor), said, _DEMAND)
    yield Rule("thr_cmd", "AETR", ("Thr",), scaled(PERCENT), "%")


def servo_rules(log: Log, named: bool) -> Iterator[Rule]:
    """Return the rules for servo pulses: those whose function the settings name, or the usual outputs where none is.

    A pulse becomes a part of full throw by SERVOn_TRIM (zero), _MIN, _MAX (full) and _REVERSED; several servos of one
    function are averaged.
    """
    settings = log.parameters
    outputs: dict[int, list[int]] = {}
    for i in range(1, 33):
        if settings.get(f"SERVO{i}_FUNCTION"):
            outputs.setdefault(int(settings[f"SERVO{i}_FUNCTION"]), []).append(i)
    if named:
        options = int(settings.get("DSPOILER_OPTS", 3.0))
        mixes = (*MIXES, *split_mixes(bool(options & 2), bool(options & 1)))
    for name in CONTROLS:
        if not named:
            stated = f"SERVO{_USUAL[name]}_FUNCTION" in settings
            if not stated and not any(name == mix.surface and outputs.keys() & mix.parts.keys() for mix in MIXES):
                guess = f"output {_USUAL[name]} drives it and its ends are those, as usual; no setting states this"
                yield from _servo_rule(log, Mix(name, {0: 1.0}, ""), {0: [_USUAL[name]]}, guess)
            continue
        fitting = [mix for mix in mixes if mix.surface == name and mix.parts.keys() <= outputs.keys()]
        beside = [mix.said for mix in fitting[1:] if not mix.parts.keys() & fitting[0].parts.keys()]
        assumed = f"the aircraft also has: {', '.join(beside)}; these are not in it" if beside else ""
        for mix in fitting[:1]:
            yield from _servo_rule(log, mix, outputs, assumed)


def _servo_rule(log: Log, mix: Mix, outputs: Mapping[int, list[int]], assumed: str) -> Iterator[Rule]:
    driven = [(i, part / len(outputs[f])) for f, part in mix.parts.items() for i in outputs[f]]
    topic = next((t for t, range_ in _OUTPUTS.items() if all(i in range_ for i, _ in driven)), "")
    if not topic:
        return
    settings = log.parameters
    both_ways = mix.surface != "thr" or settings.get("THR_MIN", 0.0) < 0.0
    servos, said = [], []
    for i, part in driven:
        low, trim, high = (
            settings.get(f"SERVO{i}_{key}", usual) for key, usual in (("MIN", 1000.0), ("TRIM", 1500.0), ("MAX", 2e3))
        )
        if not low < high or (both_ways and not low < trim < high):
            return
        turned = settings.get(f"SERVO{i}_REVERSED") == 1.0
        servos.append(Servo(low, trim if both_ways else None, high, turned, part))
        said.append(
            f"servo {i}, {low:g} to {high:g} us"
            + (f", centre {trim:g} us" if both_ways else "")
            + (", reversed" if turned else "")
        )
    what = f"{mix.said}: " if mix.said else ""
    minus = ", times -1" if _SIGN[mix.surface] < 0.0 else ""
    fields = tuple(f"C{i}" for i, _ in driven)
    convert = partial(_from_pulses, tuple(servos), _SIGN[mix.surface])
    yield Rule(f"{mix.surface}_cmd", topic, fields, convert, what + "; ".join(said) + minus, assumed)


@dataclass(frozen=True)
class Servo:
    """The ends of a servo's pulse, us, its pulse for a demand of zero (None: the lower end), and its part in a mix."""

    low: float
    trim: float | None
    high: float
    reversed_: bool
    part: float

    def demand(self, pulse: FloatArray) -> FloatArray:
        """Return the demand, -1 to 1 or, without trim, 0 to 1, that gave the pulse."""
        if self.trim is None:
            fraction = (pulse - self.low) / (self.high - self.low)
            return 1.0 - fraction if self.reversed_ else fraction
        off = pulse - self.trim
        part = np.where(off > 0.0, off / (self.high - self.trim), off / (self.trim - self.low))
        return -part if self.reversed_ else part


def _from_pulses(servos: tuple[Servo, ...], sign: float, *pulses: FloatArray) -> FloatArray:
    parts = [servo.part * servo.demand(pulse) for servo, pulse in zip(servos, pulses, strict=True)]
    off = np.any(np.asarray(pulses) <= 0.0, axis=0)  # no pulse at all: the output was switched off
    return np.where(off, np.nan, sign * np.sum(parts, axis=0))
