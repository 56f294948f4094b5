"""Play in the linkage of a control in which the surface does not rest."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import LINKAGE, Effect, Parameter, Values
from testbench.effects.free_play import WIDEST_RAD, before_play, half_of, within_play
from testbench.effects.servo import WORDS, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the surface creep to the middle of the play, which is where the servo stands; there at trim.

    With b the distance from the middle over half the play, b' = -creep b^power.
    """
    width_rad, creep_1_s, power = values["width_rad"], values["creep_1_s"], values["power"]
    aircraft, path = opened(aircraft, control)
    last = prop(path.surface)
    off = f"<difference> {prop(path.servo)} {last} </difference>"
    near = f"<min> <value>1</value> {product(f'<abs> {off} </abs>', value(1.0 / half_of(width_rad)))} </min>"
    slowed = f"<pow> {near} {value(power - 1.0)} </pow>"
    left = f"<exp> {product(value(-creep_1_s / aircraft.rate_hz), slowed)} </exp>"
    crept = f"<sum> {last} {product(f'<difference> <value>1</value> {left} </difference>', off)} </sum>"
    crept_at = f"crept through at {creep_1_s:.3g} 1/s, power {power:.3g}"
    text = f"{path.word} linkage with a play of {width_rad:.3g} rad, {crept_at}"
    edit = within_play(path, crept, width_rad)
    return aircraft.amended(
        Amendment(named(control, "creeping_free_play"), text, (edit,), rate_hz=aircraft.rate_hz)
    ), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the servo without play where the commands ``u`` (n, m) take the surface behind it."""
    return before_play(control, names, u, dt_s, aircraft, values["width_rad"], values["creep_1_s"], values["power"])


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "creeping_free_play"),
        title=f"free play of the {word} with a surface that creeps",
        place=word,
        physics=(
            "The servo takes up the play of worn hinges or rods. Air load or elastic rods then draw the surface "
            "through it, more slowly the less of it is left (Norton's power law of creep). Quick inputs lose the play, "
            "slow ones less."
        ),
        parameters=(
            Parameter("width_rad", "rad", 0.0, WIDEST_RAD, (0.01, 0.03), none=0.0),
            Parameter("creep_1_s", "1/s", 0.0, 50.0, (0.5, 3.0)),
            Parameter("power", "1", 1.0, 8.0, (1.5,)),
        ),
        amend=partial(amend, control),
        mistaken_for="play without creep, where no input is held for long",
        separated_by="a step held for seconds, of the size of the play",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        contains=(named(control, "free_play"),),
        upstream=LINKAGE,
    )


EFFECT = effect("de")
