"""Bounded searches end at the bounded minimum, also where the step that the linear model asks for leaves the bounds."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from testbench.estimators.parametric.gauss_newton import minimise


@pytest.mark.parametrize("seed", range(30))
def test_linear_problems_with_bounds_end_where_bounded_least_squares_do(seed):
    rng = np.random.default_rng(seed)
    k = 4
    # Columns that are nearly alike: the unbounded step goes far along one and back along another.
    J = rng.normal(size=(40, k)) @ (np.eye(k) + 3.0 * rng.normal(size=(k, 1)) @ rng.normal(size=(1, k)))
    target = J @ rng.normal(size=k) + 0.1 * rng.normal(size=40)
    low, high = -np.abs(rng.normal(size=k)), np.abs(rng.normal(size=k))

    def problem(point):
        return J @ point - target, J

    found = minimise(problem, np.zeros(k), low, high, tolerance=1e-12, max_iterations=200)
    expected = lsq_linear(J, target, (low, high), tol=1e-12)
    assert found.converged
    assert found.cost == pytest.approx(2.0 * expected.cost, rel=1e-6)
    assert np.all((low <= found.point) & (found.point <= high))


def test_a_lag_that_is_bounded_does_not_stop_the_others():
    """Two lags in a row, one of which wants to be below its bound: the other takes what is left."""
    t = np.linspace(0.0, 1.0, 200)
    data = 1.0 - np.exp(-t / 0.05)

    def step(a, b):
        return 1.0 - (a * np.exp(-t / a) - b * np.exp(-t / b)) / (a - b)

    def problem(point):
        r = step(*point) - data
        J = np.column_stack([(step(*(point + h)) - step(*(point - h))) / 2e-6 for h in 1e-6 * np.eye(2)])
        return r, J

    low, high = np.array([0.01, 0.02]), np.array([1.0, 1.0])
    ends = [
        minimise(problem, np.array(s), low, high, tolerance=1e-10, max_iterations=100)
        for s in ((0.3, 0.2), (0.06, 0.5))
    ]
    for end in ends:
        assert end.converged
        assert end.cost == pytest.approx(ends[0].cost, rel=1e-4)
    assert np.any(ends[0].at_bound)
