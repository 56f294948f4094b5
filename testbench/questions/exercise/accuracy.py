"""What a record of the short period tells: exact standard errors for white and for coloured noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.core.record import FloatArray
from testbench.questions.exercise.motion import respond, short_period_matrices

PARAMETERS = ("Z_alpha", "M_alpha", "M_q", "M_de")
_STATES = ("alpha", "q")
_STEP = 1e-4


def sensitivities(d: Mapping[str, float], u: FloatArray, dt_s: float, outputs: Sequence[str]) -> FloatArray:
    """Return the derivatives (n, p, 4) of the outputs by PARAMETERS, by central differences."""
    rows = [_STATES.index(name) for name in outputs]
    out = np.empty((len(u), len(rows), len(PARAMETERS)))
    for k, name in enumerate(PARAMETERS):
        step = _STEP * abs(d[name])
        y = [respond(*short_period_matrices({**d, name: d[name] + s}), u[:, None], dt_s) for s in (step, -step)]
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
