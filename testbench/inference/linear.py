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

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

KAPPAS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
"""Sizes of the unknown motion that are summed over, shares of the motion that is seen."""
_UNSEEN = 0.01
_ROUNDS = 30
_AT_REST = 1e-3  # of ln s, whose standard error is above 1e-2 for all but the longest records


@dataclass(frozen=True, eq=False)
class Motion:
    """What an unknown motion of one record does, by its principal directions, the largest first."""

    #: (p, n, m) of each channel to each direction at kappa = 1, in units of the noise; 0 where no sample counts
    response: FloatArray
    gram: FloatArray  #: (p, m, m) sums of its squares and products
    size: FloatArray  #: (m,) root of the sum of squares of each direction over all channels

    @cached_property
    def by_sample(self) -> FloatArray:
        """``response`` as (n p, m)."""
        return self.response.transpose(1, 0, 2).reshape(-1, self.size.size)

    def prewhitened(self, colour: FloatArray, taken: NDArray[np.bool_]) -> Motion:
        """Return what it does to channels that are (:func:`prewhitened`); no direction is seen better than by so much.

        Its directions are principal ones no more.
        """
        if not colour.any():
            return self
        by_sample = prewhitened(self.response.transpose(1, 0, 2), colour, taken)
        response = np.ascontiguousarray(by_sample.transpose(1, 0, 2))
        most = float(np.max(np.sqrt((1.0 + np.abs(colour)) / (1.0 - np.abs(colour)))))
        return Motion(response, response.transpose(0, 2, 1) @ response, most * self.size)

    @classmethod
    def none(cls, taken: NDArray[np.bool_]) -> Motion:
        """Return no motion, of a record whose samples (n, p) are taken."""
        n, p = taken.shape
        return cls(np.zeros((p, n, 0)), np.zeros((p, 0, 0)), np.zeros(0))


def fewer(unknown: FloatArray, taken: NDArray[np.bool_]) -> Motion:
    """Return an unknown motion (n, p, m), in units of the noise, by its principal directions.

    Pulses that are independent and of one size are so in any rotation of them. Directions that a motion as large as
    all that is seen (kappa = 1) moves by less than a hundredth of the noise in all samples together are left out.
    """
    U = np.where(taken[:, :, None], unknown, 0.0).reshape(taken.size, unknown.shape[2])
    values, turn = np.linalg.eigh(U.T @ U)
    order = [j for j in np.argsort(-values) if values[j] > _UNSEEN**2]
    response = np.ascontiguousarray((U @ turn[:, order]).reshape(*taken.shape, -1).transpose(1, 0, 2))
    return Motion(response, response.transpose(0, 2, 1) @ response, np.sqrt(values[order]))


def prewhitened(values: FloatArray, colour: FloatArray, taken: NDArray[np.bool_]) -> FloatArray:
    """Return what makes the noise of each channel white: (y_t - a y_(t-1)) / sqrt(1 - a^2), of the same variance.

    Args:
        values: (n, p) or (n, p, m) in units of the noise.
        colour: (p,) correlation ``a`` of the noise from sample to sample, an autoregressive process of first order.
        taken: (n, p) whether a sample counts; the first one, and one after a gap, stays as it is.
    """
    coloured = np.flatnonzero(colour)
    if not coloured.size:
        return values
    out = values.copy(order="K")
    for c in coloured:
        a, follows = colour[c], taken[1:, c] & taken[:-1, c]
        y = values[:, c]
        white = (y[1:] - a * y[:-1]) / np.sqrt(1.0 - a**2)
        out[1:, c] = white if follows.all() else np.where(follows.reshape(-1, *[1] * (y.ndim - 1)), white, y[1:])
    return out


