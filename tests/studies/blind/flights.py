"""Manoeuvres of the blind test, what is believed to fly and to read them, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). Truths are flown by
JSBSim one by one: the sealed draws must keep their bytes, which a batch gives of a fifth of the samples only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from studies.blind.truth import Truth
from studies.blind.truths import RATE_HZ as RATE_HZ
from studies.blind.truths import SPEEDS_M_S

from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition
from testbench.flight.air import Air
from testbench.questions.gap.starts import Start
from testbench.questions.hidden import Commands, fly_hidden
from testbench.sensors import SensorSuite, load_suite

LOG_HZ = 50.0
SETTLE_S = 2.0
HEIGHTS_M = {"eolo": 547.0, "taurus": 100.0}
# Amplitudes of elevator (rad) and throttle that move each aircraft by some 5 deg of alpha and 2 m/s.
_ELEVATOR = {"eolo": 0.045, "taurus": 0.035}
_THROTTLE = {"eolo": 0.15, "taurus": 0.15}
Signals = Mapping[str, FloatArray]
"""Control -> samples at LOG_HZ."""


# --- what is believed of them ----------------------------------------------------------------------------------------


def suite(every_axis: bool = False) -> SensorSuite:
    """Return the believed sensors at 50 Hz: V, alpha, q, theta, az and the commands, or those of all axes."""
    name = "eolo_gap_lateral" if every_axis else "eolo_gap"
    return replace(load_suite(name), name=f"{name}_50hz", rate_hz=LOG_HZ)


def condition(aircraft: str) -> FlightCondition:
    """Return the believed condition of an aircraft."""
    return FlightCondition(SPEEDS_M_S[aircraft], HEIGHTS_M[aircraft])


# --- manoeuvres ------------------------------------------------------------------------------------------------------


def manoeuvres(aircraft: str, which: str) -> dict[str, Signals]:
    """Return name -> commands of a set: "rich" (six), "short" (two) or "held_out" (two)."""
    e, t = _ELEVATOR[aircraft], _THROTTLE[aircraft]
    switch = 0.3 if aircraft == "eolo" else 0.25
    sets: dict[str, dict[str, Signals]] = {
        "rich": {
            "3211": {"de": steps(8.0, switch, (3, 2, 1, 1), e)},
            "doublets of two sizes": {"de": joined(8.0, [(0.5, doublet(0.3, 2.0 * e)), (4.0, doublet(0.3, 0.6 * e))])},
            "sweep": {"de": sweep(11.0, 0.3, 9.0, 1.6 * e)},
            "throttle": {"thr": joined(10.0, [(0.5, doublet(2.5, t)), (7.0, doublet(1.0, -t))])},
            "doublets at two throttles": {
                "de": joined(10.0, [(1.0, doublet(0.3, e)), (6.5, doublet(0.3, e))]),
                "thr": joined(10.0, [(0.2, np.full(round(5.0 * LOG_HZ), 1.1 * t))]),
            },
            "pull-ups": {"de": joined(9.0, [(0.5, half_sine(1.6, -0.9 * e)), (5.0, half_sine(0.8, -1.5 * e))])},
        },
        "short": {
            "3211": {"de": steps(8.0, switch, (3, 2, 1, 1), e)},
            "doublets of two sizes": {"de": joined(8.0, [(0.5, doublet(0.3, 2.0 * e)), (4.0, doublet(0.3, 0.6 * e))])},
        },
        "held_out": {
            "211": {"de": steps(10.0, 0.4, (2, 1, 1), -1.2 * e)},
            "doublets and throttle": {
                "de": joined(12.0, [(0.5, doublet(0.2, 2.0 * e)), (6.0, half_sine(1.2, -0.9 * e))]),
                "thr": joined(12.0, [(3.0, np.full(round(3.0 * LOG_HZ), t))]),
            },
        },
    }
    return sets[which]


# --- flights ---------------------------------------------------------------------------------------------------------


def fly_truth(
    aircraft: str, truth: Truth, which: str, seed: int, turbulence_rms_m_s: float = 0.0
) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    flights, controls, start = [], ("de", "thr"), Start(condition(aircraft))
    for i, (name, signals) in enumerate(manoeuvres(aircraft, which).items()):
        gust = truth.gust if i == 0 and which != "held_out" else None  # a gust belongs to one flight and no other
        rms = (turbulence_rms_m_s,) * 3
        air = Air(turbulence_rms_m_s=rms, gust=gust, seed=seed + 7919 * i) if rms[0] or gust else None
        u = side_by_side(signals, controls)
        flights.append(Commands(name, controls, u, SETTLE_S, seed + i, start, air))
    return fly_hidden(truth.real(aircraft), suite(), flights, RATE_HZ)


def side_by_side(signal: Signals, controls: Sequence[str]) -> FloatArray:
    """Return the commands of all controls, (n, controls): zero of those that do not move."""
    n = len(next(iter(signal.values())))
    return np.column_stack([signal.get(c, np.zeros(n)) for c in controls])


def joined(duration_s: float, parts: Sequence[tuple[float, FloatArray]]) -> FloatArray:
    """Return parts, each from its time on (s), sampled at LOG_HZ."""
    out = np.zeros(round(duration_s * LOG_HZ))
    for start_s, part in parts:
        k = round(start_s * LOG_HZ)
        out[k : k + len(part)] += part
    return out


def steps(duration_s: float, step_s: float, lengths: Sequence[int], amplitude: float) -> FloatArray:
    """Return a multistep of alternating sign, sampled at LOG_HZ."""
    signs = [amplitude * (-1.0) ** i for i in range(len(lengths))]
    part = np.concatenate([np.full(round(n * step_s * LOG_HZ), a) for n, a in zip(lengths, signs, strict=True)])
    return joined(duration_s, [(0.5, part)])


def doublet(half_s: float, amplitude: float) -> FloatArray:
    """Return a doublet, sampled at LOG_HZ."""
    half = round(half_s * LOG_HZ)
    return np.concatenate([np.full(half, amplitude), np.full(half, -amplitude)])


def half_sine(length_s: float, amplitude: float) -> FloatArray:
    """Return half a period of a sine, sampled at LOG_HZ."""
    n = round(length_s * LOG_HZ)
    return np.asarray(amplitude * np.sin(np.pi * (np.arange(n) + 0.5) / n))


def sweep(duration_s: float, low_hz: float, high_hz: float, amplitude: float) -> FloatArray:
    """Return a logarithmic sweep, sampled at LOG_HZ."""
    length = duration_s - 2.0
    t = np.arange(round(length * LOG_HZ)) / LOG_HZ
    rate = np.log(high_hz / low_hz) / length
    phase = 2.0 * np.pi * low_hz * np.expm1(rate * t) / rate
    grow = np.minimum(1.0, 0.4 + 0.6 * t / length)  # slow motion answers more: less amplitude there
    return joined(duration_s, [(0.5, amplitude * grow * np.sin(phase))])
