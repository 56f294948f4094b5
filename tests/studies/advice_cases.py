"""Flights of a linear short period with one thing wrong with each, for the study of advice.

The truth is dx/dt = A x + B de with x = (alpha, q), integrated here and not by the testbench: what the cases say of an
estimator owes nothing to its own simulation. One case is clean; every other breaks one assumption of the methods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from testbench.core.record import FlightRecord, FloatArray

DT = 0.02
INPUTS, OUTPUTS = ("de",), ("alpha", "q")
TRUTH = {"Z_alpha": -1.8, "Z_de": -0.12, "M_alpha": -14.0, "M_q": -2.6, "M_de": -18.0}
_Z, _ZDE, _M, _MQ, _MDE = TRUTH.values()
A = np.array([[_Z, 1.0], [_M, _MQ]])
B = np.array([[_ZDE], [_MDE]])
WN = float(np.sqrt(np.linalg.det(A)))
ZETA = float(-np.trace(A) / 2.0 / WN)
NOISE = np.array([0.002, 0.004])  # rad, rad/s
LONG, SHORT = 900, 30  # samples
_SUBSTEPS = 10


@dataclass(frozen=True)
class Case:
    """What is wrong with a flight, and which codes of advice name it.

    Attributes:
        words: what is wrong.
        names: codes that name the cause. Of the clean flight and of too many states, what noise does to methods that it
            biases; a missing state may be called a lag.
        order: number of states that is asked for; the truth has two.
        samples: of the record.
    """

    words: str
    names: tuple[str, ...] = ()
    order: int = 2
    samples: int = LONG


CASES = {
    "clean": Case("white measurement noise", ("far_from_best", "noisy_terms")),
    "loop": Case("rate and alpha feedback, gusts", ("closed_loop",)),
    "colour": Case("noise of the sensors coloured over a second", ("coloured_residuals",)),
    "delay": Case("the surface follows three samples late", ("delay", "lag")),
    "drift": Case("biases and drifts of the sensors", ("drift",)),
    "stall": Case("lift and stability fall beyond 1.7 deg", ("bend",)),
    "order4": Case(
        "two states too many",
        ("order_too_high", "not_told_apart", "weak_state", "no_continuous_counterpart", "far_from_best"),
        order=4,
    ),
    "order1": Case("one state too few", ("order_too_low", "lag"), order=1),
    "short": Case("thirty samples", ("few_data",), samples=SHORT),
}


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
    """Return the measured flight (de, alpha, q) of a case."""
    rng = np.random.default_rng(seed)
    N = CASES[case].samples
    u = doublets(60)[24:54] if case == "short" else doublets(N)
    moved = np.concatenate([np.zeros(3), u[:-3]]) if case == "delay" else u
    X, given = _states(case, moved, rng)
    Y = X + NOISE * rng.standard_normal((N, 2))
    if case == "colour":
        white = rng.standard_normal((N, 2))
        Y = X + 3.0 * NOISE * lfilter([np.sqrt(1.0 - 0.97**2)], [1.0, -0.97], white, axis=0)
    if case == "drift":
        Y = Y + np.array([0.02, 0.03]) + np.outer(np.arange(N) * DT / 18.0, [0.03, 0.05])
    recorded = u if case == "delay" else given
    return FlightRecord(np.arange(N) * DT, (*INPUTS, *OUTPUTS), np.column_stack([recorded, Y]), "measured")


def _states(case: str, u: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return the states (N, 2) and the elevator (N,) that the pilot's u, and in the loop a damper, moved."""
    N, h = len(u), DT / _SUBSTEPS
    block = expm(np.block([[A, B], [np.zeros((1, 3))]]) * DT)
    step, force = block[:2, :2], block[:2, 2]
    X, given, x, gust = np.zeros((N, 2)), np.array(u), np.zeros(2), 0.0
    for k in range(N):
        X[k] = x
        if case == "loop":
            sensed = x + NOISE * rng.standard_normal(2)
            given[k] = 0.25 * u[k] + 0.35 * sensed[1] + 0.5 * sensed[0]
        if case == "stall":
            for _ in range(_SUBSTEPS):
                x = x + h * _stalled(x, given[k])
        else:
            x = step @ x + force * given[k]
        if case == "loop":
            x = x + np.array([_Z, _M]) * gust * DT
            gust = 0.97 * gust + 0.0012 * rng.standard_normal()
    return X, given


def _stalled(x: FloatArray, de: float) -> FloatArray:
    beyond = max(abs(x[0]) - 0.03, 0.0)
    lift = x[0] - 0.5 * np.sign(x[0]) * beyond
    stability = lift * (1.0 - 0.6 * min(beyond / 0.03, 1.0))
    return np.array([_Z * lift + x[1] + _ZDE * de, _M * stability + _MQ * x[1] + _MDE * de])
