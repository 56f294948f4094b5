"""Evidence of linear Gaussian models of records whose noise, and whose unknown motion, have sizes that are not known.

A record r is y = f + X (theta - theta0) + U d + e. Parameters theta are shared by all records and have Gaussian priors.
The pulses d of an unknown motion belong to the record, d ~ N(0, kappa^2). The noise e of channel c has the standard
deviation s_c, in units of what is stated; ln s_c has a Gaussian prior. Parameters and pulses are integrated; s is at
the maximum, with Laplace's approximation about it; kappa is summed over a grid.

The sizes come to rest by fixed points of the evidence (D. J. C. MacKay, Bayesian interpolation, Neural Computation 4,
1992, eqs. 4.10 and 4.11; as REML, D. A. Harville, JASA 72, 1977):

    s_c^2 = |e_c|^2 / (n_c - tr(Sigma X_c' X_c) / s_c^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from testbench.core.record import FloatArray

KAPPAS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
"""Sizes of the unknown motion that are summed over, shares of the motion that is seen."""
_UNSEEN = 0.01
_ROUNDS = 30
_AT_REST = 1e-3  # of ln s, whose standard error is above 1e-2 for all but the longest records


@dataclass(frozen=True, eq=False)
class Linearised:
    """One record about one point, in units of the stated noise.

    Attributes:
        residual: (n, p) measured less predicted.
        columns: (n, p, k) change of the prediction for one unit of each shared parameter.
        unknown: (n, p, m) response to each pulse of the unknown motion at kappa = 1.
        taken: (n, p) whether a sample counts.
        own: (n, p, q) change by one standard deviation of each parameter that is the record's own, such as the form of
            an effect or the gusts that it met.
    """

    residual: FloatArray
    columns: FloatArray
    unknown: FloatArray
    taken: NDArray[np.bool_]
    own: FloatArray | None = None

    @property
    def all_own(self) -> FloatArray:
        """``own``, of no columns if it was not given."""
        return self.columns[:, :, :0] if self.own is None else self.own


def fewer(unknown: FloatArray, taken: NDArray[np.bool_]) -> FloatArray:
    """Return the same unknown motion (n, p, m) by its principal directions (n, p, r), r <= m, in units of the noise.

    Pulses that are independent and of one size are so in any rotation of them. Directions that a motion as large as
    all that is seen (kappa = 1) moves by less than a hundredth of the noise in all samples together are left out.
    """
    U = np.where(taken[:, :, None], unknown, 0.0).reshape(taken.size, unknown.shape[2])
    values, turn = np.linalg.eigh(U.T @ U)
    return (U @ turn[:, values > _UNSEEN**2]).reshape(*taken.shape, -1)


@dataclass(frozen=True, eq=False)
class Grams:
    """Sums over the samples of each channel of one record, of all that the evidence needs.

    Z holds the k columns, then the q of the record's own, then the m pulses, then the residual; ``of``
    (p, k + q + m + 1, k + q + m + 1) is Z'Z by channel.
    """

    of: FloatArray
    samples: FloatArray
    k: int
    q: int = 0

    @classmethod
    def made(cls, record: Linearised, before: Grams | None = None) -> Grams:
        """Return the sums of a record; those of its own and of the pulses are taken from ``before``, if they are."""
        p, k = record.residual.shape[1], record.columns.shape[2]
        own = record.all_own
        new = np.concatenate([record.columns, record.residual[:, :, None]], axis=2)
        new = np.where(record.taken[:, :, None], new, 0.0)
        same = np.concatenate([own, record.unknown], axis=2)  # where no sample was taken the others are zero
        size, inside = k + same.shape[2] + 1, slice(k, k + same.shape[2])
        at = np.r_[0:k, size - 1]
        out = np.empty((p, size, size))
        for c in range(p):
            out[c][np.ix_(at, at)] = new[:, c].T @ new[:, c]
            across = same[:, c].T @ new[:, c]
            out[c][inside, :k], out[c][inside, -1] = across[:, :k], across[:, k]
            out[c][:k, inside], out[c][-1, inside] = across[:, :k].T, across[:, k]
            if before is None:
                counted = np.where(record.taken[:, c, None], same[:, c], 0.0)
                out[c][inside, inside] = counted.T @ counted
            else:
                out[c][inside, inside] = before.of[c][before.k : -1, before.k : -1]
        return cls(out, record.taken.sum(axis=0).astype(float), k, own.shape[2])

    def left_by(self, record: Linearised, residual: FloatArray) -> Grams:
        """Return the sums without columns for another residual (n, p) of the same record."""
        own = record.all_own
        r = np.where(record.taken, residual, 0.0)
        of = self.of[:, self.k :, self.k :].copy()
        for c in range(r.shape[1]):
            of[c, : self.q, -1] = own[:, c].T @ r[:, c]
            of[c, self.q : -1, -1] = record.unknown[:, c].T @ r[:, c]
            of[c, -1, -1] = r[:, c] @ r[:, c]
            of[c, -1, :-1] = of[c, :-1, -1]
        return Grams(of, self.samples, 0, self.q)

    def deviations(self, kappa: float) -> FloatArray:
        """Return the prior deviations of what is the record's own, its pulses last; none of them at kappa 0."""
        m = self.of.shape[1] - 1 - self.k - self.q
        return np.concatenate([np.ones(self.q), np.full(m if kappa > 0.0 else 0, kappa)])


