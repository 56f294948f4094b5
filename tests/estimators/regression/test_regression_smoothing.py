"""Smoothing and differentiation: exact derivatives, noise level, gain over central differences, gaps, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.regression import fourier_smooth, local_polynomial, noise_level, smooth_record

DT = 0.02
T = np.arange(801) * DT


def signal(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a motion in rad and its exact derivative."""
    y = 0.05 * np.sin(2.1 * t) * np.exp(-0.05 * t) + 0.03 * np.cos(0.7 * t) + 0.02 * np.sin(4.3 * t + 0.3)
    d = 0.05 * np.exp(-0.05 * t) * (2.1 * np.cos(2.1 * t) - 0.05 * np.sin(2.1 * t))
    return y, d - 0.021 * np.sin(0.7 * t) + 0.086 * np.cos(4.3 * t + 0.3)


Y, D = signal(T)


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def test_without_noise_nothing_is_lost():
    out = fourier_smooth(Y, DT)
    assert np.max(np.abs(out.values - Y)) < 1e-5  # of 0.1; measured 4e-6, at the ends
    assert np.max(np.abs(out.derivative - D)) < 1e-3  # of 0.2; measured 7e-4, at the ends
    assert np.max(np.abs((out.derivative - D)[50:-50])) < 1e-6
    line = fourier_smooth(3.0 + 2.0 * T, DT)
    assert np.allclose(line.values, 3.0 + 2.0 * T)
    assert np.allclose(line.derivative, 2.0)


@pytest.mark.parametrize(("std", "factor"), [(1e-4, 4.0), (1e-3, 8.0), (3e-3, 10.0)])
def test_the_derivative_beats_central_differences(std, factor):
    gains, lowered, levels = [], [], []
    for seed in range(20):
        z = Y + std * np.random.default_rng(seed).standard_normal(T.size)
        out = fourier_smooth(z, DT)
        gains.append(rms(np.gradient(z, DT) - D) / rms(out.derivative - D))
        lowered.append(rms(out.values - Y) / std)
        levels.append(out.noise_std / std)
    # Measured over 30 seeds: at least 6.5, 11.8 and 13.7, in the mean 8, 18 and 24.
    assert min(gains) > factor
    assert np.mean(lowered) < 0.4
    # 320 of 800 coefficients: a deviation of 4 % each, 0.9 % of the mean of 20
    assert np.mean(levels) == pytest.approx(1.0, abs=0.04)


def test_the_noise_level_is_right_with_steps_in_the_signal():
    y = np.where(T > 4.0, 0.2, -0.2) + Y
    found = [noise_level(y + 1e-3 * np.random.default_rng(s).standard_normal(T.size)) for s in range(20)]
    # Differences overlap, so that a median of 800 deviates by about 5 %, the mean of 20 by about 1.2 %.
    assert np.mean(found) == pytest.approx(1e-3, rel=0.06)


def test_a_given_cutoff_is_used():
    z = np.sin(2 * np.pi * 0.5 * T) + np.sin(2 * np.pi * 8.0 * T)
    out = fourier_smooth(z, DT, cutoff_hz=2.0)
    assert out.cutoff_hz == pytest.approx(2.0)
    assert rms((out.values - np.sin(2 * np.pi * 0.5 * T))[50:-50]) < 0.02  # weights 0.9998 and 2.4e-4
    assert fourier_smooth(z, DT, cutoff_hz=8.0).values[200:600].std() > 0.75  # half of the second passes


def test_local_polynomials_are_exact_for_polynomials():
    t = T - 8.0
    y = 2.0 - 3.0 * t + 0.5 * t**2
    assert np.allclose(local_polynomial(y, DT), -3.0 + t, atol=1e-10)
    assert np.allclose(local_polynomial(y, DT, derivative=0, half_width=5), y, atol=1e-10)
    assert np.allclose(local_polynomial(y, DT, derivative=2, half_width=3), 1.0, atol=1e-8)
    cubic = local_polynomial(t**3, DT, degree=3, half_width=4)
    assert np.allclose(cubic, 3.0 * t**2, atol=1e-9)


def test_the_noise_of_a_local_derivative_is_the_stated_one():
    w = 4
    found = [local_polynomial(np.random.default_rng(s).standard_normal(801), DT, half_width=w) for s in range(20)]
    # 16000 samples correlated over 9: a deviation below 2 %
    assert np.std(np.array(found)[:, w:-w]) == pytest.approx(np.sqrt(3 / (w * (w + 1) * (2 * w + 1))) / DT, rel=0.08)


def test_scipy_agrees_on_local_polynomials():
    from scipy.signal import savgol_filter

    z = Y + 1e-3 * np.random.default_rng(0).standard_normal(T.size)
    for width, degree, order in ((2, 2, 1), (5, 3, 1), (6, 4, 2)):
        other = savgol_filter(z, 2 * width + 1, degree, deriv=order, delta=DT)
        found = local_polynomial(z, DT, half_width=width, degree=degree, derivative=order)
        assert np.allclose(found, other, atol=1e-9 * np.max(np.abs(other)))


def test_gaps_in_a_record_are_bridged_and_stay_marked():
    z = Y + 1e-3 * np.random.default_rng(1).standard_normal(T.size)
    valid = np.ones((T.size, 2), bool)
    valid[300:305, 0] = False
    spoilt = z.copy()
    spoilt[300:305] = 40.0
    record = FlightRecord(T, ("alpha", "de"), np.column_stack([spoilt, z]), "measured", valid=valid)
    out = smooth_record(record, ("alpha",))
    assert np.array_equal(out.valid, valid)
    assert np.array_equal(out["de"], z)
    assert rms(out["alpha"] - Y) < 0.5e-3
    assert out.provenance["smoothed"]["alpha"]["noise_std"] == pytest.approx(1e-3, rel=0.15)
    assert smooth_record(record, ("alpha",)).data.tobytes() == out.data.tobytes()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fourier_smooth(np.zeros(10), DT), "at least 16 finite samples"),
        (lambda: fourier_smooth(np.full(50, np.nan), DT), "finite"),
        (lambda: fourier_smooth(Y, DT, cutoff_hz=30.0), "Nyquist frequency = 25 Hz"),
        (lambda: local_polynomial(Y, DT, half_width=1, degree=3), "degree < 2 half_width"),
        (lambda: local_polynomial(Y[:4], DT), "at least 5"),
        (lambda: noise_level(np.zeros(3)), "at least 16"),
        (
            lambda: smooth_record(
                FlightRecord(T, ("q",), Y[:, None], "measured", valid=np.zeros((T.size, 1), bool)), ("q",)
            ),
            "at least one valid sample",
        ),
    ],
)
def test_what_cannot_be_smoothed_is_refused(call, message):
    with pytest.raises(EstimationError, match=message):
        call()
