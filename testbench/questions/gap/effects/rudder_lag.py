"""A servo of the rudder slower than believed."""

from __future__ import annotations

from functools import partial

from testbench.questions.gap.effects.actuator_lag import amend
from testbench.questions.gap.effects.base import Effect, Parameter

EFFECT = Effect(
    name="rudder_lag",
    title="lag of the rudder servo",
    place="rudder",
    physics=(
        "The rudder follows its command through a first-order lag that is slower than the model believes. "
        "The yaw rate builds up late, and fast reversals of the rudder move the aircraft less."
    ),
    parameters=(Parameter("lag_rad_s", "rad/s", 2.0, 200.0, (30.0, 8.0)),),
    amend=partial(amend, "rudder_lag", "rudder"),
    mistaken_for="an error of Cn_dr where the rudder moves slowly; a delay of its command",
    separated_by="rudder doublets much shorter than the Dutch roll's period, at two amplitudes",
    lateral=True,
)
