"""Ranks over data sets against the printed example of Demsar (2006), and stated errors against the normal."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from testbench.evaluation.calibration import calibration
from testbench.evaluation.ranks import Ranks, ranks

AUC = np.array(
    [
        [0.763, 0.768, 0.771, 0.798],
        [0.599, 0.591, 0.590, 0.569],
        [0.954, 0.971, 0.968, 0.967],
        [0.628, 0.661, 0.654, 0.657],
        [0.882, 0.888, 0.886, 0.898],
        [0.936, 0.931, 0.916, 0.931],
        [0.661, 0.668, 0.609, 0.685],
        [0.583, 0.583, 0.563, 0.625],
        [0.775, 0.838, 0.866, 0.875],
        [1.000, 1.000, 1.000, 1.000],
        [0.940, 0.962, 0.965, 0.962],
        [0.619, 0.666, 0.614, 0.669],
        [0.972, 0.981, 0.975, 0.975],
        [0.957, 0.978, 0.946, 0.970],
    ]
)
"""Demsar's Table 6: four decision trees on 14 data sets, larger is better."""
AUC[12, 2] += 1e-6  # his ranks there are 2 and 3: digits that are not printed break the tie


def test_the_printed_example_comes_out() -> None:
    found = ranks(1.0 - AUC)
    np.testing.assert_allclose(found.mean, [3.143, 2.000, 2.893, 1.964], atol=5e-4)
    assert found.chi2 == pytest.approx(9.28, abs=0.005)
    assert found.p == pytest.approx(stats.f.sf(3.69, 3, 39), abs=2e-4)
    assert found.critical == pytest.approx(1.25, abs=0.005)
    assert ranks(1.0 - AUC, 0.10).critical == pytest.approx(1.12, abs=0.005)


@pytest.mark.parametrize(("k", "q"), [(2, 1.960), (3, 2.343), (4, 2.569), (5, 2.728), (10, 3.164)])
def test_the_printed_critical_values_come_out(k, q) -> None:
    n = 20
    found = ranks(np.random.default_rng(1).random((n, k)))
    assert found.critical / np.sqrt(k * (k + 1) / (6.0 * n)) == pytest.approx(q, abs=1e-3)  # not all are rounded


def test_without_ties_the_statistic_is_that_of_scipy() -> None:
    errors = np.random.default_rng(2).random((12, 5))
    assert ranks(errors).chi2 == pytest.approx(stats.friedmanchisquare(*errors.T).statistic, rel=1e-12)


def test_what_gave_nothing_ranks_last_and_groups_are_what_cannot_be_told_apart() -> None:
    rng = np.random.default_rng(3)
    errors = np.column_stack([rng.random(30), rng.random(30), 5.0 + rng.random(30), np.full(30, np.nan)])
    found = ranks(errors)
    assert found.mean[3] == 4.0
    assert found.p < 1e-6
    assert [set(g) for g in found.groups()] == [{0, 1}, {2, 3}] or found.mean[3] - found.mean[2] >= found.critical


def test_the_level_of_the_test_is_kept() -> None:
    rng = np.random.default_rng(4)
    p = np.array([ranks(rng.random((15, 4))).p for _ in range(1000)])
    assert 0.03 < np.mean(p < 0.05) < 0.07


def test_true_stated_errors_lie_in_the_band_and_small_ones_do_not() -> None:
    rng = np.random.default_rng(5)
    shares = []
    for _ in range(200):
        z = calibration(2.0 * rng.standard_normal(80), np.full(80, 2.0))
        shares.append(np.mean((z.low <= z.found) & (z.found <= z.high)))
    assert np.mean(shares) == pytest.approx(0.95, abs=0.02)
    half = calibration(2.0 * rng.standard_normal(80), np.full(80, 1.0))
    assert np.mean((half.low <= half.found) & (half.found <= half.high)) < 0.5
    few = calibration(np.array([1.0, np.nan, 2.0]), np.array([1.0, 1.0, 0.0]))
    assert few.found.tolist() == [1.0]


@pytest.mark.parametrize("n", [1, 7, 40])
def test_each_of_the_sorted_errors_leaves_its_band_with_half_of_5_percent_on_each_side(n: int) -> None:
    """The i-th smallest of n lies below x where at least i of n do: a binomial probability."""
    z = calibration(np.random.default_rng(n).normal(size=n), np.ones(n))
    i = np.arange(1, n + 1)
    for edge, chance in ((z.low, 0.025), (z.expected, 0.5), (z.high, 0.975)):
        np.testing.assert_allclose(stats.binom.sf(i - 1, n, stats.norm.cdf(edge)), chance, rtol=1e-9)
    assert np.all(np.diff(z.found) >= 0.0)


def test_groups_hold_two_or_more_and_none_lies_within_another() -> None:
    def groups(*mean: float) -> list[tuple[int, ...]]:
        return Ranks(10, np.array(mean), 1.0, 0.5, 1.0, 0.05).groups()

    assert groups(1.0, 3.0, 5.0) == []
    assert groups(2.5, 1.0, 1.9) == [(1, 2), (2, 0)]
    assert groups(1.0, 1.5, 1.9, 4.0) == [(0, 1, 2)]
    assert groups(1.0, 2.0) == []  # the critical difference itself tells them apart
