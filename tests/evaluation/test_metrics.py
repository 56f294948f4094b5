"""MRSE and fit, by hand and at their limits."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.evaluation.metrics import fit_percent, mrse_mean, mrse_percent

Y = np.array([[3.0, 1.0], [4.0, -1.0], [0.0, 1.0], [0.0, -1.0]])


def test_by_hand():
    yhat = Y + np.array([[3.0, 0.5], [0.0, 0.5], [0.0, 0.5], [4.0, 0.5]])
    # channel 1: sqrt(9 + 16) / sqrt(9 + 16); channel 2: sqrt(4 * 0.25) / sqrt(4)
    assert mrse_percent(Y, yhat) == pytest.approx([100.0, 50.0])
    assert mrse_mean(Y, yhat) == pytest.approx(75.0)
    # channel 1 about its mean 1.75: 25 - 4 * 1.75^2 = 12.75
    assert fit_percent(Y, yhat) == pytest.approx([100.0 * (1.0 - 5.0 / np.sqrt(12.75)), 50.0])


def test_perfect_and_none_at_all():
    assert np.array_equal(mrse_percent(Y, Y), [0.0, 0.0])
    assert np.array_equal(fit_percent(Y, Y), [100.0, 100.0])
    assert mrse_percent(Y, np.zeros_like(Y)) == pytest.approx([100.0, 100.0])
    assert fit_percent(Y, np.broadcast_to(Y.mean(axis=0), Y.shape)) == pytest.approx([0.0, 0.0])


def test_invalid_samples_do_not_count():
    valid = np.ones(Y.shape, bool)
    valid[3] = False
    spoilt = np.where(valid, Y, 1e9)
    assert np.array_equal(mrse_percent(Y, spoilt, valid), [0.0, 0.0])
    valid[:, 1] = False
    with pytest.raises(EstimationError, match="none in channel number 2"):
        mrse_percent(Y, Y, valid)


def test_overflow_is_infinite_and_never_nan():
    yhat = np.array(Y)
    for bad in (np.inf, -np.inf, np.nan):
        yhat[2, 0] = bad
        assert np.array_equal(mrse_percent(Y, yhat), [np.inf, 0.0])
        assert np.array_equal(fit_percent(Y, yhat), [-np.inf, 100.0])
    yhat[2, 0] = 1e300  # its square overflows, its size does not
    assert mrse_percent(Y, yhat)[0] == pytest.approx(100.0 * 1e300 / 5.0)
    yhat[:, 0] = 1.7e308
    assert mrse_percent(1e-10 * Y, yhat)[0] == np.inf


def test_a_channel_that_does_not_move():
    still = np.zeros((4, 1))
    assert np.array_equal(mrse_percent(still, still), [0.0])
    assert np.array_equal(mrse_percent(still, still + 1.0), [np.inf])


def test_shapes_must_agree():
    with pytest.raises(EstimationError, match=r"share one shape \(n, p\), got \(4, 2\), \(3, 2\)"):
        mrse_percent(Y, Y[:3])
