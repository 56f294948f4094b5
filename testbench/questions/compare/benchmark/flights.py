"""Flights of a linear short period with one thing in the way of each: what a benchmark and the study of advice fly.

The truth is dx/dt = A x + B de with x = (alpha, q), integrated here and not by the testbench: what the flights say of
an estimator owes nothing to its own simulation.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from testbench.core.record import FlightRecord, FloatArray

DT = 0.02
INPUTS, OUTPUTS = ("de",), ("alpha", "q")
TRUTH = {"Z_alpha": -1.8, "Z_de": -0.12, "M_alpha": -14.0, "M_q": -2.6, "M_de": -18.0}
NOISE = np.array([0.002, 0.004])  # rad, rad/s
LONG, SHORT = 900, 30  # samples
COLOUR, COLOURED = 0.97, 3.0  # pole of coloured noise, and its size over that of the white
GUST, GUST_STD = 0.97, {"loop": 0.0012, "turbulence": 0.003}  # pole and step of the gust's angle, rad
MODE_RAD_S, MODE_ZETA, MODE_GAIN = 19.0, 0.03, 0.02
"""An elastic mode that elevator and alpha move and that the rate gyro feels; it moves nothing in return."""
SERVO_RAD_S = 12.0
SLOW = 6  # samples of DT to one of the slow record: 8.3 Hz
LOST = 0.15  # share of the samples of alpha that were not taken, in gaps
_SUBSTEPS = 10


def truth_matrices(params: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A (2, 2) and B (2, 1) of parameters in the order of :data:`TRUTH`."""
    Z, Zde, M, Mq, Mde = params
    return np.array([[Z, 1.0], [M, Mq]]), np.array([[Zde], [Mde]])


TRUE = np.array(list(TRUTH.values()))
A, B = truth_matrices(TRUE)
WN = float(np.sqrt(np.linalg.det(A)))
ZETA = float(-np.trace(A) / 2.0 / WN)


def doublets(samples: int) -> FloatArray:
    """Return 3-2-1-1 inputs of 0.04 rad, steps of 0.24 s, one after the other (samples,)."""
    u, step, k = np.zeros(samples), int(0.25 / DT), 25
    while k < samples:
        sign = 1.0
        for n in (3, 2, 1, 1):
            u[k : k + n * step] = 0.04 * sign
            sign, k = -sign, k + n * step
        k += 12 * step
    return u


def fly(case: str, seed: int) -> FlightRecord:
    """Return the measured flight (de, alpha, q) of a case.

    Cases: "loop" (rate and alpha feedback, gusts), "colour" (noise coloured over a second), "delay" (three samples),
    "drift" (biases and drifts), "stall" (lift and stability fall beyond 1.7 deg), "short", "turbulence" (gusts),
    "flexible" (an elastic mode in the rate), "slow" (8 Hz), "missing" (gaps in alpha), "servo" (the command is
    recorded, not the surface); any other has white noise alone.
    """
    return fly_with_surface(case, seed)[0]


def fly_with_surface(case: str, seed: int) -> tuple[FlightRecord, FloatArray]:
    """Return the measured flight of a case, and what its elevator did at every DT, rad."""
    rng = np.random.default_rng(seed)
    N = SHORT if case == "short" else LONG
    u = doublets(60)[24:54] if case == "short" else doublets(N)
    moved = np.concatenate([np.zeros(3), u[:-3]]) if case == "delay" else u
    if case == "servo":
        step = float(np.exp(-SERVO_RAD_S * DT))
        moved = lfilter([0.0, 1.0 - step], [1.0, -step], u)
    X, given = _states(case, moved, rng)
    Y = X + NOISE * rng.standard_normal((N, 2))
    if case == "colour":
        white = rng.standard_normal((N, 2))
        Y = X + COLOURED * NOISE * lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], white, axis=0)
    if case == "drift":
        Y = Y + np.array([0.02, 0.03]) + np.outer(np.arange(N) * DT / 18.0, [0.03, 0.05])
    if case == "flexible":
        Y[:, 1] += _elastic_rate(X[:, 0], given)
    recorded = u if case in ("delay", "servo") else given
    data = np.column_stack([recorded, Y]).astype(np.float64)
    valid = np.ones(data.shape, bool)
    if case == "missing":
        valid[:, 1] = ~_gaps(N, rng)
        taken = np.maximum.accumulate(np.where(valid[:, 1], np.arange(N), 0))
        data[:, 1] = data[taken, 1]
    every = slice(None, None, SLOW if case == "slow" else 1)
    t: FloatArray = np.arange(N, dtype=np.float64) * DT
    return FlightRecord(t[every], (*INPUTS, *OUTPUTS), data[every], "measured", valid=valid[every]), given


