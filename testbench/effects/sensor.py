"""Errors of sensors: bias, drift, scale, lag, delay, place and leaning of each channel, and a clock of their own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft
from testbench.core.channels import channel
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.kinds.pitot import Pitot
from testbench.sensors.triad import Triad

# Bounds and starts of a bias are for angles and rates in rad and rad/s and for speeds and accelerations in SI alike.
_KINDS = {
    "bias": (
        "bias",
        Parameter("bias", "SI", -50.0, 50.0, (0.05,), none=0.0),
        "The sensor reads a constant too much or too little. All other channels agree with the model.",
        "an error of the trim; it does not show where every channel is compared about its own mean",
        "a static check on the ground, or a kinematic compatibility check of the channels among each other",
    ),
    "drift": (
        "steady drift",
        Parameter("drift_per_s", "SI", -5.0, 5.0, (0.002, -0.002), none=0.0),
        "Electronics that warm up, or a port that ices or fills with water, cause a drift in proportion to time. The "
        "reading agrees with the model except for a straight line, which begins at the first sample of each record.",
        "a motion far slower than the record, such as an error of drag or thrust for an airspeed or a steady roll for "
        "a gyro; a bias with a random walk",
        "minutes on the ground, where the true reading stands still; a record of twice the length, and other "
        "channels, which a drift of this one does not change",
    ),
    "scale": (
        "scale error",
        Parameter("scale", "1", 0.5, 2.0, (1.02,), none=1.0),
        "A wrong calibration, or for a vane the upwash, makes the sensor read a multiple of the truth. "
        "Only its channel disagrees, in proportion to the value at every frequency.",
        "a bias if the quantity changes little; an error of coefficients that no other channel shows",
        "a wider range of the quantity, and another sensor that is tied to it by kinematics",
    ),
    "lag": (
        "lag beyond that of the suite",
        Parameter("lag_s", "s", 0.0, 1.0, (0.03, 0.15), none=0.0),
        "Inertia, tubing or a filter makes the sensor follow its quantity as a first-order lag. "
        "Only its channel disagrees, by phase and then by amplitude as the frequency rises.",
        "a delay of the same sensor while the quantity moves slowly against the lag",
        "inputs with frequencies beyond 1/lag, where the lag takes amplitude and the delay does not",
    ),
    "delay": (
        "delay beyond that of the suite",
        Parameter("delay_s", "s", 0.0, 1.0, (0.02, 0.1), none=0.0),
        "Filters, buses or time stamps make the sensor's samples late. "
        "Only its channel disagrees, by a phase in proportion to frequency and no amplitude.",
        "a lag of the same sensor while the quantity moves slowly; a delay of the command if all sensors share it",
        "inputs of high frequency, and a second sensor of another recorder",
    ),
    "position": (
        "place further forward than in the suite",
        Parameter("ahead_m", "m", -2.0, 2.0, (0.1, -0.1), none=0.0, of_span=0.5),
        "The sensor is ahead of or behind its assumed place. It also measures the rotation: an accelerometer qdot or "
        "rdot, a vane the motion of its boom.",
        "a lag or a lead of the same sensor at one frequency; a shift of the centre of gravity, for accelerometers",
        "a tape measure; inputs over a band of frequencies",
    ),
    "cross": (
        "cross sensitivity",
        Parameter("share", "1", -0.5, 0.5, (0.05, -0.05), none=0.0),
        "The sensor is not exactly aligned, or its port also responds to another quantity, of which it reads a share "
        "(that along another axis into an accelerometer or gyro, alpha into an airspeed). Its channel disagrees "
        "whenever that other one moves.",
        "an error of drag or thrust for an accelerometer, a cross derivative for a gyro; a scale error where both "
        "quantities move together",
        "a tilt table; thrust steps, or aileron and rudder in turn, which move one quantity and not the other",
    ),
}
# The axis whose quantity leaks into an inertial sensor that leans: of the two others the one that moves more.
_LEANS_TO = {"ax": "az", "ay": "az", "az": "ax", "p": "r", "q": "r", "r": "p"}
# kind of error -> the channels that the motion shows it in
_SHOWN = {"position": ("ay", "az", "alpha", "beta"), "cross": (*_LEANS_TO, "V"), "drift": ("p", "q", "r", "V")}
# Errors of a pitot tube in lateral motion, in the same order; other instruments of airspeed do not have them.
_OF_PITOT = {
    "sideslip": (
        "error in sideslip",
        Parameter("cp_beta2", "1/rad^2", -3.0, 3.0, (0.5, -0.5), none=0.0),
        "The flow across the fuselage lowers or raises the pressure at the static ports, to either side alike. "
        "The airspeed is off by half this multiple of the square of the sideslip.",
        "an error of the drag in sideslip, where no other channel shows that the aircraft slows down",
        "steady sideslips to both sides at one speed by GPS; a trailing cone or another static port",
    ),
    "position": (
        "place further to the right than in the suite",
        Parameter("right_m", "m", -20.0, 20.0, (0.3, -0.3), none=0.0),
        "The tube is beside the centre of gravity, on a wing or at its tip. In a turn it moves slower on the inner "
        "wing and faster on the outer one, by the yaw rate times its distance.",
        "a share of the yaw rate, or of the sideslip that goes with it, in the airspeed; asymmetric thrust or drag",
        "a tape measure; turns to both sides, whose errors are opposite",
    ),
}
# Parameters of one channel, where those of most are far from what is met: an airspeed drifts in m/s and not in rad/s,
# and follows through metres of narrow tube, seconds late at height or where water stands in it, as a lag and no delay.
_OF_CHANNEL = {
    ("V", "drift"): replace(_KINDS["drift"][1], starts=(0.05, -0.05)),
    ("V", "lag"): replace(_KINDS["lag"][1], high=5.0, starts=(0.03, 0.15, 0.8)),
    ("V", "delay"): replace(_KINDS["delay"][1], high=0.5),
}
# Where the check of the sensor does not show the error
_GROUND = {
    "drift": "let the sensor run at rest, from a cold start, for as long as a record lasts: a drift shows",
    "sideslip": "look whether the static ports on both sides are clean, open and joined; blow at them from the side",
    "position": "measure how far beside the middle of the aircraft the tube sits",
}
_ADDED = {"bias": "bias", "drift": "bias_rate", "lag": "lag_s", "delay": "delay_s"}  # kind -> what it is added to
_LATERAL = ("ay", "p", "q", "r")  # what leaks into these, or what they are, moves with aileron and rudder only
# kind of error -> form error; calibration and mounting have hardly another form
_FORM = {"bias": 0.01, "scale": 0.01, "lag": 0.01, "position": 0.01, "delay": 0.02, "sideslip": 0.1}


def amend(name: str, kind: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the error to what is believed of the sensor; a suite without that channel stays as it is."""
    sensors = (_wrong(s, kind, values) if s.channel == name else s for s in suite.sensors)
    return aircraft, replace(suite, sensors=tuple(sensors))


