"""Filters of a continuous denominator: exact steps, and one error where a pole leaves all numbers behind."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.estimators.continuous import StateVariableFilter


@pytest.mark.parametrize("pole", [-3.0, 0.5])
def test_a_step_through_one_pole_is_exact(pole):
    t = 0.02 * np.arange(50)
    x = StateVariableFilter(np.array([1.0, -pole]), 0.02, 50).states(np.ones((50, 1)), ["zoh"], [0.0])
    np.testing.assert_allclose(x[:, 0, 0], (np.exp(pole * t) - 1.0) / pole, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("a", [[1.0, -1e6], [1.0, -2e6, 1e12], [1.0, 3.0, -1e13]])
def test_a_pole_that_leaves_all_numbers_behind_within_a_sample_is_refused(a):
    with pytest.raises(EstimationError, match=r"within a sample of 0\.02 s, got one at"):
        StateVariableFilter(np.array(a), 0.02, 100)
