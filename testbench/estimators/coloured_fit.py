"""Linear regression of residuals whose noise is coloured: generalised least squares with autoregressive noise.

    v = X b + n,    n[k] = sum_j A[j] n[k - j] + e[k]

Regression and autoregression in turns (D. Cochrane and G. H. Orcutt, Journal of the American Statistical Association
44, 1949), from the residuals as they are and from those that plain least squares leaves: what drifts looks like noise
of a long memory from the first, and a strong disturbance like signal from the second. The better likelihood is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.residuals import LARGEST_ORDER, Autoregression, autoregression

_ROUNDS = 3
_RCOND = 1e-9


class Stretch(NamedTuple):
    """Residuals v (p, N) of one record with zeros where ``good`` (N,) is False."""

    v: FloatArray
    good: NDArray[np.bool_]


class Regression(NamedTuple):
    """Coefficients b (d,), their standard deviations, what they leave of v per record (p, N), noise and criterion.

    ``criterion`` is -2 ln L with the penalty of Hannan and Quinn on the order of the noise; differences between nested
    regressions are distributed as chi-squared with as many degrees of freedom as columns were added.
    """

    b: FloatArray
    std: FloatArray
    left: list[FloatArray]
    noise: Autoregression
    criterion: float


def samples_lost(parts: Sequence[Stretch]) -> int:
    """Return how many samples at the start of every record only serve the autoregression."""
    p, total = parts[0].v.shape[0], sum(s.v.shape[1] for s in parts)
    return max(0, min(LARGEST_ORDER, min(s.v.shape[1] for s in parts) // 4, total // (10 * p)))


def regress(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> Regression:
    """Return the regression of residuals on columns X (p, N, d), one array per record.

    Columns may depend on each other; the shortest coefficients are then taken.
    """
    first = regress_from(parts, columns, [s.v for s in parts])
    if columns[0].shape[2] == 0:
        return first
    size = np.sqrt(np.sum([np.sum(s.v**2, axis=1) for s in parts], axis=0))
    size = np.where(size > 0.0, size, 1.0)[:, None]
    Z = np.vstack(
        [((X * s.good[:, None]) / size[:, :, None]).reshape(-1, X.shape[2]) for s, X in _both(parts, columns)]
    )
    b, _ = _solve(Z, np.concatenate([(s.v / size).ravel() for s in parts]))
    other = regress_from(parts, columns, [s.v - s.good * (X @ b) for s, X in _both(parts, columns)])
    return min(first, other, key=lambda found: found.criterion)


def regress_from(parts: Sequence[Stretch], columns: Sequence[FloatArray], left: Sequence[FloatArray]) -> Regression:
    """Return the same with the noise that is in ``left`` (p, N) per record as a start.

    Raises:
        EstimationError: no more samples are left than there are columns, as where outputs have other rates.
    """
    p, lost = parts[0].v.shape[0], samples_lost(parts)
    rows = [settled(s.good, lost) for s in parts]
    if sum(r.size for r in rows) <= columns[0].shape[2]:
        raise EstimationError(
            "residuals of coloured noise need samples of all outputs one after the other, got too few"
        )
    for _ in range(_ROUNDS if columns[0].shape[2] else 1):
        noise = autoregression([r.T for r in left], lost)
        whiten = np.linalg.inv(np.linalg.cholesky(noise.S + 1e-12 * np.trace(noise.S) * np.eye(p)))
        e = np.hstack([filtered(noise, s.v[:, :, None])[:, r, 0] for s, r in zip(parts, rows, strict=True)])
        Z = np.concatenate([filtered(noise, X)[:, r] for X, r in zip(columns, rows, strict=True)], axis=1)
        b, std = _solve((whiten @ Z.reshape(p, -1)).reshape(-1, Z.shape[2]), (whiten @ e).ravel())
        left = [s.v - s.good * (X @ b) for s, X in _both(parts, columns)]
    E = e - Z @ b
    n = E.shape[1]
    penalty = 2.0 * np.log(np.log(max(n, 3))) * len(noise.A) * p * p
    return Regression(b, std, list(left), noise, float(n * np.linalg.slogdet(E @ E.T / n)[1] + penalty))


def filtered(noise: Autoregression, x: FloatArray) -> FloatArray:
    """Return x[k] - sum_j A[j] x[k - 1 - j] of signals (p, N, d)."""
    p, N, d = x.shape
    out = x.copy()
    for j, A in enumerate(noise.A):
        out[:, j + 1 :] -= (A @ x[:, : N - j - 1].reshape(p, -1)).reshape(p, -1, d)
    return out


def settled(good: NDArray[np.bool_], lost: int) -> NDArray[np.intp]:
    """Return the samples (k,) with ``lost`` good ones before them."""
    run = np.cumsum(good)
    before = np.concatenate([np.zeros(lost + 1), run])[: len(run)]
    return np.flatnonzero((run - before == lost + 1) & (np.arange(len(run)) >= lost))


def _both(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> list[tuple[Stretch, FloatArray]]:
    return list(zip(parts, columns, strict=True))


def _solve(Z: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least-squares coefficients, and their standard deviations for errors of unit size."""
    size = np.sqrt(np.sum(Z**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    Q, R = np.linalg.qr(Z / size)
    U, sigma, Vt = np.linalg.svd(R, full_matrices=False)
    kept = sigma > _RCOND * np.max(sigma, initial=0.0)
    root = Vt[kept].T / sigma[kept]
    b = root @ (U[:, kept].T @ (Q.T @ y))
    return np.asarray(b / size), np.asarray(np.sqrt(np.sum(root**2, axis=1)) / size)
