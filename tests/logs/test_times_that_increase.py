"""Which samples of a clock with wrong times are kept: against every possible choice, and by its stated limits."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from testbench.logs.signals import increasing


def longest(t: np.ndarray) -> int:
    """Return the length of the longest increasing subsequence: every choice is tried."""
    sizes = range(t.size, 0, -1)
    return next(n for n in sizes if any(np.all(np.diff(t[list(c)]) > 0.0) for c in combinations(range(t.size), n)))


@pytest.mark.parametrize("seed", range(30))
def test_as_many_samples_are_kept_as_can_increase(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 10))
    t = np.arange(float(n))
    wrong = rng.choice(n, 2, replace=False)  # two are no clock that was set back
    t[wrong] = rng.integers(0, n, 2) + rng.choice([0.0, 0.5], 2)
    kept = increasing(t)
    assert np.all(np.diff(kept) > 0)
    assert np.all(np.diff(t[kept]) > 0.0)
    assert kept.size == longest(t)


def test_the_first_and_the_last_sample_are_kept_where_they_are_right():
    t = np.array([0.0, 1.0, 9.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0])
    assert increasing(t).tolist() == [0, 1, 3, 4, 5, 6, 7, 8, 9, 10]
    assert increasing(np.array([0.0, 1.0, 1.0, 2.0, np.nan, 3.0])).size == 4


@pytest.mark.parametrize("back", [-50.0, 30.0])
def test_of_a_clock_that_was_set_back_the_longest_stretch_is_kept(back):
    t = np.concatenate([100.0 + np.arange(40.0), 100.0 + back + np.arange(60.0)])
    assert increasing(t).tolist() == (list(range(40, 100)))
    assert increasing(t[::-1].copy()[::-1][:90]).tolist() == list(range(40, 90))


@pytest.mark.parametrize(("times_the_span", "kept"), [(1.9, True), (2.1, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_time_is_far_off_beyond_twice_the_span_from_its_middle(times_the_span, kept, sign):
    t = np.arange(0.0, 1001.0)
    low, high = np.quantile(t, [0.01, 0.99])  # one sample more moves them by less than a hundredth of the span
    far = 0.5 * (low + high) + sign * times_the_span * (high - low)
    whole = np.append(t, far) if sign > 0 else np.insert(t, 0, far)
    assert (increasing(whole).size == 1002) == kept
