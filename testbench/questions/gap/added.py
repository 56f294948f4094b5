"""What an effect at its values makes of aircraft, sensors, commands and condition, as a belief applies it.

These stand at the top of a file, as a belief goes from process to process.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from testbench.aircraft import Aircraft
from testbench.effects import Effect
from testbench.flight import FlightCondition
from testbench.sensors import SensorSuite


def in_place(aircraft: Aircraft, known: int, effect: Effect) -> Aircraft:
    """Return an aircraft whose amendments behind the ``known`` first ones act where ``effect`` does."""
    new = (replace(a, upstream=effect.upstream) for a in aircraft.amendments[known:])
    return replace(aircraft, amendments=(*aircraft.amendments[:known], *new))


def grown_by(
    effect: Effect, values: Mapping[str, float], aircraft: Aircraft, suite: SensorSuite, at_s: float
) -> tuple[Aircraft, SensorSuite]:
    """Return both with an effect as it has grown so many s after take-off."""
    assert effect.over_time is not None
    known = len(aircraft.amendments)
    grown, suite = effect.over_time(aircraft, suite, values, at_s)
    return in_place(grown, known, effect), suite


def raised(aircraft: Aircraft, by_m: float) -> Aircraft:
    """Return an aircraft that may fly higher or lower by so much, one that may stand on the ground no lower.

    The height stands for the density of the air there, which is another one at the height that is flown.
    """
    if by_m == 0.0 or "h" not in aircraft.limits:
        return aircraft
    low, high = aircraft.limits["h"]
    low = low + by_m if aircraft.adapter is None else low + max(by_m, 0.0)
    return replace(aircraft, limits={**aircraft.limits, "h": (low, high + max(by_m, 0.0))})


def moved_by(effect: Effect, values: Mapping[str, float], believed: FlightCondition) -> FlightCondition:
    """Return the condition that an effect makes of the believed one."""
    assert effect.elsewhere is not None
    return effect.elsewhere(believed, values)
