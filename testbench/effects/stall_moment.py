"""A stall that pitches, or that begins on one wing."""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, value
from testbench.effects.aero import force
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.stall import attached, lost_lift
from testbench.sensors import SensorSuite


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Take away the lift that separation loses, see :mod:`stall`, and add a moment in proportion to what separated."""
    X = attached(values["alpha_rad"], values["sharpness"])
    coefficient = "Cm" if name == "stall_moment" else "Cl"
    size, label = values[coefficient], name.replace("_", "-")
    apart = f"<difference> {value(1.0)} {X} </difference>"
    edits = (
        force("CL", f"{label}-lift", lost_lift(aircraft, X)),
        force(coefficient, label, product(value(size), apart)),
    )
    text = f"flow separates about alpha = {values['alpha_rad']:.3g} rad, with a {coefficient} of {size:+.3g} at most"
    return aircraft.amended(Amendment(name, text, edits)), suite


_BREAK = (
    Parameter("alpha_rad", "rad", 0.03, 0.6, (0.1, 0.14, 0.22)),
    Parameter("sharpness", "1/rad", 5.0, 80.0, (20.0,)),
)
EFFECTS = (
    Effect(
        name="stall_moment",
        title="stall with a pitching moment",
        place="lift",
        physics=(
            "As the flow separates, the wing's lift moves aft and the downwash at the tail falls. The nose drops, or "
            "rises if the tips stall first, by a moment in proportion to what has separated."
        ),
        parameters=(*_BREAK, Parameter("Cm", "1", -1.0, 1.0, (-0.05, 0.05))),
        amend=partial(amend, "stall_moment"),
        mistaken_for="a stall beside a pitching moment curved over alpha, as long as alpha stays below the break",
        separated_by="pull-ups beyond the break, with the elevator held",
        flown=True,
    ),
    Effect(
        name="asymmetric_stall",
        title="stall of one wing first",
        place="wing",
        physics=(
            "One wing separates before the other: another rigging, dirt, damage. The aircraft drops that wing by a "
            "rolling moment in proportion to what has separated."
        ),
        parameters=(*_BREAK, Parameter("Cl", "1", -0.5, 0.5, (0.02, -0.02))),
        amend=partial(amend, "asymmetric_stall"),
        mistaken_for="one wing with more lift slope, as long as alpha stays below the break",
        separated_by="pull-ups beyond the break with the ailerons held",
        flown=True,
        lateral=True,
    ),
)
