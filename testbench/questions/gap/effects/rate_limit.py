"""An elevator servo that cannot turn as fast as believed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.base import Effect, Parameter, Values
from testbench.questions.gap.effects.servo import LAG, LIMIT, column_of, declared, through_servo
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the elevator servo another rate limit."""
    limit = values["limit_rad_s"]
    text = f"elevator servo turns at {limit:.3g} rad/s at most"
    return aircraft.amended(Amendment("rate_limit", text, (SetProperty(LIMIT, limit),))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return commands that take the servo without limit where the commands ``u`` (n, m) take the limited one."""
    limit = values["limit_rad_s"]
    return limited(names, u, dt_s, declared(aircraft, LAG), limit, limit)


def limited(names: Sequence[str], u: FloatArray, dt_s: float, lag: float, down: float, up: float) -> FloatArray:
    """Return the commands for limits ``down`` (trailing edge down, positive) and ``up``, rad/s."""
    column = column_of(names)
    if column is None:
        return u

    def move(d: float, c: float, time_s: float) -> float:
        error = c - d
        limit = down if error > 0.0 else up
        slewing = min(max(abs(error) / limit - 1.0 / lag, 0.0), time_s)  # s until the lag asks for less than the limit
        d += math.copysign(limit * slewing, error)
        return d if slewing == time_s else c - math.exp(-lag * (time_s - slewing)) * (c - d)

    return through_servo(u, column, dt_s, lag, move)


EFFECT = Effect(
    name="rate_limit",
    title="rate limit of the elevator servo",
    place="elevator",
    physics=(
        "The servo turns no faster than a limit that lies below what the model believes. "
        "Small or slow commands arrive unchanged, large fast ones are flattened into ramps and arrive late."
    ),
    parameters=(Parameter("limit_rad_s", "rad/s", 0.02, 10.0, (1.5, 0.5, 0.15)),),
    amend=amend,
    mistaken_for="a slower servo or a delay if all inputs are of one size; it does not show without fast commands",
    separated_by="two amplitudes of the same input: a lag and a delay scale with it, a rate limit does not",
    shape=shape,
)
