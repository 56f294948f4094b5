"""Play in the linkage of a control."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.reroute import moving, prop, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import LINKAGE, Effect, Parameter, Values
from testbench.effects.servo import (
    WORDS,
    BehindServo,
    behind_servo,
    column_of,
    corner_of,
    named,
)
from testbench.sensors import SensorSuite

WIDEST_RAD = 0.06  # some 3 degrees, several times what airworthiness codes let a worn surface have (from memory)
_LEAST_HALF_RAD = 1e-9  # a play of this width is none


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Put a play of the given width between servo and surface; in the middle of it at trim."""
    aircraft, path = opened(aircraft, control)
    text = f"{path.word} linkage with a play of {values['width_rad']:.3g} rad"
    edit = within_play(path, prop(path.surface), values["width_rad"])
    return aircraft.amended(Amendment(named(control, "free_play"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the servo without play where the commands ``u`` (n, m) take the surface behind it."""
    return before_play(control, names, u, dt_s, aircraft, values["width_rad"])


def within_play(path: ControlPath, drawn: str, width_rad: float) -> BehindServo:
    """Return the edit that lets the surface stand where ``drawn`` (XML) says, within a play about the servo."""
    low, high = (f"<sum> {prop(path.servo)} {value(s * 0.5 * width_rad)} </sum>" for s in (-1.0, 1.0))
    return behind_servo(path, moving(f"<min> <max> {drawn} {low} </max> {high} </min>", prop(path.servo)))


def before_play(
    control: str,
    names: Sequence[str],
    u: FloatArray,
    dt_s: float,
    aircraft: Aircraft,
    width_rad: float,
    creep_1_s: float = 0.0,
    power: float = 1.0,
) -> FloatArray:
    """Return commands that take the servo where the commands ``u`` (n, m) take a surface with a play of its own.

    The surface creeps to the middle of the play, where the servo stands: b' = -creep_1_s b^power with b its distance
    from there over half the play.
    """
    from scipy.signal import lfilter

    column = column_of(names, control)
    if column is None:
        return u
    half, creep, slower = half_of(width_rad), creep_1_s * dt_s, power - 1.0
    start, whole = float(u[0, column]), math.exp(-corner_of(aircraft, control) * dt_s)
    servo = np.asarray(lfilter([1.0 - whole], [1.0, -whole], u[:, column] - start)) + start
    d = [start]
    for x in servo.tolist():
        off = x - d[-1]
        step = -math.expm1(-creep * min(1.0, abs(off) / half) ** slower) if creep else 0.0
        d.append(min(max(d[-1] + step * off, x - half), x + half))
    surface, out = np.array(d), u.copy()
    out[:, column] = (surface[1:] - whole * surface[:-1]) / (1.0 - whole)
    return out


def half_of(width_rad: float) -> float:
    """Return half a play's width, rad, which is never quite nothing: distances are taken over it."""
    return max(0.5 * width_rad, _LEAST_HALF_RAD)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "free_play"),
        title=f"free play of the {word}",
        place=word,
        physics=(
            "Worn hinges or rods let the servo move by a certain angle before the surface follows. "
            "Every reversal loses the play: small inputs vanish in it, large ones arrive late and reduced by half of "
            "it."
        ),
        parameters=(Parameter("width_rad", "rad", 0.0, WIDEST_RAD, (0.01, 0.03), none=0.0),),
        amend=partial(amend, control),
        mistaken_for=f"a dead band of the servo; a lower {word} effectiveness if all inputs are of one size",
        separated_by="two amplitudes of the same input; a measured deflection, which only the dead band moves",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        upstream=LINKAGE,
    )


EFFECT = effect("de")
