"""A servo that turns slower one way than the other."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.rate_limit import limited
from testbench.effects.servo import WORDS, OneSidedLimit, corner_of, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the servo one rate limit per direction."""
    down, up = values["down_rad_s"], values["up_rad_s"]
    aircraft, path = opened(aircraft, control)
    edits = (OneSidedLimit(".", "", None, up, path), SetProperty(str(path.rate_limit), down))
    text = f"{path.word} servo turns at {down:.3g} rad/s down and {up:.3g} rad/s up at most"
    return aircraft.amended(Amendment(named(control, "asymmetric_rate_limit"), text, edits)), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the servo without limit where the commands ``u`` (n, m) take the limited one."""
    return limited(control, names, u, dt_s, corner_of(aircraft, control), values["down_rad_s"], values["up_rad_s"])


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "asymmetric_rate_limit"),
        title=f"rate limit of the {word} servo, another one each way",
        place=word,
        physics=(
            "The air load helps the servo one way and holds it back the other, so that it turns slower against the "
            "load. Large fast inputs arrive as ramps of two slopes and leave a mean deflection behind."
        ),
        parameters=(
            Parameter("down_rad_s", "rad/s", 0.02, 10.0, (1.0, 0.3)),
            Parameter("up_rad_s", "rad/s", 0.02, 10.0, (1.0, 0.3)),
        ),
        amend=partial(amend, control),
        mistaken_for="a symmetric rate limit, where only one of the two is ever met",
        separated_by="inputs of both signs at two amplitudes, the larger one beyond both limits",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        contains=(named(control, "rate_limit"),),
    )


EFFECT = effect("de")
