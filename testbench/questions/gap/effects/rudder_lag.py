"""A servo of the rudder slower than believed."""

from __future__ import annotations

from testbench.questions.gap.effects.actuator_lag import effect

EFFECT = effect("dr")
