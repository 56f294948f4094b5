"""A feedback from yaw rate to rudder that nobody mentioned."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import washed_feedback
from testbench.aircraft.seams import opened
from testbench.effects.base import URGED, Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add gain times washed-out yaw rate, s / (s + washout) r, to what the rudder servo is told."""
    gain, washout = values["gain_s"], values["washout_rad_s"]
    aircraft, path = opened(aircraft, "dr")
    edit, state = washed_feedback(path.command, "yaw-damper", "velocities/r-rad_sec", gain, washout)
    text = f"rudder fed back {gain:+.4g} rad per rad/s of yaw rate, washed out below {washout:.3g} rad/s"
    return aircraft.amended(Amendment("yaw_damper", text, (edit,), memories=(state,))), suite


EFFECT = Effect(
    name="yaw_damper",
    title="yaw damper",
    place="rudder",
    part="autopilot",
    physics=(
        "An autopilot turns the rudder in proportion to yaw rate, behind the recorded command and through the servo; a "
        "washout lets a steady turn pass. The Dutch roll is damped more, or less with the other sign, than by the "
        "aircraft itself, and the yaw that the rudder commands is reduced."
    ),
    parameters=(
        Parameter("gain_s", "s", URGED, 2.0, (0.2, 0.5 * URGED), none=0.0),
        Parameter("washout_rad_s", "rad/s", 0.0, 5.0, (0.3,), none=0.0),
    ),
    amend=amend,
    mistaken_for=(
        "an error of Cn_r, within its prior, where the servo is much faster than the Dutch roll; the washout is not "
        "known where no record holds a turn as long as it lasts"
    ),
    separated_by="a measured rudder deflection, a flight with the autopilot off, or a turn held for some seconds",
    flown=True,  # the washout does not show in a linearisation, in which time stands still
    lateral=True,
)