@dataclass(frozen=True, eq=False)
class Linearised:
    """One record about one point, in units of the stated noise."""

    residual: FloatArray  #: (n, p) measured less predicted
    columns: FloatArray  #: (n, p, k) change of the prediction for one unit of each shared parameter
    unknown: Motion  #: what the unknown motion does
    taken: NDArray[np.bool_]  #: (n, p) whether a sample counts
    #: (n, p, q) change by one standard deviation of each parameter that is the record's own, such as the form of an
    #: effect or the gusts that it met
    own: FloatArray | None = None

    @property
    def all_own(self) -> FloatArray:
        """``own``, of no columns if it was not given."""
        return self.columns[:, :, :0] if self.own is None else self.own

    def counted(self, values: FloatArray) -> FloatArray:
        """Return values (n, p, ...) by channel, (p, n, ...); 0 where no sample counts."""
        taken = self.taken.reshape(*self.taken.shape, *[1] * (values.ndim - 2))
        return np.ascontiguousarray(np.moveaxis(np.where(taken, values, 0.0), 1, 0))


@dataclass(frozen=True, eq=False)
class Grams:
    """Sums over the samples of each channel of one record, of all that the evidence needs."""

    shared: FloatArray  #: (p, k + 1, k + 1) of the k columns, then the residual
    across: FloatArray  #: (p, q + m, k + 1) of the q of the record's own, then the m directions of motion, with those
    inside: FloatArray  #: (p, q + m, q + m) of the record's own and the directions
    samples: FloatArray  #: (p,) number that counts
    size: FloatArray  #: (m,) see :class:`Motion`
    _kept: dict[bytes, dict[float, tuple[FloatArray, Any, float]]] = field(default_factory=dict, repr=False)

    @classmethod
    def made(cls, record: Linearised, before: Grams | None = None, kept: Sequence[int] = ()) -> Grams:
        """Return the sums of a record.

        Args:
            record: about a point.
            before: of the same record about another point: sums of its own and of the pulses are taken from there.
            kept: columns that were the same there, so that their sums are, too.
        """
        known = [] if before is None else list(kept)
        every = record.counted(np.concatenate([record.columns, record.residual[:, :, None]], axis=2))
        fresh = [i for i in range(every.shape[2]) if i not in known]
        new = np.ascontiguousarray(every[:, :, fresh]) if known else every
        U, own = record.unknown, record.all_own
        shared, across = every.transpose(0, 2, 1) @ new, U.response.transpose(0, 2, 1) @ new
        inside = U.gram if before is None else before.inside
        if own.shape[2]:
            mine = record.counted(own).transpose(0, 2, 1)
            across = np.concatenate([mine @ new, across], axis=1)
            if before is None:
                with_motion = mine @ U.response
                left = np.concatenate([mine @ mine.transpose(0, 2, 1), with_motion.transpose(0, 2, 1)], axis=1)
                inside = np.concatenate([left, np.concatenate([with_motion, U.gram], axis=1)], axis=2)
        if before is not None and known:
            shared, across = _replaced(before.shared, shared, fresh), _replaced(before.across, across, fresh)
            shared[:, fresh] = shared[:, :, fresh].transpose(0, 2, 1)
        samples = record.taken.sum(axis=0).astype(float)
        return cls(shared, across, inside, samples, U.size, {} if before is None else before._kept)

    @classmethod
    def parted(cls, of: FloatArray, samples: FloatArray, k: int) -> Grams:
        """Return sums (p, k + q + 1, k + q + 1) of k columns, q of the record's own and the residual, in parts."""
        own, at = slice(k, -1), np.r_[0:k, of.shape[1] - 1]
        return cls(of[:, at][:, :, at], of[:, own][:, :, at], of[:, own, own], samples, np.zeros(0))

    @property
    def k(self) -> int:
        """Number of columns."""
        return self.shared.shape[1] - 1

    @property
    def q(self) -> int:
        """Number of the record's own."""
        return len(self.inside[0]) - len(self.size)

    def left_by(self, record: Linearised, residual: FloatArray) -> Grams:
        """Return the sums without columns for another residual (n, p) of the same record."""
        r = record.counted(residual)[:, :, None]
        across = record.unknown.response.transpose(0, 2, 1) @ r
        if self.q:
            across = np.concatenate([record.counted(record.all_own).transpose(0, 2, 1) @ r, across], axis=1)
        return replace(self, shared=r.transpose(0, 2, 1) @ r, across=across)

    def deviations(self, kappa: float) -> FloatArray:
        """Return the prior deviations of what is the record's own, then of the directions that a motion shows.

        Of the others, the smallest ones, so large a motion moves less than noise can tell.
        """
        return np.concatenate([np.ones(self.q), np.full(int(np.sum(kappa * self.size > _UNSEEN)), kappa)])

    def inner(self, scales: FloatArray, kappa: float) -> tuple[FloatArray, Any, float]:
        """Return the deviations D (r,), the Cholesky factor of 1 + D G D, and ln of its determinant.

        G is ``inside`` over the squares of noise scales (p,). A descent asks for the same ones again and again.
        """
        known = self._kept.get(key := scales.tobytes())
        if known is None:
            self._kept.clear()
            known = self._kept[key] = {}
        if kappa not in known:
            D = self.deviations(kappa)
            G = self._weighted(scales, len(D))
            factor = factored(np.eye(len(D)) + D[:, None] * G * D)
            known[kappa] = D, factor, 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        return known[kappa]

    def _weighted(self, scales: FloatArray, r: int) -> FloatArray:
        """Return the first (r, r) of ``inside``, summed over channels by their weights."""
        out = np.zeros((r, r))
        for inside, s in zip(self.inside, scales, strict=True):
            out += s**-2.0 * inside[:r, :r]
        return out


