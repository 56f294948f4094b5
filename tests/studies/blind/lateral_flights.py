"""Manoeuvre sets of the lateral draw of the blind test, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). Truths are flown by
JSBSim one by one, as those of the longitudinal draws are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.gap.hidden.aircraft import RATE_HZ
from testbench.questions.gap.hidden.flights import Commands, fly_hidden
from testbench.questions.gap.hidden.lateral import STEPS
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.flights import (
    LOG_HZ,
    SETTLE_S,
    _doublet,
    _half_sine,
    _joined,
    _steps,
    _sweep,
    condition,
    side_by_side,
)
from testbench.sensors import SensorSuite, load_suite

CONTROLS = ("de", "da", "dr", "thr")
_PULL = {"eolo": 0.045, "taurus": 0.035}  # rad of elevator: some 5 deg of alpha
_UNIT_S = {"eolo": 0.5, "taurus": 0.3}  # of the aileron's switching, near the roll mode


def suite() -> SensorSuite:
    """Return the believed sensors of both aircraft: those of all axes and all commands, at 50 Hz."""
    return replace(load_suite("eolo_gap_lateral"), name="eolo_gap_lateral_50hz", rate_hz=LOG_HZ)


def manoeuvres(aircraft: str, which: str) -> tuple[tuple[Mapping[str, FloatArray], ...], tuple[str, ...]]:
    """Return commands (control -> samples at LOG_HZ) and names of a set: "rich" (six) or "held_out" (two)."""
    a, r, e = STEPS["da"][aircraft], STEPS["dr"][aircraft], _PULL[aircraft]
    unit = _UNIT_S[aircraft]
    bank = 2.0 * unit
    sets: dict[str, dict[str, Mapping[str, FloatArray]]] = {
        "rich": {
            "aileron 3211": {"da": _steps(8.0, unit, (3, 2, 1, 1), a)},
            "rudder doublets of two sizes": {
                "dr": _joined(10.0, [(0.5, _doublet(0.5, 1.5 * r)), (5.5, _doublet(0.5, 0.5 * r))])
            },
            "aileron sweep": {"da": _sweep(11.0, 0.3, 4.0, 1.5 * a)},
            "rudder sweep": {"dr": _sweep(11.0, 0.25, 3.0, r)},
            "bank to bank": {
                "da": _joined(13.0, [(0.5, _held(bank, a)), (4.0, _held(2.0 * bank, -a)), (9.0, _held(bank, a))])
            },
            "pull-ups with aileron and rudder": {
                "de": _joined(10.0, [(0.5, _half_sine(1.4, -e)), (5.0, _half_sine(0.8, -1.5 * e))]),
                "da": _joined(10.0, [(2.5, _doublet(bank, 0.8 * a))]),
                "dr": _joined(10.0, [(6.5, _doublet(0.4, r))]),
            },
        },
        "held_out": {
            "aileron 211, then rudder": {
                "da": _steps(10.0, 1.2 * unit, (2, 1, 1), -1.2 * a),
                "dr": _joined(10.0, [(6.0, _doublet(0.7, -r))]),
            },
            "turn with a pull-up": {
                "da": _joined(12.0, [(0.5, _held(bank, -a)), (8.0, _held(bank, a))]),
                "de": _joined(12.0, [(4.0, _half_sine(1.2, -e))]),
                "dr": _joined(12.0, [(1.0, _half_sine(1.0, 0.7 * r))]),
            },
        },
    }
    chosen = sets[which]
    return tuple(chosen.values()), tuple(chosen)


def fly_lateral(aircraft: str, truth: Truth, which: str, seed: int) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    flights = []
    for i, (signal, name) in enumerate(zip(*manoeuvres(aircraft, which), strict=True)):
        flights.append(Commands(name, CONTROLS, side_by_side(signal, CONTROLS), SETTLE_S, seed + i))
    return fly_hidden(aircraft, "rigid", truth, suite(), condition(aircraft), flights, RATE_HZ)


def _held(length_s: float, amplitude: float) -> FloatArray:
    return np.full(round(length_s * LOG_HZ), amplitude)
