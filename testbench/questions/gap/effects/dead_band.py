"""A servo that ignores small errors: hysteresis between command and deflection."""

from __future__ import annotations

import math
from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.base import SERVO, Effect, Parameter, Values
from testbench.questions.gap.effects.free_play import WIDEST_RAD
from testbench.questions.gap.effects.reroute import ELEVATOR, moving, prop, reroute, value
from testbench.questions.gap.effects.servo import LAG, POSITION, column_of, declared, through_servo
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Take a band off the error that moves the elevator servo."""
    half = values["half_width_rad"]
    c, d = prop(ELEVATOR), prop(POSITION)
    error = f"<difference> {c} {d} </difference>"
    within = f"<min> <max> {error} {value(-half)} </max> {value(half)} </min>"
    body = moving(f"<difference> {c} {within} </difference>", c)
    text = f"elevator servo with a dead band of {half:.3g} rad to either side"
    return aircraft.amended(Amendment("dead_band", text, (reroute(ELEVATOR, "dead-band", body),))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return commands that take the servo without a dead band where the commands ``u`` (n, m) take the one with it."""
    column = column_of(names)
    if column is None:
        return u
    half, lag = values["half_width_rad"], declared(aircraft, LAG)

    def move(d: float, c: float, time_s: float) -> float:
        error = c - d
        return d - math.expm1(-lag * time_s) * (error - max(-half, min(half, error)))

    return through_servo(u, column, dt_s, lag, move)


EFFECT = Effect(
    name="dead_band",
    title="dead band of the elevator servo (hysteresis)",
    place="elevator",
    physics=(
        "Friction or a coarse control loop lets the servo rest until its error exceeds a band. "
        "The deflection stops short of every command and where it stops depends on where it came from."
    ),
    parameters=(Parameter("half_width_rad", "rad", 0.0, 0.5 * WIDEST_RAD, (0.005, 0.015), none=0.0),),
    amend=amend,
    mistaken_for="free play of the linkage",
    separated_by="a measured deflection; small inputs from the rest, in both directions",
    shape=shape,
    upstream=SERVO,
)
