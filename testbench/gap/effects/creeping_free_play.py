"""Play in the elevator's linkage in which the surface does not rest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.gap.effects.base import Effect, Parameter, Values
from testbench.gap.effects.free_play import before_servo
from testbench.gap.effects.reroute import moving, product, prop, value
from testbench.gap.effects.servo import POSITION, behind_servo, column_of
from testbench.record import FloatArray
from testbench.sensors import SensorSuite

_LABEL = "creeping-free-play"


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the surface creep to the middle of the play, which is where the servo stands; there at trim."""
    half = 0.5 * values["width_rad"]
    last = prop(f"gap/{_LABEL}")
    step = value(-math.expm1(-values["creep_1_s"] / aircraft.rate_hz))
    crept = f"<sum> {last} {product(step, f'<difference> {prop(POSITION)} {last} </difference>')} </sum>"
    low, high = (f"<sum> {prop(POSITION)} {value(s * half)} </sum>" for s in (-1.0, 1.0))
    body = moving(f"<min> <max> {crept} {low} </max> {high} </min>", prop(POSITION))
    text = (
        f"elevator linkage with a play of {values['width_rad']:.3g} rad, crept through at {values['creep_1_s']:.3g} 1/s"
    )
    return aircraft.amended(Amendment("creeping_free_play", text, (behind_servo(_LABEL, body),))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return commands that take the servo without play where the commands ``u`` (n, m) take the surface behind it."""
    column = column_of(names)
    if column is None:
        return u
    half, step = 0.5 * values["width_rad"], -math.expm1(-values["creep_1_s"] * dt_s)

    def behind(servo: FloatArray) -> FloatArray:
        y, surface = float(servo[0]), []
        for x in servo[1:].tolist():
            y = min(max(y + step * (x - y), x - half), x + half)
            surface.append(y)
        return np.array(surface)

    return before_servo(u, column, dt_s, aircraft, behind)


EFFECT = Effect(
    name="creeping_free_play",
    title="free play of the elevator with a surface that creeps",
    place="elevator",
    physics=(
        "The servo takes up the play of worn hinges or rods, and air load or elastic rods draw the surface through it. "
        "Quick inputs lose the play, slow ones arrive whole."
    ),
    parameters=(
        Parameter("width_rad", "rad", 0.0, 0.2, (0.01, 0.03), none=0.0),
        Parameter("creep_1_s", "1/s", 0.0, 50.0, (0.5, 3.0)),
    ),
    amend=amend,
    mistaken_for="play without creep, where no input is held for long",
    separated_by="a step held for seconds, of the size of the play",
    shape=shape,
    contains=("free_play",),
)
