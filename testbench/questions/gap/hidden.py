"""Measured records with a hidden truth, to test the workflow with: what flies here is not told to what names it.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from testbench.aircraft import Aircraft, Amendment, Insert, SetProperty, SetText, load_aircraft
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Manoeuvre as ManoeuvreSpec
from testbench.core.schema import NonNegative, Positive, Strict
from testbench.flight import FlightCondition, Manoeuvre, TrimmedFlight, fly, trim
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.sensors import SensorSuite


class FlexibleWings(Strict):
    """The aircraft flies with all its elastic modes."""

    kind: Literal["flexible_wings"]


class SlowServo(Strict):
    """The elevator servo lags with the given corner frequency."""

    kind: Literal["slow_servo"]
    corner_rad_s: Positive


class HighThrust(Strict):
    """The thruster sits above the centre of gravity."""

    kind: Literal["high_thrust"]
    offset_m: float


class VaneGain(Strict):
    """The alpha vane reads ``gain`` times the truth."""

    kind: Literal["vane_gain"]
    gain: Positive


class LateCommand(Strict):
    """The elevator command is sent this much after it is recorded, to the nearest frame."""

    kind: Literal["late_command"]
    delay_s: Positive


class SlewedCommand(Strict):
    """What is sent to the elevator servo changes no faster than this; the limit stands before the servo's lag."""

    kind: Literal["slewed_command"]
    rate_rad_s: Positive


class CommandGain(Strict):
    """The elevator is sent this multiple of the recorded change of the command."""

    kind: Literal["command_gain"]
    gain: float


class SluggishMotor(Strict):
    """The motor takes the throttle through a lag in two equal stages, half the given time constant each."""

    kind: Literal["sluggish_motor"]
    time_s: Positive


class ShiftedWing(Strict):
    """The aerodynamic centre and the accelerometers lie ahead of where they are believed, as if the CG were aft."""

    kind: Literal["shifted_wing"]
    ahead_m: float


class Ballast(Strict):
    """A point mass at the centre of gravity."""

    kind: Literal["ballast"]
    mass_kg: Positive


class Roughness(Strict):
    """More drag at zero lift."""

    kind: Literal["roughness"]
    CD0: float


class RateFeedback(Strict):
    """Pitch rate is fed to the elevator's trim input, rad per rad/s."""

    kind: Literal["rate_feedback"]
    gain_s: float


class YawFeedback(Strict):
    """Yaw rate, washed out with a time constant, is fed to the rudder's trim input, rad per rad/s."""

    kind: Literal["yaw_feedback"]
    gain_s: float
    washout_s: Positive


class SensorError(Strict):
    """The sensor of a channel has another scale, lag or delay."""

    kind: Literal["sensor_error"]
    channel: str
    gain: Positive = 1.0
    lag_s: NonNegative = 0.0
    delay_s: NonNegative = 0.0


class Nothing(Strict):
    """The believed model is right."""

    kind: Literal["nothing"]


Hidden = Annotated[
    FlexibleWings
    | SlowServo
    | HighThrust
    | VaneGain
    | LateCommand
    | SlewedCommand
    | CommandGain
    | SluggishMotor
    | ShiftedWing
    | Ballast
    | Roughness
    | RateFeedback
    | YawFeedback
    | SensorError
    | Nothing,
    Field(discriminator="kind"),
]


def measure_hidden(
    aircraft: str,
    wings: str,
    hidden: Hidden,
    suite: SensorSuite,
    condition: FlightCondition,
    manoeuvres: Sequence[ManoeuvreSpec],
    seed: int,
    rate_hz: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Mapping[str, FlightRecord]:
    """Fly the aircraft with its hidden truth and return name -> measured record; provenance is left out.

    Commands are issued at the rate of the suite's log and held, as an on-board computer does.

    Raises:
        TrimError, FlightAborted, LimitError: the hidden aircraft cannot fly these manoeuvres.
    """
    real, sensors = _real(load_aircraft(aircraft, wings), hidden, suite, aircraft)
    rate = rate_hz or real.rate_hz
    trimmed = trim(real, condition, rate)
    out = {}
    for i, spec in enumerate(manoeuvres):
        if progress:
            progress(f"fly {spec.name}")
        coarse = build(spec.input, spec.duration_s, suite.rate_hz)
        u = np.repeat(coarse.u, round(rate / suite.rate_hz), axis=0)
        sent = _sent(hidden, u, coarse.channels, 1.0 / rate)
        signal = InputSignal(np.arange(u.shape[0]) / rate, sent, coarse.channels)
        truth = fly(real, trimmed, Manoeuvre(spec.name, signal, spec.settle_s), suite.rate_hz)
        measured = replace(sensors.measure(truth, seed + i), provenance={"manoeuvre": spec.name})
        if isinstance(hidden, (LateCommand, SlewedCommand, CommandGain, SluggishMotor, RateFeedback, YawFeedback)):
            measured = _as_issued(measured, u, coarse.channels, trimmed, spec.settle_s)
        out[spec.name] = measured
    return out


def _sent(hidden: Hidden, u: FloatArray, channels: Sequence[str], dt_s: float) -> FloatArray:
    """Return what reaches the servos of the commands ``u`` (frames, m)."""
    out = u.copy()
    de = list(channels).index("de") if "de" in channels else None
    if isinstance(hidden, LateCommand) and de is not None:
        late = round(hidden.delay_s / dt_s)
        out[:, de] = np.concatenate([np.full(late, u[0, de]), u[:, de]])[: len(u)]
    elif isinstance(hidden, SlewedCommand) and de is not None:
        most, x = hidden.rate_rad_s * dt_s, float(u[0, de])
        for k, wanted in enumerate(u[:, de].tolist()):
            x += min(most, max(-most, wanted - x))
            out[k, de] = x
    elif isinstance(hidden, CommandGain) and de is not None:
        out[:, de] = hidden.gain * u[:, de]
    elif isinstance(hidden, SluggishMotor) and "thr" in channels:
        thr, share = list(channels).index("thr"), dt_s / (0.5 * hidden.time_s)
        first = second = float(u[0, thr])
        for k, wanted in enumerate(u[:, thr].tolist()):
            first += min(1.0, share) * (wanted - first)
            second += min(1.0, share) * (first - second)
            out[k, thr] = second
    return out


def _as_issued(
    record: FlightRecord, u: FloatArray, channels: Sequence[str], trimmed: TrimmedFlight, settle_s: float
) -> FlightRecord:
    """Return the record with the commands as they were issued, not as they reached the servos."""
    data = record.data.copy()
    frames = round(settle_s * trimmed.rate_hz)
    issued = np.concatenate([np.zeros((frames, u.shape[1])), u, u[-1:]])[:: round(trimmed.rate_hz * record.dt_s)]
    for i, name in enumerate(channels):
        data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name] + issued[: len(record), i]
    for name in ("de", "dr"):
        if name not in channels and f"{name}_cmd" in record:  # a feedback moves it all the same
            data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name]
    return replace(record, data=data)


