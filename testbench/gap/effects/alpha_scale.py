"""An angle-of-attack vane that reads too much or too little."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from testbench.aircraft import Aircraft
from testbench.gap.effects.base import Effect, Parameter
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Mapping[str, float]) -> tuple[Aircraft, SensorSuite]:
    """Give the vane another scale factor; a suite without a vane stays as it is."""
    sensors = tuple(replace(s, scale=s.scale * values["scale"]) if s.channel == "alpha" else s for s in suite.sensors)
    return aircraft, replace(suite, sensors=sensors)


EFFECT = Effect(
    name="alpha_scale",
    title="scale error of the alpha vane",
    physics=(
        "Upwash or a wrong calibration makes the vane read a multiple of the true angle of attack. "
        "Only the alpha channel disagrees, in proportion to alpha at every frequency."
    ),
    parameters=(Parameter("scale", "1", 0.5, 2.0, (1.02,)),),
    amend=amend,
    separated_by="looks like an alpha bias if alpha hardly moves; a slow-down gives the range that separates them",
)
