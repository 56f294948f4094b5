"""A feedback from pitch rate to elevator that nobody mentioned."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.effects.base import AUTOPILOT, URGED, Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add gain times pitch rate to what the elevator servo is told."""
    gain = values["gain_s"]
    aircraft, path = opened(aircraft, "de")
    body = f"<sum> {prop(path.command)} {product(value(gain), prop('velocities/q-rad_sec'))} </sum>"
    edit = reroute(path.command, "pitch-damper", body)
    text = f"elevator fed back {gain:+.4g} rad per rad/s of pitch rate"
    return aircraft.amended(Amendment("pitch_damper", text, (edit,))), suite


EFFECT = Effect(
    name="pitch_damper",
    title="pitch damper",
    place="pitching moment",
    part="autopilot",
    physics=(
        "An autopilot turns the elevator in proportion to pitch rate, behind the recorded command and through the "
        "servo. The short period is damped more, or less with the other sign, than the aircraft itself would be."
    ),
    parameters=(Parameter("gain_s", "s", URGED, 1.0, (0.1, 0.5 * URGED), none=0.0),),
    amend=amend,
    mistaken_for="an error of Cm_q, within its prior, where the servo is much faster than the short period",
    separated_by="a measured deflection, or a flight with the autopilot off",
    upstream=AUTOPILOT,
)
