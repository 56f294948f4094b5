"""Hidden truths that grow from record to record of a flight, or within each record: (sizes, aircraft) -> what flies.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from testbench.core.record import FloatArray
from testbench.questions.gap.hidden import servos
from testbench.questions.gap.hidden.aircraft import number_of
from testbench.questions.gap.hidden.entries import TRUTHS, Make
from testbench.questions.gap.hidden.mass import load, with_moved_accelerometers
from testbench.questions.gap.hidden.truth import Size, Truth

WHOLE_S = 1500.0  # after take-off, when a battery has lost, and a tank holds, what their sizes say
_CLIMB_S = 600.0
_WARM_S = 30.0
_SOON_S = 10.0


def drooping_battery(s: Size, aircraft: str) -> Truth:
    """A battery whose voltage falls steadily, and drops at its end: thrust as 1 - lost (0.6 x + 0.4 x^4), x = t / T."""

    def worn(at_s: float) -> Truth:
        x = at_s / WHOLE_S
        return Truth(throttle=servos.scaled(1.0 - s["lost"] * (0.6 * x + 0.4 * x**4)))

    return Truth(later=worn)


def tank_ahead(s: Size, aircraft: str) -> Truth:
    """A tank ahead of the centre of gravity that empties: mass, its moment of inertia, and its place together."""
    mass, ahead_m = number_of(aircraft, "mass_kg"), s["ahead_chords"] * number_of(aircraft, "cbar_m")

    def burnt(at_s: float) -> Truth:
        kg = -s["ratio"] * mass * at_s / WHOLE_S
        return with_moved_accelerometers(load(kg, -ahead_m), -kg / (mass + kg) * ahead_m)

    return Truth(later=burnt)


def thirsty_climb(s: Size, aircraft: str) -> Truth:
    """Fuel that burns fast in the climb and slower later, at the centre of gravity: as 1 - exp(-t / 600 s)."""
    kg = s["ratio"] * number_of(aircraft, "mass_kg") / -math.expm1(-WHOLE_S / _CLIMB_S)
    return Truth(later=lambda at_s: load(kg * math.expm1(-at_s / _CLIMB_S), 0.0))


def drift(channel: str) -> Make:
    """Return what flies with a reading that runs away at one rate from the first sample of every record on."""
    return lambda s, a: _away(channel, lambda t: s["per_s"] * t)


def warming(channel: str) -> Make:
    """Return what flies with a reading that runs away ever more slowly, as electronics that warm up in 30 s do."""
    return lambda s, a: _away(channel, lambda t: -s["per_s"] * _WARM_S * np.expm1(-t / _WARM_S))


def icing(channel: str) -> Make:
    """Return what flies with a reading that runs away ever faster: at half its rate at first, at the double in 30 s."""
    return lambda s, a: _away(channel, lambda t: s["per_s"] * t * (0.5 + 0.25 * t / _SOON_S))


def _away(channel: str, run: Callable[[FloatArray], FloatArray]) -> Truth:
    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + run(t - t[0])) if name == channel else y

    return Truth(spoil=spoil)


OVER_TIME: Mapping[str, Make] = {
    "battery that empties": TRUTHS["battery that empties"],
    "fuel that burns": TRUTHS["fuel that burns"],
    "roll gyro that drifts": drift("p"),
    "pitch gyro that drifts": drift("q"),
    "yaw gyro that drifts": drift("r"),
    "airspeed that drifts": drift("V"),
    "tank ahead that empties": tank_ahead,
    "battery that droops": drooping_battery,
    "thirsty climb": thirsty_climb,
    "roll gyro that warms up": warming("p"),
    "pitch gyro that warms up": warming("q"),
    "yaw gyro that warms up": warming("r"),
    "airspeed port that ices": icing("V"),
}