@dataclass(frozen=True, eq=False)
class Reduced:
    """All records with their pulses integrated, at one kappa and one set of scales.

    -2 ln p(y | theta) = log_det + c - 2 b'(theta - theta0) + (theta - theta0)' A (theta - theta0) + N ln 2 pi.
    """

    A: FloatArray
    b: FloatArray
    c: float
    log_det: float
    samples: float

    def log_evidence(self, mean: FloatArray, std: FloatArray, which: Sequence[int] | None = None) -> float:
        """Return ln p(y) with priors theta - theta0 ~ N(mean, std^2) of the parameters ``which``; others stay at 0."""
        A, b = self._some(which)
        v = b - A @ mean
        q = self.c - 2.0 * mean @ b + mean @ A @ mean
        M = np.eye(len(mean)) + std[:, None] * A * std
        factor = cho_factor(M, check_finite=False)
        log_det = self.log_det + 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        q -= (std * v) @ cho_solve(factor, std * v, check_finite=False)
        return -0.5 * (self.samples * float(np.log(2.0 * np.pi)) + log_det + float(q))

    def posterior(
        self, mean: FloatArray, std: FloatArray, which: Sequence[int] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance of theta - theta0 given the records."""
        A, b = self._some(which)
        M = np.eye(len(mean)) + std[:, None] * A * std
        factor = cho_factor(M, check_finite=False)
        covariance = std[:, None] * cho_solve(factor, np.diag(std), check_finite=False)
        return mean + covariance @ (b - A @ mean), covariance

    def _some(self, which: Sequence[int] | None) -> tuple[FloatArray, FloatArray]:
        if which is None:
            return self.A, self.b
        rows = np.asarray(which, dtype=int)
        return self.A[np.ix_(rows, rows)], self.b[rows]


def reduced(grams: Sequence[Grams], scales: FloatArray, kappa: float) -> Reduced:
    """Integrate what is each record's own at noise scales (p,) and one size of the unknown motion."""
    k = grams[0].k
    A, b, c, log_det, samples = np.zeros((k, k)), np.zeros(k), 0.0, 0.0, 0.0
    for g in grams:
        G = np.tensordot(scales**-2.0, g.of, 1)
        samples += float(g.samples.sum())
        log_det += 2.0 * float(g.samples @ np.log(scales))
        shared, D = np.r_[0:k, G.shape[0] - 1], g.deviations(kappa)
        own = slice(k, k + len(D))
        S = G[np.ix_(shared, shared)]
        if len(D):
            M = np.eye(len(D)) + D[:, None] * G[own, own] * D
            factor = cho_factor(M, check_finite=False)
            log_det += 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
            B = D[:, None] * G[own][:, shared]
            S = S - B.T @ cho_solve(factor, B, check_finite=False)
        A += S[:k, :k]
        b += S[:k, k]
        c += float(S[k, k])
    return Reduced(A, b, c, log_det, samples)


@dataclass(frozen=True, eq=False)
class Sized:
    """Noise scales at rest for one hypothesis at one kappa.

    Attributes:
        scales: (p,) s.
        price: ln of the prior of s and of its integral about the rest (Laplace's approximation).
        log_errors: (p,) standard errors of ln s.
        reduced: at these scales.
        log_density: ln of the evidence, s integrated.
    """

    scales: FloatArray
    price: float
    log_errors: FloatArray
    reduced: Reduced
    log_density: float


def sized(
    grams: Sequence[Grams],
    mean: FloatArray,
    std: FloatArray,
    spread: FloatArray,
    kappa: float,
    begin: FloatArray | None = None,
) -> Sized:
    """Bring the noise scales of a hypothesis to rest.

    Args:
        grams: of all records.
        mean: (k,) prior mean of theta - theta0.
        std: (k,) of the prior.
        spread: (p,) prior standard deviation of ln s; 0 for a channel whose noise is known.
        kappa: size of the unknown motion.
        begin: (p,) scales to begin with.
    """
    free = spread > 0.0
    weight = np.where(free, 1.0 / np.where(free, spread, 1.0) ** 2, 0.0)
    log_s = np.zeros(len(spread)) if begin is None else np.log(begin)
    effective = np.ones(len(spread))
    for _ in range(_ROUNDS):
        squares, effective = _left(grams, np.exp(log_s), kappa, mean, std)
        gradient = squares - effective - weight * log_s
        step = np.where(free, gradient / (2.0 * np.maximum(effective, 1.0) + weight), 0.0)
        log_s = log_s + np.clip(step, -0.7, 0.7)
        if np.max(np.abs(step), initial=0.0) < _AT_REST:
            break
    scales = np.exp(log_s)
    found = reduced(grams, scales, kappa)
    curvature = 2.0 * np.maximum(effective, 1.0) + weight
    price = float(np.sum(-0.5 * weight * log_s**2)) + 0.5 * float(np.sum(np.log(weight[free] / curvature[free])))
    return Sized(scales, price, np.where(free, curvature**-0.5, 0.0), found, found.log_evidence(mean, std) + price)


def _left(
    grams: Sequence[Grams], scales: FloatArray, kappa: float, mean: FloatArray, std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return, by channel, the squares of the noise that is left over s^2, and its effective number of samples (p,)."""
    theta, covariance = reduced(grams, scales, kappa).posterior(mean, std)
    squares, effective, weights = np.zeros(len(scales)), np.zeros(len(scales)), scales**-2.0
    for g in grams:
        k, D = g.k, g.deviations(kappa)
        K = k + len(D)
        G = np.tensordot(weights, g.of, 1)
        found, Sigma = theta, covariance
        if len(D):
            M = np.diag(D**-2.0) + G[k:K, k:K]
            P = cho_solve(cho_factor(M, check_finite=False), np.eye(len(D)), check_finite=False)
            T = P @ G[k:K, :k]
            found = np.concatenate([theta, P @ G[k:K, -1] - T @ theta])
            Sigma = np.block([[covariance, -covariance @ T.T], [-T @ covariance, P + T @ covariance @ T.T]])
        XX, xy = g.of[:, :K, :K], g.of[:, :K, -1]
        squares += weights * (
            g.of[:, -1, -1] - 2.0 * xy @ found + np.einsum("i,cij,j->c", found, XX, found, optimize=True)
        )
        effective += g.samples - weights * np.tensordot(XX, Sigma, 2)
    return squares, np.maximum(effective, 1e-3)
