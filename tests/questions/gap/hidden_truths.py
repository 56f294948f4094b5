"""Hidden truths of tests, in code of their own that has nothing of the library of effects, and their records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from studies.blind import servos
from studies.blind.truth import Truth, number
from studies.blind.truths import TRUTHS, pitch_feedback, sensor, yaw_feedback

from testbench.aircraft import Insert
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.flight import FlightCondition, load_aircraft
from testbench.questions.gap.starts import Start
from testbench.questions.hidden import fly_hidden, issued
from testbench.sensors import SensorSuite

NOTHING = Truth()


def measure_truth(
    aircraft: str,
    truth: Truth,
    suite: SensorSuite,
    condition: FlightCondition,
    manoeuvres: Sequence[Manoeuvre],
    seed: int,
    rate_hz: float | None = None,
    starts: Mapping[str, Start] | None = None,
) -> dict[str, FlightRecord]:
    """Fly a truth through manoeuvres; commands that it changes on their way are recorded as they were issued."""
    as_issued = truth.fed_back or any((truth.elevator, truth.throttle, truth.later))
    commands = issued(suite, condition, manoeuvres, seed, starts)
    return fly_hidden(truth.real(aircraft, as_issued), suite, commands, rate_hz)


def slow_servo(corner_rad_s: float) -> Truth:
    """The elevator servo lags with the given corner frequency."""
    return TRUTHS["slow servo"]({"lag_rad_s": corner_rad_s}, "")


def late_command(delay_s: float) -> Truth:
    """The elevator command is sent this much after it is recorded, to the nearest frame."""
    return Truth(elevator=servos.held_back(delay_s))


def slewed_command(rate_rad_s: float) -> Truth:
    """What is sent to the elevator servo changes no faster than this; the limit stands before the servo's lag."""
    return Truth(elevator=servos.slewed(rate_rad_s))


def command_gain(gain: float) -> Truth:
    """The elevator is sent this multiple of the recorded change of the command."""
    return TRUTHS["linkage ratio"]({"gain": gain}, "")


def roughness(CD0: float) -> Truth:
    """More drag at zero lift, in the packaged models' own sum."""
    path = "aerodynamics/axis[@name='DRAG']/function/product/sum"
    return Truth(changes=(Insert(path, number(CD0)),))


def rate_feedback(gain_s: float, aircraft: str = "eolo") -> Truth:
    """Pitch rate is fed to the elevator's trim input, rad per rad/s."""
    full_rad = load_aircraft(aircraft, "rigid").controls["de"].full
    return Truth(changes=(pitch_feedback(gain_s, full_rad, "velocities/q-rad_sec"),), fed_back=True)


def yaw_damper(gain_s: float, washout_s: float, aircraft: str = "eolo") -> Truth:
    """Yaw rate, washed out with a time constant, is fed to the rudder's trim input, rad per rad/s."""
    full_rad = load_aircraft(aircraft, "rigid").controls["dr"].full
    return Truth(changes=(yaw_feedback(gain_s, washout_s, full_rad),), fed_back=True)


def scaled_sensor(channel: str, gain: float) -> Truth:
    """The sensor of a channel reads a multiple of the truth."""
    return sensor(channel, lambda s: replace(s, scale=gain * s.scale))


def interconnect(ratio: float) -> Insert:
    """The rudder turns with the command of the ailerons, both of the same throw."""
    return Insert(
        "flight_control",
        '<channel name="interconnect"><pure_gain name="interconnect"><input>fcs/aileron-cmd-norm</input>'
        f"<gain>{ratio!r}</gain><output>fcs/yaw-trim-cmd-norm</output></pure_gain></channel>",
        0,
    )
