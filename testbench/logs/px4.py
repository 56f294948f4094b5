"""How PX4's topics become channels: which estimate, which airspeed, and what the servos mean.

Facts: PX4 guide (messages, control allocation, logging) and PX4's lists of logged topics and of parameters. Frames:
body forward-right-down, attitude quaternion (w, x, y, z) from it to north-east-down; torque commands turn right-handed
about those axes. A servo's command of 1 is its surface fully up (a rudder: fully right); CA_SV_CSi_TRQ_R, _P and _Y say
how much torque about roll, pitch and yaw it then gives, of the most that all give.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.logs.rates import too_slow
from testbench.logs.signals import AT_IMU, Log, Rule, filters, modes_of, placed, scaled, without
from testbench.logs.vectors import euler

CLOCK, SAMPLED = "timestamp", "timestamp_sample"
"""When a topic was published, and when its sensor was read."""
_COMMAND = "PX4 normalises commands to -1..1; positive turns right-handed about the body axis"
_AXES = ("roll", "pitch", "yaw")
_SURFACES = (("da_cmd", "R", 1.0), ("de_cmd", "P", -1.0), ("dr_cmd", "Y", -1.0))
"""Command of each axis, the letter of its torque setting, sign from a right-handed torque to the channel table."""


def sampled(published: NDArray[Any], read: NDArray[Any] | None) -> NDArray[Any]:
    """Return the times of a topic: when its sensor was read, unless one sample of it was published several times."""
    taken = read is not None and np.all((read > 0) & (read <= published)) and np.all(np.diff(read))
    return read if taken and read is not None else published


def _vector(names: str, topic: str, field: str, said: str, assumed: str = "") -> list[Rule]:
    return [Rule(n, topic, (f"{field}[{i}]",), scaled(1.0), said, assumed) for i, n in enumerate(names.split())]


def _rules() -> tuple[Rule, ...]:
    q = tuple(f"q[{i}]" for i in range(4))
    rules = _vector("p q r", "vehicle_angular_velocity", "xyz", "rad/s, as logged")
    rules += [
        Rule(n, "vehicle_attitude", (f,), scaled(1.0), "rad/s, as logged")
        for n, f in (("p", "rollspeed"), ("q", "pitchspeed"), ("r", "yawspeed"))
    ]
    rules += _vector("p q r", "sensor_combined", "gyro_rad", "rad/s, as logged")
    rules += _vector("pdot qdot rdot", "vehicle_angular_acceleration", "xyz", "rad/s2, as logged, filtered by PX4")
    rules += _vector("pdot qdot rdot", "vehicle_angular_velocity", "xyz_derivative", "rad/s2, filtered by PX4")
    for i, name in enumerate(("phi", "theta", "psi")):
        angle = partial(euler, i, "frd")
        rules.append(Rule(name, "vehicle_attitude", q, angle, "Euler angle (3-2-1) of the quaternion"))
    rules += _vector("ax ay az", "vehicle_acceleration", "xyz", "m/s2, as logged", AT_IMU)
    rules += _vector("ax ay az", "sensor_combined", "accelerometer_m_s2", "m/s2, as logged", AT_IMU)
    one = scaled(1.0)
    minus = scaled(-1.0)
    rules += [
        Rule("V", "airspeed_validated", ("true_airspeed_m_s",), one, "true airspeed, m/s"),
        Rule("V", "airspeed", ("true_airspeed_m_s",), one, "true airspeed, m/s"),
        Rule("qbar", "differential_pressure", ("differential_pressure_pa",), one, "Pa", _AS_MEASURED),
        Rule("qbar", "differential_pressure", ("differential_pressure_filtered_pa",), one, "Pa, filtered by PX4",
             _AS_MEASURED),
        Rule("h", "vehicle_air_data", ("baro_alt_meter",), one, "m, barometric"),
        Rule("h", "vehicle_global_position", ("alt",), one, "m above sea level"),
        Rule("hdot", "vehicle_local_position", ("vz",), minus, "m/s, minus the velocity downwards"),
        Rule("Vg", "vehicle_local_position", ("vx", "vy"), np.hypot, "m/s, length of the horizontal velocity"),
        Rule("north", "vehicle_local_position", ("x",), one, "m, from the local origin"),
        Rule("east", "vehicle_local_position", ("y",), one, "m, from the local origin"),
    ]  # fmt: skip
    for topic in ("wind", "wind_estimate"):
        for name, column in (("wind_north", "windspeed_north"), ("wind_east", "windspeed_east")):
            rules.append(Rule(name, topic, (column,), one, "m/s, estimated by PX4"))
    return tuple(rules)


_AS_MEASURED = "incompressible: qbar is the measured pressure"
RULES = _rules()
"""What needs no setting of the autopilot, by preference."""
SERVOS = 8
_IMUS = 4  # one position is set for all
_CHOICE = {"airspeed_validated": ("selected_airspeed_index", "airspeed_source")}
"""What says which of several sensors was flown by."""
_TORQUE, _THRUST, _OLD = "vehicle_torque_setpoint", "vehicle_thrust_setpoint", "actuator_controls_0"
_ROTARY = {2: "quadrotor", 3: "coaxial helicopter", 4: "helicopter", 13: "hexarotor", 14: "octorotor", 15: "tricopter"}
_FIXED_WING = 1  # MAV_TYPE
_OLD_VTOL = "actuator_controls_1"  # of VTOL aircraft before control allocation: the fixed wing's commands

COLUMNS: Mapping[str, tuple[str, ...]] = {
    **{topic: tuple({f for rule in RULES if rule.topic == topic for f in rule.fields} | set(_CHOICE.get(topic, ())))
       for topic in dict.fromkeys(rule.topic for rule in RULES)},
    _TORQUE: tuple(f"xyz[{i}]" for i in range(3)),
    _THRUST: ("xyz[0]",),
    "actuator_servos": tuple(f"control[{i}]" for i in range(SERVOS)),
    **{topic: tuple(f"control[{i}]" for i in range(4)) for topic in (_OLD, _OLD_VTOL)},
    "estimator_selector_status": ("primary_instance",),
    "vehicle_status": ("nav_state", "vehicle_type", "is_rotary_wing", "in_transition_mode", "is_vtol"),
    "vehicle_land_detected": ("landed",),
}  # fmt: skip
COLUMNS = {
    **COLUMNS,
    "airspeed_validated": (*COLUMNS["airspeed_validated"], "airspeed_source", "selected_airspeed_index"),
}
"""Topic -> the columns of it that are read, beside its times."""
_TORQUES = {
    1: (-0.5, 0.0, 0.0), 2: (0.5, 0.0, 0.0), 3: (0.0, 1.0, 0.0), 4: (0.0, 0.0, 1.0), 5: (-0.5, 0.5, 0.0),
    6: (0.5, 0.5, 0.0), 7: (0.0, 0.5, 0.5), 8: (0.0, 0.5, -0.5), 13: (0.0, 0.5, 0.5), 14: (0.0, 0.5, -0.5),
    15: (1.0, 0.0, 0.0),
}  # fmt: skip
"""CA_SV_CSi_TYPE -> torque about roll, pitch and yaw where CA_SV_CSi_TRQ_x is not in the log: PX4's own defaults."""
_NAMES = {
    1: "left aileron", 2: "right aileron", 3: "elevator", 4: "rudder", 5: "left elevon", 6: "right elevon",
    7: "left V-tail", 8: "right V-tail", 12: "custom", 13: "left A-tail", 14: "right A-tail", 15: "aileron",
}  # fmt: skip
_NO_TORQUE = (9, 10, 11, 16, 17, 18)  # flaps, airbrakes, steering wheel, spoilers
_TAILSITTER, _VTOLS = 4, (2, 3, 4)  # CA_AIRFRAME
_KEPT = 0.8  # of the rate of torque set-points that the servos must have been logged at, to be taken in their place
_BETTER = (
    "SDLOG_PROFILE: bit 4 (high rate: angular velocity, attitude, torque set-points and servos) and bit 3 (system "
    "identification: acceleration), 25 with the default topics"
)

