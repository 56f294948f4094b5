"""Paired tests, intervals and the correction for many questions, against second implementations and by coverage."""

from __future__ import annotations

from dataclasses import astuple
from itertools import product

import numpy as np
import pytest
from scipy import stats

from testbench.core.proportion import proportion_interval
from testbench.evaluation.statistics import (
    chance_of_scatter,
    holm,
    mean_interval,
    paired,
    paired_misses,
    root_mean_square,
    scatter_interval,
    seeds_needed,
)


@pytest.mark.parametrize("n", [3, 6, 12, 25])
def test_signed_rank_probability_is_scipy_s_exact_one(n: int) -> None:
    d = np.random.default_rng(n).normal(0.4, 1.0, n)
    assert paired(d, "wilcoxon").p == pytest.approx(stats.wilcoxon(d, method="exact").pvalue, rel=1e-12)


def test_signed_rank_with_ties_counts_every_assignment_of_signs() -> None:
    d = np.array([1.0, 1.0, -1.0, 2.0, 2.0, 0.0, 3.0, -0.5])
    used = d[d != 0.0]
    ranks = stats.rankdata(np.abs(used))
    observed = ranks[used > 0.0].sum()
    sums = np.array([np.dot(signs, ranks) for signs in product((0, 1), repeat=used.size)])
    smaller = min(observed, ranks.sum() - observed)
    assert paired(d, "wilcoxon").p == pytest.approx(min(1.0, 2.0 * np.mean(sums <= smaller + 1e-9)))


def test_interval_holds_what_the_test_does_not_reject() -> None:
    d = np.random.default_rng(5).normal(1.0, 2.0, 15)
    found = paired(d, "wilcoxon").difference
    assert found is not None
    assert found.low < found.value < found.high
    for edge, outward in ((found.low, -1e-6), (found.high, 1e-6)):
        assert paired(d - edge - outward, "wilcoxon").p < 0.05 < paired(d - edge + outward, "wilcoxon").p


@pytest.mark.parametrize("test", ["wilcoxon", "t"])
def test_intervals_cover_with_their_probability(test) -> None:
    rng, runs = np.random.default_rng(11), 1000
    hits = 0
    for _ in range(runs):
        found = paired(rng.normal(0.7, 1.0, 12), test).difference
        hits += found.low <= 0.7 <= found.high
    # 95 % (the signed rank's own level with 12 pairs is 95.8 %); 5 standard deviations of the share: 6e-7
    assert abs(hits / runs - 0.955) < 5.0 * np.sqrt(0.05 * 0.95 / runs) + 0.005


def test_t_is_scipy_s() -> None:
    d = np.random.default_rng(2).normal(0.4, 1.0, 9)
    found, expected = paired(d, "t"), stats.ttest_1samp(d, 0.0)
    assert found.p == pytest.approx(expected.pvalue, rel=1e-12)
    interval = expected.confidence_interval(0.95)
    assert (found.difference.low, found.difference.high) == pytest.approx((interval.low, interval.high))


@pytest.mark.parametrize("test", ["wilcoxon", "t"])
def test_no_difference_is_no_finding_and_too_few_pairs_are_no_test(test) -> None:
    assert paired(np.zeros(8), test).p == 1.0
    assert paired(np.ones(2), test).p is None


def test_misses_are_compared_by_an_exact_sign_test_of_the_pairs_that_differ() -> None:
    before = np.array([True] * 9 + [False] * 3)
    after = np.array([False] * 8 + [True] + [True] + [False] * 2)
    found = paired_misses(before, after)
    assert found.p == pytest.approx(stats.binomtest(1, 9, 0.5).pvalue)
    assert found.difference.value == pytest.approx(100.0 * 7 / 12)
    assert found.difference.low < found.difference.value < found.difference.high
    assert paired_misses(before, before).p == 1.0
    assert paired_misses(before[:2], after[:2]).p is None
    back = paired_misses(after, before).difference
    assert (back.low, back.high) == pytest.approx((-found.difference.high, -found.difference.low))


