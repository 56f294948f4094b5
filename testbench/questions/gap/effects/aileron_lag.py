"""A servo of the aileron slower than believed."""

from __future__ import annotations

from testbench.questions.gap.effects.actuator_lag import effect

EFFECT = effect("da")
