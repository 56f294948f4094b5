"""Small linear aircraft for exercises: the short period, exact responses to held inputs, records and random draws."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.random import Generator
from scipy.linalg import expm

from testbench.core.record import FlightRecord, FloatArray


def respond(A: FloatArray, B: FloatArray, u: FloatArray, dt_s: float) -> FloatArray:
    """Return the states (n, k) of xdot = A x + B u from rest, for inputs u (n, m) held from sample to sample."""
    k, m = B.shape
    step = expm(np.block([[A, B], [np.zeros((m, k + m))]]) * dt_s)
    F, G = step[:k, :k], step[:k, k:]
    x = np.zeros((len(u), k))
    for i in range(1, len(u)):
        x[i] = F @ x[i - 1] + G @ u[i - 1]
    return x


def short_period_matrices(d: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return A and B of alphadot = Z_alpha alpha + q + Z_de de, qdot = M_alpha alpha + M_q q + M_de de."""
    A = np.array([[d["Z_alpha"], 1.0], [d["M_alpha"], d["M_q"]]])
    return A, np.array([[d.get("Z_de", 0.0)], [d["M_de"]]])


def with_servo(A: FloatArray, B: FloatArray, tau_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A and B with one more state, the last: the deflection, which follows the one input by a lag of tau_s."""
    n = len(A)
    driven = np.block([[A, B], [np.zeros((1, n)), np.array([[-1.0 / tau_s]])]])
    return driven, np.concatenate([np.zeros((n, 1)), [[1.0 / tau_s]]])


def draw_short_period(
    rng: Generator, omega: tuple[float, float], zeta: tuple[float, float], M_de: tuple[float, float]
) -> dict[str, float]:
    """Draw dimensional derivatives of an aircraft whose short period lies in the given ranges.

    wn^2 = Z_alpha M_q - M_alpha and 2 zeta wn = -(Z_alpha + M_q); Z_alpha gives 40 to 60 % of the damping.
    """
    wn, z = rng.uniform(*omega), rng.uniform(*zeta)
    share = rng.uniform(0.4, 0.6)
    Z_alpha, M_q = -2.0 * z * wn * share, -2.0 * z * wn * (1.0 - share)
    return {
        "omega": float(wn),
        "zeta": float(z),
        "Z_alpha": float(Z_alpha),
        "M_q": float(M_q),
        "M_alpha": float(Z_alpha * M_q - wn**2),
        "M_de": float(rng.uniform(*M_de)),
    }


def measured(columns: Mapping[str, FloatArray], dt_s: float) -> FlightRecord:
    """Return a measured record of channels (each (n,)) sampled every ``dt_s`` from 0."""
    n = len(next(iter(columns.values())))
    data = np.column_stack(list(columns.values())).astype(np.float64)
    t = (np.arange(n) * dt_s).astype(np.float64)
    return FlightRecord(t, tuple(columns), data, "measured")


def doublet(n: int, dt_s: float, start_s: float, step_s: float, amplitude: float) -> FloatArray:
    """Return a doublet (n,): ``amplitude`` for one step, minus it for another."""
    t = np.arange(n) * dt_s + 1e-9
    first = (t >= start_s) & (t < start_s + step_s)
    second = (t >= start_s + step_s) & (t < start_s + 2.0 * step_s)
    return amplitude * (first.astype(float) - second.astype(float))


def multistep(
    n: int, dt_s: float, start_s: float, step_s: float, amplitude: float, lengths: str = "3211"
) -> FloatArray:
    """Return steps (n,) of alternating sign that last ``lengths`` times ``step_s``."""
    t = np.arange(n) * dt_s + 1e-9
    u, at, sign = np.zeros(n), start_s, 1.0
    for length in lengths:
        end = at + int(length) * step_s
        u[(t >= at) & (t < end)] = sign * amplitude
        at, sign = end, -sign
    return u
