"""InputSignal: the commands over time, and their exact energy spectrum.

All spectra are those of the held signal: u_k holds from k dt to (k + 1) dt, and the signal is zero before and after.
An input that has not returned to zero by its last sample, such as a step, therefore ends with a jump back to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from testbench.core.channels import CONTROLS
from testbench.core.errors import ChannelError, EstimationError, LimitError, nearest
from testbench.core.record import FloatArray

_BLOCK = 2_000_000  # phases held at once by a spectrum: 16 MB
_PAIRS = 1_000_000  # up to this many pairs of jumps are counted one by one, beyond it by FFT
_SHARE_MAX = 1.0 - 1e-6  # a held signal has energy at all frequencies; its tail falls as 1/w


@dataclass(frozen=True, eq=False)
class InputSignal:
    """Deviations of the controls from trim, sampled and held (zero-order hold) until the next sample.

    Args:
        t_s: (n,) uniform sample times from 0, at least two.
        u: (n, m) deviation from trim; rad for surfaces, 1 for throttle.
        channels: (m,) control channels, all different.

    Raises:
        ChannelError: a channel is not a control.
        LimitError: shapes disagree, times are not uniform from 0, a channel comes twice or a value is not finite.

    Example:
        >>> import testbench as tb
        >>> tb.InputSignal([0.0, 0.01], [[0.0], [0.02]], ("de",)).dt_s
        0.01
    """

    t_s: FloatArray
    u: FloatArray
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in self.channels:
            if name not in CONTROLS:
                raise ChannelError(
                    f"a control must be one of {', '.join(CONTROLS)}, got '{name}'{nearest(name, CONTROLS)}"
                )
        if len(set(self.channels)) != len(self.channels):
            raise LimitError(f"controls of a signal must differ, got {', '.join(self.channels)}; add signals with +")
        object.__setattr__(self, "channels", tuple(self.channels))
        for name in ("t_s", "u"):
            array = np.array(getattr(self, name), float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        t, u = self.t_s, self.u
        if t.ndim != 1 or u.shape != (t.size, len(self.channels)):
            raise LimitError(f"u must have shape (samples, controls) = ({t.size}, {len(self.channels)}), got {u.shape}")
        if t.size < 2:
            raise LimitError(f"a signal must have at least 2 samples, got {t.size}; lengthen it or raise its rate")
        if not np.all(np.isfinite(t)) or not np.all(np.isfinite(u)):
            raise LimitError("times and values of a signal must be finite, got inf or nan")
        if t[1] <= t[0] or not np.allclose(t, np.arange(t.size) * self.dt_s, rtol=0.0, atol=1e-6 * self.dt_s):
            raise LimitError(
                f"times of a signal must be k dt with k = 0, 1, ..., got {t[0]:g}, {t[1]:g} to {t[-1]:g} s "
                f"in {t.size} samples"
            )

    @property
    def dt_s(self) -> float:
        """Sample time, s."""
        return float((self.t_s[-1] - self.t_s[0]) / (self.t_s.size - 1))

    def columns(self, controls: Sequence[str]) -> FloatArray:
        """Return the samples (n, m) of ``controls``, in their order; zero for those that it does not move."""
        out = np.zeros((self.t_s.size, len(controls)))
        for j, name in enumerate(controls):
            if name in self.channels:
                out[:, j] = self.u[:, self.channels.index(name)]
        return out

    def at(self, t_s: ArrayLike, controls: Sequence[str]) -> FloatArray:
        """Return what it commands of ``controls`` at times (k,), (k, m); zero before and after it."""
        rows = np.floor(np.asarray(t_s) / self.dt_s + 1e-6).astype(int) + 1
        return np.pad(self.columns(controls), ((1, 1), (0, 0)))[np.clip(rows, 0, self.t_s.size + 1)]

    def energy_spectrum(self, omega_rad_s: FloatArray) -> FloatArray:
        """Return the energy spectral density |U(w)|^2 of each control at ``omega_rad_s``; (k, m), unit u^2 s^2."""
        return energy_spectrum(self.u, self.dt_s, omega_rad_s)

    def __add__(self, other: InputSignal) -> InputSignal:
        if self.t_s.shape != other.t_s.shape or not np.allclose(self.t_s, other.t_s, rtol=0.0, atol=1e-6 * self.dt_s):
            raise LimitError(
                f"signals that are added must share their sample times, got {self.t_s.size} samples every "
                f"{self.dt_s:g} s and {other.t_s.size} every {other.dt_s:g} s; build both for one duration and rate"
            )
        names = (*self.channels, *(n for n in other.channels if n not in self.channels))
        u = np.zeros((self.t_s.size, len(names)))
        for signal in (self, other):
            for i, name in enumerate(signal.channels):
                u[:, names.index(name)] += signal.u[:, i]
        return InputSignal(self.t_s, u, names)


def energy_spectrum(u: FloatArray, dt_s: float, omega_rad_s: FloatArray) -> FloatArray:
    """Return |U(w)|^2 of sampled-and-held signals, exactly, at any frequencies.

    A held signal is a sum of steps: with jumps J_k = u_k - u_(k-1) at k dt (back to zero at n dt),
    U(w) = sum_k J_k exp(-j w k dt) / (j w), and U(0) is the area. The jumps sum to zero, which is used to write
    J_k (exp(-j w k dt) - 1) so that small w loses no digits.

    Args:
        u: (n,) or (n, m) samples.
        dt_s: sample time, s.
        omega_rad_s: (k,) frequencies, rad/s, of any sign.

    Returns:
        (k, m) energy spectral density, unit of u squared times s^2.
    """
    jumps, rows = _jumps(u)
    omega = np.asarray(omega_rad_s, float)
    times = rows * dt_s
    moving = omega != 0.0
    spectrum = np.empty((omega.size, jumps.shape[1]))
    spectrum[~moving] = (times @ jumps) ** 2  # minus the area, by summation by parts
    block = max(1, _BLOCK // max(1, rows.size))
    where = np.flatnonzero(moving)
    for start in range(0, where.size, block):
        part = where[start : start + block]
        phase = np.outer(omega[part], times)
        # exp(-jx) - 1 = -2 sin^2(x/2) - j sin(x)
        real, imaginary = -2.0 * np.sin(0.5 * phase) ** 2 @ jumps, -np.sin(phase) @ jumps
        spectrum[part] = (real**2 + imaginary**2) / omega[part, None] ** 2
    return spectrum


def held_spectrum(u: FloatArray, dt_s: float, omega_rad_s: FloatArray) -> NDArray[np.complex128]:
    """Return the complex spectrum U(w) (k, m) of sampled-and-held signals at frequencies (k,) other than 0, rad/s.

    See :func:`energy_spectrum`, which loses no digits at small w and leaves the phase out.
    """
    jumps, rows = _jumps(u)
    return np.asarray((np.exp(-1j * np.outer(omega_rad_s, rows * dt_s)) @ jumps) / (1j * omega_rad_s[:, None]))


def total_energy(u: FloatArray, dt_s: float) -> FloatArray:
    """Return the energy, integral of u^2 dt, of each column of a held signal (n,) or (n, m); (m,), unit u^2 s.

    Parseval: it equals the integral of |U(w)|^2 dw over all w, divided by 2 pi.
    """
    return (_columns(u) ** 2).sum(axis=0) * dt_s


def band_share(u: FloatArray, dt_s: float, low_rad_s: float, high_rad_s: float) -> FloatArray:
    """Return the share of the energy of each column of ``u`` that lies between two frequencies; 0 to 1, shape (m,).

    The integral of |U(w)|^2 over the band is taken in closed form (see :func:`_energy_below`), so that a mode's
    narrow half-power band, wn (1 - zeta) to wn (1 + zeta), is as accurate as a wide one. ``high_rad_s`` may be inf.

    Args:
        u: (n,) or (n, m) samples, held.
        dt_s: sample time, s.
        low_rad_s: lower edge of the band, rad/s.
        high_rad_s: upper edge, rad/s.

    Raises:
        LimitError: not 0 <= low < high.
        EstimationError: a column is zero throughout or not finite.
    """
    if not 0.0 <= low_rad_s < high_rad_s:
        raise LimitError(f"0 <= low_rad_s < high_rad_s must hold for a band, got {low_rad_s:g} and {high_rad_s:g}")
    tau, correlation, half = _correlation(u, dt_s)
    band = _energy_below(tau, correlation, high_rad_s) - _energy_below(tau, correlation, low_rad_s)
    return np.maximum(band, 0.0) / half  # a difference of sums may be -1e-17 where the spectrum vanishes


def frequency_below(u: FloatArray, dt_s: float, share: float = 0.95) -> FloatArray:
    """Return the frequency, rad/s, below which ``share`` of the energy of each column of ``u`` lies; shape (m,).

    Args:
        u: (n,) or (n, m) samples, held.
        dt_s: sample time, s.
        share: 0 < share <= 0.999999; may lead beyond the Nyquist frequency, where the steps of the hold have energy.

    Raises:
        LimitError: ``share`` is out of range.
        EstimationError: a column is zero throughout or not finite.
    """
    from scipy.optimize import brentq

    if not 0.0 < share <= _SHARE_MAX:
        raise LimitError(f"0 < share <= {_SHARE_MAX:g} must hold for the share of the energy, got {share:g}")
    tau, correlation, half = _correlation(u, dt_s)
    frequencies = np.empty(half.size)
    for i in range(half.size):
        column = correlation[:, i : i + 1]

        def excess(omega: float, column: FloatArray = column, total: float = float(half[i])) -> float:
            """Return the share of the energy below ``omega``, less ``share``."""
            return float(_energy_below(tau, column, omega)[0]) / total - share

        high = np.pi / dt_s
        while excess(high) < 0.0:  # ends: the share above w falls as 1/w
            high *= 2.0
        frequencies[i] = brentq(excess, 0.0, high, xtol=1e-12, rtol=1e-12)
    return frequencies


def _columns(u: FloatArray) -> FloatArray:
    u = np.asarray(u, float)
    return u[:, None] if u.ndim == 1 else u


def _jumps(u: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the jumps (j, m) of a held signal where any column has one, and their sample numbers (j,), 0 to n.

    A multistep input has a handful of jumps among thousands of samples; nothing else enters its spectrum.
    """
    u = _columns(u)
    zero = np.zeros((1, u.shape[1]))
    jumps = np.diff(u, axis=0, prepend=zero, append=zero)
    rows = np.flatnonzero(np.any(jumps != 0.0, axis=1))
    return jumps[rows], rows


