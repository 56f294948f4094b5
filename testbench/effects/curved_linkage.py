"""A linkage whose ratio changes with the deflection."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import GEARING, Effect, Parameter, Values
from testbench.effects.servo import PLACES, WORDS, about_trim, handed_on, labelled, named
from testbench.sensors import SensorSuite

_LEAST = 0.1  # of what is under the root: a ratio that grows is followed no farther


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Turn the surface by scale x / sqrt(1 + 2 loss x^2), x what the servo, or the engine, is told as a deviation from
    trim."""
    scale, loss = values["scale"], values[_loss_of(control).name]
    aircraft, path = opened(aircraft, control)

    def bent(x: str) -> str:
        under = f"<max> <sum> {value(1.0)} {product(value(2.0 * loss), x, x)} </sum> {value(_LEAST)} </max>"
        return f"<quotient> {product(value(scale), x)} <pow> {under} {value(0.5)} </pow> </quotient>"

    edit = about_trim(path, labelled(control, "curved"), bent)
    of = "" if control == "thr" else " rad^-2"
    text = f"{path.word} turns {scale:.4g} times the command near trim, and loses {loss:.3g}{of} of its square"
    return aircraft.amended(Amendment(named(control, "curved_linkage"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return the commands ``u`` (n, m), deviations from trim, with one of them as the linkage hands it on."""

    loss = values[_loss_of(control).name]

    def bent(x: FloatArray) -> FloatArray:
        return values["scale"] * x / np.sqrt(np.maximum(1.0 + 2.0 * loss * x**2, _LEAST))

    return handed_on(control, names, u, bent)


def _loss_of(control: str) -> Parameter:
    """Return what large deflections lose: of surfaces per rad^2, of the throttle per square of full throttle."""
    if control == "thr":
        return Parameter("loss", "1", -4.0, 40.0, (1.0,), none=0.0)
    return Parameter("loss_per_rad2", "1/rad^2", -4.0, 40.0, (3.0,), none=0.0)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    physics = (
        f"A rod on a horn pulls less the farther the horn has turned, and air that separates at the hinge makes "
        f"large deflections of the {word} worth less. A deflection x from trim is worth scale x / sqrt(1 + 2 loss x^2)."
    )
    if control == "thr":
        physics = (
            "Thrust over throttle is no straight line: a carburettor or a speed controller gives most of it over a "
            "part of the way. A deviation x from the trimmed throttle is worth scale x / sqrt(1 + 2 loss x^2)."
        )
    return Effect(
        name=named(control, "curved_linkage"),
        title=f"{word} linkage, or effectiveness, that changes with the deflection",
        place=PLACES[control],
        physics=physics,
        parameters=(
            Parameter("scale", "1", 0.0, 3.0, (0.8, 1.25), none=1.0),
            _loss_of(control),
        ),
        amend=partial(amend, control),
        mistaken_for="a scale of the deflection where all inputs are of one size; a rate limit where they differ",
        separated_by="inputs of two sizes; measuring the deflection for several commands on the ground",
        shape=partial(shape, control),
        flown=True,
        lateral=control in ("da", "dr"),
        contains=("thrust_scale", "throttle_scale") if control == "thr" else (named(control, "surface_scale"),),
        upstream=GEARING,
    )


EFFECT = effect("de")
