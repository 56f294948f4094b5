"""A surface rigged off its zero."""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.effects.base import GEARING, Effect, Parameter, Values
from testbench.effects.servo import COEFFICIENTS, WORDS, labelled, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a constant to what the servo is told."""
    offset = values["offset_rad"]
    aircraft, path = opened(aircraft, control)
    body = f"<sum> {prop(path.command)} {value(offset)} </sum>"
    edit = reroute(path.command, labelled(control, "surface-offset"), body)
    text = f"{path.word} rigged {offset:+.4g} rad off"
    return aircraft.amended(Amendment(named(control, "surface_offset"), text, (edit,))), suite


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word, moment = WORDS[control], COEFFICIENTS[control][0].partition("_")[0]
    return Effect(
        name=named(control, "surface_offset"),
        title=f"offset of the {word}'s zero",
        place=word,
        physics=(
            f"The {word} stands at an angle when its command is zero. "
            "Trim needs another command, and the motion about trim stays what it was."
        ),
        parameters=(Parameter("offset_rad", "rad", -0.2, 0.2, (0.02, -0.02), none=0.0),),
        amend=partial(amend, control),
        mistaken_for=f"an error of {moment}0, exactly; it does not show where commands are deviations from trim",
        separated_by="the absolute command at trim at several speeds, beside a weighed centre of gravity",
        lateral=control in ("da", "dr"),
        upstream=GEARING,
    )


EFFECT = effect("de")