def _real(believed: Aircraft, hidden: Hidden, suite: SensorSuite, name: str) -> tuple[Aircraft, SensorSuite]:
    if isinstance(hidden, FlexibleWings):
        return load_aircraft(name, "flexible"), suite
    if isinstance(hidden, SlowServo):
        change = SetProperty("fcs/elevator-lag-rad_sec", hidden.corner_rad_s)
        return believed.amended(Amendment("hidden", "hidden", (change,))), suite
    if isinstance(hidden, HighThrust):
        change_z = SetText("propulsion/engine/thruster/location/z", hidden.offset_m)
        return believed.amended(Amendment("hidden", "hidden", (change_z,))), suite
    if isinstance(hidden, VaneGain):
        sensors = [replace(s, scale=hidden.gain) if s.channel == "alpha" else s for s in suite.sensors]
        return believed, replace(suite, sensors=tuple(sensors))
    return _otherwise_real(believed, hidden, suite)


def _otherwise_real(believed: Aircraft, hidden: Hidden, suite: SensorSuite) -> tuple[Aircraft, SensorSuite]:
    if isinstance(hidden, ShiftedWing):
        ahead = SetText("metrics/location[@name='AERORP']/x", -hidden.ahead_m)
        placed = [
            replace(s, position_m=(s.position_m[0] + hidden.ahead_m, *s.position_m[1:]))
            if s.channel in ("ax", "ay", "az")
            else s
            for s in suite.sensors
        ]
        return believed.amended(Amendment("hidden", "hidden", (ahead,))), replace(suite, sensors=tuple(placed))
    if isinstance(hidden, Ballast):
        point = (
            f'<pointmass name="ballast"> <weight unit="KG">{hidden.mass_kg!r}</weight> '
            '<location unit="M"> <x>0</x> <y>0</y> <z>0</z> </location> </pointmass>'
        )
        loaded = believed.amended(Amendment("hidden", "hidden", (Insert("mass_balance", point),)))
        mass = replace(believed.mass, mass_kg=believed.mass.mass_kg + hidden.mass_kg)
        return replace(loaded, mass=mass), suite
    if isinstance(hidden, Roughness):
        path = "aerodynamics/axis[@name='DRAG']/function/product/sum"
        rough = Insert(path, f"<value>{hidden.CD0!r}</value>")
        return believed.amended(Amendment("hidden", "hidden", (rough,))), suite
    if isinstance(hidden, RateFeedback):
        gain = hidden.gain_s / believed.controls["de"].full
        feedback = Insert(
            "flight_control",
            '<channel name="feedback"> <pure_gain name="feedback/pitch-rate"> <input>velocities/q-rad_sec</input> '
            f"<gain>{gain!r}</gain> <output>fcs/pitch-trim-cmd-norm</output> </pure_gain> </channel>",
            0,
        )
        return believed.amended(Amendment("hidden", "hidden", (feedback,))), suite
    if isinstance(hidden, YawFeedback):
        damper = Insert(
            "flight_control",
            '<channel name="feedback"> <washout_filter name="feedback/yaw-rate"> <input>velocities/r-rad_sec</input> '
            f"<c1>{1.0 / hidden.washout_s!r}</c1> </washout_filter> <pure_gain name='feedback/rudder'> "
            f"<input>feedback/yaw-rate</input> <gain>{hidden.gain_s / believed.controls['dr'].full!r}</gain> "
            "<output>fcs/yaw-trim-cmd-norm</output> </pure_gain> </channel>",
            0,
        )
        return believed.amended(Amendment("hidden", "hidden", (damper,))), suite
    if isinstance(hidden, SensorError):
        read = [
            replace(s, scale=hidden.gain * s.scale, lag_s=s.lag_s + hidden.lag_s, delay_s=s.delay_s + hidden.delay_s)
            if s.channel == hidden.channel
            else s
            for s in suite.sensors
        ]
        return believed, replace(suite, sensors=tuple(read))
    return believed, suite
