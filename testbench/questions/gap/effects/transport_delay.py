"""A command that reaches the elevator servo late."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.base import LINK, Effect, Parameter, Values
from testbench.questions.gap.effects.reroute import ELEVATOR, moving, product, prop, reroute, value
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the elevator command wait.

    It is handed from one memory to the next every frame of ``aircraft.rate_hz``, and between two of them the value is
    interpolated, so that a fit sees a smooth function of the delay.
    """
    frames = values["delay_s"] * aircraft.rate_hz
    whole = math.floor(frames)
    share = frames - whole
    memories = [(f"{k}", moving(prop(f"gap/delay-{k - 1}"), prop(ELEVATOR))) for k in range(whole + 1, 0, -1)]
    memories.append(("0", prop(ELEVATOR)))
    late = [
        product(value(1.0 - share), prop(f"gap/delay-{whole}")),
        product(value(share), prop(f"gap/delay-{whole + 1}")),
    ]
    edit = reroute(ELEVATOR, "delay", f"<sum> {' '.join(late)} </sum>", memories)
    return aircraft.amended(
        Amendment("transport_delay", f"elevator command late by {values['delay_s']:.4g} s", (edit,))
    ), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the elevator's late, averaged over each sample."""
    if "de" not in names:
        return u
    column, t = list(names).index("de"), np.arange(len(u)) * dt_s
    out = u.copy()
    out[:, column] = np.interp(t - values["delay_s"], t, u[:, column])
    return out


EFFECT = Effect(
    name="transport_delay",
    title="delay of the elevator command",
    place="elevator",
    physics=(
        "The elevator command waits in computers, buses or radio links before the servo sees it. "
        "Every frequency arrives with its full amplitude and a phase loss in proportion to frequency."
    ),
    parameters=(Parameter("delay_s", "s", 0.0, 0.25, (0.03, 0.1), none=0.0),),
    amend=amend,
    mistaken_for="a slower servo at low frequency; a delay common to all sensors, which a clock offset gives too",
    separated_by="a sweep beyond the servo's corner, where a lag takes amplitude and a delay does not",
    shape=shape,
    upstream=LINK,
)
