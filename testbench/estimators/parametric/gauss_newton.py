"""Bounded least squares by Gauss-Newton steps, damped as far as the linear model cannot be believed.

Innovations of a filter feel the parameters through its gain as well as directly, and with coloured residuals second
derivatives count: undamped Gauss-Newton steps then overshoot to the other side of the valley again and again.

Rounds of a search: the parameters for a noise covariance in turns with the covariance of what they leave.

The variances converge linearly, with a ratio that is near one where the model misses more than noise: an output that is
weighed less is followed less well. Steps to where the rounds lead save most of them.

Sensitivities of records to unknowns of which some belong to one record alone.

Initial states, offsets and biases of a record move its outputs only. So a record keeps the columns that it feels, and
the columns of all records meet in a small square root of the information, not in one long Jacobian: with m records of
n samples, k common unknowns and q of each record, n (k + q) numbers at a time in place of m n (k + m q).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

# --- sensitivities of records to unknowns of which some belong to one record alone ------------------------------------


_ROWS = 8192  # of a block: as many as a cache holds


class Sensitivities(NamedTuple):
    """Derivatives (N, p, c) of one record's outputs or residuals by the unknowns ``columns`` (c,) that it feels."""

    values: FloatArray
    columns: NDArray[np.intp]

    @classmethod
    def of_all(cls, values: FloatArray) -> Sensitivities:
        """Return the sensitivities (N, p, k) by all unknowns, in their order."""
        return cls(values, np.arange(values.shape[2]))


def in_blocks(residuals: FloatArray, sensitivities: Sensitivities, whiten: FloatArray) -> Iterator[FloatArray]:
    """Yield rows (r, c + 1) of one record, by time: weighted sensitivities (N, p, c) and residuals (N, p), last.

    ``whiten`` (p, p) multiplies both.
    """
    step = max(1, _ROWS // residuals.shape[1])
    for i in range(0, len(residuals), step):
        block = np.concatenate([sensitivities.values[i : i + step], residuals[i : i + step, :, None]], axis=2)
        yield (whiten @ block).reshape(-1, block.shape[2])


def believed_alone(
    columns: NDArray[np.intp], prior_weight: FloatArray, alone: NDArray[np.bool_], point: FloatArray | None = None
) -> Iterator[FloatArray]:
    """Yield rows (r, c + 1) of the priors about zero of unknowns that this record alone feels, if it has any.

    Args:
        columns: (c,) unknowns that it feels.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
        alone: (k,) or more, which only one record feels.
        point: (k,) of the search, whose distance from the priors stands last; none if not given.
    """
    mine = np.flatnonzero(alone[columns] & (prior_weight[columns] > 0.0))
    if mine.size:
        rows = np.zeros((mine.size, columns.size + 1))
        rows[np.arange(mine.size), mine] = weight = prior_weight[columns[mine]]
        if point is not None:
            rows[:, -1] = weight * point[columns[mine]]
        yield rows


def square_root(parts: Iterable[tuple[Iterable[FloatArray], NDArray[np.intp]]], alone: NDArray[np.bool_]) -> FloatArray:
    """Return S (s, k) with S' S = J' J of the rows of all parts.

    Each part is reduced by Householder reflections, block by block, the unknowns of its own first, so that only its
    rows of the common ones go on (A. Bjorck, Numerical Methods for Least Squares Problems, 1996, section 6.3: block
    angular problems). A row that is not finite makes all of S infinite.

    Args:
        parts: blocks of rows (r, c) and which columns (c,) of the whole they are; consumed one by one.
        alone: (k,) unknowns that only one part feels.
    """
    out: list[FloatArray] = []
    common = np.flatnonzero(~alone)
    shared = np.zeros((0, common.size))
    for blocks, columns in parts:
        order = np.argsort(~alone[columns], kind="stable")  # its own first
        triangle = np.zeros((0, columns.size))
        for rows in blocks:
            if not np.all(np.isfinite(rows)):
                return np.full((1, alone.size), np.inf)
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows[:, order]]), mode="r"))
        own = int(np.sum(alone[columns]))
        whole = np.zeros((len(triangle[:own]), alone.size))
        whole[:, columns[order]] = triangle[:own]
        out.append(whole)
        rest = np.zeros((len(triangle[own:]), common.size))
        rest[:, np.searchsorted(common, columns[order][own:])] = triangle[own:, own:]
        shared = np.asarray(np.linalg.qr(np.vstack([shared, rest]), mode="r"))
    last = np.zeros((len(shared), alone.size))
    last[:, common] = shared
    return np.vstack([*out, last])


# --- bounded least squares by Gauss-Newton steps, damped as far as the linear model cannot be believed ----------------


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


def reduced(
    parts: Callable[[FloatArray], Iterable[tuple[Iterable[FloatArray], NDArray[np.intp]]]], alone: NDArray[np.bool_]
) -> Problem:
    """Return a problem from the rows of each record, with the columns that they fill, as of :func:`square_root`.

    Residuals, in the last column, and Jacobian are reduced to as many rows as say the same.
    """

    def weighted(point: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(all="ignore"):  # a trial point may diverge: the search sees that and steps back
            S = square_root(parts(point), alone)
        return S[:, -1], S[:, :-1]

    return weighted


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
