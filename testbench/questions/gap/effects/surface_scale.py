"""An elevator that turns by another angle than commanded."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.base import GEARING, Effect, Parameter, Values
from testbench.questions.gap.effects.reroute import ELEVATOR, moving, product, prop, reroute, value
from testbench.sensors import SensorSuite

_TRIM = "gap/surface-scale-trim"


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply what the elevator servo is told, as a deviation from what it was told in trim.

    The surface stands at trim where the aircraft needs it, whatever the command for it was; scaled from its zero, the
    command of a weak elevator would run into the throw of the one that is believed.
    """
    scale = values["scale"]
    trim = ("trim", moving(prop(_TRIM), prop(ELEVATOR)))  # kept from where time stands still
    moved = f"<difference> {prop(ELEVATOR)} {prop(_TRIM)} </difference>"
    edit = reroute(ELEVATOR, "surface-scale", f"<sum> {prop(_TRIM)} {product(value(scale), moved)} </sum>", (trim,))
    text = f"elevator turns {scale:.4g} times the command, counted from trim"
    return aircraft.amended(Amendment("surface_scale", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m), deviations from trim, with the elevator's scaled."""
    if "de" not in names:
        return u
    out = u.copy()
    out[:, list(names).index("de")] *= values["scale"]
    return out


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
    shape=shape,
    flown=True,  # larger commands meet the slew limit that is believed, which a linearisation does not see
    upstream=GEARING,
)
