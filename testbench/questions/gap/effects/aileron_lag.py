"""A servo of the aileron slower than believed."""

from __future__ import annotations

from functools import partial

from testbench.questions.gap.effects.actuator_lag import amend
from testbench.questions.gap.effects.base import Effect, Parameter

EFFECT = Effect(
    name="aileron_lag",
    title="lag of the aileron servo",
    place="aileron",
    physics=(
        "The aileron follows its command through a first-order lag that is slower than the model believes. "
        "The roll rate builds up late, and fast reversals of the aileron move the aircraft less."
    ),
    parameters=(Parameter("lag_rad_s", "rad/s", 2.0, 200.0, (30.0, 8.0)),),
    amend=partial(amend, "aileron_lag", "aileron"),
    mistaken_for="errors of Cl_p and Cl_da together where the ailerons move slowly; a delay of their command",
    separated_by="aileron doublets shorter than the roll mode's time constant, at two amplitudes",
    lateral=True,
)
