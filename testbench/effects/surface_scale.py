"""A surface that turns by another angle than commanded."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import GEARING, Effect, Parameter, Values
from testbench.effects.servo import COEFFICIENTS, WORDS, about_trim, handed_on, labelled, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply what the servo is told, as a deviation from what it was told in trim.

    The surface stands at trim where the aircraft needs it, whatever the command for it was; scaled from its zero, the
    command of a weak surface would run into the throw of the one that is believed.
    """
    scale = values["scale"]
    aircraft, path = opened(aircraft, control)
    edit = about_trim(path, labelled(control, "surface-scale"), lambda x: product(value(scale), x))
    text = f"{path.word} turns {scale:.4g} times the command, counted from trim"
    return aircraft.amended(Amendment(named(control, "surface_scale"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return the commands ``u`` (n, m), deviations from trim, with one of them scaled."""
    return handed_on(control, names, u, lambda x: values["scale"] * x)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "surface_scale"),
        title=f"scale of the {word}'s deflection or effectiveness",
        place=word,
        physics=(
            f"The linkage turns the {word} by a multiple of the command, or it works better or worse than "
            "believed. Force and moment due to the command change by the same factor at every frequency."
        ),
        parameters=(Parameter("scale", "1", 0.2, 3.0, (0.8, 1.3), none=1.0),),
        amend=partial(amend, control),
        mistaken_for=(
            f"an error of {' and '.join(COEFFICIENTS[control])} together, exactly, so that only what exceeds their "
            "prior can be named"
        ),
        separated_by="a measured deflection: a linkage error shows in it, a wrong effectiveness does not",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        flown=True,  # larger commands meet the slew limit that is believed, which a linearisation does not see
        upstream=GEARING,
    )


EFFECT = effect("de")
