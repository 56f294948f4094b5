"""A servo that cannot turn as fast as believed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.servo import WORDS, column_of, corner_of, named, through_servo
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the servo another rate limit; a surface without a servo follows its command up to that rate."""
    limit = values["limit_rad_s"]
    aircraft, path = opened(aircraft, control)
    text = f"{path.word} servo turns at {limit:.3g} rad/s at most"
    edit = SetProperty(str(path.rate_limit), limit)
    return aircraft.amended(Amendment(named(control, "rate_limit"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the servo without limit where the commands ``u`` (n, m) take the limited one."""
    limit = values["limit_rad_s"]
    return limited(control, names, u, dt_s, corner_of(aircraft, control), limit, limit)


def limited(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, lag: float, down: float, up: float
) -> FloatArray:
    """Return the commands for limits ``down`` (positive deflections) and ``up``, rad/s."""
    column = column_of(names, control)
    if column is None:
        return u

    def move(d: float, c: float, time_s: float) -> float:
        error = c - d
        limit = down if error > 0.0 else up
        slewing = min(max(abs(error) / limit - 1.0 / lag, 0.0), time_s)  # s until the lag asks for less than the limit
        d += math.copysign(limit * slewing, error)
        return d if slewing == time_s else c - math.exp(-lag * (time_s - slewing)) * (c - d)

    return through_servo(u, column, dt_s, lag, move)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "rate_limit"),
        title=f"rate limit of the {word} servo",
        place=word,
        physics=(
            "The servo turns no faster than a limit that lies below what the model believes. "
            "Small or slow commands arrive unchanged, large fast ones are flattened into ramps and arrive late."
        ),
        parameters=(Parameter("limit_rad_s", "rad/s", 0.02, 10.0, (1.5, 0.5, 0.15)),),
        amend=partial(amend, control),
        mistaken_for=(
            "a slower servo or a delay if all inputs are of one size; it does not show without fast commands"
        ),
        separated_by="two amplitudes of the same input: a lag and a delay scale with it, a rate limit does not",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
    )


EFFECT = effect("de")
