"""Manoeuvres of every draw, what is believed to fly and to read them, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). Truths are flown by
JSBSim one by one: the sealed draws must keep their bytes, which a batch gives of a fifth of the samples only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from studies.blind.lateral_truths import STEPS
from studies.blind.truth import Truth
from studies.blind.truths import RATE_HZ as RATE_HZ
from studies.blind.truths import SPEEDS_M_S

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition
from testbench.flight.air import Air
from testbench.questions.gap.starts import Start, marked
from testbench.questions.hidden import Commands, fly_hidden
from testbench.sensors import Sensor, SensorSuite, load_suite

LOG_HZ = 50.0
SETTLE_S = 2.0
CONTROLS = ("de", "da", "dr", "thr")
SURFACES = ("de", "da", "dr")
NOISE_RAD = 0.001  # of a potentiometer at a hinge
HEIGHTS_M = {"eolo": 547.0, "taurus": 100.0}
# Amplitudes of elevator (rad) and throttle that move each aircraft by some 5 deg of alpha and 2 m/s.
_ELEVATOR = {"eolo": 0.045, "taurus": 0.035}
_THROTTLE = {"eolo": 0.15, "taurus": 0.15}
_UNIT_S = {"eolo": 0.5, "taurus": 0.3}  # of the aileron's switching, near the roll mode
Signals = Mapping[str, FloatArray]
"""Control -> samples at LOG_HZ."""


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


STOCK: dict[str, Flown] = {
    "jsbsim:737": Flown(_three(130.0, 160.0, 2000.0, 1500.0), 2.0 * DEG_RAD, 4.0 * DEG_RAD, 4.0 * DEG_RAD, 0.1, 0.8),
    "jsbsim:A4": Flown(_three(120.0, 150.0, 2000.0, 1500.0), 1.0 * DEG_RAD, 2.0 * DEG_RAD, 3.0 * DEG_RAD, 0.1, 0.5),
    "jsbsim:c172p": Flown(_three(43.0, 55.0, 1000.0, 600.0), 2.0 * DEG_RAD, 3.0 * DEG_RAD, 4.0 * DEG_RAD, 0.15, 0.5),
    "jsbsim:B747": Flown(_three(140.0, 175.0, 2000.0, 1500.0), 2.0 * DEG_RAD, 6.0 * DEG_RAD, 4.5 * DEG_RAD, 0.1, 1.0),
}
FIGHTER: dict[str, Flown] = {
    "jsbsim:f16": Flown(_three(150.0, 190.0, 2500.0, 1000.0), 2.0 * DEG_RAD, 3.5 * DEG_RAD, 2.4 * DEG_RAD, 0.1, 0.5),
}
"""Of a draw of its own: hardly stable in pitch, which those of the draw of stock aircraft are not."""


def _small(aircraft: str, slow: float, fast: float, h_m: float, unit_s: float) -> Flown:
    da, dr = (STEPS[c][aircraft] for c in ("da", "dr"))
    return Flown(_three(slow, fast, h_m, 400.0), _ELEVATOR[aircraft], da, dr, 0.15, unit_s)


SMALL: dict[str, Flown] = {
    "eolo": _small("eolo", 15.0, 18.0, 547.0, 0.4),
    "taurus": _small("taurus", 14.0, 17.0, 100.0, 0.3),
}
FLOWN = STOCK | FIGHTER | SMALL


# --- what is believed of them ----------------------------------------------------------------------------------------


def suite(draw: str = "main") -> SensorSuite:
    """Return the believed sensors of a draw, at 50 Hz.

    "main": V, alpha, q, theta, az and the commands; others: all axes and all commands; "paths": the surfaces, too.
    """
    if draw == "main":
        return replace(load_suite("eolo_gap"), name="eolo_gap_50hz", rate_hz=LOG_HZ)
    plain = replace(load_suite("eolo_gap_lateral"), name="eolo_gap_lateral_50hz", rate_hz=LOG_HZ)
    if draw != "paths":
        return plain
    surfaces = tuple(Sensor(c, noise_std=NOISE_RAD) for c in SURFACES)
    return replace(plain, name="eolo_gap_surfaces_50hz", sensors=(*plain.sensors, *surfaces))


def condition(draw: str, aircraft: str) -> FlightCondition:
    """Return the believed condition of an aircraft; that of its first records where these have several."""
    if draw in ("main", "lateral"):
        return FlightCondition(SPEEDS_M_S[aircraft], HEIGHTS_M[aircraft])
    return FLOWN[aircraft].conditions[0]


# --- manoeuvres ------------------------------------------------------------------------------------------------------


def manoeuvres(draw: str, aircraft: str, which: str) -> dict[str, tuple[Start, Signals]]:
    """Return name -> what a record starts from, and its commands.

    Args:
        draw: "main", "lateral", "stock", "paths" or "time".
        aircraft: that flies.
        which: "rich" (six) or "held_out" (two); of "main" also "short" (two).
    """
    if draw in ("main", "lateral"):
        start = Start(condition(draw, aircraft))
        flown = (_longitudinal if draw == "main" else _lateral)(aircraft, which)
        return {name: (start, signals) for name, signals in flown.items()}
    conditions = FLOWN[aircraft].conditions
    if draw == "time":
        timed = _over_time(aircraft, which).items()
        return {name: (Start(conditions[0], at_s=at_s), signals) for name, (at_s, signals) in timed}
    three = from_three(FLOWN[aircraft], which).items()
    return {name: (Start(conditions[i]), signals) for name, (i, signals) in three}


def told(draw: str, aircraft: str, which: str, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records that say what each was flown from, where they were not all flown from one condition."""
    starts = manoeuvres(draw, aircraft, which)
    return {n: r if draw in ("main", "lateral") else marked(r, starts[n][0]) for n, r in records.items()}


