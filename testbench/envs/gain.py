"""Fisher information during a flight, and the cost of a design that follows from it.

    M(t) = sum over samples so far of s s' / sigma^2 - sum over sensors of b b' / c,    b = sum of s / sigma^2

with c the weight of a sensor's samples so far: its unknown offset is projected out, as in
:mod:`testbench.information.fisher`, with which M agrees at every moment. The prior information P = diag(1 / prior^2) is
added, so that the cost is finite from the first sample on (Bayesian optimality: K. Chaloner and I. Verdinelli,
Statistical Science 10, 1995).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.envs.compiled import compiled
from testbench.information.fisher import Criterion


class Known(NamedTuple):
    """Natural logarithm of the cost (copies,), and standard errors of the targets over the wanted ones (copies, t)."""

    log_cost: FloatArray
    relative: FloatArray


class Sums(NamedTuple):
    """What flights have told so far."""

    M: FloatArray  # (copies, k, k) lower half of the information, offsets included
    b: FloatArray  # (copies, p, k) weighted sums of the sensitivities
    c: FloatArray  # (copies, p) weights of the samples
    covariance: FloatArray  # (copies, t, t) of the targets, prior included
    volume: FloatArray  # (copies,) logarithm of the root of its determinant


Mask = npt.NDArray[np.bool_]


class Gain:
    """Sums up information of flights that each have a clock of their own.

    Args:
        problem: the design problem.
        criterion: which cost, see :func:`testbench.information.fisher.cost`.
        prior: standard error before the flight, relative to a parameter's true value; for a parameter that is zero,
            that of 1 in its unit.
        copies: how many flights.

    Raises:
        EstimationError: no prior, or targets that depend on one another under criterion D.

    Attributes:
        prior: (k,) standard errors before the flight.
        sensitivity_scale: (p, k) factors on sensitivities before they enter: prior standard errors over noise.
        known: logarithm of the cost (copies,) and relative errors (copies, t), prior included; of a flight that is left
            out of :meth:`add`, those before.
    """

    def __init__(self, problem: Problem, criterion: Criterion, prior: float, copies: int = 1) -> None:
        if not prior > 0.0:
            raise EstimationError(f"prior > 0 must hold, got {prior:g}")
        true = problem.experiment.structure.true
        self.prior = prior * np.where(true == 0.0, 1.0, np.abs(true))
        self.sensitivity_scale = self.prior / problem.experiment.sigma[:, None]
        self._gradient = np.ascontiguousarray((problem.targets.gradient * self.prior).T)  # in wanted, by prior errors
        k, t = self._gradient.shape
        if criterion == "D" and np.linalg.matrix_rank(self._gradient) < t:
            raise EstimationError(
                "the volume of the error ellipsoid needs targets that do not depend on one another, but "
                f"{', '.join(problem.targets.names)} do; leave some out or choose criterion 'worst'"
            )
        self._taken, p = _taken(problem), len(problem.experiment.sensors)
        self._made = problem, criterion, prior
        self._sums = Sums(*(np.zeros((copies, *of)) for of in ((k, k), (p, k), (p,), (t, t), ())))
        self.reset(np.ones(copies, bool), 0)

    def of(self, copies: int) -> Gain:
        """Return the same for another number of flights."""
        return Gain(*self._made, copies)

    def reset(self, which: Mask, quiet: int) -> None:
        """Begin the flights ``which`` (copies,) again after ``quiet`` samples of undisturbed flight.

        They tell the offsets alone.
        """
        self._sums.M[which], self._sums.b[which] = 0.0, 0.0
        self._sums.c[which] = np.sum(self._taken[:quiet] ** 2, axis=0)
        none = np.zeros((len(which), 1, 1, self._sums.M.shape[1]))
        self.add(none, np.zeros(len(which), np.int64), which, samples=0)

    def add(self, S: FloatArray, at: npt.NDArray[np.int64], which: Mask, samples: int) -> None:
        """Take in sensitivities of the next samples of the flights ``which`` (copies,).

        Args:
            S: (copies, r, p, k), times :attr:`sensitivity_scale`.
            at: (copies,) number of the first sample.
            which: the flights.
            samples: how many of the r are taken in.

        Raises:
            EstimationError: the information of one is not positive, which says that it ceased to be finite.
        """
        failed = _learn(np.ascontiguousarray(S), at, which, samples, self._taken, self._gradient, self._sums)
        if failed >= 0:
            whose = f" of copy {failed}" if len(which) > 1 else ""
            raise EstimationError(
                f"information must stay finite; the linear aircraft{whose} has diverged, shorten the flight"
            )
        variance, criterion = np.diagonal(self._sums.covariance, axis1=1, axis2=2), self._made[1]
        relative = np.sqrt(variance)
        if criterion == "D":
            cost = self._sums.volume / relative.shape[1]
        elif criterion == "worst":
            cost = 0.5 * np.log(variance.max(axis=1))
        elif criterion == "A":
            cost = 0.5 * np.log(variance.mean(axis=1))
        else:
            cost = 0.5 * np.log(np.linalg.eigvalsh(self._sums.covariance)[:, -1])
        self.known = Known(cost, relative)

    @property
    def information(self) -> FloatArray:
        """Fisher information (copies, k, k) so far, without the prior."""
        M, b, c, *_ = self._sums
        offsets = np.einsum("npa,npb->nab", b, b / np.maximum(c, 1e-300)[:, :, None])
        M = np.tril(M) + np.swapaxes(np.tril(M, -1), 1, 2)
        return np.asarray((M - offsets) / np.outer(self.prior, self.prior))


def _taken(problem: Problem) -> FloatArray:
    """Return (N, p) the root of the share of samples that each sensor delivers at each instant."""
    experiment = problem.experiment
    base = 1.0 / (experiment.dt_s * experiment.stride)
    out = np.zeros((experiment.samples, len(experiment.sensors)))
    for i, sensor in enumerate(experiment.sensors):
        out[:: round(base / (sensor.rate_hz or base)), i] = np.sqrt(1.0 - sensor.dropout)
    return out


@compiled
def _learn(
    S: FloatArray, at: npt.NDArray[np.int64], which: Mask, samples: int, taken: FloatArray, gradient: FloatArray,
    sums: Sums,
) -> int:  # fmt: skip  # pragma: no cover
    """Add samples and take the covariance of the targets, prior included; return a flight that failed, or -1.

    Args:
        S: (copies, r, p, k) sensitivities.
        at: (copies,) number of the first sample.
        which: (copies,) flights that are looked at.
        samples: of S that are added.
        taken: (N, p) root of the share of samples that arrive.
        gradient: (k, t).
        sums: changed.
    """
    M, b, c, covariance, volume = sums
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
