"""Smoothing and differentiation: exact derivatives, noise level, gain over central differences, refusals."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.estimators.regression.smoothing import SineSeries, bridge, noise_level

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
    out = SineSeries.of(Y, DT).smoothed()
    assert np.max(np.abs(out.values - Y)) < 1e-5  # of 0.1; measured 4e-6, at the ends
    assert np.max(np.abs(out.derivative - D)) < 1e-3  # of 0.2; measured 7e-4, at the ends
    assert np.max(np.abs((out.derivative - D)[50:-50])) < 1e-6
    line = SineSeries.of(3.0 + 2.0 * T, DT).smoothed()
    assert np.allclose(line.values, 3.0 + 2.0 * T)
    assert np.allclose(line.derivative, 2.0)


@pytest.mark.parametrize(("std", "factor"), [(1e-4, 4.0), (1e-3, 8.0), (3e-3, 10.0)])
def test_the_derivative_beats_central_differences(std, factor):
    gains, lowered, levels = [], [], []
    for seed in range(20):
        z = Y + std * np.random.default_rng(seed).standard_normal(T.size)
        out = SineSeries.of(z, DT).smoothed()
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
    out = SineSeries.of(z, DT).smoothed(2.0)
    assert out.cutoff_hz == pytest.approx(2.0)
    assert rms((out.values - np.sin(2 * np.pi * 0.5 * T))[50:-50]) < 0.02  # weights 0.9998 and 2.4e-4
    assert SineSeries.of(z, DT).smoothed(8.0).values[200:600].std() > 0.75  # half of the second passes


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SineSeries.of(np.zeros(10), DT).smoothed(), "at least 16 finite samples"),
        (lambda: SineSeries.of(np.full(50, np.nan), DT).smoothed(), "finite"),
        (lambda: SineSeries.of(Y, DT).smoothed(30.0), "Nyquist frequency = 25 Hz"),
        (lambda: noise_level(np.zeros(3)), "at least 16"),
        (lambda: bridge(T, Y, np.zeros(T.size, bool), "q"), "at least one valid sample"),
    ],
)
def test_what_cannot_be_smoothed_is_refused(call, message):
    with pytest.raises(EstimationError, match=message):
        call()
