"""Manoeuvre sets of the blind test, and flights of a truth through them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.aircraft import Aircraft, Amendment, Insert, ScaleCoefficient, SetProperty, SetText, load_aircraft
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition, Manoeuvre, fly, trim
from testbench.flight.air import Air, Gust
from testbench.inputs.signal import InputSignal
from testbench.sensors import Sensor, SensorSuite, load_suite

RATE_HZ = 100.0
LOG_HZ = 50.0
SETTLE_S = 2.0
SPEEDS_M_S = {"eolo": 16.0, "taurus": 15.0}
HEIGHTS_M = {"eolo": 547.0, "taurus": 100.0}
# Amplitudes of elevator (rad) and throttle that move each aircraft by some 5 deg of alpha and 2 m/s.
_ELEVATOR = {"eolo": 0.045, "taurus": 0.035}
_THROTTLE = {"eolo": 0.15, "taurus": 0.15}

Command = Callable[[FloatArray, float], FloatArray]
Reading = Callable[[Sensor], Sensor]


@dataclass(frozen=True)
class Plan:
    """What a hidden truth changes, in the order in which it acts.

    Attributes:
        elevator, throttle: (command (frames,) as deviation from trim, frame time) -> what is sent to the servo.
        whole_servo: the elevator's command is turned into the deflection itself; of the believed servo only its slew
            limit is left.
        changes: edits of the JSBSim model.
        flexible: fly with the elastic modes.
        extra_kg: mass that the edits add.
        read: what becomes of each sensor.
        spoil: (channel -> readings, time) -> readings, after the sensors.
        gust: a gust, met in one of the manoeuvres.
    """

    elevator: Command | None = None
    throttle: Command | None = None
    whole_servo: bool = False
    changes: tuple[Insert | SetText | SetProperty | ScaleCoefficient, ...] = ()
    flexible: bool = False
    extra_kg: float = 0.0
    read: Reading | None = None
    spoil: Callable[[str, FloatArray, FloatArray], FloatArray] | None = None
    gust: Gust | None = None
    factors: Mapping[str, float] = field(default_factory=dict)

    def with_(self, other: Plan) -> Plan:
        """Return both plans at once; command and sensor parts must not clash."""
        return Plan(
            self.elevator or other.elevator,
            self.throttle or other.throttle,
            self.whole_servo or other.whole_servo,
            (*self.changes, *other.changes),
            self.flexible or other.flexible,
            self.extra_kg + other.extra_kg,
            self.read or other.read,
            self.spoil or other.spoil,
            self.gust or other.gust,
            {**self.factors, **other.factors},
        )


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
    plan: Plan,
    which: str,
    seed: int,
    turbulence_rms_m_s: float = 0.0,
) -> dict[str, FlightRecord]:
    """Fly a truth through a set of manoeuvres; return name -> measured record, provenance left out.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    real = _real(aircraft, plan)
    sensors = suite()
    if plan.read is not None:
        sensors = replace(sensors, sensors=tuple(plan.read(s) for s in sensors.sensors))
    trimmed = trim(real, condition(aircraft), RATE_HZ)
    signals, names = manoeuvres(aircraft, which)
    out = {}
    for i, (name, signal) in enumerate(zip(names, signals, strict=True)):
        channels = ("de", "thr")
        n = len(next(iter(signal.values())))
        coarse = np.column_stack([signal.get(c, np.zeros(n)) for c in channels])
        u = np.repeat(coarse, round(RATE_HZ / LOG_HZ), axis=0)
        sent = u.copy()
        if plan.elevator is not None:
            sent[:, 0] = plan.elevator(u[:, 0], 1.0 / RATE_HZ)
        if plan.throttle is not None:
            sent[:, 1] = plan.throttle(u[:, 1], 1.0 / RATE_HZ)
        flown = InputSignal(np.arange(len(u)) / RATE_HZ, sent, channels)
        met = plan.gust if i == 0 and which != "held_out" else None  # a gust belongs to one flight and no other
        air = _air(turbulence_rms_m_s, met, seed + 7919 * i)
        truth = fly(real, trimmed, Manoeuvre(name, flown, SETTLE_S), LOG_HZ, None, air)
        measured = replace(sensors.measure(truth, seed + i), provenance={"manoeuvre": name})
        out[name] = _as_recorded(measured, coarse, trimmed.controls, plan)
    return out


def _air(rms_m_s: float, gust: Gust | None, seed: int) -> Air | None:
    if rms_m_s == 0.0 and gust is None:
        return None
    return Air(turbulence_rms_m_s=(rms_m_s,) * 3, gust=gust, seed=seed)


def _as_recorded(record: FlightRecord, u: FloatArray, trim_: Mapping[str, float], plan: Plan) -> FlightRecord:
    """Return the record with the commands as they were issued, and readings spoiled as the plan says."""
    data = record.data.copy()
    quiet = round(SETTLE_S * LOG_HZ)
    issued = np.concatenate([np.zeros((quiet, 2)), u, u[-1:]])[: len(record)]
    for i, name in enumerate(("de", "thr")):
        data[:, record.channels.index(f"{name}_cmd")] = trim_[name] + issued[:, i]
    if plan.spoil is not None:
        for i, name in enumerate(record.channels):
            data[:, i] = plan.spoil(name, data[:, i], record.t_s)
    return replace(record, data=data)


def _real(name: str, plan: Plan) -> Aircraft:
    aircraft = load_aircraft(name, "flexible" if plan.flexible and name == "eolo" else "rigid")
    changes = [*plan.changes, *(ScaleCoefficient(n, f) for n, f in plan.factors.items())]
    if plan.whole_servo:
        changes.append(SetProperty("fcs/elevator-lag-rad_sec", 1e5))  # its slew limit stays
    real = aircraft.amended(Amendment("hidden", "hidden", tuple(changes))) if changes else aircraft
    return replace(real, mass=replace(real.mass, mass_kg=real.mass.mass_kg + plan.extra_kg))


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
