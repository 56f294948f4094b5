"""Block Hankel matrices: lag products, shared Gram matrices and predictions against windows written out."""

import numpy as np
import pytest

from testbench.estimators import hankel
from testbench.estimators.hankel import BlockHankel, block_factor, lag_products, predict, thin_svd, window_starts


def explicit(z, starts, length):
    return np.array([z[k : k + length].ravel() for k in starts]).reshape(len(starts), length * z.shape[1])


def data(seed=0):
    rng = np.random.default_rng(seed)
    series = [np.array([1.0, 0.0, 5.0]) + rng.standard_normal((n, 3)) for n in (2000, 25, 1500)]
    good = [np.ones(2000, bool), np.ones(25, bool), rng.random(1500) > 0.02]
    return series, good


@pytest.mark.parametrize(("begin", "end", "length"), [(0, 980, 21), (7, 300, 1), (3, 9, 40), (5, 5, 4), (990, 996, 4)])
def test_lag_products_are_the_sums_of_products(begin, end, length):
    z = np.random.default_rng(1).standard_normal((1000, 2))
    expected = sum((np.outer(z[k], z[k : k + length]) for k in range(begin, end)), np.zeros((2, 2 * length)))
    assert np.abs(lag_products(z, begin, end, length) - expected).max() < 1e-11  # sums near 1000


@pytest.mark.parametrize("lead", [0, 1, 2])
@pytest.mark.parametrize("announced", [(20, 12, 5), (5,), ()])
def test_factors_of_several_lengths_equal_those_of_their_own_windows(lead, announced):
    series, good = data()
    shared = BlockHankel(series, good, announced, lead)
    for length in (12, 20, 5, 1):
        starts = [window_starts(g, length) for g in good]
        rows = []
        for z, first in zip(series, starts, strict=True):
            Z = explicit(z, first, length)
            if lead:
                line = hankel.trend(first, first, lead)
                Z = Z - line @ np.linalg.lstsq(line, Z, rcond=None)[0]
            rows.append(Z)
        expected = np.vstack(rows).T @ np.vstack(rows)
        R = shared.quick(length)
        assert R is not None
        # 3500 products are summed in another order: 1e-12 is some hundred roundings of the largest sum
        assert np.abs(R.T @ R - expected).max() < 1e-12 * np.abs(expected).max()
        own, columns = block_factor(series, good, length, lead)
        assert shared.columns(length) == columns == sum(first.size - lead for first in starts if first.size > lead)
        assert np.abs(own - R).max() < 1e-10 * np.abs(R).max()


def test_dependent_windows_are_folded_instead_of_squared():
    t = np.arange(4000.0)
    z = np.stack([np.sin(0.3 * t), np.cos(0.3 * t)], axis=1)  # two directions, whatever the length
    shared = BlockHankel([z], [np.ones(4000, bool)], (6,))
    assert shared.quick(6) is None
    R, columns = shared.factor(6)
    assert columns == 3995
    s = np.linalg.svd(R, compute_uv=False)
    assert s[2] < 1e-13 * s[0]  # a Gram matrix would leave 1e-8


@pytest.mark.parametrize("samples", [3, 30, 31, 500, 1001])
def test_predictions_are_windows_times_coefficients(samples):
    rng = np.random.default_rng(2)
    z, theta = rng.standard_normal((samples, 3)), rng.standard_normal((15, 2))
    starts = np.arange(max(samples - 4, 0))
    found = predict(z, theta, 5)
    assert found.shape == (starts.size, 2)
    assert np.abs(found - explicit(z, starts, 5) @ theta).max(initial=0.0) < 1e-13


def test_a_decomposition_that_does_not_converge_is_made_by_the_slower_algorithm(monkeypatch):
    M = np.random.default_rng(1).standard_normal((7, 4))
    U, s, Vt = thin_svd(M)

    def fails(*args, **settings):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    again = thin_svd(M)
    assert [a.shape for a in again] == [U.shape, s.shape, Vt.shape]
    np.testing.assert_allclose(again[1], s, rtol=1e-13)
    np.testing.assert_allclose(again[0] * again[1] @ again[2], M, atol=1e-13)


def test_a_trend_runs_from_minus_one_to_one_over_the_series_whatever_its_length():
    """Its scale leaves what is projected out as it is, and the Gram matrix well-conditioned for any length."""
    for first in (np.arange(40, 51), np.arange(0, 100_001, 10), np.array([3, 90, 103])):
        found = hankel.trend(first, first, 2)
        assert np.array_equal(found[:, 0], np.ones(first.size))
        assert (found[0, 1], found[-1, 1]) == (-1.0, 1.0)
        assert np.allclose(np.diff(found[:, 1]), np.diff(first) * 2.0 / (first[-1] - first[0]), rtol=1e-12)
    assert hankel.trend(np.array([7]), np.array([7]), 2).tolist() == [[1.0, 0.0]]  # one window has no length
