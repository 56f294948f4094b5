"""The tables ``[hidden]`` of gap scenarios: each is a kind of hidden truth with its size.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field

from testbench.aircraft import Aircraft, Insert
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.schema import NonNegative, Positive, Strict
from testbench.flight import FlightCondition, load_aircraft
from testbench.inputs import build
from testbench.questions.gap.hidden import servos
from testbench.questions.gap.hidden.entries import TRUTHS
from testbench.questions.gap.hidden.feedback import pitch_feedback, yaw_feedback
from testbench.questions.gap.hidden.flights import Commands, fly_hidden
from testbench.questions.gap.hidden.mass import load, shifted
from testbench.questions.gap.hidden.readings import sensor
from testbench.questions.gap.hidden.terms import number
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import Sensor, SensorSuite


class FlexibleWings(Strict):
    """The aircraft flies with all its elastic modes."""

    kind: Literal["flexible_wings"]

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["flexible wings"]({}, name)


class SlowServo(Strict):
    """The elevator servo lags with the given corner frequency."""

    kind: Literal["slow_servo"]
    corner_rad_s: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["slow servo"]({"lag_rad_s": self.corner_rad_s}, name)


class HighThrust(Strict):
    """The thruster sits above the centre of gravity."""

    kind: Literal["high_thrust"]
    offset_m: float

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["high thrust"]({"z_m": self.offset_m}, name)


class VaneGain(Strict):
    """The alpha vane reads ``gain`` times the truth."""

    kind: Literal["vane_gain"]
    gain: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return sensor("alpha", lambda s: replace(s, scale=self.gain))


class LateCommand(Strict):
    """The elevator command is sent this much after it is recorded, to the nearest frame."""

    kind: Literal["late_command"]
    delay_s: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return Truth(elevator=servos.held_back(self.delay_s))


class SlewedCommand(Strict):
    """What is sent to the elevator servo changes no faster than this; the limit stands before the servo's lag."""

    kind: Literal["slewed_command"]
    rate_rad_s: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return Truth(elevator=servos.slewed(self.rate_rad_s))


class CommandGain(Strict):
    """The elevator is sent this multiple of the recorded change of the command."""

    kind: Literal["command_gain"]
    gain: float

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["linkage ratio"]({"gain": self.gain}, name)


class SluggishMotor(Strict):
    """The motor takes the throttle through a lag in two equal stages, half the given time constant each."""

    kind: Literal["sluggish_motor"]
    time_s: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return Truth(throttle=servos.sluggish(self.time_s))


class EmptyingBattery(Strict):
    """A throttle step gives this much less thrust a minute after take-off, as a share of what it gave then."""

    kind: Literal["emptying_battery"]
    per_min: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["battery that empties"]({"per_min": self.per_min}, name)


class BurntFuel(Strict):
    """The aircraft gets this much lighter a minute after take-off, as a share of what it weighed then."""

    kind: Literal["burnt_fuel"]
    per_min: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return TRUTHS["fuel that burns"]({"per_min": self.per_min}, name)


class ShiftedWing(Strict):
    """The aerodynamic centre and the accelerometers lie ahead of where they are believed, as if the CG were aft."""

    kind: Literal["shifted_wing"]
    ahead_m: float

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return shifted(self.ahead_m)


class Ballast(Strict):
    """A point mass at the centre of gravity."""

    kind: Literal["ballast"]
    mass_kg: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return load(self.mass_kg, 0.0)


class Roughness(Strict):
    """More drag at zero lift."""

    kind: Literal["roughness"]
    CD0: float

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        path = "aerodynamics/axis[@name='DRAG']/function/product/sum"
        return Truth(changes=(Insert(path, number(self.CD0)),))


class RateFeedback(Strict):
    """Pitch rate is fed to the elevator's trim input, rad per rad/s."""

    kind: Literal["rate_feedback"]
    gain_s: float

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        edit = pitch_feedback(self.gain_s, believed.controls["de"].full, "velocities/q-rad_sec")
        return Truth(changes=(edit,), fed_back=True)


class YawFeedback(Strict):
    """Yaw rate, washed out with a time constant, is fed to the rudder's trim input, rad per rad/s."""

    kind: Literal["yaw_feedback"]
    gain_s: float
    washout_s: Positive

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        edit = yaw_feedback(self.gain_s, self.washout_s, believed.controls["dr"].full)
        return Truth(changes=(edit,), fed_back=True)


class SensorError(Strict):
    """The sensor of a channel has another scale, lag or delay."""

    kind: Literal["sensor_error"]
    channel: str
    gain: Positive = 1.0
    lag_s: NonNegative = 0.0
    delay_s: NonNegative = 0.0

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""

        def read(s: Sensor) -> Sensor:
            more = s.lag_s + self.lag_s, s.delay_s + self.delay_s
            return replace(s, scale=self.gain * s.scale, lag_s=more[0], delay_s=more[1])

        return sensor(self.channel, read)


class Nothing(Strict):
    """The believed model is right."""

    kind: Literal["nothing"]

    def truth(self, name: str, believed: Aircraft) -> Truth:
        """Return what flies in place of the believed aircraft of that name."""
        return Truth()


Hidden = Annotated[
    FlexibleWings
    | SlowServo
    | HighThrust
    | VaneGain
    | LateCommand
    | SlewedCommand
    | CommandGain
    | SluggishMotor
    | EmptyingBattery
    | BurntFuel
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
    manoeuvres: Sequence[Manoeuvre],
    seed: int,
    rate_hz: float | None = None,
    progress: Callable[[str], None] | None = None,
    starts: Mapping[str, tuple[FlightCondition, float, float, float | None]] | None = None,
) -> Mapping[str, FlightRecord]:
    """Fly the aircraft with its hidden truth and return name -> measured record; provenance is left out.

    Commands are issued at the rate of the suite's log and held, as an on-board computer does. ``starts`` are manoeuvres
    that begin from another condition, with a load in kg so many metres aft of the centre of gravity, or at a time after
    take-off.

    Raises:
        TrimError, FlightAborted, LimitError: the hidden aircraft cannot fly these manoeuvres.
    """
    truth = hidden.truth(aircraft, load_aircraft(aircraft, wings))
    built = [build(spec.input, spec.duration_s, suite.rate_hz) for spec in manoeuvres]
    flights = [
        Commands(
            spec.name, signal.channels, signal.u, spec.settle_s, seed + i, None, *(starts or {}).get(spec.name, ())
        )
        for i, (spec, signal) in enumerate(zip(manoeuvres, built, strict=True))
    ]
    changed = truth.elevator, truth.throttle, truth.later
    as_issued = truth.fed_back or any(law is not None for law in changed)
    return fly_hidden(aircraft, wings, truth, suite, condition, flights, rate_hz, as_issued, progress)
