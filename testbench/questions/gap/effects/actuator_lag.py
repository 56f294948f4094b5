"""A servo slower than believed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.questions.gap.effects.base import Effect, Parameter
from testbench.sensors import SensorSuite


def amend(
    name: str, servo: str, aircraft: Aircraft, suite: SensorSuite, values: Mapping[str, float]
) -> tuple[Aircraft, SensorSuite]:
    """Give the servo of a surface another first-order lag."""
    lag = values["lag_rad_s"]
    amendment = Amendment(name, f"{servo} servo lag {lag:.3g} rad/s", (SetProperty(f"fcs/{servo}-lag-rad_sec", lag),))
    return aircraft.amended(amendment), suite


EFFECT = Effect(
    name="actuator_lag",
    title="lag of the elevator servo",
    place="elevator",
    physics=(
        "The elevator follows its command through a first-order lag that is slower than the model believes. "
        "Fast inputs arrive late and reduced, slow ones hardly changed."
    ),
    parameters=(Parameter("lag_rad_s", "rad/s", 2.0, 200.0, (30.0, 8.0)),),
    amend=partial(amend, "actuator_lag", "elevator"),
    mistaken_for="a transport delay or a rate limit at low frequency",
    separated_by="a sweep beyond 6 Hz, which shows the loss of amplitude, at two amplitudes",
)
