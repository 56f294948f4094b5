"""A command that reaches its servo, or the engine, late."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, product, prop, reroute, value
from testbench.aircraft.seams import opened
from testbench.core.record import FloatArray
from testbench.effects.base import LINK, Effect, Parameter, Values
from testbench.effects.servo import PLACES, WORDS, handed_on, labelled, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the command of a control wait.

    It is handed from one memory to the next every frame of ``aircraft.rate_hz``, and between two of them the value is
    interpolated, so that a fit sees a smooth function of the delay.
    """
    frames = values["delay_s"] * aircraft.rate_hz
    whole = math.floor(frames)
    share = frames - whole
    aircraft, path = opened(aircraft, control)
    label, c = labelled(control, "delay"), prop(path.command)
    memories = [(f"{k}", moving(prop(f"gap/{label}-{k - 1}"), c)) for k in range(whole + 1, 0, -1)]
    memories.append(("0", c))
    late = [
        product(value(1.0 - share), prop(f"gap/{label}-{whole}")),
        product(value(share), prop(f"gap/{label}-{whole + 1}")),
    ]
    edit = reroute(path.command, label, f"<sum> {' '.join(late)} </sum>", memories)
    text = f"{path.word} command late by {values['delay_s']:.4g} s"
    return aircraft.amended(
        Amendment(named(control, "transport_delay"), text, (edit,), rate_hz=aircraft.rate_hz)
    ), suite


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return the commands ``u`` (n, m) with one of them late, averaged over each sample."""
    t = np.arange(len(u)) * dt_s
    return handed_on(control, names, u, lambda x: np.interp(t - values["delay_s"], t, x))


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word, follower = WORDS[control], "engine" if control == "thr" else "servo"
    return Effect(
        name=named(control, "transport_delay"),
        title=f"delay of the {word} command",
        place=PLACES[control],
        physics=(
            f"The {word} command waits in computers, buses or radio links before the {follower} sees it. "
            "Every frequency arrives with its full amplitude and a phase loss in proportion to frequency."
        ),
        parameters=(Parameter("delay_s", "s", 0.0, 0.5, (0.03, 0.1), none=0.0),),
        amend=partial(amend, control),
        mistaken_for="a slower servo at low frequency; a delay common to all sensors, which a clock offset gives too",
        separated_by="a sweep beyond the servo's corner, where a lag takes amplitude and a delay does not",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        upstream=LINK,
    )


EFFECT = effect("de")
