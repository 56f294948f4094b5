"""Small linear aircraft for exercises: the short period, exact responses to held inputs, records and random draws.

What a record of the short period tells: exact standard errors for white and for coloured noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator
from scipy.linalg import expm

from testbench.core.record import FlightRecord, FloatArray

if TYPE_CHECKING:
    from testbench.estimators.parametric.model import ParametricModel


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


def short_period_response(d: Mapping[str, float], u: FloatArray, dt_s: float, servo_s: float = 0.0) -> FloatArray:
    """Return alpha and q (n, 2) from rest for elevator commands (n,), through a servo of lag servo_s if it is not 0."""
    A, B = short_period_matrices(d)
    return respond(*(with_servo(A, B, servo_s) if servo_s else (A, B)), u[:, None], dt_s)[:, :2]


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


PARAMETERS = ("Z_alpha", "M_alpha", "M_q", "M_de")
_STATES = ("alpha", "q")
_STEP = 1e-4


def sensitivities(d: Mapping[str, float], u: FloatArray, dt_s: float, outputs: Sequence[str]) -> FloatArray:
    """Return the derivatives (n, p, 4) of the outputs by PARAMETERS, by central differences."""
    rows = [_STATES.index(name) for name in outputs]
    out = np.empty((len(u), len(rows), len(PARAMETERS)))
    for k, name in enumerate(PARAMETERS):
        step = _STEP * abs(d[name])
        y = [short_period_response({**d, name: d[name] + s}, u, dt_s) for s in (step, -step)]
        out[:, :, k] = (y[0] - y[1])[:, rows] / (2.0 * step)
    return out


def standard_errors(J: FloatArray, noise_std: Sequence[float]) -> dict[str, float]:
    """Return the Cramer-Rao bounds: the root of the diagonal of (sum J' R^-1 J)^-1 for white noise."""
    covariance = np.linalg.inv(_information(J, noise_std))
    return dict(zip(PARAMETERS, np.sqrt(np.diag(covariance)).tolist(), strict=True))


def coloured_errors(J: FloatArray, noise_std: Sequence[float], correlation: float) -> dict[str, float]:
    """Return the true standard errors of least squares whose residuals have R[k] = R[0] correlation^|k|.

    With F = (sum J' R^-1 J)^-1 they are the root of the diagonal of F (sum_ij J_i' R^-1 R[j - i] R^-1 J_j) F.
    """
    W = J / np.asarray(noise_std)[:, None]
    forward = np.zeros_like(W)
    for i in range(1, len(W)):
        forward[i] = correlation * (forward[i - 1] + W[i - 1])
    one_sided = np.einsum("ipk,ipl->kl", W, forward)
    white = _information(J, noise_std)
    F = np.linalg.inv(white)
    covariance = F @ (white + one_sided + one_sided.T) @ F
    return dict(zip(PARAMETERS, np.sqrt(np.diag(covariance)).tolist(), strict=True))


def _information(J: FloatArray, noise_std: Sequence[float]) -> FloatArray:
    W = J / np.asarray(noise_std)[:, None]
    return np.asarray(np.einsum("ipk,ipl->kl", W, W))


# --- what is estimated from it: output error, all but the four derivatives held ---------------------------------------


_HELD = ("Z_0", "Z_q", "Z_de", "M_0")


def fitted(
    records: Sequence[FlightRecord], outputs: Sequence[str] = _STATES, start: Mapping[str, float] | None = None
) -> ParametricModel:
    """Return the short period that output error finds in records of "de_cmd" that begin at rest.

    Args:
        records: deviations from trim.
        outputs: of "alpha" and "q".
        start: values of PARAMETERS that the search begins at.
    """
    from testbench.estimators.parametric import output_error
    from testbench.estimators.parametric.structures.longitudinal import short_period
    from testbench.estimators.settings import OutputError

    structure = short_period(tuple(outputs), "de_cmd").with_parameters(dict.fromkeys(_HELD, 0.0), fixed=_HELD)
    return output_error.estimate(
        records, structure.with_parameters(dict(start or {})), OutputError(initial_states="zero")
    )


def white_error(model: ParametricModel, name: str) -> tuple[float, float]:
    """Return the standard error as if residuals were white, and the factor that their colour puts on it."""
    free = [p.name for p in model.structure.parameters if p.free]
    factor = float(model.diagnostics["error_inflation"][free.index(name)])
    return model.standard_errors[name] / factor, factor
