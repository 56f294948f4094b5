"""Manoeuvres of one flight of half an hour, each at its time after take-off, and flights of a truth through them.

Each begins with a step of the throttle up and down, as a motor is judged by what it does and not by where it stands.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

from studies.blind.lateral_flights import CONTROLS, suite
from studies.blind.path_flights import FLOWN

from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.gap.hidden.aircraft import RATE_HZ
from testbench.questions.gap.hidden.flights import Commands, fly_hidden
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.flights import SETTLE_S, _doublet, _half_sine, _joined, side_by_side

_LONG_S = 14.0
_FROM_S = 6.0  # of the surfaces, when the throttle is back


def manoeuvres(aircraft: str, which: str) -> dict[str, tuple[float, Mapping[str, FloatArray]]]:
    """Return name -> (time after take-off, s, control -> samples at the rate of the log): "rich" or "held_out"."""
    f = FLOWN[aircraft]
    u = f.unit_s

    def after(*parts: tuple[float, FloatArray]) -> FloatArray:
        return _joined(_LONG_S, [(_FROM_S + at, part) for at, part in parts])

    def throttle(sign: float = 1.0) -> dict[str, FloatArray]:
        return {"thr": _joined(_LONG_S, [(0.5, _doublet(2.0, sign * f.thr))])}

    if which == "held_out":
        return {
            "elevator and aileron, half-way": (
                510.0,
                throttle(-1.0) | {"de": after((0.0, _doublet(1.2 * u, -f.de))), "da": after((4.0, _doublet(u, -f.da)))},
            ),
            "rudder and pull-up, late": (
                1410.0,
                throttle(-1.0)
                | {"dr": after((0.0, _doublet(1.4 * u, -f.dr))), "de": after((4.0, _half_sine(1.2, -f.de)))},
            ),
        }
    return {
        "elevator after take-off": (60.0, throttle() | {"de": after((0.0, _doublet(u, f.de)))}),
        "aileron": (360.0, throttle() | {"da": after((0.0, _doublet(u, f.da)), (4.0, _doublet(u, -0.6 * f.da)))}),
        "rudder": (660.0, throttle() | {"dr": after((0.0, _doublet(u, 1.4 * f.dr)), (4.0, _doublet(u, -0.6 * f.dr)))}),
        "pull-up": (960.0, throttle() | {"de": after((0.0, _half_sine(1.6, -0.9 * f.de)))}),
        "aileron and rudder": (
            1260.0,
            throttle() | {"da": after((0.0, _doublet(u, f.da))), "dr": after((3.0, _doublet(0.8 * u, f.dr)))},
        ),
        "elevator before landing": (
            1500.0,
            throttle() | {"de": after((0.0, _doublet(0.7 * u, 1.5 * f.de)), (4.0, _doublet(0.7 * u, 0.6 * f.de)))},
        ),
    }


def fly_over_time(aircraft: str, truth: Truth, which: str, seed: int) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    flights = [
        Commands(name, CONTROLS, side_by_side(signal, CONTROLS), SETTLE_S, seed + i, at_s=at_s)
        for i, (name, (at_s, signal)) in enumerate(manoeuvres(aircraft, which).items())
    ]
    return fly_hidden(aircraft, "rigid", truth, suite(), FLOWN[aircraft].conditions[0], flights, RATE_HZ)
