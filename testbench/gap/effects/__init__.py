"""The library of physical effects, one file each; this table is the whole of it."""

from __future__ import annotations

from testbench.gap.effects import actuator_lag, alpha_scale, thrust_line, wing_bending
from testbench.gap.effects.base import Effect, Parameter

EFFECTS: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT for module in (wing_bending, actuator_lag, thrust_line, alpha_scale)
}

__all__ = ["EFFECTS", "Effect", "Parameter"]
