"""Where simulation and measurement disagree: residual energy by manoeuvre, channel, time and frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.record import FloatArray

BANDS_HZ = ((0.0, 0.5), (0.5, 1.5), (1.5, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, 50.0))


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """Residual energy of one manoeuvre in units of the noise energy: 1 everywhere if the model is right.

    Attributes:
        manoeuvre: name.
        channels: (p,) outputs.
        by_band: (bands, p) mean squared residual within each frequency band.
        by_time: (windows, p) mean squared residual within each window of ``window_s``.
        window_s: length of a window, s.
    """

    manoeuvre: str
    channels: tuple[str, ...]
    by_band: FloatArray
    by_time: FloatArray
    window_s: float

    @property
    def sentence(self) -> str:
        """Channel, time and band of the largest residual, in words."""
        window, channel = np.unravel_index(int(np.argmax(self.by_time)), self.by_time.shape)
        band = BANDS_HZ[int(np.argmax(self.by_band[:, channel]))]
        return (
            f"{self.manoeuvre}: largest in {self.channels[int(channel)]}, {window * self.window_s:.0f} to "
            f"{(window + 1) * self.window_s:.0f} s, {band[0]:g} to {band[1]:g} Hz, "
            f"{self.by_time[window, channel]:.3g} times the noise"
        )


def locate(
    name: str, residuals: FloatArray, channels: Sequence[str], dt_s: float, window_s: float = 1.0
) -> ResidualMap:
    """Return where the residuals (n, p), in units of the noise, have their energy."""
    n, p = residuals.shape
    frequency = np.fft.rfftfreq(n, dt_s)
    # Periodogram scaled so that white noise of unit variance gives 1 in every bin.
    power = np.abs(np.fft.rfft(residuals, axis=0)) ** 2 / n
    by_band = np.zeros((len(BANDS_HZ), p))
    for b, (low, high) in enumerate(BANDS_HZ):
        inside = (frequency > low) & (frequency <= high)
        if inside.any():
            by_band[b] = power[inside].mean(axis=0)
    length = max(1, round(window_s / dt_s))
    by_time = np.stack([(residuals[i : i + length] ** 2).mean(axis=0) for i in range(0, n - length + 1, length)])
    return ResidualMap(name, tuple(channels), by_band, by_time, length * dt_s)