def factored(M: FloatArray) -> tuple[FloatArray, bool]:
    """Return the Cholesky factor of the unit matrix plus a sum of squares, also where rounding hides that it has one.

    Eigenvalues are then no less than 1; those of sums of very large numbers are less by rounding.
    """
    if not np.isfinite(M).all():
        raise EstimationError(
            "readings must be small enough for the sum of their squares, got one beyond 1e150 of its noise"
        )
    with suppress(LinAlgError):
        return cho_factor(M, check_finite=False)
    values, E = np.linalg.eigh(M)
    R = np.linalg.qr(np.sqrt(np.maximum(values, 1.0))[:, None] * E.T, mode="r")
    return np.sign(np.diag(R))[:, None] * R, False


def whitened(record: Linearised, sums: Grams, scales: FloatArray, kappa: float) -> tuple[FloatArray, FloatArray]:
    """Return residual (n, p) and columns (n, p, k) multiplied by the symmetric root of the samples' inverse covariance.

    What is left of a record that the model describes is then white noise of unit variance, all that is the record's
    own being integrated: sums of squares and products are those of :func:`reduced`.
    """
    k, s = record.columns.shape[2], scales[:, None]
    each = record.counted(np.concatenate([record.columns, record.residual[:, :, None]], axis=2)) / s[:, :, None]
    D = sums.deviations(kappa)
    if len(D):
        q = sums.q
        own = record.counted(record.all_own) / s[:, :, None] * D[:q]
        moved = record.unknown.response[:, :, : len(D) - q] / s[:, :, None] * D[q:]
        along = D[:, None] * np.tensordot(scales**-2.0, sums.across[:, : len(D)], 1)
        values, E = np.linalg.eigh(D[:, None] * sums._weighted(scales, len(D)) * D)
        small = np.maximum(values, 1e-12)
        shrink = (1.0 - (1.0 + small) ** -0.5) / small
        back = E @ (shrink[:, None] * (E.T @ along))
        each = each - own @ back[:q] - moved @ back[q:]
    each = np.moveaxis(each, 0, 1)
    return each[:, :, k], each[:, :, :k]