_FILTERS = {
    "IMU_GYRO_CUTOFF": ("vehicle_angular_velocity", "p q r"),
    "IMU_ACCEL_CUTOFF": ("vehicle_acceleration", "ax ay az"),
}
"""Low passes of second order before the topic is published (VehicleAngularVelocity, VehicleAcceleration)."""


def px4_rules(log: Log) -> tuple[Log, tuple[Rule, ...]]:
    """Return the log with what was chosen and what would serve better, and the rules for it by its own settings.

    Servo outputs count where the settings say which surface each drives and they were logged as fast as the torque
    set-points, because they hold limits, flaps and trim; else torque set-points; else the commands of actuator_controls
    (PX4 before control allocation).
    """
    notes: list[str] = []
    log = _flown(log)
    servos = list(servo_rules(log))
    held = [rule for rule in servos if rule.topic in log.topics]
    torques = list(_torque_rules(log))
    rates = [_rate(log, rules[0].topic) for rules in (held, torques) if rules]
    if held and len(rates) == 2 and rates[0] < _KEPT * rates[1]:
        notes.append(
            f"commands of surfaces are torque set-points ({rates[1]:.3g} Hz): actuator_servos, which would also "
            f"contain limits and flaps, was logged at {rates[0]:.3g} Hz only"
        )
        servos = []
    elif held and rates[-1] > 0.0:
        notes.append("commands of surfaces are servo outputs, mixed by the log's own CA_SV_CS settings")
    elif "actuator_servos" in log.topics:
        notes.append(
            "actuator_servos is not read: no CA_SV_CSi_TYPE or _TRQ_R, _P, _Y states the surface of each servo"
            if log.parameters.get("CA_AIRFRAME") != _TAILSITTER
            else "actuator_servos is not read: a tailsitter's surfaces act about other axes in hover and in flight"
        )
    if _selected(log, "airspeed_validated", "true_airspeed_m_s") and "airspeed" in log.topics:
        notes.append("V is airspeed_validated, which PX4 flew by; airspeed, the sensor alone, is not read")
    notes += [*_rotary(log), *_changes(log)]
    rules = (*RULES, *servos, *torques, *_thrust_rules(log), *_old_rules(log))
    notes += too_slow(log, rules, _BETTER)
    place = placed(log.parameters, "EKF2_IMU_POS_")
    imu = dict.fromkeys(range(_IMUS), place) if place else {}
    return replace(log, notes=(*log.notes, *notes), imu_m=imu, filtered_hz=filters(log.parameters, _FILTERS)), rules


