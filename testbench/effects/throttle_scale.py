"""A throttle linkage of another ratio: a scale of the thrust only where thrust is proportional to the throttle."""

from __future__ import annotations

from functools import partial

from testbench.effects import surface_scale
from testbench.effects.base import GEARING, Effect, Parameter
from testbench.effects.throttle_free_play import GROUND_CHECK

EFFECT = Effect(
    name="throttle_scale",
    title="scale of the throttle's linkage",
    place="thrust",
    physics=(
        "The linkage moves the engine's lever by a multiple of the command. Every throttle step does more or less than "
        "believed, and the throttle at trim is where the linkage was rigged, so the engine works where it did."
    ),
    parameters=(Parameter("scale", "1", 0.2, 3.0, (0.8, 1.3), none=1.0),),
    amend=partial(surface_scale.amend, "thr"),
    mistaken_for=(
        "a scale of the thrust, which changes the throttle that trim needs, too, and so where on its curve the engine "
        "works"
    ),
    separated_by="the throttle at trim, read at the engine; throttle steps from two airspeeds",
    shape=partial(surface_scale.shape, "thr"),
    flown=True,
    upstream=GEARING,
    ground_check=GROUND_CHECK,
    own_form="thrust_scale",
)
