"""What the estimators of the study are given: simulated flights of both aircraft whose truth is known.

``longitudinal``: the linearised longitudinal motion, two records of 320 and 240 samples (Taurus at 40 Hz, EOLO at
20 Hz), 3-2-1-1 multisteps of 0.05 rad of a held elevator, each followed by its mirror image, white noise of the EOLO
suite with the air data boom on V, alpha, q and theta. EOLO's short period is overdamped: two real poles, whose product
and sum stand for frequency and damping.

``multisine``: the same motion in the steady response to 25 lines of 0.1 to 2.5 Hz, nine periods of 10 s, and, for
windowed spectra, 90 s of random steps of 0.1 rad, at random to one side or the other, every 0.2 s; same noise.

``instruments``: the kinematics of such a flight of 24 s, noise of the suite on outputs and inputs, and four instruments
that err.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "estimators" / "parametric"), str(ROOT / "tests" / "studies")]

from parametric_cases import fly  # noqa: E402

from testbench.core.constants import G0_M_S2  # noqa: E402
from testbench.core.errors import EstimationError  # noqa: E402
from testbench.core.record import FlightRecord  # noqa: E402
from testbench.estimators.parametric.response import Sampling, discretise, respond  # noqa: E402
from testbench.estimators.parametric.structures import Trim, longitudinal  # noqa: E402
from testbench.evaluation.derivatives import dimensional_derivatives  # noqa: E402
from testbench.flight import FlightCondition, linearise, load_aircraft, trim  # noqa: E402
from testbench.sensors import load_suite  # noqa: E402

OUTPUTS = ("V", "alpha", "q", "theta")
LENGTHS, AMPLITUDE = (320, 240), 0.05
DT = {"taurus": 0.025, "eolo": 0.05}
UNITS = {"taurus": (0.15, 0.25), "eolo": (0.3, 0.5)}  # of the 3-2-1-1, s
HELD = np.ones(1, bool)
CONDITIONS = {"taurus": FlightCondition(12.0, 100.0), "eolo": FlightCondition(16.0, 547.0)}
_HOLD = {"taurus": 8, "eolo": 4}  # samples between the random steps: 0.2 s
RESPONDING = ("alpha", "q")
PERIOD_S, PERIODS, LINES = 10.0, 9, np.arange(1, 26)
ERRORS = {"q_bias": 0.01, "az_bias": 0.2, "alpha_scale": 0.1, "theta_bias": 0.02}


class Case(NamedTuple):
    """One aircraft in one kind of flight.

    ``true``: quantity -> its true value; ``bound``: quantity -> its Cramer-Rao bound, where there is one; ``draw``:
    seed -> records; ``whiten``: takes errors of the free derivatives to unit covariance at the bound.
    """

    name: str
    true: dict[str, float]
    draw: Callable[[int], list[FlightRecord]]
    structure: Any = None
    pair: np.ndarray = np.zeros(0)
    bound: dict[str, float] = {}
    whiten: np.ndarray = np.zeros((0, 0))
    clean: tuple[FlightRecord, ...] = ()
    response: np.ndarray = np.zeros(0)  # at the lines of the multisine


def modal_of(pair: np.ndarray) -> dict[str, float]:
    """Return natural frequency and damping ratio of a pair of poles, and each pole if they are real."""
    wn = float(np.sqrt(np.abs(pair[0] * pair[1])))
    out = {"wn": wn, "zeta": float(-np.real(pair[0] + pair[1]) / (2.0 * wn))}
    if np.all(pair.imag == 0.0):
        out |= dict(zip(("slow pole", "fast pole"), np.sort(pair.real)[::-1].tolist(), strict=True))
    return out


def closest(poles: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the two poles, together closed under conjugation, that lie nearest to the true pair."""
    best, least = None, np.inf
    for i in range(poles.size):
        for j in range(poles.size):
            a, b = poles[i], poles[j]
            if i == j or abs((a + b).imag) > 1e-6 * abs(a):
                continue
            apart = abs(a - pair[0]) + abs(b - pair[1])
            if apart < least:
                best, least = np.array([a, b], complex), apart
    if best is None:
        raise EstimationError("no pair of poles")
    return best


