"""Smoothing and differentiation of sampled signals: global Fourier smoothing, and the noise of a signal.

Global Fourier smoothing removes the straight line between the ends, so that the odd extension of the rest is continuous
with its slope and its sine series falls off as k^-3, while noise stays level; a Wiener filter tells the two apart
(E. A. Morelli, "Estimating Noise Characteristics from Flight Test Data Using Optimal Fourier Smoothing", Journal of
Aircraft 32(4), 1995; V. Klein, E. A. Morelli, Aircraft System Identification, ch. 11).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

_NOISE_BAND = 0.6  # noise is read above this share of the Nyquist frequency
LEAST = 16
"""Samples below which there is no such band to speak of."""
_TRIALS = 200  # cut-offs tried
_MEDIAN_TO_STD = 0.6744897501960817  # median of |x| of a standard normal x


@dataclass(frozen=True, eq=False)
class Smoothed:
    """One smoothed signal."""

    values: FloatArray  # (n,) smoothed samples
    derivative: FloatArray  # (n,) their time derivative, per s
    noise_std: float  # standard deviation of the noise, estimated from the data, in units of the signal
    cutoff_hz: float  # frequency where the filter weight is one half


@dataclass(frozen=True, eq=False)
class SineSeries:
    """A signal as the line between its ends and a sine series, to be smoothed with one cut-off or several.

    y(t) = line(t) + sum_k phi_k b_k sin(k pi t / T), phi_k = 1 / (1 + (k / k_c)^6): the Wiener filter of a signal
    whose |b_k| falls as k^-3 and equals the noise at k_c. The line joins the end values of cubics fitted to either end,
    because single samples at the ends would bring their noise into the whole record. Sharp corners (steps of a control)
    are rounded; do not smooth controls. Noise that was filtered before it was logged is not level above 60 % of the
    Nyquist frequency: then ``noise_std`` is too small and little is smoothed; give a cut-off.
    """

    ends: tuple[float, float]  # values of the line at the first and last sample
    b: FloatArray  # (n - 2,) coefficients of the orthonormal sine series
    noise_std: float  # standard deviation of the noise, estimated from the data, in units of the signal
    dt_s: float  # sample time, s

    @classmethod
    def of(cls, y: FloatArray, dt_s: float) -> SineSeries:
        """Return the series of samples (n,), n >= 16.

        Raises:
            EstimationError: fewer than 16 samples, or one that is not finite.
        """
        from scipy.fft import dst

        y = _signal(y, LEAST)
        first, last = _end_values(y)
        line = first + np.arange(y.size) / (y.size - 1) * (last - first)
        b = dst(y[1:-1] - line[1:-1], type=1, norm="ortho")
        k = np.arange(1, y.size - 1)
        noise = float(np.sqrt(np.mean(b[k > _NOISE_BAND * (y.size - 1)] ** 2)))
        return cls((first, last), b, noise, dt_s)

    @property
    def best_cutoff_hz(self) -> float:
        """The cut-off that the data ask for, at most the Nyquist frequency.

        k_c minimises Stein's unbiased estimate of the mean square error of the values,
        sum (1 - phi)^2 b^2 + 2 sigma^2 phi, with sigma^2 the mean square of b_k above 60 % of the Nyquist frequency.
        """
        k = np.arange(1, self.b.size + 1)
        return _choose_corner(self.b, k, self.noise_std) / (2.0 * self.dt_s * (self.b.size + 1))

    def noise_left(self, cutoff_hz: float) -> float:
        """Return the variance of the noise that is left in the values smoothed with this cut-off."""
        k = np.arange(1, self.b.size + 1)
        phi = 1.0 / (1.0 + (k / (2.0 * cutoff_hz * self.dt_s * (self.b.size + 1))) ** 6)
        return float(self.noise_std**2 * np.mean(phi**2))

    def smoothed(self, cutoff_hz: float | None = None) -> Smoothed:
        """Return the signal smoothed and its derivative, with the cut-off k_c that the data ask for if none is given.

        Raises:
            EstimationError: a cut-off outside (0, Nyquist frequency].
        """
        from scipy.fft import dct, idst

        nyquist_hz = 0.5 / self.dt_s
        if cutoff_hz is not None and not 0.0 < cutoff_hz <= nyquist_hz:
            raise EstimationError(
                f"0 < cutoff_hz <= Nyquist frequency = {nyquist_hz:g} Hz must hold, got {cutoff_hz:g}"
            )
        cutoff_hz = self.best_cutoff_hz if cutoff_hz is None else cutoff_hz
        n, (first, last), dt_s = self.b.size + 2, self.ends, self.dt_s
        k = np.arange(1, n - 1)
        kept = self.b / (1.0 + (k / (2.0 * cutoff_hz * dt_s * (n - 1))) ** 6)
        values = first + np.arange(n) / (n - 1) * (last - first)
        values[1:-1] += idst(kept, type=1, norm="ortho")
        # d/dt of sqrt(2/(n-1)) b_k sin(k pi i / (n-1)); the unscaled DCT-I counts inner terms twice
        slopes = np.zeros(n)
        slopes[1:-1] = 0.5 * np.sqrt(2.0 / (n - 1)) * kept * k * np.pi / ((n - 1) * dt_s)
        derivative = (last - first) / ((n - 1) * dt_s) + dct(slopes, type=1)
        return Smoothed(values, derivative, self.noise_std, cutoff_hz)


def noise_level(y: FloatArray) -> float:
    """Return the standard deviation of white noise on a smooth signal, from the median of |third differences|.

    Third differences of white noise have the variance 20 s^2; a smooth signal leaves nothing in them, and the median
    ignores the few that a step leaves (P. Hall et al., Biometrika 77, 1990, for difference-based estimates).

    Raises:
        EstimationError: fewer than 16 samples.
    """
    y = _signal(y, LEAST)
    return float(np.median(np.abs(np.diff(y, 3))) / (_MEDIAN_TO_STD * np.sqrt(20.0)))


def white_std(parts: Sequence[FloatArray]) -> float:
    """Return the standard deviation of white noise on smooth signals together, by the mean square of third differences.

    It scatters less than :func:`noise_level`, but steps raise it. 0 where no signal has four samples.
    """
    third = np.concatenate([np.diff(y, 3) for y in parts])
    return float(np.sqrt(np.mean(third**2) / 20.0)) if third.size else 0.0


def bridge(t_s: FloatArray, y: FloatArray, valid: NDArray[np.bool_], name: str) -> FloatArray:
    """Return the samples (n,) with invalid ones interpolated linearly; beyond the ends the nearest valid is held.

    Raises:
        EstimationError: no valid sample.
    """
    if not valid.any():
        raise EstimationError(f"channel '{name}' must hold at least one valid sample, got none; leave it out")
    return np.asarray(np.interp(t_s, t_s[valid], y[valid])) if not valid.all() else np.asarray(y)


def _signal(y: FloatArray, least: int) -> FloatArray:
    y = np.asarray(y, np.float64)
    if y.ndim != 1 or y.size < least or not np.all(np.isfinite(y)):
        raise EstimationError(
            f"smoothing needs a signal of at least {least} finite samples, got shape {y.shape}; give a longer record"
        )
    return y


def _end_values(y: FloatArray) -> tuple[float, float]:
    """Return the values at the ends of cubics fitted to the first and last samples, as many as noise asks for.

    The window is the longest of 5, 7, 10, 14 ... samples whose fit leaves no more than noise would.
    """
    noise = noise_level(y)
    out = []
    for part in (y, y[::-1]):
        value, width = float(part[0]), 5
        while width <= y.size // 2:
            x = np.arange(width) / (width - 1)
            basis = np.vander(x, 4, increasing=True)
            c = np.linalg.lstsq(basis, part[:width], rcond=None)[0]
            rest = part[:width] - basis @ c
            if np.sum(rest**2) > noise**2 * (width - 4 + 2.0 * np.sqrt(2.0 * (width - 4))):
                break
            value = float(c[0])
            width = int(1.4 * width) + 1
        out.append(value)
    return out[0], out[1]


def _choose_corner(b: FloatArray, k: NDArray[np.intp], noise: float) -> float:
    """Return the corner index with the least unbiased risk, among logarithmically spaced ones."""
    corners = np.geomspace(1.0, float(k[-1]), _TRIALS)
    power = b**2
    risk = []
    for corner in corners:
        square = (k / corner) ** 2
        phi = 1.0 / (1.0 + square * square * square)  # a sixth power by pow costs ten times as much
        risk.append(float(np.sum((1.0 - phi) ** 2 * power + 2.0 * noise**2 * phi)))
    return float(corners[int(np.argmin(risk))])
