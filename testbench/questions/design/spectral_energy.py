"""Spectral energy of an input: the share that reaches each mode, and what each sensor shows of it.

Mode i receives the share of the energy of an input U(w) that lies inside the mode's half-power band. What a sensor sees
of mode i is the term R_i / (jw - s_i), with its conjugate, of the partial-fraction expansion of the linear model. The
energy of that term in the band over the energy of the sensor's noise there is the signal-to-noise ratio of the mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.flight.linear_model import EXCITED_DB, LinearModel, ModalForm, half_power_band
from testbench.inputs.signal import frequency_below, total_energy

_POINTS = 33  # frequencies per band


@dataclass(frozen=True, eq=False)
class SpectralEnergy:
    """What one input does to each mode.

    Attributes:
        modes, sensors: names.
        share: (modes,) share of the input's energy in each half-power band.
        snr_db: (modes, sensors) energy of the mode's response over that of the noise, in its band.
        below_95: (m,) per control the frequency below which 95 % of its energy lies, rad/s; NaN for one at rest.
    """

    modes: tuple[str, ...]
    sensors: tuple[str, ...]
    share: FloatArray
    snr_db: FloatArray
    below_95: FloatArray

    def seen(self, mode: str) -> tuple[str, float]:
        """Return the sensor that shows a mode best, and its signal-to-noise ratio in dB."""
        row = self.snr_db[self.modes.index(mode)]
        return self.sensors[int(np.argmax(row))], float(row.max())

    def excited(self, mode: str) -> bool:
        """Return whether some sensor shows the mode at least EXCITED_DB above its noise."""
        return self.seen(mode)[1] >= EXCITED_DB


@dataclass(frozen=True, eq=False)
class ModeBands:
    """The modes of an aircraft seen by sensors, ready for many inputs of one length and rate.

    Args:
        model: linear model whose states span the modes.
        modes: name -> pole, rad/s.
        inputs: (m,) channels of the input among the model's.
        noise: sensor channel -> standard deviation of one sample, and its sample time in s.
        dt_s: sample time of the input, s.
        samples: number of them.
    """

    model: LinearModel
    modes: Mapping[str, complex]
    inputs: Sequence[str]
    noise: Mapping[str, tuple[float, float]]
    dt_s: float
    samples: int
    bands: tuple[tuple[float, float], ...] = field(init=False)
    _omega: FloatArray = field(init=False, repr=False)  # (modes, points)
    _phase: NDArray[np.complex128] = field(init=False, repr=False)  # (modes points, samples + 1)
    _H: NDArray[np.complex128] = field(init=False, repr=False)  # (modes, points, sensors, m)
    _floor: FloatArray = field(init=False, repr=False)  # (modes, sensors)

    def __post_init__(self) -> None:
        modal = ModalForm(self.model, tuple(self.noise), self.inputs)
        T = self.samples * self.dt_s
        bands, omegas, responses, floors = [], [], [], []
        for pole in self.modes.values():
            low, high = half_power_band(pole, T)
            omega = np.linspace(low, high, _POINTS)
            bands.append((low, high))
            omegas.append(omega)
            responses.append(modal.response(pole, omega, T))
            floors.append([std**2 * T * dt * (high - low) / np.pi for std, dt in self.noise.values()])
        omega = np.stack(omegas)
        phase = np.exp(-1j * np.outer(omega.ravel(), self.dt_s * np.arange(self.samples + 1)))
        for name, value in (
            ("bands", tuple(bands)),
            ("_omega", omega),
            ("_phase", phase / (1j * omega.ravel()[:, None])),
            ("_H", np.stack(responses)),
            ("_floor", np.array(floors)),
        ):
            object.__setattr__(self, name, value)

    def _in_bands(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return energies in each band: of the input (modes,) and of each mode at each sensor (modes, sensors)."""
        zero = np.zeros((1, u.shape[1]))
        jumps = np.diff(u, axis=0, prepend=zero, append=zero)
        at = np.flatnonzero(np.any(jumps != 0.0, axis=1))
        phase = self._phase if 2 * at.size > len(jumps) else self._phase[:, at]
        moved = jumps if 2 * at.size > len(jumps) else jumps[at]
        U = (phase @ moved).reshape(*self._omega.shape, -1)
        Y = np.einsum("kfsm,kfm->kfs", self._H, U)
        given = np.trapezoid(np.sum(np.abs(U) ** 2, axis=2), self._omega, axis=1) / np.pi
        seen = np.trapezoid(np.abs(Y) ** 2, self._omega[:, :, None], axis=1) / np.pi
        return given, seen

    def snr_db(self, u: FloatArray) -> FloatArray:
        """Return the signal-to-noise ratio (modes, sensors) of an input (samples, m), dB."""
        _, seen = self._in_bands(u)
        return np.asarray(10.0 * np.log10(np.maximum(seen, 1e-300) / self._floor))

    def analyse(self, u: FloatArray) -> SpectralEnergy:
        """Return the spectral energy of one input (samples, m), deviation from trim, held."""
        given, seen = self._in_bands(u)
        energy = total_energy(u, self.dt_s)
        below = np.full(u.shape[1], np.nan)
        moving = energy > 0.0
        if moving.any():
            below[moving] = frequency_below(u[:, moving], self.dt_s)
        return SpectralEnergy(
            tuple(self.modes),
            tuple(self.noise),
            given / max(float(energy.sum()), 1e-300),
            10.0 * np.log10(np.maximum(seen, 1e-300) / self._floor),
            below,
        )


def spectral_energy(
    model: LinearModel,
    modes: Mapping[str, complex],
    inputs: Sequence[str],
    u: FloatArray,
    dt_s: float,
    noise: Mapping[str, tuple[float, float]],
) -> SpectralEnergy:
    """Return the spectral energy of any input, designed or recorded; see :class:`ModeBands`."""
    return ModeBands(model, modes, inputs, noise, dt_s, len(u)).analyse(u)