def _longitudinal(aircraft: str, which: str) -> dict[str, Signals]:
    e, t = _ELEVATOR[aircraft], _THROTTLE[aircraft]
    switch = 0.3 if aircraft == "eolo" else 0.25
    sets: dict[str, dict[str, Signals]] = {
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
    return sets[which]


def _lateral(aircraft: str, which: str) -> dict[str, Signals]:
    a, r, e = STEPS["da"][aircraft], STEPS["dr"][aircraft], _ELEVATOR[aircraft]
    unit = _UNIT_S[aircraft]
    bank = 2.0 * unit
    sets: dict[str, dict[str, Signals]] = {
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
    return sets[which]


def from_three(f: Flown, which: str) -> dict[str, tuple[int, Signals]]:
    """Return name -> (number of its condition, commands) of flights from three conditions."""
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


_LONG_S = 14.0
_FROM_S = 6.0  # of the surfaces, when the throttle is back


def _over_time(aircraft: str, which: str) -> dict[str, tuple[float, Signals]]:
    """Return name -> (time after take-off, s, commands) of one flight of half an hour.

    Each begins with a step of the throttle up and down, as a motor is judged by what it does and not by where it
    stands.
    """
    f = SMALL[aircraft]
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


# --- flights ---------------------------------------------------------------------------------------------------------


def fly(
    draw: str, aircraft: str, truth: Truth, which: str, seed: int, turbulence_rms_m_s: float = 0.0
) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    flights, controls = [], ("de", "thr") if draw == "main" else CONTROLS
    for i, (name, (start, signals)) in enumerate(manoeuvres(draw, aircraft, which).items()):
        gust = truth.gust if i == 0 and which != "held_out" else None  # a gust belongs to one flight and no other
        rms = (turbulence_rms_m_s,) * 3
        air = Air(turbulence_rms_m_s=rms, gust=gust, seed=seed + 7919 * i) if rms[0] or gust else None
        u = side_by_side(signals, controls)
        flights.append(Commands(name, controls, u, SETTLE_S, seed + i, start, air))
    return fly_hidden(truth.real(aircraft), suite(draw), flights, RATE_HZ)


fly_truth, fly_lateral, fly_stock, fly_paths, fly_over_time = (
    partial(fly, draw) for draw in ("main", "lateral", "stock", "paths", "time")
)


def side_by_side(signal: Signals, controls: Sequence[str]) -> FloatArray:
    """Return the commands of all controls, (n, controls): zero of those that do not move."""
    n = len(next(iter(signal.values())))
    return np.column_stack([signal.get(c, np.zeros(n)) for c in controls])


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


def _held(length_s: float, amplitude: float) -> FloatArray:
    return np.full(round(length_s * LOG_HZ), amplitude)