def _wrong(s: Sensor, kind: str, values: Values) -> Sensor:
    """Return the sensor with an error of that kind beside those that are believed.

    An inertial sensor that leans feels a share of another axis too, and the port of a pitot tube that of alpha.
    """
    ahead, right, down = s.position_m
    (size,) = values.values()
    if kind in _ADDED:
        return replace(s, **{_ADDED[kind]: getattr(s, _ADDED[kind]) + size})
    if kind == "scale":
        return replace(s, scale=s.scale * size)
    if "ahead_m" in values and s.channel in s.PLACED:  # an alpha that is corrected to the CG already has no place
        return replace(s, position_m=(ahead + size, right, down))
    if kind == "cross" and isinstance(s, Triad) and s.channel in _LEANS_TO:
        of = s.AXES.index(_LEANS_TO[s.channel])
        x, y, z = (c + (size if i == of else 0.0) for i, c in enumerate(s.cross_axis))
        return replace(s, cross_axis=(x, y, z))
    if not isinstance(s, Pitot):
        return s
    if kind == "cross":
        return replace(s, static_cp_alpha=s.static_cp_alpha + size)
    if kind == "sideslip":
        return replace(s, static_cp_beta2=s.static_cp_beta2 + size)
    return replace(s, position_m=(ahead, right + size, down)) if "right_m" in values else s


def clock_offset(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Stamp all sensors but the command log by a clock that is ahead by ``offset_s``, so that they seem late."""
    offset = values["offset_s"]
    if offset == 0.0:
        return aircraft, suite
    sensors = tuple(
        s
        if s.channel.endswith("_cmd")
        else replace(s, clock_offset_s=s.clock_offset_s + offset, recorder=s.recorder or "second recorder")
        for s in suite.sensors
    )
    return aircraft, replace(suite, sensors=sensors)


def sensor_effects(channels: Iterable[str], pitot: bool = False) -> dict[str, Effect]:
    """Return the errors of the sensors of ``channels``, by name (alpha_scale, q_lag, ...); a heading has no scale.

    With ``pitot``, those of an airspeed that a pitot tube reads are among them.
    """
    out = {}
    for name in channels:
        shown = {
            k: row for k, row in _KINDS.items() if name in _SHOWN.get(k, (name,)) and (name, k) != ("psi", "scale")
        }
        for kind, row in (shown | (_OF_PITOT if pitot and name == "V" else {})).items():
            words, usual, physics, mistaken_for, separated_by = row
            parameter = _OF_CHANNEL.get((name, kind), usual)
            unit = channel(name).unit
            per_s = f"{unit}2" if unit.endswith("/s") else f"{unit}/s"
            unit = {"bias": unit, "drift": per_s}.get(kind, parameter.unit)
            of_pitot = row is _OF_PITOT.get(kind)
            out[f"{name}_{kind}"] = Effect(
                name=f"{name}_{kind}",
                title=f"{words} of the {name} sensor",
                place=f"{name} sensor",
                physics=physics,
                parameters=(replace(parameter, unit=unit),),
                amend=partial(amend, name, kind),
                lateral=of_pitot or (kind == "cross" and name in _LATERAL),
                ground_check=_GROUND[kind] if of_pitot or kind == "drift" else "",
                mistaken_for=mistaken_for,
                separated_by=separated_by,
                form_error=_FORM.get(kind, Effect.form_error),
            )
    return out


def has_pitot(suite: SensorSuite) -> bool:
    """Return whether a pitot tube reads the airspeed."""
    return any(s.channel == "V" and isinstance(s, Pitot) for s in suite.sensors)


EFFECTS = (
    Effect(
        name="clock_offset",
        title="clock of the sensors apart from that of the commands",
        place="elevator",
        physics="Sensors and commands are logged by two recorders whose clocks differ by a constant. All sensors "
        "appear late or early by the same time relative to the commands, for every motion.",
        parameters=(Parameter("offset_s", "s", -0.3, 0.3, (0.02, -0.02), none=0.0),),
        amend=clock_offset,
        mistaken_for="a delay of the elevator command, exactly, where the elevator alone moves and the clock is ahead",
        separated_by="throttle steps, which a delay of the elevator's command leaves in time; a common event on both "
        "logs",
        form_error=0.02,
    ),
)
