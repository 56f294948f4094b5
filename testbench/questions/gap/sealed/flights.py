"""Manoeuvre sets of the blind test, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). Truths are flown by
JSBSim one by one: the sealed draw must keep its bytes, and a batch gives the last bit of only a fifth of the samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition
from testbench.flight.air import Air, Gust
from testbench.questions.gap.hidden.aircraft import RATE_HZ as RATE_HZ
from testbench.questions.gap.hidden.aircraft import SPEEDS_M_S
from testbench.questions.gap.hidden.flights import Commands, fly_hidden
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import SensorSuite, load_suite

LOG_HZ = 50.0
SETTLE_S = 2.0
CONTROLS = ("de", "thr")
HEIGHTS_M = {"eolo": 547.0, "taurus": 100.0}
# Amplitudes of elevator (rad) and throttle that move each aircraft by some 5 deg of alpha and 2 m/s.
_ELEVATOR = {"eolo": 0.045, "taurus": 0.035}
_THROTTLE = {"eolo": 0.15, "taurus": 0.15}


def suite() -> SensorSuite:
    """Return the believed sensors of both aircraft: V, alpha, q, theta, az and the commands, at 50 Hz."""
    return replace(load_suite("eolo_gap"), name="eolo_gap_50hz", rate_hz=LOG_HZ)


def condition(aircraft: str) -> FlightCondition:
    """Return the believed condition that all manoeuvres start from."""
    return FlightCondition(SPEEDS_M_S[aircraft], HEIGHTS_M[aircraft])


def manoeuvres(aircraft: str, which: str) -> tuple[tuple[Mapping[str, FloatArray], ...], tuple[str, ...]]:
    """Return commands (control -> samples at LOG_HZ) and names of a set: "rich" (six), "short" (two) or "held_out"."""
    e, t = _ELEVATOR[aircraft], _THROTTLE[aircraft]
    switch = 0.3 if aircraft == "eolo" else 0.25
    sets: dict[str, dict[str, Mapping[str, FloatArray]]] = {
        "rich": {
            "3211": {"de": _steps(8.0, switch, (3, 2, 1, 1), e)},
            "doublets of two sizes": {
                "de": _joined(8.0, [(0.5, _doublet(0.3, 2.0 * e)), (4.0, _doublet(0.3, 0.6 * e))])
            },
            "sweep": {"de": _sweep(11.0, 0.3, 9.0, 1.6 * e)},
            "throttle": {"thr": _joined(10.0, [(0.5, _doublet(2.5, t)), (7.0, _doublet(1.0, -t))])},
            "doublets at two throttles": {
                "de": _joined(10.0, [(1.0, _doublet(0.3, e)), (6.5, _doublet(0.3, e))]),
                "thr": _joined(10.0, [(0.2, np.full(round(5.0 * LOG_HZ), 1.1 * t))]),
            },
            "pull-ups": {
                "de": _joined(9.0, [(0.5, _half_sine(1.6, -0.9 * e)), (5.0, _half_sine(0.8, -1.5 * e))]),
            },
        },
        "short": {
            "3211": {"de": _steps(8.0, switch, (3, 2, 1, 1), e)},
            "doublets of two sizes": {
                "de": _joined(8.0, [(0.5, _doublet(0.3, 2.0 * e)), (4.0, _doublet(0.3, 0.6 * e))])
            },
        },
        "held_out": {
            "211": {"de": _steps(10.0, 0.4, (2, 1, 1), -1.2 * e)},
            "doublets and throttle": {
                "de": _joined(12.0, [(0.5, _doublet(0.2, 2.0 * e)), (6.0, _half_sine(1.2, -0.9 * e))]),
                "thr": _joined(12.0, [(3.0, np.full(round(3.0 * LOG_HZ), t))]),
            },
        },
    }
    chosen = sets[which]
    return tuple(chosen.values()), tuple(chosen)


def fly_truth(
    aircraft: str,
    truth: Truth,
    which: str,
    seed: int,
    turbulence_rms_m_s: float = 0.0,
) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    signals, names = manoeuvres(aircraft, which)
    flights = []
    for i, (name, signal) in enumerate(zip(names, signals, strict=True)):
        u = side_by_side(signal, CONTROLS)
        met = truth.gust if i == 0 and which != "held_out" else None  # a gust belongs to one flight and no other
        air = _air(turbulence_rms_m_s, met, seed + 7919 * i)
        flights.append(Commands(name, CONTROLS, u, SETTLE_S, seed + i, air))
    return fly_hidden(aircraft, "rigid", truth, suite(), condition(aircraft), flights, RATE_HZ)


def side_by_side(signal: Mapping[str, FloatArray], controls: Sequence[str]) -> FloatArray:
    """Return the commands of all controls, (n, controls): zero of those that do not move."""
    n = len(next(iter(signal.values())))
    return np.column_stack([signal.get(c, np.zeros(n)) for c in controls])


def _air(rms_m_s: float, gust: Gust | None, seed: int) -> Air | None:
    if rms_m_s == 0.0 and gust is None:
        return None
    return Air(turbulence_rms_m_s=(rms_m_s,) * 3, gust=gust, seed=seed)


def _joined(duration_s: float, parts: Sequence[tuple[float, FloatArray]]) -> FloatArray:
    out = np.zeros(round(duration_s * LOG_HZ))
    for start_s, part in parts:
        k = round(start_s * LOG_HZ)
        out[k : k + len(part)] += part
    return out


def _steps(duration_s: float, step_s: float, lengths: Sequence[int], amplitude: float) -> FloatArray:
    signs = [amplitude * (-1.0) ** i for i in range(len(lengths))]
    part = np.concatenate([np.full(round(n * step_s * LOG_HZ), a) for n, a in zip(lengths, signs, strict=True)])
    return _joined(duration_s, [(0.5, part)])


def _doublet(half_s: float, amplitude: float) -> FloatArray:
    half = round(half_s * LOG_HZ)
    return np.concatenate([np.full(half, amplitude), np.full(half, -amplitude)])


def _half_sine(length_s: float, amplitude: float) -> FloatArray:
    n = round(length_s * LOG_HZ)
    return np.asarray(amplitude * np.sin(np.pi * (np.arange(n) + 0.5) / n))


def _sweep(duration_s: float, low_hz: float, high_hz: float, amplitude: float) -> FloatArray:
    length = duration_s - 2.0
    t = np.arange(round(length * LOG_HZ)) / LOG_HZ
    rate = np.log(high_hz / low_hz) / length
    phase = 2.0 * np.pi * low_hz * np.expm1(rate * t) / rate
    grow = np.minimum(1.0, 0.4 + 0.6 * t / length)  # slow motion answers more: less amplitude there
    return _joined(duration_s, [(0.5, amplitude * grow * np.sin(phase))])
