"""A curved lift line."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import prop, value
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add CL_alpha2 alpha^2 to the lift coefficient."""
    edit = force("CL", "nonlinear-lift", value(values["CL_alpha2"]), prop(ALPHA), prop(ALPHA))
    return aircraft.amended(
        Amendment("nonlinear_lift", f"lift with {values['CL_alpha2']:+.3g} alpha^2 more", (edit,))
    ), suite


EFFECT = Effect(
    name="nonlinear_lift",
    title="curved lift line",
    place="lift",
    physics=(
        "The lift line is not straight: camber, low Reynolds numbers or the fuselage bend it well below the stall. "
        "To first order lift gets a term in the square of alpha."
    ),
    parameters=(Parameter("CL_alpha2", "1", -40.0, 40.0, (-5.0, 5.0), none=0.0),),
    amend=amend,
    mistaken_for="another CL_alpha in a narrow band of alpha; the beginning of a stall",
    separated_by="a wide range of alpha on both sides of trim",
    flown=True,
)
