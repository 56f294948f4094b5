"""A gust met in one manoeuvre."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

from testbench.effects.base import Effect, MetGust, Parameter, Values, unchanged
from testbench.flight.air import Gust

Axis = Literal["north", "east", "down"]
LARGEST_M_S = 15.0  # what linear predictions and a small aircraft's limits stand; CS-23 asks for 15.24 m/s (50 ft/s)
SHORTEST_S, LONGEST_S = 0.2, 6.0  # shorter ones pass the sensors' lags by, longer ones are a wind
_WORDS = {"north": "along the heading", "east": "from the left", "down": "vertical, downward positive"}


def _met(record: str, manoeuvre: str, axis: Axis, values: Values) -> MetGust:
    gust = Gust(axis, values["amplitude_m_s"], values["start_s"], values["duration_s"])
    return MetGust(record, manoeuvre, gust)


EFFECT = Effect(
    name="gust",
    title="gust met in one manoeuvre",
    place="air",
    physics=(
        "In one manoeuvre the air moves as a 1-cosine for a second or so, along one axis. Every channel answers as to "
        "a change of airspeed or angle of flow that no command asked for; the other manoeuvres do not show it."
    ),
    parameters=(
        Parameter("amplitude_m_s", "m/s", -LARGEST_M_S, LARGEST_M_S, (1.0,), none=0.0),
        Parameter("start_s", "s", 0.0, 3600.0, (1.0,)),
        Parameter("duration_s", "s", SHORTEST_S, LONGEST_S, (1.0,)),
    ),
    amend=unchanged,  # a gust is of one record's air (``met``)
    mistaken_for=(
        "a missing answer to a command at the same time (a servo that sticks once, a stall in the one manoeuvre that "
        "reaches it); a shear of the wind; turbulence"
    ),
    separated_by="the same manoeuvre once more: a gust does not come twice, an effect of the aircraft does",
    met=partial(_met, "", "", "down"),
    looks=0,
)


def placed(
    effect: Effect,
    record: str,
    manoeuvre: str,
    axis: Axis,
    start: tuple[float, float, float],
    lasts_s: float,
    looks: int,
) -> Effect:
    """Return ``effect``, a gust, in one record along one axis, its parameters about where it was found.

    Args:
        effect: of the library.
        record: key of the record.
        manoeuvre: name of the record, for people.
        axis: that it blows along.
        start: amplitude, start and duration that a fit starts from; they are brought within the bounds.
        lasts_s: length of the record.
        looks: number of places that it was looked for at.
    """
    amplitude, begins, duration = effect.parameters
    bounded = (amplitude, replace(begins, high=lasts_s), duration)
    inside = [
        min(max(x, 0.98 * p.low + 0.02 * p.high), 0.02 * p.low + 0.98 * p.high)
        for x, p in zip(start, bounded, strict=True)
    ]
    return replace(
        effect,
        title=f"gust in manoeuvre '{manoeuvre}', {_WORDS[axis]}",
        parameters=tuple(replace(p, starts=(x,)) for p, x in zip(bounded, inside, strict=True)),
        met=partial(_met, record, manoeuvre, axis),
        looks=looks,
    )
