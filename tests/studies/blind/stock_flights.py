"""Manoeuvres of the draw of stock aircraft, each from one of three conditions, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). Truths are flown by
JSBSim one by one, as those of the other draws are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from studies.blind.lateral_flights import CONTROLS, _held, suite

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition
from testbench.questions.gap.hidden.aircraft import RATE_HZ
from testbench.questions.gap.hidden.flights import Commands, fly_hidden
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.flights import SETTLE_S, _doublet, _half_sine, _joined, _steps, side_by_side
from testbench.sensors import SensorSuite


@dataclass(frozen=True)
class Flown:
    """How an aircraft is flown.

    Attributes:
        conditions: three that manoeuvres start from; the first is the one that is believed.
        de, da, dr: deflections, rad, that move it by some 4 deg of alpha, 20 deg of bank, 5 deg of sideslip.
        thr: share of the throttle.
        unit_s: of the switching, near its short period and roll mode.
    """

    conditions: tuple[FlightCondition, FlightCondition, FlightCondition]
    de: float
    da: float
    dr: float
    thr: float
    unit_s: float


def _three(
    slow: float, fast: float, h_m: float, up_m: float
) -> tuple[FlightCondition, FlightCondition, FlightCondition]:
    high = FlightCondition(0.5 * (slow + fast), h_m + up_m)
    return FlightCondition(slow, h_m), FlightCondition(fast, h_m), high


FLOWN: dict[str, Flown] = {
    "jsbsim:737": Flown(_three(130.0, 160.0, 2000.0, 1500.0), 2.0 * DEG_RAD, 4.0 * DEG_RAD, 4.0 * DEG_RAD, 0.1, 0.8),
    "jsbsim:A4": Flown(_three(120.0, 150.0, 2000.0, 1500.0), 1.0 * DEG_RAD, 2.0 * DEG_RAD, 3.0 * DEG_RAD, 0.1, 0.5),
    "jsbsim:c172p": Flown(_three(43.0, 55.0, 1000.0, 600.0), 2.0 * DEG_RAD, 3.0 * DEG_RAD, 4.0 * DEG_RAD, 0.15, 0.5),
    "jsbsim:B747": Flown(_three(140.0, 175.0, 2000.0, 1500.0), 2.0 * DEG_RAD, 6.0 * DEG_RAD, 4.5 * DEG_RAD, 0.1, 1.0),
}
FIGHTER: dict[str, Flown] = {
    "jsbsim:f16": Flown(_three(150.0, 190.0, 2500.0, 1000.0), 2.0 * DEG_RAD, 3.5 * DEG_RAD, 2.4 * DEG_RAD, 0.1, 0.5),
}
"""Of a draw of its own: hardly stable in pitch, which those of the draw of stock aircraft are not."""


def manoeuvres(f: Flown, which: str) -> dict[str, tuple[int, Mapping[str, FloatArray]]]:
    """Return name -> (number of its condition, control -> samples at the rate of the log): "rich" or "held_out"."""
    u, long = f.unit_s, 6.0 + 12.0 * f.unit_s
    if which == "held_out":
        return {
            "elevator 211, then aileron": (
                1,
                {
                    "de": _steps(long, 1.2 * u, (2, 1, 1), -1.2 * f.de),
                    "da": _joined(long, [(0.6 * long, _doublet(u, -f.da))]),
                },
            ),
            "rudder, then throttle": (
                2,
                {
                    "dr": _joined(long, [(0.5, _doublet(1.4 * u, -f.dr))]),
                    "thr": _joined(long, [(0.5 * long, _doublet(2.0, f.thr))]),
                },
            ),
        }
    return {
        "elevator 3211": (0, {"de": _steps(long, u, (3, 2, 1, 1), f.de)}),
        "throttle": (1, {"thr": _joined(long, [(0.5, _doublet(2.5, f.thr)), (7.0, _doublet(1.0, -f.thr))])}),
        "aileron 3211": (2, {"da": _steps(long, u, (3, 2, 1, 1), f.da)}),
        "rudder doublets of two sizes": (
            0,
            {"dr": _joined(long, [(0.5, _doublet(u, 1.4 * f.dr)), (0.6 * long, _doublet(u, 0.6 * f.dr))])},
        ),
        "elevator doublets of two sizes": (
            2,
            {"de": _joined(long, [(0.5, _doublet(0.7 * u, 1.5 * f.de)), (0.5 * long, _doublet(0.7 * u, 0.6 * f.de))])},
        ),
        "bank to bank with a pull-up": (
            1,
            {
                "da": _joined(long, [(0.5, _held(u, f.da)), (3.0 + 2.0 * u, _doublet(u, -f.da))]),
                "de": _joined(long, [(1.0 + u, _half_sine(1.4, -f.de))]),
                "dr": _joined(long, [(0.7 * long, _doublet(0.8 * u, f.dr))]),
            },
        ),
    }  # fmt: skip


def fly_stock(aircraft: str, truth: Truth, which: str, seed: int) -> dict[str, FlightRecord]:
    """Fly a truth of a stock aircraft through a set of manoeuvres; see :func:`fly_from_three`."""
    return fly_from_three(aircraft, (FLOWN | FIGHTER)[aircraft], truth, which, seed, suite())


def fly_from_three(
    aircraft: str, f: Flown, truth: Truth, which: str, seed: int, sensors: SensorSuite
) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    flights = []
    for i, (name, (at, signal)) in enumerate(manoeuvres(f, which).items()):
        u = side_by_side(signal, CONTROLS)
        flights.append(Commands(name, CONTROLS, u, SETTLE_S, seed + i, condition=f.conditions[at]))
    return fly_hidden(aircraft, "rigid", truth, sensors, f.conditions[0], flights, RATE_HZ)
