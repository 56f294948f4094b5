"""MRSE and fit, by hand and at their limits.

Errors of frequency responses.
"""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.evaluation.metrics import bode_error, fit_percent, mrse_mean, mrse_percent, zero_order_hold

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


OMEGA = np.geomspace(0.1, 10.0, 25)
TRUE = np.stack([1.0 / (1.0 + 1j * OMEGA), 5.0 / (2.0 + 1j * OMEGA)], axis=1)[:, :, None]


def test_a_factor_and_a_phase():
    found = TRUE * np.array([2.0, np.exp(0.1j)])[:, None]
    error = bode_error(found, TRUE)
    assert error.magnitude_db == pytest.approx([20.0 * np.log10(2.0), 0.0], abs=1e-9)
    assert error.relative_percent == pytest.approx([100.0, 100.0 * abs(np.exp(0.1j) - 1.0)])
    assert np.array_equal(bode_error(TRUE, TRUE).relative_percent, [0.0, 0.0])


def test_root_mean_square_over_frequencies_and_inputs():
    true = np.ones((2, 1, 2), complex)
    found = np.array([[[1.1, 1.0]], [[1.0, 1.0]]], complex)
    assert bode_error(found, true).relative_percent == pytest.approx([5.0])  # sqrt(0.1^2 / 4)


def test_missing_paths_do_not_count_and_spurious_ones_are_infinite():
    true = np.ones((3, 2, 2), complex)
    true[:, 0, 1] = 0.0
    found = np.array(true)
    assert np.array_equal(bode_error(found, true).relative_percent, [0.0, 0.0])
    found[0, 0, 1] = 1e-3
    error = bode_error(found, true)
    assert np.array_equal(error.relative_percent, [np.inf, 0.0])
    assert np.array_equal(error.magnitude_db, [np.inf, 0.0])
    assert bode_error(np.zeros_like(true), true).magnitude_db[1] == np.inf


def test_hold_makes_a_continuous_response_comparable_with_a_discrete_one():
    from scipy.signal import cont2discrete

    dt, omega = 0.02, np.geomspace(0.5, 20.0, 20)
    num, den, _ = cont2discrete(([9.0], [1.0, 2.4, 9.0]), dt)
    z = np.exp(1j * omega * dt)
    sampled = np.polyval(num.ravel(), z) / np.polyval(den, z)
    s = 1j * omega
    continuous = 9.0 / (s**2 + 2.4 * s + 9.0)
    # aliases of a second-order roll-off at 20 rad/s from the first image at 294 rad/s: (20 / 294)^2 = 0.5 %
    assert (
        bode_error(sampled[:, None, None], (continuous * zero_order_hold(omega, dt))[:, None, None]).relative_percent
        < 0.5
    )
    assert bode_error(sampled[:, None, None], continuous[:, None, None]).relative_percent > 5.0


def test_shapes_of_responses_must_agree():
    with pytest.raises(EstimationError, match="must share one shape"):
        bode_error(TRUE, TRUE[:, :1])
    with pytest.raises(EstimationError, match="k >= 1"):
        bode_error(TRUE[:0], TRUE[:0])