def steady_states(params: FloatArray, u: FloatArray, stall: bool) -> FloatArray:
    """Return the states (N, 2) that an elevator (N,) moves in still air, of any parameters."""
    A, B = truth_matrices(params)
    block = expm(np.block([[A, B], [np.zeros((1, 3))]]) * DT)
    X, x = np.zeros((len(u), 2)), np.zeros(2)
    for k in range(len(u)):
        X[k] = x
        x = _bent(x, u[k], params) if stall else block[:2, :2] @ x + block[:2, 2] * u[k]
    return X


def mean_outputs(case: str, params: FloatArray, surface: FloatArray) -> FloatArray:
    """Return what alpha and q (N, 2) would show without noise and gusts for any parameters."""
    Y = steady_states(params, surface, case == "stall")
    if case == "flexible":
        Y[:, 1] += _elastic_rate(Y[:, 0], surface)
    return Y


def _states(case: str, u: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the states (N, 2) and the elevator (N,) that the pilot's u, and in the loop a damper, moved."""
    if case not in ("loop", "turbulence"):
        return steady_states(TRUE, u, case == "stall"), np.array(u)
    N = len(u)
    block = expm(np.block([[A, B], [np.zeros((1, 3))]]) * DT)
    step, force = block[:2, :2], block[:2, 2]
    X, given, x, gust = np.zeros((N, 2)), np.array(u), np.zeros(2), 0.0
    for k in range(N):
        X[k] = x
        if case == "loop":
            sensed = x + NOISE * rng.standard_normal(2)
            given[k] = 0.25 * u[k] + 0.35 * sensed[1] + 0.5 * sensed[0]
        x = step @ x + force * given[k] + A[:, 0] * gust * DT
        gust = GUST * gust + GUST_STD[case] * rng.standard_normal()
    return X, given


def _bent(x: FloatArray, de: float, params: FloatArray) -> FloatArray:
    for _ in range(_SUBSTEPS):
        x = x + DT / _SUBSTEPS * _stalled(x, de, params)
    return x


def _stalled(x: FloatArray, de: float, params: FloatArray) -> FloatArray:
    Z, Zde, M, Mq, Mde = params
    beyond = max(abs(x[0]) - 0.03, 0.0)
    lift = x[0] - 0.5 * np.sign(x[0]) * beyond
    stability = lift * (1.0 - 0.6 * min(beyond / 0.03, 1.0))
    return np.array([Z * lift + x[1] + Zde * de, M * stability + Mq * x[1] + Mde * de])


def _elastic_rate(alpha: FloatArray, de: FloatArray) -> FloatArray:
    """Return the rate that a mode adds to what the gyro senses, rad/s."""
    w = MODE_RAD_S
    mode = np.array([[0.0, 1.0], [-w * w, -2.0 * MODE_ZETA * w]])
    block = expm(np.block([[mode, np.array([[0.0], [w * w]])], [np.zeros((1, 3))]]) * DT)
    out, eta = np.zeros(len(de)), np.zeros(2)
    for k in range(len(de)):
        out[k] = eta[1]
        eta = block[:2, :2] @ eta + block[:2, 2] * MODE_GAIN * (alpha[k] + de[k])
    return out


def _gaps(N: int, rng: np.random.Generator) -> np.ndarray:
    lost = np.zeros(N, bool)
    while lost.mean() < LOST:
        start, length = int(rng.integers(1, N - 20)), int(rng.integers(2, 15))
        lost[start : start + length] = True
    return lost
