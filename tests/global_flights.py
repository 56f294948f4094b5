"""Flights over the envelope of an aircraft for global models: how they are flown, with which instruments, what is true.

The multisines move every control at once, of two sizes in turn, at ten speeds; what needs a pilot to stay near its trim
has a stabiliser. The instruments are packaged ones of several suites: pitot tube, vanes, gyros, attitude, barometer,
accelerometers, potentiometers at the surfaces, the log of the throttle.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.aircraft.seams import stabilised
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.inputs import Multisine
from testbench.estimators.regression.global_model import FlownDomain
from testbench.flight.batch.along import ForcesAlong, GivenMotion, Lane, forces_along
from testbench.flight.coefficients import COEFFICIENTS, in_air
from testbench.inference.instruments import without_errors
from testbench.sensors import SensorSuite, load_suite

CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "h", "ax", "ay", "az", "de", "da", "dr", "thr_cmd")
_HELD, _RATE_HZ, _LOG_HZ = 24, 20.0, 200.0  # samples of a state: it is read when servos rest, two thirds on


@dataclass(frozen=True)
class Envelope:
    """Speeds m/s and height m of the trims, sizes of the multisines of de, da and dr, deg, and feedback."""

    speeds_m_s: tuple[float, ...]
    h_m: float
    sizes_deg: tuple[float, float, float]
    stabiliser: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


ENVELOPES = {
    "f16": Envelope(
        (84.0, 90.0, 98.0, 106.0, 115.0, 125.0, 140.0, 160.0, 185.0, 102.0), 3000.0, (5.0, 6.0, 3.6),
        {"da": {"phi": -0.2}, "de": {"alpha": 0.4, "q": 0.3, "theta": 0.2}},
    ),
    "T38": Envelope(
        (90.0, 98.0, 108.0, 120.0, 135.0, 150.0, 170.0, 190.0, 210.0, 103.0), 3000.0, (4.0, 4.0, 6.0),
        {"da": {"phi": -0.3}},
    ),
    "c172p": Envelope((28.0, 30.0, 32.0, 35.0, 38.0, 42.0, 47.0, 52.0, 58.0, 33.0), 1000.0, (5.0, 6.0, 8.0)),
}  # fmt: skip


def drawn(domain: FlownDomain, rng: np.random.Generator, count: int) -> dict[str, FloatArray]:
    """Return states, signal -> (count,): uniform over alpha, and in the domain over the other signals."""
    out, k = np.empty((0, 1 + len(domain.signals))), len(domain.signals)
    while len(out) < count:
        a = rng.uniform(domain.low, domain.high, count)
        away = rng.standard_normal((count, k))
        away *= (rng.random(count) ** (1.0 / k) / np.linalg.norm(away, axis=1))[:, None]
        away *= np.interp(a, domain.alpha, domain.radius)[:, None]
        middle, half = (
            np.stack([np.interp(a, domain.alpha, x[:, i]) for i in range(k)], axis=1)
            for x in (domain.middle, domain.half)
        )
        out = np.vstack([out, np.column_stack([a, middle + away * half])[np.abs(away).max(axis=1) <= 1.0]])
    return dict(zip(("alpha", *domain.signals), out[:count].T.copy(), strict=True))


@cache
def aircraft_of(name: str) -> Aircraft:
    """Return an aircraft of JSBSim's as it is believed, without its control law: forces are read at given surfaces."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tb.load_aircraft(f"jsbsim:{name}", commanded_at="surface")


def suite() -> SensorSuite:
    """Return the instruments, each as a packaged suite has it; the longitudinal accelerometer is one as the lateral."""
    sold = {s.channel: s for n in ("eolo_full", "eolo_gap", "eolo_gap_lateral", "eolo_alpha_beta")
            for s in load_suite(n).sensors}  # fmt: skip
    sold["ax"] = replace(sold["ay"], channel="ax")
    sold["h"] = replace(sold["h"], recorder="", clock_offset_s=0.0, clock_ppm=0.0)
    return SensorSuite("sold", "packaged instruments of several suites", 100.0, tuple(sold[c] for c in CHANNELS))


def data_sheet_lags() -> dict[str, float]:
    """Return the lags that the instruments have, as a description's ``correct`` names them, s."""
    return {f"{s.channel}_lag": s.lag_s for s in suite().sensors if s.lag_s}