def gradient(structure: Any, params: np.ndarray, pair: np.ndarray) -> dict[str, np.ndarray]:
    """Return quantity -> its derivatives (k,) by the parameters, central differences, for the modes of ``pair``."""
    names = list(modal_of(closest(np.linalg.eigvals(structure.matrices(params).A), pair)))
    out = {name: np.zeros(params.size) for name in names}
    for j in np.flatnonzero(structure.free):
        step = 1e-6 * max(abs(params[j]), 1.0)
        ends = []
        for sign in (1.0, -1.0):
            moved = params.copy()
            moved[j] += sign * step
            ends.append(modal_of(closest(np.linalg.eigvals(structure.matrices(moved).A), pair)))
        for name in names:
            if all(name in end for end in ends):
                out[name][j] = (ends[0][name] - ends[1][name]) / (2.0 * step)
    return out


def elevator(name: str, samples: int, unit: float) -> np.ndarray:
    """Return the input (n, 1): 3-2-1-1, its mirror image, and so on, with a rest between them."""
    u, width, k, sign = np.zeros((samples, 1)), round(unit / DT[name]), 10, 1.0
    while k < samples:
        for length in (3, 2, 1, 1, 3, 2, 1, 1):
            u[k : k + length * width] = sign * AMPLITUDE
            k, sign = k + length * width, -sign
        k += 2 * width
    return u


def _motion(name: str) -> tuple[Any, np.ndarray]:
    """Return the structure with its true values, and the noise (p,) of its outputs."""
    aircraft = load_aircraft(name)
    trimmed = trim(aircraft, CONDITIONS[name])
    derivatives = dimensional_derivatives(linearise(aircraft, trimmed), trimmed)
    values = {d.name: d.held if d.static is None else d.static for d in derivatives}
    structure = longitudinal(Trim(trimmed.condition.V_m_s, trimmed.alpha, trimmed.state["theta"]), outputs=OUTPUTS)
    structure = structure.with_parameters({n: values[n] for n in structure.parameter_names if n in values})
    noise = {s.channel: s.noise_std for s in load_suite("eolo_alpha").sensors}
    return structure, np.array([noise[output] for output in OUTPUTS])


def _noisy(clean: list[FlightRecord], std: np.ndarray, seed: int) -> list[FlightRecord]:
    """Return the records with the noise of a seed, ``std`` by channel after the first."""
    rng = np.random.default_rng(seed)
    out = []
    for r in clean:
        e = rng.standard_normal((len(r), std.size))
        out.append(FlightRecord(r.t_s, r.channels, r.data + np.hstack([np.zeros((len(r), 1)), std * e]), "measured"))
    return out


def prepare_longitudinal(name: str) -> Case:
    """Return the 3-2-1-1 flights of an aircraft with their bounds."""
    structure, std = _motion(name)
    p, free, n = structure.values, np.flatnonzero(structure.free), len(structure.states)
    clean, J = [], []
    for i, (samples, unit) in enumerate(zip(LENGTHS, UNITS[name], strict=True)):
        u = elevator(name, samples, unit)
        r = respond(structure, p, free.tolist(), u, Sampling(DT[name], HELD), np.zeros(n))
        clean.append(fly(structure, p, u, DT[name], np.zeros(n), held=True))
        own = [r.dx0 if i == k else np.zeros((len(u), len(OUTPUTS), n)) for k in range(len(LENGTHS))]
        J.append((np.concatenate([r.dparams, *own], axis=2) / std[:, None]).reshape(len(u) * len(OUTPUTS), -1))
    stacked = np.vstack(J)
    covariance = np.linalg.inv(stacked.T @ stacked)[: free.size, : free.size]
    poles = np.linalg.eigvals(structure.matrices(p).A).astype(complex)
    pair = poles[np.argsort(-np.abs(poles))[:2]]
    slopes = gradient(structure, p, pair)
    bound = {q: float(np.sqrt(slope[free] @ covariance @ slope[free])) for q, slope in slopes.items()}
    names = np.array(structure.parameter_names)[free]
    true = modal_of(pair) | {f"derivatives: {q}": float(v) for q, v in zip(names, p[free], strict=True)}
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    return Case(name, true, lambda seed: _noisy(clean, std, seed), structure, pair, bound, whiten, clean=tuple(clean))


