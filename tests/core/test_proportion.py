"""Intervals of a share that was counted."""

import pytest
from scipy.stats import binom

from testbench.core.proportion import proportion_interval


def test_wilsons_interval_solves_its_equation():
    """Its ends solve (share - p)^2 = z^2 p (1 - p) / n (Brown, Cai, DasGupta, Stat. Sci. 16(2), 2001, equation 4)."""
    for p in proportion_interval(8, 10):
        assert (0.8 - p) ** 2 == pytest.approx(1.959964**2 * p * (1 - p) / 10, rel=1e-6)
    low, high = proportion_interval(10, 10)
    assert high == pytest.approx(1.0)
    assert low > 0.7


def test_the_exact_interval_is_the_wider_one_and_nothing_counted_says_nothing():
    low, high = proportion_interval(3, 20)
    exact_low, exact_high = proportion_interval(3, 20, method="exact")
    assert exact_low < low < 0.15 < high < exact_high
    assert proportion_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("k", [1, 3, 12])
def test_the_exact_interval_leaves_half_of_the_error_on_each_side(k):
    low, high = proportion_interval(k, 20, method="exact")
    assert binom.sf(k - 1, 20, low) == pytest.approx(0.025)
    assert binom.cdf(k, 20, high) == pytest.approx(0.025)