@cache
def truths(name: str, count: int = 10, duration_s: float = 60.0) -> tuple[FlightRecord, ...]:
    """Return the truth of flights at the first speeds of an envelope."""
    envelope = ENVELOPES[name]
    flown = stabilised(replace(aircraft_of(name), stabiliser=envelope.stabiliser))
    out = []
    for i, V in enumerate(envelope.speeds_m_s[:count]):
        trimmed = tb.trim(flown, tb.FlightCondition(V, envelope.h_m))
        inputs = [
            Multisine(
                signal="multisine", control=c, amplitude_deg=size * (1.0 if i % 2 else 0.7), f_max_hz=1.2,
                f_min_hz=0.1 if c == "de" else 0.15, period_s=20.0, periods=int(duration_s / 20.0), stride=3,
                first=(k + i) % 3,
            )
            for k, (c, size) in enumerate(zip(("de", "da", "dr"), envelope.sizes_deg, strict=True))
        ]  # fmt: skip
        manoeuvre = tb.Manoeuvre.of(f"log{i + 1}", inputs, duration_s, trimmed.rate_hz)
        out.append(tb.fly_and_measure(tb.Job(flown, trimmed, manoeuvre, _LOG_HZ)).flown)
    return tuple(out)


def logs(
    name: str, seed: int, errors: Mapping[str, float] | None = None, **flown: float
) -> list[tuple[str, str, FlightRecord]]:
    """Return flights as logged, with the lags of the data sheets and ``errors`` taken out (a minus lays them on)."""
    out = {**data_sheet_lags(), **(errors or {})}
    records = [suite().measure(truth, 100 * seed + i) for i, truth in enumerate(truths(name, **flown))]  # type: ignore
    return [(f"log{i + 1}", "identification", without_errors(r, out)) for i, r in enumerate(records)]


def given_states(aircraft: Aircraft, states: Mapping[str, FloatArray], V_ref: float, h_m: float) -> GivenMotion:
    """Return a motion that rests in each state, signal -> (n,), for a while; alphadot is q."""
    a, b, V, g = states["alpha"], states["beta"], (1.0 + states["V_rel"]) * V_ref, aircraft.geometry
    p, q, r = (states[f"{n}_hat"] * 2.0 * V / x for n, x in (("p", g.b_m), ("q", g.cbar_m), ("r", g.b_m)))
    motion = {
        "h": np.full_like(a, h_m), "phi": np.zeros_like(a), "theta": a, "V": V, "alpha": a, "beta": b, "p": p, "q": q,
        "r": r, "udot": -V * np.sin(a) * np.cos(b) * q, "vdot": np.zeros_like(a),
        "wdot": V * np.cos(a) * np.cos(b) * q,
    }  # fmt: skip
    limits = aircraft.controls
    commands = {c: np.clip(states[c], limits[c].low, limits[c].full) for c in ("de", "da", "dr")}
    return GivenMotion(
        _RATE_HZ,
        {k: np.repeat(x, _HELD) for k, x in motion.items()},
        {c: np.repeat(u, _HELD) for c, u in commands.items()},
    )


def at_states(aircraft: Sequence[Aircraft], given: GivenMotion, V_m_s: float, h_m: float) -> list[ForcesAlong]:
    """Return what aircraft say of the forces in states, all with the engines of the first one's trim."""
    trimmed = tb.trim(aircraft[0], tb.FlightCondition(V_m_s, h_m), 200.0)
    return forces_along([Lane(a, trimmed, given) for a in aircraft])


def coefficients_of(
    aircraft: Aircraft,
    forces: ForcesAlong,
    states: Mapping[str, FloatArray],
    more_force: FloatArray | float = 0.0,
    more_moment: FloatArray | float = 0.0,
) -> dict[str, FloatArray]:
    """Return the six coefficients (n,) of the aerodynamics in states, with more force and moment (samples, 3)."""
    at, g = np.arange(len(states["alpha"])) * _HELD + 2 * _HELD // 3, aircraft.geometry
    F, M = (forces.aero_force + more_force)[at], (forces.aero_moment + more_moment)[at]
    qS = forces.qbar_Pa[at] * g.S_m2
    values = in_air(F, M, states["alpha"], states["beta"], qS, np.array([g.b_m, g.cbar_m, g.b_m]))
    return dict(zip(COEFFICIENTS, values.T, strict=True))
