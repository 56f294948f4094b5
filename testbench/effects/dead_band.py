"""A servo that ignores small errors: hysteresis between command and deflection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.free_play import WIDEST_RAD
from testbench.effects.servo import WORDS, column_of, corner_of, labelled, named, through_servo
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Take a band off the error that moves the servo."""
    half = values["half_width_rad"]
    aircraft, path = opened(aircraft, control)
    c, d = prop(path.command), prop(path.servo)
    error = f"<difference> {c} {d} </difference>"
    within = f"<min> <max> {error} {value(-half)} </max> {value(half)} </min>"
    body = moving(f"<difference> {c} {within} </difference>", c)
    text = f"{path.word} servo with a dead band of {half:.3g} rad to either side"
    edit = reroute(path.command, labelled(control, "dead-band"), body)
    return aircraft.amended(Amendment(named(control, "dead_band"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the servo without a dead band where the commands ``u`` (n, m) take the one with it."""
    column = column_of(names, control)
    if column is None:
        return u
    half, lag = values["half_width_rad"], corner_of(aircraft, control)

    def move(d: float, c: float, time_s: float) -> float:
        error = c - d
        return d - math.expm1(-lag * time_s) * (error - max(-half, min(half, error)))

    return through_servo(u, column, dt_s, lag, move)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "dead_band"),
        title=f"dead band of the {word} servo (hysteresis)",
        place=word,
        physics=(
            "Friction or a coarse control loop lets the servo rest until its error exceeds a band. "
            "The deflection stops short of every command and where it stops depends on where it came from."
        ),
        parameters=(Parameter("half_width_rad", "rad", 0.0, 0.5 * WIDEST_RAD, (0.005, 0.015), none=0.0),),
        amend=partial(amend, control),
        mistaken_for="free play of the linkage",
        separated_by="a measured deflection; small inputs from the rest, in both directions",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        upstream=SERVO,
    )


EFFECT = effect("de")
