"""A pitch damper that lets slow pitch rates pass."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import washed_feedback
from testbench.aircraft.seams import opened
from testbench.effects.base import AUTOPILOT, URGED, Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add gain times washed-out pitch rate, s / (s + washout) q, to what the elevator servo is told."""
    gain, washout = values["gain_s"], values["washout_rad_s"]
    aircraft, path = opened(aircraft, "de")
    edit, state = washed_feedback(path.command, "washed-pitch-damper", "velocities/q-rad_sec", gain, washout)
    text = f"elevator fed back {gain:+.4g} rad per rad/s of pitch rate, washed out below {washout:.3g} rad/s"
    return aircraft.amended(Amendment("washed_pitch_damper", text, (edit,), memories=(state,))), suite


EFFECT = Effect(
    name="washed_pitch_damper",
    title="pitch damper with washout",
    place="pitching moment",
    part="autopilot",
    physics=(
        "An autopilot turns the elevator in proportion to pitch rate, but lets a lasting rate pass, so that it does "
        "not work against a pull-up. The short period is damped more, and the phugoid stays as it is."
    ),
    parameters=(
        Parameter("gain_s", "s", URGED, 1.0, (0.15, 0.5 * URGED), none=0.0),
        Parameter("washout_rad_s", "rad/s", 0.0, 5.0, (0.5,), none=0.0),
    ),
    amend=amend,
    mistaken_for="a plain pitch damper where no pitch rate lasts as long as the washout; an error of Cm_q",
    separated_by="a measured deflection, a pull-up held for some seconds, or a flight with the autopilot off",
    flown=True,  # the washout does not show in a linearisation, in which time stands still
    contains=("pitch_damper",),
    upstream=AUTOPILOT,
)