_MODES = {0: "MANUAL", 1: "ALTCTL", 2: "POSCTL", 3: "AUTO_MISSION", 4: "AUTO_LOITER", 5: "AUTO_RTL", 8: "AUTO_SLOW",
          10: "ACRO", 12: "DESCEND", 13: "TERMINATION", 14: "OFFBOARD", 15: "STABILIZED", 17: "AUTO_TAKEOFF",
          18: "AUTO_LAND", 19: "AUTO_FOLLOW", 20: "AUTO_PRECLAND", 21: "ORBIT", 22: "AUTO_VTOL_TAKEOFF"}  # fmt: skip
"""nav_state of vehicle_status."""
_BY = {
    "manual": "MANUAL", "stabilised": "STABILIZED ACRO ALTCTL POSCTL",
    "automatic": " ".join(n for n in _MODES.values() if n.startswith("AUTO")) + " OFFBOARD ORBIT DESCEND TERMINATION",
}  # fmt: skip
_PLANE_AIRFRAME = 1  # CA_AIRFRAME
_ROTARY_TYPE = 1  # vehicle_type of vehicle_status


def _flown(log: Log) -> Log:
    """Return the log with what it says of its vehicle, modes, landings, hovers and transitions."""
    settings, status = log.parameters, log.topics.get("vehicle_status")
    landed = log.topics.get("vehicle_land_detected")
    flags = {}
    if landed is not None and "landed" in landed.columns:
        flags["landed"] = (landed.t_s, landed.columns["landed"] != 0)
    kind, frame = int(settings.get("MAV_TYPE", 0)), int(settings.get("CA_AIRFRAME", -1))
    vtol = "VT_TYPE" in settings or frame in _VTOLS
    vehicle = "VTOL" if vtol else "rotorcraft" if kind in _ROTARY else ""
    if not vehicle and (kind == _FIXED_WING or frame == _PLANE_AIRFRAME):
        vehicle = "fixed wing"
    if status is not None and vtol:
        for name, columns, on in (
            ("hover", ("vehicle_type", "is_rotary_wing"), _ROTARY_TYPE),
            ("transition", ("in_transition_mode",), 1),
        ):
            column = next((c for c in columns if c in status.columns), None)
            flags |= {name: (status.t_s, status.columns[column] == on)} if column else {}
    said = {"vehicle": _ROTARY.get(kind, vehicle) if vehicle == "rotorcraft" else vehicle} if vehicle else {}
    return replace(
        log,
        vehicle=vehicle,
        modes=modes_of(status, "nav_state", _MODES, _BY),
        flags=flags,
        facts={**log.facts, **said},
        topics=without(log, ("vehicle_status", "vehicle_land_detected")),
    )


def _rate(log: Log, topic: str) -> float:
    held = log.topics.get(topic)
    return 0.0 if held is None or held.t_s.size < 2 else (held.t_s.size - 1) / float(held.t_s[-1] - held.t_s[0])


def _selected(log: Log, topic: str, column: str) -> bool:
    held = log.topics.get(topic)
    return held is not None and column in held.columns and bool(np.any(np.isfinite(held.columns[column])))


