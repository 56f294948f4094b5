"""Play in the elevator's linkage."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.gap.effects.base import Effect, Parameter, Values
from testbench.gap.effects.reroute import moving, prop, value
from testbench.gap.effects.servo import LAG, POSITION, behind_servo, column_of, declared
from testbench.record import FloatArray
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Put a play of the given width between servo and surface; in the middle of it at trim."""
    half = 0.5 * values["width_rad"]
    last = prop("gap/free-play")
    low, high = (f"<sum> {prop(POSITION)} {value(s * half)} </sum>" for s in (-1.0, 1.0))
    body = moving(f"<min> <max> {last} {low} </max> {high} </min>", prop(POSITION))
    text = f"elevator linkage with a play of {values['width_rad']:.3g} rad"
    return aircraft.amended(Amendment("free_play", text, (behind_servo("free-play", body),))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return commands that take the servo without play where the commands ``u`` (n, m) take the surface behind it."""
    column = column_of(names)
    if column is None:
        return u
    half = 0.5 * values["width_rad"]

    def behind(servo: FloatArray) -> FloatArray:
        y, surface = float(servo[0]), []
        for x in servo[1:].tolist():
            y = min(max(y, x - half), x + half)
            surface.append(y)
        return np.array(surface)

    return before_servo(u, column, dt_s, aircraft, behind)


def before_servo(
    u: FloatArray, column: int, dt_s: float, aircraft: Aircraft, behind: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return commands that take the servo where the commands ``u`` (n, m) take a surface behind it.

    ``behind`` is the surface (n,) after the positions (n + 1,) of the servo, the first of them at rest.
    """
    from scipy.signal import lfilter

    start, whole = float(u[0, column]), math.exp(-declared(aircraft, LAG) * dt_s)
    servo = np.asarray(lfilter([1.0 - whole], [1.0, -whole], u[:, column] - start)) + start
    d = np.concatenate([[start], behind(np.concatenate([[start], servo]))])
    out = u.copy()
    out[:, column] = (d[1:] - whole * d[:-1]) / (1.0 - whole)
    return out


EFFECT = Effect(
    name="free_play",
    title="free play of the elevator",
    place="elevator",
    physics=(
        "Worn hinges or rods let the servo move by a certain angle before the surface follows. "
        "Every reversal loses the play: small inputs vanish in it, large ones arrive late and reduced by half of it."
    ),
    parameters=(Parameter("width_rad", "rad", 0.0, 0.2, (0.01, 0.03), none=0.0),),
    amend=amend,
    mistaken_for="a dead band of the servo; a lower elevator effectiveness if all inputs are of one size",
    separated_by="two amplitudes of the same input; a measured deflection, which only the dead band moves",
    shape=shape,
)
