"""Linear regression of residuals whose noise is coloured: generalised least squares with autoregressive noise.

    v = X b + n,    n[k] = sum_j A[j] n[k - j] + e[k]

Regressions are solved by their normal equations with columns of unit size, the columns that depend on others left out:
many hypotheses then share one matrix of products (:class:`Normal`).

Regression and autoregression in turns (D. Cochrane and G. H. Orcutt, Journal of the American Statistical Association
44, 1949), from the residuals as they are and from those that plain least squares leaves: what drifts looks like noise
of a long memory from the first, and a strong disturbance like signal from the second. The better likelihood is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpstrf

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.residuals import LARGEST_ORDER, Autoregression, autoregression

_ROUNDS = 3
_SETTLED = 0.01  # of the criterion, between two rounds
_DEPENDENT = 1e-11  # squared sine of the angle to the columns before below which a column adds nothing


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

    Columns may depend on each other; those that add nothing to the others then have no coefficient.
    """
    first = regress_from(parts, columns, [s.v for s in parts])
    if columns[0].shape[2] == 0:
        return first
    _, left = regress_plainly(parts, columns)
    other = regress_from(parts, columns, left)
    return min(first, other, key=lambda found: found.criterion)


def regress_plainly(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> tuple[FloatArray, list[FloatArray]]:
    """Return the coefficients (d,) of ordinary least squares, outputs of unit size, and what they leave (p, N)."""
    size = np.sqrt(np.sum([np.sum(s.v**2, axis=1) for s in parts], axis=0))
    size = np.where(size > 0.0, size, 1.0)[:, None]
    Z = np.vstack(
        [((X * s.good[:, None]) / size[:, :, None]).reshape(-1, X.shape[2]) for s, X in _both(parts, columns)]
    )
    b, _ = solved(normal(Z, np.concatenate([(s.v / size).ravel() for s in parts])))
    return b, [s.v - s.good * (X @ b) for s, X in _both(parts, columns)]


def regress_from(parts: Sequence[Stretch], columns: Sequence[FloatArray], left: Sequence[FloatArray]) -> Regression:
    """Return the same with the noise that is in ``left`` (p, N) per record as a start.

    Raises:
        EstimationError: no more samples are left than there are columns, as where outputs have other rates.
    """
    p, lost, width = parts[0].v.shape[0], samples_lost(parts), columns[0].shape[2]
    if sum(settled(s.good, lost).size for s in parts) <= width:
        raise EstimationError(
            "residuals of coloured noise need samples of all outputs one after the other, got too few"
        )
    criterion = np.inf
    for _ in range(_ROUNDS):
        noise = autoregression([r.T for r in left], lost)
        whitener = Whitener(noise, parts)
        e = whitener([s.v[:, :, None] for s in parts])[:, 0]
        Z = whitener(columns)
        b, std = solved(normal(Z, e))
        left = [s.v - s.good * (X @ b) for s, X in _both(parts, columns)]
        E = (e - Z @ b).reshape(-1, p) @ whitener.root.T
        n, last = len(E), criterion
        penalty = 2.0 * np.log(np.log(max(n, 3))) * len(noise.A) * p * p
        criterion = float(n * np.linalg.slogdet(E.T @ E / n)[1] + penalty)
        if width == 0 or not abs(last - criterion) > _SETTLED:
            break
    return Regression(b, std, list(left), noise, criterion)


class Whitener:
    """The inverse of an autoregression, for signals of given records, at the samples that have a past.

    Attributes:
        root: (p, p) Cholesky factor of the covariance of the noise's innovations.
    """

    def __init__(self, noise: Autoregression, parts: Sequence[Stretch]) -> None:
        """Prepare one banded matrix per record."""
        p, lost = parts[0].v.shape[0], samples_lost(parts)
        self.root = np.linalg.cholesky(noise.S + 1e-12 * np.trace(noise.S) * np.eye(p))
        inverse = np.linalg.inv(self.root)
        taps = np.hstack([inverse, *[-inverse @ A for A in noise.A]])  # (p, (order + 1) p), the present sample first
        back = (-p * np.arange(len(noise.A) + 1)[:, None] + np.arange(p)).ravel()
        self.matrices = []
        for part in parts:
            rows = settled(part.good, lost)
            at = np.repeat(rows[:, None] * p + back, p, axis=0)
            values, ends = np.tile(taps, (len(rows), 1)), np.arange(len(at) + 1) * at.shape[1]
            shape = (len(at), part.v.shape[1] * p)
            self.matrices.append(sparse.csr_matrix((values.ravel(), at.ravel(), ends), shape))

    def __call__(self, signals: Sequence[FloatArray]) -> FloatArray:
        """Return signals (p, N, d), one array per record, as white (rows, d), the outputs of a sample together."""
        return np.vstack(
            [
                M @ x.transpose(1, 0, 2).reshape(M.shape[1], x.shape[2])
                for M, x in zip(self.matrices, signals, strict=True)
            ]
        )


class Normal(NamedTuple):
    """Products of white columns Z (rows, d) among themselves G (d, d), with the residuals g (d,), and their square."""

    G: FloatArray
    g: FloatArray
    total: float

    def of(self, chosen: Sequence[int] | NDArray[np.intp]) -> Normal:
        """Return the normal equations of the chosen columns alone."""
        at = np.asarray(chosen, np.intp)
        return Normal(self.G[np.ix_(at, at)], self.g[at], self.total)

    def explained(self) -> float:
        """Return by how much all columns together reduce the sum of squares."""
        return float(np.sum(self._eliminated()[0] ** 2))

    def _eliminated(self) -> tuple[FloatArray, FloatArray, NDArray[np.intp], FloatArray]:
        """Return R^-T g, R (r, r) of the r columns that do not depend on others, which they are, and their sizes."""
        size = np.sqrt(np.diag(self.G))
        alive = np.flatnonzero(size > 0.0)
        s = size[alive]
        if not alive.size:
            return np.zeros(0), np.zeros((0, 0)), alive, s
        R, order, rank, _ = dpstrf(self.G[np.ix_(alive, alive)] / np.outer(s, s), tol=_DEPENDENT, lower=0)
        kept = order[:rank] - 1
        R = np.triu(R[:rank, :rank])
        return solve_triangular(R, (self.g[alive] / s)[kept], trans="T"), R, alive[kept], s[kept]


def normal(Z: FloatArray, e: FloatArray) -> Normal:
    """Return the normal equations of residuals e (rows,) on columns Z (rows, d)."""
    return Normal(np.asarray(Z.T @ Z), np.asarray(Z.T @ e), float(e @ e))


def solved(equations: Normal) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients (d,) and their standard deviations for errors of unit size; zero of columns left out."""
    z, R, kept, size = equations._eliminated()
    b, std = np.zeros(len(equations.g)), np.zeros(len(equations.g))
    if kept.size:
        inverse = solve_triangular(R, np.eye(len(R)))
        b[kept], std[kept] = inverse @ z / size, np.sqrt(np.sum(inverse**2, axis=1)) / size
    return b, std


def settled(good: NDArray[np.bool_], lost: int) -> NDArray[np.intp]:
    """Return the samples (k,) with ``lost`` good ones before them."""
    run = np.cumsum(good)
    before = np.concatenate([np.zeros(lost + 1), run])[: len(run)]
    return np.flatnonzero((run - before == lost + 1) & (np.arange(len(run)) >= lost))


def _both(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> list[tuple[Stretch, FloatArray]]:
    return list(zip(parts, columns, strict=True))
