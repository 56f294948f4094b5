"""Flights of small aircraft whose surfaces are recorded, each from one of three conditions.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from studies.blind import lateral_flights
from studies.blind.stock_flights import Flown, _three, fly_from_three

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.lateral import STEPS
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import Sensor, SensorSuite

SURFACES = ("de", "da", "dr")
NOISE_RAD = 0.001  # of a potentiometer at a hinge


def _small(aircraft: str, slow: float, fast: float, h_m: float, de: float, unit_s: float) -> Flown:
    da, dr = (STEPS[c][aircraft] for c in ("da", "dr"))
    return Flown(_three(slow, fast, h_m, 400.0), de, da, dr, 0.15, unit_s)


FLOWN: Mapping[str, Flown] = {
    "eolo": _small("eolo", 15.0, 18.0, 547.0, 0.045, 0.4),
    "taurus": _small("taurus", 14.0, 17.0, 100.0, 0.035, 0.3),
}


def suite() -> SensorSuite:
    """Return the believed sensors: those of all axes, all commands, and the position of every surface, at 50 Hz."""
    plain = lateral_flights.suite()
    surfaces = tuple(Sensor(c, noise_std=NOISE_RAD) for c in SURFACES)
    return replace(plain, name="eolo_gap_surfaces_50hz", sensors=(*plain.sensors, *surfaces))


def fly_paths(aircraft: str, truth: Truth, which: str, seed: int) -> dict[str, FlightRecord]:
    """Fly a truth of a small aircraft through a set of manoeuvres; see :func:`fly_from_three`."""
    return fly_from_three(aircraft, FLOWN[aircraft], truth, which, seed, suite())
