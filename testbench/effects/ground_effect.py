"""Lift near the ground."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, value
from testbench.core.constants import FT_M
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

_DECAY = 4.0  # of the effect with height over span: gone at one span, half there at a sixth (estimate after handbooks)


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add k exp(-4 h / b) of the lift due to alpha, h the height above ground."""
    rate = -_DECAY * FT_M / aircraft.geometry.b_m
    share = f"<exp> {product(value(rate), prop('position/h-agl-ft'))} </exp>"
    lift = product(value(aircraft.coefficient("CL_alpha")), prop(ALPHA))
    edit = force("CL", "ground-effect", value(values["k"]), share, lift)
    text = f"lift slope {100 * values['k']:+.3g} % at the ground, next to nothing at one span"
    return aircraft.amended(Amendment("ground_effect", text, (edit,))), suite


EFFECT = Effect(
    name="ground_effect",
    title="ground effect",
    place="air",
    physics=(
        "Within a span of the ground the downwash is hindered, so that the wing gives more lift at the same alpha. "
        "The gain dies out with height over span."
    ),
    parameters=(Parameter("k", "1", -0.5, 1.0, (0.2, -0.1), none=0.0),),
    amend=amend,
    mistaken_for="an error of CL_alpha if the height stays the same; it does not show well above the ground",
    separated_by="the same manoeuvre at two heights, one of them below half a span",
    flown=True,
)