@pytest.mark.slow
def test_interval_of_misses_covers() -> None:
    rng, runs, hits = np.random.default_rng(3), 1000, 0
    for _ in range(runs):
        state = rng.choice(4, size=16, p=[0.4, 0.3, 0.1, 0.2])  # both, before alone, after alone, none
        found = paired_misses((state == 0) | (state == 1), (state == 0) | (state == 2)).difference
        hits += found.low <= 20.0 <= found.high
    # at least 95 % by construction; 4 standard deviations of the share below: 3e-5
    assert hits / runs > 0.95 - 4.0 * np.sqrt(0.05 * 0.95 / runs)


def test_interval_of_a_mean_is_scipy_s() -> None:
    d = np.random.default_rng(4).normal(0.4, 1.0, 9)
    expected = stats.ttest_1samp(d, 0.0).confidence_interval(0.95)
    found = mean_interval(d)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_holm_on_a_worked_example() -> None:
    # 4 x 0.005, 3 x 0.01, 2 x 0.03, and 0.04 not below the one before
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


@pytest.mark.parametrize("questions", [1, 5, 38])
def test_fewest_pairs_that_can_show_anything(questions: int) -> None:
    n = seeds_needed(questions, 0.05)
    least = [holm([paired(np.arange(1.0, k + 1), "wilcoxon").p] + [1.0] * (questions - 1))[0] for k in (n, n - 1)]
    assert least[0] <= 0.05 < least[1]


def test_root_mean_square_and_its_interval() -> None:
    errors = np.array([3.0, -4.0, 5.0, -2.0])
    found = root_mean_square(errors)
    assert found.value == pytest.approx(np.sqrt(np.mean(errors**2)))
    square = errors**2
    half = stats.t.ppf(0.975, 3) * stats.sem(square) / np.mean(square)  # of the logarithm of the mean square
    assert np.log([found.low, found.high]) * 2.0 == pytest.approx(np.log(np.mean(square)) + half * np.array([-1, 1]))
    assert root_mean_square(np.ones(1)) is None
    assert astuple(root_mean_square(np.array([2.0, 2.0]))) == pytest.approx((2.0, 2.0, 2.0))
    assert astuple(root_mean_square(np.zeros(3))) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("n", [2, 5, 40])
def test_scatter_leaves_the_same_chance_on_each_side(n: int) -> None:
    low, high = scatter_interval(3.0, n)
    assert stats.chi2.sf((n - 1) * (3.0 / low) ** 2, n - 1) == pytest.approx(0.025)
    assert stats.chi2.cdf((n - 1) * (3.0 / high) ** 2, n - 1) == pytest.approx(0.025)
    assert chance_of_scatter(3.0 / low, n) == pytest.approx(0.05)
    assert chance_of_scatter(3.0 / high, n) == pytest.approx(0.05)
    assert chance_of_scatter(np.sqrt(stats.chi2.median(n - 1) / (n - 1)), n) == pytest.approx(1.0)


def test_interval_of_misses_takes_each_share_at_its_own_97_5_percent() -> None:
    before, after = (
        np.repeat([True, False, True, False], [5, 2, 8, 5]),
        np.repeat([False, True, True, False], [5, 2, 8, 5]),
    )
    found = paired_misses(before, after).difference
    (b_low, b_high), (c_low, c_high) = (proportion_interval(k, 20, 0.975, "exact") for k in (5, 2))
    assert astuple(found) == pytest.approx((15.0, 100.0 * (b_low - c_high), 100.0 * (b_high - c_low)))


def test_interval_of_a_scatter_covers() -> None:
    rng, runs = np.random.default_rng(4), 2000
    hits = 0
    for _ in range(runs):
        low, high = scatter_interval(float(np.std(rng.normal(0.0, 2.0, 10), ddof=1)), 10)
        hits += low <= 2.0 <= high
    assert abs(hits / runs - 0.95) < 5.0 * np.sqrt(0.05 * 0.95 / runs)  # 5 standard deviations: 6e-7
