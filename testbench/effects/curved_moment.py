"""A pitching moment that is curved over alpha."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import prop, value
from testbench.effects.aero import ALPHA, pitching_moment
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add Cm_alpha2 alpha^2 to the pitching moment coefficient."""
    edit = pitching_moment("curved-moment", value(values["Cm_alpha2"]), prop(ALPHA), prop(ALPHA))
    text = f"pitching moment with {values['Cm_alpha2']:+.3g} alpha^2 more"
    return aircraft.amended(Amendment("curved_moment", text, (edit,))), suite


EFFECT = Effect(
    name="curved_moment",
    title="pitching moment curved over alpha",
    place="pitching moment",
    physics=(
        "The tail leaves the wing's downwash, or fuselage and wing lose their linear moment, as alpha grows. "
        "To first order the moment gets a term in the square of alpha: stability changes with alpha."
    ),
    parameters=(Parameter("Cm_alpha2", "1", -10.0, 10.0, (-1.0, 1.0), none=0.0),),
    amend=amend,
    mistaken_for="another Cm_alpha in a narrow band of alpha; a stall of the tail",
    separated_by="a wide range of alpha on both sides of trim",
    flown=True,
)