def _correlation(u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return lags tau > 0 (l,) in s, autocorrelation of the jumps (l, m) at them, and pi times the energy (m,).

    Raises:
        EstimationError: the energy of a column is zero or not finite; no share of it exists.
    """
    energy = total_energy(u, dt_s)
    usable = np.isfinite(energy) & (energy > 0.0)
    if not usable.all():
        column = int(np.argmin(usable))
        raise EstimationError(
            f"a share of energy needs a finite signal that moves, got energy {energy[column]:g} in column {column}"
        )
    jumps, rows = _jumps(u)
    rows = rows - rows[0]
    length = int(rows[-1]) + 1
    if rows.size**2 <= _PAIRS:
        first, second = np.triu_indices(rows.size, 1)
        lags, where = np.unique(rows[second] - rows[first], return_inverse=True)
        correlation = np.zeros((lags.size, jumps.shape[1]))
        np.add.at(correlation, where, jumps[first] * jumps[second])
    else:
        dense = np.zeros((length, jumps.shape[1]))
        dense[rows] = jumps
        transform = np.fft.rfft(dense, 2 * length, axis=0)
        correlation = np.fft.irfft(np.abs(transform) ** 2, 2 * length, axis=0)[1:length]
        lags = np.arange(1, length)
    return lags * dt_s, correlation, np.pi * energy


def _energy_below(tau: FloatArray, correlation: FloatArray, omega: float) -> FloatArray:
    """Return the integral of |U(w)|^2 from 0 to ``omega``, in closed form; (m,).

    With jumps J_i at t_i that sum to zero, |U(w)|^2 = -(2 / w^2) sum over i < j of J_i J_j (1 - cos(w tau_ij)), and
    the integral of (1 - cos(w tau)) / w^2 from 0 to W is tau Si(tau W) - (1 - cos(tau W)) / W, with Si the sine
    integral. For W to infinity it becomes tau pi / 2, which gives pi times the energy (Parseval).
    """
    from scipy.special import sici

    if omega == 0.0:
        return np.zeros(correlation.shape[1])
    if np.isinf(omega):
        return -np.pi * tau @ correlation
    kernel = tau * sici(tau * omega)[0] - 2.0 * np.sin(0.5 * tau * omega) ** 2 / omega
    return -2.0 * kernel @ correlation
