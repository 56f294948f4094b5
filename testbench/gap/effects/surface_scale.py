"""An elevator that turns by another angle than commanded."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.gap.effects.base import Effect, Parameter, Values
from testbench.gap.effects.reroute import ELEVATOR, product, prop, reroute, value
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply what the elevator servo is told."""
    scale = values["scale"]
    edit = reroute(ELEVATOR, "surface-scale", product(value(scale), prop(ELEVATOR)))
    return aircraft.amended(Amendment("surface_scale", f"elevator turns {scale:.4g} times the command", (edit,))), suite


EFFECT = Effect(
    name="surface_scale",
    title="scale of the elevator's deflection or effectiveness",
    place="elevator",
    physics=(
        "The linkage turns the elevator by a multiple of the command, or the elevator works better or worse than "
        "believed. Moment and lift due to the command change by the same factor at every frequency."
    ),
    parameters=(Parameter("scale", "1", 0.2, 3.0, (0.8, 1.3), none=1.0),),
    amend=amend,
    mistaken_for="an error of Cm_de and CL_de together, exactly, so that only what exceeds their prior can be named",
    separated_by="a measured deflection: a linkage error shows in it, a wrong effectiveness does not",
    flown=True,  # larger commands meet the slew limit that is believed, which a linearisation does not see
)
