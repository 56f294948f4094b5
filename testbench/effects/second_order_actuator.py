"""A servo with inertia: second order instead of first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.elastic import first_order_hold
from testbench.aircraft.reroute import moving, product, prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects import actuator_lag
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.servo import WORDS, column_of, corner_of, labelled, named
from testbench.sensors import SensorSuite


def _step(values: Values, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A (2, 2), B0 (2,), B1 (2,) of the step A x + B0 c + B1 c+ of position and rate under a ramp from c to c+.

    Under a command that is held it is A x + (B0 + B1) c.
    """
    w, zeta = values["omega_rad_s"], values["zeta"]
    A, B0, B1 = first_order_hold(np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([[0.0], [w * w]]), dt_s)
    return A, B0[:, 0], B1[:, 0]


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Replace the first-order servo by one of second order.

    What the believed servo of corner a is told is d + d' / a, with d the position of the second-order servo: that takes
    it to d itself. As the believed servo does, it takes a command that changes from frame to frame as a ramp.
    """
    A, B0, B1 = _step(values, 1.0 / aircraft.rate_hz)
    aircraft, path = opened(aircraft, control)
    label = labelled(control, "servo")
    p, v, c, last = (
        prop(f"gap/{label}-position"),
        prop(f"gap/{label}-rate"),
        prop(path.command),
        prop(f"gap/{label}-last"),
    )
    still = value(0.0)
    rows = [
        f"<sum> {product(value(A[i, 0]), p)} {product(value(A[i, 1]), v)} "
        f"{product(value(B0[i]), last)} {product(value(B1[i]), c)} </sum>"
        for i in (0, 1)
    ]
    before = [
        ("next-rate", moving(rows[1], still)),
        ("position", moving(rows[0], c)),
        ("rate", moving(prop(f"gap/{label}-next-rate"), still)),
        ("last", c),
    ]
    body = f"<sum> {p} {product(value(1.0 / corner_of(aircraft, control)), v)} </sum>"
    text = f"{path.word} servo of second order, {values['omega_rad_s']:.3g} rad/s, damping {values['zeta']:.2g}"
    edit = reroute(path.command, label, body, before)
    return aircraft.amended(
        Amendment(named(control, "second_order_actuator"), text, (edit,), rate_hz=aircraft.rate_hz)
    ), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the believed servo where the commands ``u`` (n, m) take the one of second order."""
    column = column_of(names, control)
    if column is None:
        return u
    from testbench.estimators.trajectories import Trajectories

    A, B0, B1 = _step(values, dt_s)
    c = u[:, column] - u[0, column]
    d = Trajectories(A, len(c) + 1).forced((np.append(c, c[-1])[:, None] * (B0 + B1))[:, :, None])[:, 0, 0]
    whole = math.exp(-corner_of(aircraft, control) * dt_s)
    out = u.copy()
    out[:, column] = (d[1:] - whole * d[:-1]) / (1.0 - whole) + u[0, column]
    return out


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "second_order_actuator"),
        title=f"{word} servo of second order",
        place=word,
        physics=(
            "The servo's motor and the surface have inertia, so the deflection follows the command as a mass on a "
            "spring. Beyond its frequency the amplitude falls twice as fast as behind a first-order lag; near it, it "
            "may overshoot."
        ),
        parameters=(
            Parameter("omega_rad_s", "rad/s", 4.0, 300.0, (25.0,)),
            Parameter("zeta", "1", 0.1, 2.0, (0.7,)),
        ),
        amend=partial(amend, control),
        mistaken_for="a delay with a first-order lag, or a lag in two stages, below its frequency",
        separated_by="a sweep through the servo's frequency; a measured deflection",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        contains=(actuator_lag.NAMES[control],),
        upstream=SERVO,
    )


EFFECT = effect("de")
