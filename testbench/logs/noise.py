"""A signal against its own noise: what it does where nothing happens, its quantisation, and how often it is new.

A channel moves where it does more than that. A fixed threshold cannot say so: 0.5 deg/s is motion for a ring laser and
noise for a gyro on a shaking wing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray

WINDOW_S = 1.0  # over which a straight line is the motion and the rest noise: below the period of rigid motions
FEWEST = 8  # samples in a window
QUIET = 0.25  # of the windows are taken to hold nothing but noise
BEYOND = 2.5  # times the noise: a window of 8 samples of white noise does that once in 10^8
_LARGEST_STEPS = 50.0  # quantisation steps in a usual change: above it the digits are those of a float
_WHOLE = 0.1  # of a step: changes are whole steps
_JUMPS = 0.8  # of what it moves by
_MOST = 0.95  # of the changes
_HELD = 0.8  # of the times between changes that are alike, where a slower signal is repeated


@dataclass(frozen=True)
class Noise:
    """What a channel does where nothing happens.

    Args:
        std: standard deviation about a straight line in the quietest quarter of the windows of 1 s, in the unit of the
            channel: with gusts, vibration and quantisation.
        step: its quantisation, 0 if none shows.
        rate_hz: how often it takes a new value: below the rate of its samples where they repeat a slower signal.
        white: standard deviation of what is new in every sample, by third differences, which no rigid motion has.
    """

    std: float
    step: float
    rate_hz: float
    white: float = 0.0

    @property
    def size(self) -> float:
        """The standard deviation, at least that of the quantisation (Widrow: step / sqrt(12))."""
        return max(self.std, self.step / np.sqrt(12.0))


def noise_of(t_s: FloatArray, x: FloatArray) -> Noise:
    """Return the noise of a channel.

    Args:
        t_s: (n,) times of its samples, s, increasing.
        x: (n,) samples.
    """
    if x.size < 2:
        return Noise(0.0, 0.0, 0.0)
    rate = 1.0 / float(np.median(np.diff(t_s)))
    spread = _spread(x, rate)[0]
    std = float(np.quantile(spread, QUIET)) if spread.size else 0.0
    return Noise(std, _step(x), true_rate(x, rate), white_std(x))


def white_std(x: FloatArray) -> float:
    """Return the standard deviation of white noise in samples (n,), of which those that are NaN are left out.

    Third differences of what is slow are small beside those of white noise, whose square is 20 times its variance.
    """
    changes = np.diff(x, 3)
    changes = changes[np.isfinite(changes)]
    return float(np.sqrt(np.mean(changes**2) / 20.0)) if changes.size else 0.0


def is_noise(x: FloatArray, noise: Noise) -> bool:
    """Say whether samples scatter by no more than what is new in each of them: nothing else is in them.

    The ratio of the two standard deviations is 1 +- 1.3 / sqrt(n) for white noise; three times that is beyond it.
    """
    return x.size < FEWEST or float(np.std(x)) <= noise.white * (1.0 + 4.0 / np.sqrt(x.size))


def moving(x: FloatArray, rate_hz: float, noise: Noise) -> NDArray[np.bool_]:
    """Return for each window of 1 s (8 samples at least) of evenly sampled ``x`` whether it moves beyond its noise.

    Within a window it moves if its deviation from a straight line, or what that line climbs, is 2.5 times the noise or
    more, and more than its quantisation explains.
    """
    spread, climbs = _spread(x, rate_hz)
    limit = BEYOND * noise.size
    return np.asarray((spread > limit) | (climbs > 2.0 * limit + noise.step))


def moves(x: FloatArray, rate_hz: float, noise: Noise) -> bool:
    """Say whether a channel moves beyond its noise anywhere in evenly sampled ``x``, quickly or slowly."""
    m = _samples(rate_hz)
    if x.size < FEWEST:
        return bool(np.ptp(x) > 2.0 * BEYOND * noise.size + noise.step) if x.size else False
    means = x[: x.size // m * m].reshape(-1, m).mean(axis=1) if x.size >= m else x[:0]
    slow = means.size > 1 and float(np.ptp(means)) > 2.0 * BEYOND * noise.size + noise.step
    return slow or bool(moving(x, rate_hz, noise).any())


def _samples(rate_hz: float) -> int:
    return max(FEWEST, round(WINDOW_S * rate_hz))


def _spread(x: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviation about a straight line, and the climb of that line, in windows of 1 s."""
    m = min(_samples(rate_hz), x.size)
    if m < 3:
        return np.zeros(0), np.zeros(0)
    rows = x[: x.size // m * m].reshape(-1, m)
    at = np.arange(m) - 0.5 * (m - 1)
    slope = rows @ at / float(at @ at)
    rest = rows - rows.mean(axis=1, keepdims=True) - np.outer(slope, at)
    return np.sqrt(np.sum(rest**2, axis=1) / (m - 2)), np.abs(slope) * (m - 1)


def _step(x: FloatArray) -> float:
    change = np.abs(np.diff(x))
    change = change[change > 1e-9 * max(float(np.max(np.abs(x))), 1e-300)]
    if change.size < FEWEST:
        return 0.0
    least = float(change.min())
    times = change / least
    if float(np.median(times)) > _LARGEST_STEPS:
        return 0.0
    return least if float(np.mean(np.abs(times - np.rint(times)) < _WHOLE)) >= _MOST else 0.0


def true_rate(x: FloatArray, rate_hz: float) -> float:
    """Return how often a signal takes a new value, Hz: below ``rate_hz`` where its samples repeat a slower one evenly.

    Args:
        x: (n,) samples.
        rate_hz: of the samples.
    """
    at = np.flatnonzero(np.diff(x))
    if at.size < FEWEST:
        return rate_hz
    apart = np.diff(at)
    usual = float(np.median(apart))
    alike = float(np.mean(np.abs(apart - usual) <= max(1.0, 0.1 * usual)))
    return rate_hz / float(np.mean(apart)) if usual >= 2.0 and alike >= _HELD else rate_hz


def jump_of(x: FloatArray) -> float:
    """Return the largest jump of a signal that moves in jumps between samples that rest; 0 if it moves otherwise.

    A jump is a change of which the samples around it have less than a tenth. A signal moves in jumps if they make up
    four fifths of all that it moves by.
    """
    change = np.abs(np.diff(x))
    if change.size < FEWEST or not change.any():
        return 0.0
    beside = np.maximum(np.r_[0.0, change[:-1]], np.r_[change[1:], 0.0])
    jumps = (change > 10.0 * beside) & (change > 0.05 * float(np.ptp(x)))
    total = float(np.sum(change[change > 0.01 * float(np.ptp(x))]))
    return float(np.max(change[jumps])) if jumps.any() and np.sum(change[jumps]) > _JUMPS * total else 0.0
