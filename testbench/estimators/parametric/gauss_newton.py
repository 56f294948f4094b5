"""Bounded least squares by Gauss-Newton steps with Levenberg-Marquardt damping."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.errors import EstimationError
from testbench.record import FloatArray

_ROUNDING = 1e-9  # share of the cost that its differences may not show
Problem = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Point (k,) -> weighted residuals r (N,) and their Jacobian dr/dpoint (N, k); r not finite where the point is bad."""


class Minimum(NamedTuple):
    """Where the search ended: point (k,), cost r'r, Jacobian triangle R (k, k) with R'R = J'J, and how it went."""

    point: FloatArray
    cost: float
    R: FloatArray
    iterations: int
    converged: bool
    at_bound: NDArray[np.bool_]


def minimise(
    problem: Problem, start: FloatArray, low: FloatArray, high: FloatArray, *, tolerance: float, max_iterations: int
) -> Minimum:
    """Minimise r'r over low <= point <= high.

    Steps solve the damped normal equations through a QR factorisation of [J; sqrt(lambda) diag(|J|)], so that the
    scale of a parameter does not matter (J. J. More, 1978). Parameters that a step would push through a bound stay on
    it while the gradient points outwards. It ends when a full step would lower the cost by less than
    ``tolerance`` times the cost (or by less than rounding).

    Raises:
        EstimationError: the start itself gives residuals that are not finite.
    """
    point = np.clip(start, low, high)
    r, J = problem(point)
    if not np.all(np.isfinite(r)) or not np.all(np.isfinite(J)):
        raise EstimationError("the model diverges from its start values; start from others, or from equation error")
    cost, damping, converged, iterations = float(r @ r), 1e-4, False, 0
    held = np.zeros(point.size, bool)
    while iterations < max_iterations:
        iterations += 1
        gradient = J.T @ r
        held = ((point <= low) & (gradient > 0.0)) | ((point >= high) & (gradient < 0.0))
        moving = np.flatnonzero(~held)
        Q, R = np.linalg.qr(J[:, moving])
        size = np.sqrt(np.sum(R**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        target = Q.T @ r
        promised = float(target @ target)  # what a full linear step would remove
        if promised <= tolerance * cost or not moving.size:
            converged = True
            break
        accepted, tried = False, damping  # a gain within rounding is tried once only
        while damping < 1e12 and (damping <= tried or promised > _ROUNDING * cost):
            stacked = np.vstack([R, np.sqrt(damping) * np.diag(size)])
            step = np.linalg.lstsq(stacked, -np.concatenate([target, np.zeros(moving.size)]), rcond=None)[0]
            trial = point.copy()
            trial[moving] = np.clip(point[moving] + step, low[moving], high[moving])
            r_new, J_new = problem(trial)
            new = float(r_new @ r_new) if np.all(np.isfinite(r_new)) and np.all(np.isfinite(J_new)) else np.inf
            if new < cost:
                point, r, J, cost, accepted = trial, r_new, J_new, new, True
                damping = max(damping / 10.0, 1e-12)
                break
            damping = max(10.0 * damping, 1e-8)
        if not accepted:  # no descent left within rounding
            converged = promised <= 1e-6 * cost
            break
    return Minimum(point, cost, np.asarray(np.linalg.qr(J, mode="r")), iterations, converged, held)