def _changes(log: Log) -> Iterator[str]:
    """Say if PX4 changed the estimator or the airspeed that it flew by: the topics read follow it, with a step."""
    for topic, columns, what in (
        ("estimator_selector_status", ("primary_instance",), "attitude, position and wind come from the estimator"),
        ("airspeed_validated", ("selected_airspeed_index", "airspeed_source"), "V comes from the airspeed sensor"),
    ):
        held = log.topics.get(topic)
        column = next((c for c in columns if held is not None and c in held.columns), None)
        if held is None or column is None:
            continue
        used, counts = np.unique(held.columns[column], return_counts=True)
        if used.size > 1 or (topic.startswith("estimator") and used[0] != 0):
            parts = ", ".join(
                f"{int(u)} for {100.0 * n / counts.sum():.3g} %" for u, n in zip(used, counts, strict=True)
            )
            yield f"{what} that PX4 flew by: instance {parts} of the time"


def _rotary(log: Log) -> Iterator[str]:
    """Say of a multicopter or helicopter that its demands move no control surface."""
    kind = _ROTARY.get(int(log.parameters.get("MAV_TYPE", 0)))
    if kind is not None:
        yield (
            f"the log is of a {kind} (MAV_TYPE {log.parameters['MAV_TYPE']:g}): no fixed-wing control surface was "
            "found; da_cmd, de_cmd and dr_cmd are the commands of its rotors"
        )


def servo_rules(log: Log) -> Iterator[Rule]:
    """Return the rules for servo outputs: for each axis the mean of the servos, weighted by their torque settings."""
    settings = log.parameters
    if settings.get("CA_AIRFRAME") == _TAILSITTER:
        return
    surfaces = []
    for i in range(int(min(settings.get("CA_SV_CS_COUNT", SERVOS), SERVOS))):
        kind = int(settings.get(f"CA_SV_CS{i}_TYPE", 0))
        usual = _TORQUES.get(kind, (0.0, 0.0, 0.0))
        torque = [settings.get(f"CA_SV_CS{i}_TRQ_{axis}", t) for axis, t in zip("RPY", usual, strict=True)]
        if kind and kind not in _NO_TORQUE:
            surfaces.append((i, _NAMES.get(kind, f"type {kind}"), torque))
    for axis, (name, letter, sign) in enumerate(_SURFACES):
        used = [(i, label, torque[axis]) for i, label, torque in surfaces if torque[axis]]
        if not used:
            continue
        total = sum(abs(weight) for _, _, weight in used)
        told = ", ".join(f"{weight / total:+.3g} of servo {i} ({label})" for i, label, weight in used)
        yield Rule(
            name,
            "actuator_servos",
            tuple(f"control[{i}]" for i, _, _ in used),
            partial(_weighted, tuple(sign * weight / total for _, _, weight in used)),
            f"{'minus ' if sign < 0.0 else ''}the sum of {told}, by CA_SV_CS_TRQ_{letter}",
        )


def _weighted(weights: tuple[float, ...], *commands: FloatArray) -> FloatArray:
    return np.asarray(np.tensordot(weights, np.asarray(commands), axes=1))


def _wing(log: Log, topic: str) -> str:
    """Return the topic of the fixed wing's commands: the second instance of VTOL aircraft."""
    second = f"{topic}#1"
    return second if log.parameters.get("CA_AIRFRAME") in _VTOLS and second in log.topics else topic


def _commanded(axis: int, sign: float) -> str:
    return f"{'minus ' if sign < 0.0 else ''}the normalised {_AXES[axis]} command times full throw"


def _torque_rules(log: Log) -> Iterator[Rule]:
    topic = _wing(log, _TORQUE)
    if topic in log.topics:
        for axis, (name, _, sign) in enumerate(_SURFACES):
            yield Rule(name, topic, (f"xyz[{axis}]",), scaled(sign), _commanded(axis, sign), _COMMAND)


def _thrust_rules(log: Log) -> Iterator[Rule]:
    said = "normalised thrust command along body x"
    yield Rule("thr_cmd", _wing(log, _THRUST), ("xyz[0]",), scaled(1.0), said, "throttle is the thrust command")


def _old_rules(log: Log) -> Iterator[Rule]:
    yield from command_rules(_OLD_VTOL if "VT_TYPE" in log.parameters and _OLD_VTOL in log.topics else _OLD)


def command_rules(topic: str, field: str = "control[{}]") -> Iterator[Rule]:
    """Return the rules for normalised commands before the mixer: roll, pitch, yaw, thrust."""
    mixed = f"{_COMMAND}; the mixer after it, which is not in the log, gives each axis full throw"
    for axis, (name, _, sign) in enumerate(_SURFACES):
        yield Rule(name, topic, (field.format(axis),), scaled(sign), _commanded(axis, sign), mixed)
    said = "normalised thrust command"
    yield Rule("thr_cmd", topic, (field.format(3),), scaled(1.0), said, "throttle is the thrust command")
