"""Smoothing and differentiation of sampled signals: global Fourier smoothing and local polynomials.

Global Fourier smoothing removes the straight line between the ends, so that the odd extension of the rest is continuous
with its slope and its sine series falls off as k^-3, while noise stays level; a Wiener filter tells the two apart
(E. A. Morelli, "Estimating Noise Characteristics from Flight Test Data Using Optimal Fourier Smoothing", Journal of
Aircraft 32(4), 1995; V. Klein, E. A. Morelli, Aircraft System Identification, ch. 11).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray

_NOISE_BAND = 0.6  # noise is read above this share of the Nyquist frequency
LEAST = 16
"""Samples below which there is no such band to speak of."""
_TRIALS = 200  # cut-offs tried
_MEDIAN_TO_STD = 0.6744897501960817  # median of |x| of a standard normal x


@dataclass(frozen=True, eq=False)
class Smoothed:
    """One smoothed signal.

    Attributes:
        values: (n,) smoothed samples.
        derivative: (n,) their time derivative, per s.
        noise_std: standard deviation of the noise, estimated from the data, in units of the signal.
        cutoff_hz: frequency where the filter weight is one half.
    """

    values: FloatArray
    derivative: FloatArray
    noise_std: float
    cutoff_hz: float


def fourier_smooth(y: FloatArray, dt_s: float, *, cutoff_hz: float | None = None) -> Smoothed:
    """Smooth and differentiate a signal by a sine series and a Wiener filter.

    y(t) = line(t) + sum_k phi_k b_k sin(k pi t / T), phi_k = 1 / (1 + (k / k_c)^6): the Wiener filter of a signal
    whose |b_k| falls as k^-3 and equals the noise at k_c. The line joins the end values of cubics fitted to either end,
    because single samples at the ends would bring their noise into the whole record. k_c minimises Stein's unbiased
    estimate of the mean square error of the values, sum (1 - phi)^2 b^2 + 2 sigma^2 phi, with sigma^2 the mean square
    of b_k above 60 % of the Nyquist frequency.

    Noise that was filtered before it was logged is not level up there: then sigma is too small and little is
    smoothed; give ``cutoff_hz``. Sharp corners (steps of a control) are rounded; do not smooth controls.

    Args:
        y: (n,) samples, n >= 16.
        dt_s: sample time, s.
        cutoff_hz: k_c as a frequency; chosen from the data if not given.

    Raises:
        EstimationError: fewer than 16 samples, or a cut-off outside (0, Nyquist frequency].
    """
    return SineSeries.of(y, dt_s).smoothed(cutoff_hz)


@dataclass(frozen=True, eq=False)
class SineSeries:
    """A signal as the line between its ends and a sine series, to be smoothed with one cut-off or several.

    Attributes:
        ends: values of the line at the first and last sample.
        b: (n - 2,) coefficients of the orthonormal sine series.
        noise_std: standard deviation of the noise, estimated from the data, in units of the signal.
        dt_s: sample time, s.
    """

    ends: tuple[float, float]
    b: FloatArray
    noise_std: float
    dt_s: float

    @classmethod
    def of(cls, y: FloatArray, dt_s: float) -> SineSeries:
        """Return the series of samples (n,), n >= 16; raises as :func:`fourier_smooth`."""
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
        """The cut-off that the data ask for, at most the Nyquist frequency."""
        k = np.arange(1, self.b.size + 1)
        return _choose_corner(self.b, k, self.noise_std) / (2.0 * self.dt_s * (self.b.size + 1))

    def noise_left(self, cutoff_hz: float) -> float:
        """Return the variance of the noise that is left in the values smoothed with this cut-off."""
        k = np.arange(1, self.b.size + 1)
        phi = 1.0 / (1.0 + (k / (2.0 * cutoff_hz * self.dt_s * (self.b.size + 1))) ** 6)
        return float(self.noise_std**2 * np.mean(phi**2))

    def smoothed(self, cutoff_hz: float | None = None) -> Smoothed:
        """Return the signal smoothed and its derivative; see :func:`fourier_smooth`."""
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


def local_polynomial(
    y: FloatArray, dt_s: float, *, half_width: int = 2, degree: int = 2, derivative: int = 1
) -> FloatArray:
    """Return the ``derivative``-th derivative (n,) of the polynomial fitted by least squares around every sample.

    Windows of 2 half_width + 1 samples; the first and last half_width samples take the first and last whole window.
    With white noise of standard deviation s and degree 1 or 2, the first derivative of the middle sample has the
    standard deviation s sqrt(3 / (w (w + 1) (2 w + 1))) / dt, w the half width (A. Savitzky, M. J. E. Golay,
    Analytical Chemistry 36, 1964).

    Raises:
        EstimationError: degree < derivative, a window not longer than the degree, or a record shorter than a window.
    """
    width = 2 * half_width + 1
    if not 0 <= derivative <= degree < width:
        raise EstimationError(
            f"0 <= derivative <= degree < 2 half_width + 1 must hold, got derivative = {derivative}, "
            f"degree = {degree}, half_width = {half_width}"
        )
    y = _signal(y, width)
    x = np.arange(-half_width, half_width + 1) / max(half_width, 1)
    fit = np.linalg.pinv(np.vander(x, degree + 1, increasing=True))  # samples -> coefficients
    order = np.arange(derivative, degree + 1)
    factor = np.array([np.prod(np.arange(i - derivative + 1, i + 1)) for i in order], dtype=float)
    powers = x[:, None] ** (order - derivative) * factor  # (width, coefficients): derivative at every sample
    weights = powers @ fit[derivative:]
    scale = (max(half_width, 1) * dt_s) ** derivative
    out = np.empty(y.size)
    out[half_width : y.size - half_width] = np.correlate(y, weights[half_width], "valid")
    out[:half_width] = weights[:half_width] @ y[:width]
    out[y.size - half_width :] = weights[half_width + 1 :] @ y[-width:]
    return out / scale


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


def smooth_record(record: FlightRecord, channels: tuple[str, ...], *, cutoff_hz: float | None = None) -> FlightRecord:
    """Return the record with ``channels`` smoothed by :func:`fourier_smooth`, gaps bridged and still marked.

    The provenance holds under "smoothed" the cut-off in Hz and the noise of each channel.

    Raises:
        EstimationError: a channel without valid samples, or against the laws of :func:`fourier_smooth`.
        ChannelError: the record lacks a channel.
        RecordError: the record is not uniformly sampled.
    """
    columns, done = {}, {}
    for name in channels:
        valid = record.valid[:, record.channels.index(name)] if name in record else np.ones(len(record), bool)
        out = fourier_smooth(bridge(record.t_s, record[name], valid, name), record.dt_s, cutoff_hz=cutoff_hz)
        columns[name] = out.values
        done[name] = {"cutoff_hz": out.cutoff_hz, "noise_std": out.noise_std}
    smooth = record.with_columns(columns)
    return replace(smooth, provenance={**record.provenance, "smoothed": done})


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
