"""Fisher information during a flight, and the cost of a design that follows from it.

    M(t) = sum over samples so far of s s' / sigma^2 - sum over sensors of b b' / c,    b = sum of s / sigma^2

with c the weight of a sensor's samples so far: its unknown offset is projected out, as in
:mod:`testbench.information.fisher`, with which M agrees at every moment. The prior information P = diag(1 / prior^2) is
added, so that the cost is finite from the first sample on (Bayesian optimality: K. Chaloner and I. Verdinelli,
Statistical Science 10, 1995).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgeqrf, dpotrf, dtrtrs

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.information.fisher import Criterion
from testbench.questions.design.problem import Problem


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
