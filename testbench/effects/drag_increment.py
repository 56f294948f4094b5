"""Drag that the model lacks."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.aircraft.reroute import value
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a constant drag coefficient."""
    cd = values["CD"]
    edit = Increment("CD", "aero/coefficient/CD_increment", (value(cd),))
    return aircraft.amended(Amendment("drag_increment", f"drag coefficient {cd:+.4g}", (edit,))), suite


EFFECT = Effect(
    name="drag_increment",
    title="drag increment",
    place="drag",
    physics=(
        "Something in the flow, such as an open door, a probe or a rough surface, adds drag at every angle of attack. "
        "Trim needs more throttle, and speed settles faster after a disturbance."
    ),
    parameters=(Parameter("CD", "1", -0.03, 0.3, (0.02, -0.01), none=0.0),),
    amend=amend,
    mistaken_for="an error of the drag polar, within its prior, or of thrust at trim",
    separated_by="glides or coast-downs at two speeds, where no thrust hides it",
)
