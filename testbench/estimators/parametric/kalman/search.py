"""The search for the maximum of the filter-error likelihood: Gauss-Newton steps in turns with new variances R."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.parametric.gauss_newton import Minimum, Rounds, minimise
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood, Part

_SETTLED = 3e-3  # relative change of the innovations' variances between two rounds that ends them
_ROUNDS = 60
_FOLLOWING = 4  # steps per round until R has settled
_START = 0.1  # innovations to start from, relative to the outputs' size
_NOTHING = 1e-10  # innovations below this share of every output's size are rounding


class Found(NamedTuple):
    """Where the search ended: the minimum, innovations of every record, their variances R (p,), and how it went."""

    minimum: Minimum
    parts: list[Part]
    R: FloatArray
    rounds: int
    settled: bool

    @property
    def converged(self) -> bool:
        """Whether both the steps and the variances came to rest."""
        return self.minimum.converged and self.settled


def search(likelihood: FilterLikelihood, values: FloatArray, max_iterations: int, rounds: int = _ROUNDS) -> Found:
    """Search by Gauss-Newton steps for a given R in turns with a new R, F and point of linearisation.

    Args:
        likelihood: of the records; its points of linearisation are moved.
        values: (k,) parameter values to start from.
        max_iterations: Gauss-Newton steps of the last round.
        rounds: most values of R.

    Raises:
        EstimationError: the filter diverges from these values.
    """
    base = likelihood.base
    low, high = likelihood.bounds()
    point = likelihood.start(values)
    R = (_START * base.size) ** 2
    total = float(base.counts.sum())
    settled, done, following = False, 0, Rounds(R)
    while True:
        done += 1
        # The rounds only have to follow R; the last one ends at 1/1000 of an error.
        tolerance, most = (1e-6, max_iterations) if settled else (1e-2, _FOLLOWING)
        minimum = minimise(likelihood.problem(R), point, low, high, tolerance=tolerance / total, max_iterations=most)
        point = minimum.point
        parts = likelihood.evaluate(point, R)
        if settled or done == rounds:
            return Found(minimum, parts, R, done, settled)
        new = np.diag(base.noise([part.v for part in parts]))
        if np.all(new <= (_NOTHING * base.size) ** 2):  # data without noise: nothing left to weigh
            return Found(minimum._replace(converged=True), parts, new, done, True)
        settled = bool(np.max(np.abs(new - R) / R) < _SETTLED)
        new = following.follow(new, settled)
        likelihood.points = [
            (part.x.mean(axis=0), s.u.mean(axis=0)) for part, s in zip(parts, base.stretches, strict=True)
        ]
        if not settled:
            point = np.clip(_rescaled(likelihood, point, R, new), low, high)
        R = new


def _rescaled(likelihood: FilterLikelihood, point: FloatArray, R: FloatArray, new: FloatArray) -> FloatArray:
    """Return the search point with F F' changed as R is where the states show: Jategaonkar 2015, section 5.3."""
    base, out = likelihood.base, point.copy()
    params = base.parameters(point, base.structure.values)[None].astype(complex)
    C = likelihood.linearised(params, 0)[1][0].real[:, likelihood.noisy]
    before, after = (np.sum(C**2 / variance[:, None], axis=0) for variance in (R, new))
    seen = before > 0.0
    common = np.full(seen.size, np.exp(np.mean(np.log(new / R))))
    change = 0.5 * np.log(np.divide(before, after, out=common, where=seen))
    out[base.unknowns : likelihood.own] += change
    rows = [likelihood.noisy.index(i) for i, _ in likelihood.pairs]
    out[likelihood.own :] *= np.exp(change[rows])
    return out
