"""Fisher information during a flight, and the cost of a design that follows from it.

    M(t) = sum over samples so far of s s' / sigma^2 - sum over sensors of b b' / c,    b = sum of s / sigma^2

with c the weight of a sensor's samples so far: its unknown offset is projected out, as in
:mod:`testbench.information.fisher`, with which M agrees at every moment. The prior information P = diag(1 / prior^2) is
added, so that the cost is finite from the first sample on (Bayesian optimality: K. Chaloner and I. Verdinelli,
Statistical Science 10, 1995).

Fisher information of many flights at once: what :class:`testbench.envs.gain.Gain` sums up for one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dgeqrf, dpotrf, dtrtrs

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.flight.batch.compiled import compiled
from testbench.information.fisher import Criterion


class Known(NamedTuple):
    """Natural logarithm of the cost, and standard errors of the targets over the wanted ones (t,).

    Of many flights at once they have one axis more, the first.
    """

    log_cost: Any
    relative: FloatArray


class Gain:
    """Sums up information sample by sample.

    Args:
        problem: the design problem.
        criterion: which cost, see :func:`testbench.information.fisher.cost`.
        prior: standard error before the flight, relative to a parameter's true value; for a parameter that is zero,
            that of 1 in its unit.

    Raises:
        EstimationError: no prior, or targets that depend on one another under criterion D.

    Attributes:
        prior: (k,) standard errors before the flight.
        sensitivity_scale: (p, k) factors on sensitivities before they enter: prior standard errors over noise.
        gradient: (k, t) of the targets in wanted errors by the parameters in prior standard errors.
        taken: (N, p) root of the share of samples that each sensor delivers at each instant.
        criterion: which cost.
    """

    def __init__(self, problem: Problem, criterion: Criterion, prior: float) -> None:
        if not prior > 0.0:
            raise EstimationError(f"prior > 0 must hold for what is believed before the flight, got {prior:g}")
        true = problem.experiment.structure.true
        self.prior = prior * np.where(true == 0.0, 1.0, np.abs(true))
        self.sensitivity_scale = self.prior / problem.experiment.sigma[:, None]
        self.criterion = criterion
        self.gradient = np.asfortranarray((problem.targets.gradient * self.prior).T)
        if criterion == "D" and np.linalg.matrix_rank(self.gradient) < len(problem.targets.names):
            raise EstimationError(
                "the volume of the error ellipsoid needs targets that do not depend on one another, but "
                f"{', '.join(problem.targets.names)} do; leave some out or choose criterion 'worst'"
            )
        self.taken = _taken(problem)
        self._eye = np.eye(len(true))
        self._p = len(problem.experiment.sensors)
        self._always = bool(np.all(self.taken == 1.0))
        self.reset(0)

    def reset(self, quiet: int) -> None:
        """Begin again after ``quiet`` samples of undisturbed flight, which tell the offsets alone."""
        k = len(self._eye)
        self._M, self._b = np.zeros((k, k)), np.zeros((self._p, k))
        self._c = np.sum(self.taken[:quiet] ** 2, axis=0)
        self._n = quiet

    def add(self, S: FloatArray) -> None:
        """Take in sensitivities (r, p, k) of the next r samples, times :attr:`sensitivity_scale`."""
        r, _, k = S.shape
        if self._always:
            self._b += np.add.reduce(S, 0)
        else:
            w = self.taken[self._n : self._n + r]
            self._b += (S * (w * w)[:, :, None]).sum(axis=0)
            self._c = self._c + (w * w).sum(axis=0)
            S = S * w[:, :, None]
        W = S.reshape(-1, k)
        self._M += W.T.dot(W)
        self._n += r

    @property
    def information(self) -> FloatArray:
        """Fisher information (k, k) so far, without the prior."""
        return np.asarray(self._projected() / np.outer(self.prior, self.prior))

    def _projected(self) -> FloatArray:
        if self._always:  # every sensor has had as many samples
            return self._M - self._b.T.dot(self._b) * (1.0 / max(self._n, 1))
        return self._M - self._b.T @ (self._b / np.maximum(self._c, 1e-300)[:, None])

    def known(self) -> Known:
        """Return the cost and the relative errors, prior included.

        Raises:
            EstimationError: the information is not positive, which says that it ceased to be finite.
        """
        L, failed = dpotrf(self._projected() + self._eye, lower=1)
        if failed:
            raise EstimationError("information must stay finite; the linear aircraft has diverged, shorten the flight")
        half, _ = dtrtrs(L, self.gradient, lower=1)  # covariance of the targets: half' half
        variance = np.add.reduce(half * half, 0)
        relative = np.sqrt(variance)
        if self.criterion == "D":  # volume of the ellipsoid: product of the diagonal of R in half = Q R
            volume = abs(float(np.multiply.reduce(dgeqrf(half)[0].diagonal())))
            return Known(math.log(volume) / len(relative), relative)
        if self.criterion == "worst":
            return Known(0.5 * float(np.log(variance.max())), relative)
        if self.criterion == "A":
            return Known(0.5 * float(np.log(variance.mean())), relative)
        return Known(float(np.log(np.linalg.svd(half, compute_uv=False)[0])), relative)


def _taken(problem: Problem) -> FloatArray:
    """Return (N, p) the root of the share of samples that each sensor delivers at each instant."""
    experiment = problem.experiment
    base = 1.0 / (experiment.dt_s * experiment.stride)
    out = np.zeros((experiment.samples, len(experiment.sensors)))
    for i, sensor in enumerate(experiment.sensors):
        out[:: round(base / (sensor.rate_hz or base)), i] = np.sqrt(1.0 - sensor.dropout)
    return out


Mask = npt.NDArray[np.bool_]


class Gains:
    """Sums up information of flights that each have a clock of their own.

    Args:
        one: the same of one flight.
        copies: how many flights.

    Attributes:
        known: logarithm of the cost (copies,) and relative errors (copies, t), see :class:`testbench.envs.gain.Known`;
            of a flight that is left out of :meth:`add`, those before.
    """

    def __init__(self, one: Gain, copies: int) -> None:
        p, (k, t) = one.taken.shape[1], one.gradient.shape
        self._taken, self._gradient = one.taken, np.ascontiguousarray(one.gradient)
        self._prior, self._criterion = one.prior, one.criterion
        self._M, self._b, self._c = np.zeros((copies, k, k)), np.zeros((copies, p, k)), np.zeros((copies, p))
        self._volume, self._covariance = np.zeros(copies), np.zeros((copies, t, t))
        self.known = Known(np.zeros(copies), np.zeros((copies, t)))

    def reset(self, which: Mask, quiet: int) -> None:
        """Begin the flights ``which`` (copies,) again after ``quiet`` samples of undisturbed flight."""
        self._M[which], self._b[which] = 0.0, 0.0
        self._c[which] = np.sum(self._taken[:quiet] ** 2, axis=0)
        none = np.zeros((len(which), 1, 1, self._M.shape[1]))
        self.add(none, np.zeros(len(which), np.int64), which, samples=0)

    def add(self, S: FloatArray, at: npt.NDArray[np.int64], which: Mask, samples: int) -> None:
        """Take in sensitivities of the next samples of the flights ``which`` (copies,).

        Args:
            S: (copies, r, p, k), times :attr:`testbench.envs.gain.Gain.sensitivity_scale`.
            at: (copies,) number of the first sample.
            which: the flights.
            samples: how many of the r are taken in.

        Raises:
            EstimationError: the information of one is not positive, which says that it ceased to be finite.
        """
        failed = _learn(
            np.ascontiguousarray(S), at, which, samples, self._taken, self._gradient, self._M, self._b, self._c,
            self._covariance, self._volume,
        )  # fmt: skip
        if failed >= 0:
            raise EstimationError(
                f"information must stay finite; the linear aircraft of copy {failed} has diverged, shorten the flight"
            )
        variance = np.diagonal(self._covariance, axis1=1, axis2=2)
        relative = np.sqrt(variance)
        if self._criterion == "D":
            cost = self._volume / relative.shape[1]
        elif self._criterion == "worst":
            cost = 0.5 * np.log(variance.max(axis=1))
        elif self._criterion == "A":
            cost = 0.5 * np.log(variance.mean(axis=1))
        else:
            cost = 0.5 * np.log(np.linalg.eigvalsh(self._covariance)[:, -1])
        self.known = Known(cost, relative)

    @property
    def information(self) -> FloatArray:
        """Fisher information (copies, k, k) so far, without the prior."""
        offsets = np.einsum("npa,npb->nab", self._b, self._b / np.maximum(self._c, 1e-300)[:, :, None])
        M = np.tril(self._M) + np.swapaxes(np.tril(self._M, -1), 1, 2)
        return np.asarray((M - offsets) / np.outer(self._prior, self._prior))


@compiled
def _learn(
    S: FloatArray, at: npt.NDArray[np.int64], which: Mask, samples: int, taken: FloatArray, gradient: FloatArray,
    M: FloatArray, b: FloatArray, c: FloatArray, covariance: FloatArray, volume: FloatArray,
) -> int:  # fmt: skip  # pragma: no cover
    """Add samples and take the covariance of the targets, prior included; return a flight that failed, or -1.

    Args:
        S: (copies, r, p, k) sensitivities.
        at: (copies,) number of the first sample.
        which: (copies,) flights that are looked at.
        samples: of S that are added.
        taken: (N, p) root of the share of samples that arrive.
        gradient: (k, t).
        M: (copies, k, k) lower half, changed.
        b: (copies, p, k) changed.
        c: (copies, p) changed.
        covariance: (copies, t, t) filled.
        volume: (copies,) logarithm of the root of its determinant, filled.
    """
    k, t = gradient.shape
    L, half = np.empty((k, k)), np.empty((k, t))
    s = np.empty(k)
    for f in range(which.size):
        if not which[f]:
            continue
        for i in range(samples):
            for j in range(c.shape[1]):
                w = taken[at[f] + i, j]
                if w == 0.0:
                    continue
                c[f, j] += w * w
                for a in range(k):
                    s[a] = w * S[f, i, j, a]
                    b[f, j, a] += w * s[a]
                    for d in range(a + 1):
                        M[f, a, d] += s[a] * s[d]
        # Cholesky factor of the information, offsets projected out and the prior added
        for a in range(k):
            for d in range(a + 1):
                x = M[f, a, d]
                for j in range(c.shape[1]):
                    x -= b[f, j, a] * b[f, j, d] / max(c[f, j], 1e-300)
                if a == d:
                    x += 1.0
                for e in range(d):
                    x -= L[a, e] * L[d, e]
                if a == d:
                    if not x > 0.0:
                        return f
                    L[a, a] = math.sqrt(x)
                else:
                    L[a, d] = x / L[d, d]
        for v in range(t):
            for a in range(k):
                x = gradient[a, v]
                for e in range(a):
                    x -= L[a, e] * half[e, v]
                half[a, v] = x / L[a, a]
        for v in range(t):
            for u in range(v + 1):
                x = 0.0
                for a in range(k):
                    x += half[a, v] * half[a, u]
                covariance[f, v, u] = covariance[f, u, v] = x
        # volume of the ellipsoid: product of the diagonal of R in half = Q R, by Gram and Schmidt
        size = 0.0
        for v in range(t):
            for u in range(v):
                x = 0.0
                for a in range(k):
                    x += half[a, v] * half[a, u]
                for a in range(k):
                    half[a, v] -= x * half[a, u]
            x = 0.0
            for a in range(k):
                x += half[a, v] * half[a, v]
            x = math.sqrt(x)
            size += math.log(x)
            for a in range(k):
                half[a, v] /= x
        volume[f] = size
    return -1