def prepare_multisine(name: str) -> Case:
    """Return the steady response of alpha and q to a multisine, then that to random steps, which the methods read."""
    structure, std = _motion(name)
    dt, p = DT[name], structure.values
    period = round(PERIOD_S / dt)
    t = np.arange(period) * dt
    phases = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, LINES.size)
    one = 0.02 * np.sum(np.cos(2.0 * np.pi * LINES / PERIOD_S * t[:, None] + phases), axis=1)[:, None]
    s = structure.matrices(p)
    d = discretise(s, dt, HELD)
    x = respond(structure, p, (), np.vstack([one, one[:1]]), Sampling(dt, HELD), np.zeros(4)).x[-1]
    x0 = np.linalg.solve(np.eye(4) - np.linalg.matrix_power(d.A, period), x)
    whole = fly(structure, p, np.tile(one, (PERIODS, 1)), dt, x0, held=True)
    steps = 0.1 * np.random.default_rng(2).choice([-1.0, 1.0], (len(whole) // _HOLD[name] + 1, 1))
    random = np.repeat(steps, _HOLD[name], axis=0)[: len(whole)]
    clean = [r.select(("de", *RESPONDING)) for r in (whole, fly(structure, p, random, dt, np.zeros(4), held=True))]
    z = np.exp(2j * np.pi * LINES / PERIOD_S * dt)
    rows = [OUTPUTS.index(o) for o in RESPONDING]
    response = (s.C[rows] @ np.linalg.solve(z[:, None, None] * np.eye(4) - d.A, d.G.astype(complex)))[:, :, 0]
    poles = np.linalg.eigvals(s.A).astype(complex)
    pair = poles[np.argsort(-np.abs(poles))[:2]]
    true = modal_of(pair)
    for i, output in enumerate(RESPONDING):
        for f, H in zip(LINES / PERIOD_S, response[:, i], strict=True):
            true |= {f"gain: {output}, {f:.1f} Hz": float(np.abs(H)), f"phase: {output}, {f:.1f} Hz": 0.0}
    return Case(name, true, lambda seed: _noisy(clean, std[rows], seed), pair=pair, response=response)


def prepare_instruments(name: str) -> Case:
    """Return a flight of 24 s as its instruments read it, some of which err (``ERRORS``)."""
    structure, _ = _motion(name)
    dt, V0 = 0.04, structure.trim.V
    size = {"taurus": 1.5, "eolo": 0.7}[name]
    u = size * elevator(name, round(24.0 / DT[name]), 0.8)  # long steps, which move the airspeed, too
    flown = fly(structure, structure.values, u, DT[name], np.zeros(4), held=True)
    t = np.arange(0.0, 23.9, dt)
    dev = {c: np.interp(t, flown.t_s, flown[c]) for c in OUTPUTS}
    V, alpha, theta = V0 + dev["V"], structure.trim.alpha + dev["alpha"], structure.trim.theta + dev["theta"]
    x = np.column_stack([V * np.cos(alpha), V * np.sin(alpha)])
    du, dw = np.gradient(x, t, axis=0).T
    q = np.gradient(theta, t)
    ax = du + q * x[:, 1] + G0_M_S2 * np.sin(theta)
    az = dw - q * x[:, 0] - G0_M_S2 * np.cos(theta)
    inputs = np.column_stack([q, ax, az])

    def kinematics(at: float, state: np.ndarray) -> list[float]:
        rate, fx, fz = (np.interp(at, t, column) for column in inputs.T)
        forward, down, pitch, _ = state
        return [
            fx - rate * down - G0_M_S2 * np.sin(pitch),
            fz + rate * forward + G0_M_S2 * np.cos(pitch),
            rate,
            forward * np.sin(pitch) - down * np.cos(pitch),
        ]

    state = solve_ivp(kinematics, (0.0, t[-1]), [*x[0], theta[0], 300.0], t_eval=t, rtol=1e-9, atol=1e-9, max_step=dt).y
    true = {
        "V": np.hypot(state[0], state[1]),
        "alpha": np.arctan2(state[1], state[0]),
        "theta": state[2],
        "h": state[3],
        **dict(zip(("q", "ax", "az"), inputs.T, strict=True)),
    }
    channels = tuple(true)
    read = [(1.0 + ERRORS.get(f"{c}_scale", 0.0)) * true[c] + ERRORS.get(f"{c}_bias", 0.0) for c in channels]
    noise = {s.channel: s.noise_std for s in load_suite("eolo_alpha").sensors}
    noise |= {"ax": 0.05, "az": 0.05, "h": 0.3}  # a small aircraft's inertial unit and static port, estimated
    std = np.array([noise[c] for c in channels])
    data = np.column_stack(read)

    def draw(seed: int) -> list[FlightRecord]:
        e = np.random.default_rng(seed).standard_normal(data.shape)
        return [FlightRecord(t, channels, data + std * e, "measured")]

    errors = dict.fromkeys(("wind_bias", *(f"{c}_{kind}" for c in channels for kind in ("bias", "late", "scale"))), 0.0)
    errors |= ERRORS
    kinds = ("instrument errors", "tested instrument errors")
    return Case(name, {f"{kind}: {k}": v for kind in kinds for k, v in errors.items()}, draw)
