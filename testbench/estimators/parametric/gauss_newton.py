"""Bounded least squares by Gauss-Newton steps, damped as far as the linear model cannot be believed.

Innovations of a filter feel the parameters through its gain as well as directly, and with coloured residuals second
derivatives count: undamped Gauss-Newton steps then overshoot to the other side of the valley again and again.

Rounds of a search: the parameters for a noise covariance in turns with the covariance of what they leave.

The variances converge linearly, with a ratio that is near one where the model misses more than noise: an output that is
weighed less is followed less well. Steps to where the rounds lead save most of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

_EVERY = 3  # rounds from one step ahead to the next, so that its own change has died away
_FARTHEST, _LARGEST = 6.0, 0.5  # changes that a step goes ahead, and its change of a logarithm, at most


class Rounds:
    """Variances (p,) of a search, round by round."""

    def __init__(self, variances: FloatArray) -> None:
        self.variances, self.done = variances, 0
        self._previous = np.zeros(variances.size)

    def follow(self, found: FloatArray, last: bool) -> FloatArray:
        """Return the variances (p,) of the next round, after those that a round left behind (``found``).

        ``last`` says that nothing must be added any more, as the next round ends the search.
        """
        self.done += 1
        change, previous = np.log(found / self.variances), self._previous
        along = float(change @ previous) / max(float(previous @ previous), 1e-300)
        self._previous = change
        if self.done % _EVERY == 0 and not last and along > 0.0:
            changes = along / (1.0 - along) if along < 1.0 else _FARTHEST
            farthest = min(_FARTHEST, _LARGEST / max(float(np.max(np.abs(change))), 1e-300))
            found = found * np.exp(min(changes, farthest) * change)
            self._previous = np.zeros(change.size)
        self.variances = found
        return found


_POOR, _FINE = 0.25, 0.75  # real over predicted fall of the cost
_ROUNDING = 1e-11  # of the cost
_HUGE = 1e100
_NEAR = 0.1  # standard errors: a search that ends nearer to its minimum than this has found it (judged)
Problem = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Point (k,) -> weighted residuals r (N,) and their Jacobian dr/dpoint (N, k); r not finite where the point is bad."""


class Minimum(NamedTuple):
    """The end of the search: point (k,), cost r'r, Jacobian triangle R (k, k) with R'R = J'J, and how it went."""

    point: FloatArray
    cost: float
    R: FloatArray
    iterations: int
    converged: bool
    at_bound: NDArray[np.bool_]


def minimise(
    problem: Problem, start: FloatArray, low: FloatArray, high: FloatArray, *, tolerance: float, max_iterations: int
) -> Minimum:
    """Minimise r'r over low <= point <= high by Levenberg-Marquardt steps.

    The damping, in units of the squared column lengths of the Jacobian, rises after a step that gave less than a
    quarter of the fall that the linear model predicts, and falls after one that gave more than three quarters of it
    (J. J. More, 1978).

    A search that runs out of steps has converged all the same if no estimate is farther from the minimum of the linear
    model than a tenth of its standard error: its last steps then lie far below what the data can tell.

    Args:
        problem: point -> residuals, in units of their standard deviation, and their Jacobian.
        start: where the search starts.
        low: bounds below; a parameter on its bound stays while the gradient points outwards.
        high: bounds above.
        tolerance: the search ends when a full step would lower the cost by less than this share of it.
        max_iterations: most steps that are taken.

    Raises:
        EstimationError: the start itself gives residuals that are not finite.
    """
    point = np.clip(start, low, high)
    r, J = problem(point)
    if not _tame(r, J):
        raise EstimationError("the model diverges from its start values; start from others, or from equation error")
    cost, damping, converged, iterations = float(r @ r), 1e-4, False, 0
    held = np.zeros(point.size, bool)
    while iterations < max_iterations:
        iterations += 1
        gradient = J.T @ r
        held = ((point <= low) & (gradient > 0.0)) | ((point >= high) & (gradient < 0.0))
        moving = np.flatnonzero(~held)
        # The triangle of [J r] holds Q'r in its last column: Q itself, as large as J, is not needed.
        triangle = np.asarray(np.linalg.qr(np.column_stack([J[:, moving], r]), mode="r"))
        R, target = triangle[: moving.size, :-1], triangle[: moving.size, -1]
        size = np.sqrt(np.sum(R**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        promised = float(target @ target)  # what a full linear step would remove
        if promised <= tolerance * cost or not moving.size:
            converged = True
            break
        accepted = False
        while damping < 1e12:
            stacked = np.vstack([R, np.sqrt(damping) * np.diag(size)])
            step = np.linalg.lstsq(stacked, -np.concatenate([target, np.zeros(moving.size)]), rcond=None)[0]
            trial = point.copy()
            trial[moving] = np.clip(point[moving] + step, low[moving], high[moving])
            moved = target + R @ (trial[moving] - point[moving])
            predicted = promised - float(moved @ moved)
            if predicted <= 0.0 and np.any(trial[moving] != point[moving] + step):
                damping = max(10.0 * damping, 1e-3)  # a bound has bent the step uphill; a shorter one leads down
                continue
            if predicted <= 0.0 or (damping > 1e-4 and predicted < _ROUNDING * cost):
                break
            r_new, J_new = problem(trial)
            new = float(r_new @ r_new) if _tame(r_new, J_new) else np.inf
            gain = (cost - new) / predicted
            if gain < _POOR:
                damping = max(4.0 * damping, 1e-3) if gain > 0.0 else max(10.0 * damping, 1e-3)
            elif gain > _FINE:
                damping = max(damping / 10.0, 1e-12)
            if new < cost:
                point, r, J, cost, accepted = trial, r_new, J_new, new, True
                break
        if not accepted:  # no descent left within rounding
            converged = promised <= 1e-6 * cost
            break
    if not converged and np.any(~held):
        triangle = np.asarray(np.linalg.qr(np.column_stack([J[:, ~held], r]), mode="r"))
        converged = float(np.linalg.norm(triangle[: int(np.sum(~held)), -1])) <= _NEAR
    return Minimum(point, cost, np.asarray(np.linalg.qr(J, mode="r")), iterations, converged, held)


def _tame(r: FloatArray, J: FloatArray) -> bool:
    """Return whether residuals and Jacobian are numbers whose squares are numbers, too."""
    return all(bool(np.all(np.abs(x) < _HUGE)) for x in (r, J))
