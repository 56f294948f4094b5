"""A linkage that moves its surface less one way than the other."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, product, prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import GEARING, Effect, Parameter, Values
from testbench.effects.servo import PLACES, WORDS, handed_on, labelled, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply the positive part of what the servo is told, as a deviation from what it was told in trim."""
    scale = values["scale"]
    aircraft, path = opened(aircraft, control)
    label, c = labelled(control, "one-sided"), prop(path.command)
    kept = prop(f"gap/{label}-trim")
    forth = f"<max> <difference> {c} {kept} </difference> {value(0.0)} </max>"
    body = f"<sum> {c} {product(value(scale - 1.0), forth)} </sum>"
    edit = reroute(path.command, label, body, (("trim", moving(kept, c)),))
    text = f"{path.word} turns {scale:.4g} times the command where that is positive, counted from trim"
    return aircraft.amended(Amendment(named(control, "one_sided_linkage"), text, (edit,))), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return the commands ``u`` (n, m), deviations from trim, with the positive part of one of them scaled."""
    return handed_on(control, names, u, lambda x: x + (values["scale"] - 1.0) * x.clip(min=0.0))


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "one_sided_linkage"),
        title=f"{word} linkage that works less one way",
        place=PLACES[control],
        physics=(
            f"A cable that slackens, a horn off its angle or a lost aileron on one side turns the {word} by another "
            "angle one way than the other. Positive commands give a multiple of what negative ones give."
        ),
        parameters=(Parameter("scale", "1", 0.0, 3.0, (0.8, 1.2), none=1.0),),
        amend=partial(amend, control),
        mistaken_for="a scale of the deflection where all inputs are of one sign; a curved moment",
        separated_by="inputs of both signs; turning the control to both stops on the ground",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        flown=True,
        upstream=GEARING,
    )


EFFECT = effect("de")