def _replaced(before: FloatArray, new: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Return sums (p, r, c), those of some columns being ``new`` ones."""
    out = before.copy()
    out[:, :, columns] = new
    return out


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

    def log_evidence(self, mean: FloatArray, std: FloatArray) -> float:
        """Return ln p(y) with priors theta - theta0 ~ N(mean, std^2) of the parameters."""
        A, b = self.A, self.b
        v = b - A @ mean
        q = self.c - 2.0 * mean @ b + mean @ A @ mean
        factor = factored(np.eye(len(mean)) + std[:, None] * A * std)
        log_det = self.log_det + 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        q -= (std * v) @ cho_solve(factor, std * v, check_finite=False)
        return -0.5 * (self.samples * float(np.log(2.0 * np.pi)) + log_det + float(q))

    def posterior(self, mean: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance of theta - theta0 given the records."""
        factor = factored(np.eye(len(mean)) + std[:, None] * self.A * std)
        covariance = std[:, None] * cho_solve(factor, np.diag(std), check_finite=False)
        return mean + covariance @ (self.b - self.A @ mean), covariance


def reduced(grams: Sequence[Grams], scales: FloatArray, kappa: float) -> Reduced:
    """Integrate what is each record's own at noise scales (p,) and one size of the unknown motion."""
    k, weights = grams[0].k, scales**-2.0
    A, b, c, log_det, samples = np.zeros((k, k)), np.zeros(k), 0.0, 0.0, 0.0
    for g in grams:
        samples += float(g.samples.sum())
        log_det += 2.0 * float(g.samples @ np.log(scales))
        S = np.tensordot(weights, g.shared, 1)
        D, factor, more = g.inner(scales, kappa)
        if len(D):
            log_det += more
            B = D[:, None] * np.tensordot(weights, g.across[:, : len(D)], 1)
            S = S - B.T @ cho_solve(factor, B, check_finite=False)
        A += S[:k, :k]
        b += S[:k, k]
        c += float(S[k, k])
    return Reduced(A, b, c, log_det, samples)


@dataclass(frozen=True, eq=False)
class Sized:
    """Noise scales at rest for one hypothesis at one kappa."""

    scales: FloatArray  #: (p,) s
    price: float  #: ln of the prior of s and of its integral about the rest (Laplace's approximation)
    log_errors: FloatArray  #: (p,) standard errors of ln s
    reduced: Reduced  #: at these scales
    log_density: float  #: ln of the evidence, s integrated


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
    squares, effective, weights = np.zeros(len(scales)), np.zeros(len(scales)), scales**-2.0
    for g, (found, Sigma) in zip(grams, expected(grams, scales, kappa, mean, std), strict=True):
        k, r = g.k, len(found) - g.k
        XX, xy = g.shared[:, :k, :k], g.shared[:, :k, k]
        if r:
            between = g.across[:, :r, :k]
            XX = np.block([[XX, between.transpose(0, 2, 1)], [between, g.inside[:, :r, :r]]])
            xy = np.concatenate([xy, g.across[:, :r, k]], axis=1)
        squares += weights * (g.shared[:, k, k] - 2.0 * xy @ found + (XX @ found) @ found)
        effective += g.samples - weights * np.tensordot(XX, Sigma, 2)
    return squares, np.maximum(effective, 1e-3)


def expected(
    grams: Sequence[Grams], scales: FloatArray, kappa: float, mean: FloatArray, std: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield of each record the posterior mean (k + r,) and covariance of parameters and of what is its own."""
    theta, covariance = reduced(grams, scales, kappa).posterior(mean, std)
    for g in grams:
        D, factor, _ = g.inner(scales, kappa)
        r, k = len(D), g.k
        if not r:
            yield theta, covariance
            continue
        P = D[:, None] * cho_solve(factor, np.diag(D), check_finite=False)
        across = np.tensordot(scales**-2.0, g.across[:, :r], 1)
        T = P @ across[:, :k]
        covariances = np.block([[covariance, -covariance @ T.T], [-T @ covariance, P + T @ covariance @ T.T]])
        yield np.concatenate([theta, P @ across[:, k] - T @ theta]), covariances
