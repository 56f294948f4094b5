"""Does this input excite each mode? Its energy in the mode's band, and what sensors show above their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.flight.linear_model import EXCITED_DB, REAL, LinearModel, ModalForm, half_power_band
from testbench.inputs.signal import energy_spectrum, held_spectrum, total_energy

__all__ = ["EXCITED_DB", "ModeExcitation", "excitation"]


@dataclass(frozen=True)
class ModeExcitation:
    """How one input excites one mode."""

    mode: str  #: name
    pole: complex  #: rad/s
    #: half-power band of the mode, wn (1 - zeta) to wn (1 + zeta), or the resolution of the record; of a real root s,
    #: up to |s|
    band_rad_s: tuple[float, float]
    input_share: float  #: share of the input's energy inside that band
    snr_db: Mapping[str, float]  #: sensor -> energy of the mode's response in that band over the noise energy there, dB

    @property
    def best_sensor(self) -> str:
        """The sensor that shows the mode best."""
        return max(self.snr_db, key=lambda name: self.snr_db[name])

    @property
    def excited(self) -> bool:
        """True when the best sensor shows the mode at least EXCITED_DB above its noise."""
        return self.snr_db[self.best_sensor] >= EXCITED_DB

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        wn, sensor = abs(self.pole), self.best_sensor
        verdict = "excited" if self.excited else "NOT excited"
        real = abs(self.pole.imag) <= REAL
        where = f"real, {self.pole.real:.2f} 1/s" if real else f"{wn:.2f} rad/s, {wn / (2 * np.pi):.2f} Hz"
        snr = self.snr_db[sensor]
        return (
            f"{self.mode} ({where}) is {verdict}: {100 * self.input_share:.2g} % of the input's energy lies in its "
            f"band, and its response is {abs(snr):.0f} dB {'above' if snr >= 0.0 else 'below'} the noise of {sensor}"
        )


def excitation(
    model: LinearModel,
    modes: Mapping[str, complex],
    inputs: Sequence[str],
    u: FloatArray,
    dt_s: float,
    noise: Mapping[str, tuple[float, float]],
    duration_s: float,
) -> list[ModeExcitation]:
    """Return the excitation of every mode.

    The response of mode i is its term R_i / (jw - s_i) (with its conjugate) of the partial-fraction expansion of the
    linear model, driven by the input's exact spectrum. Signal and noise energy are compared inside the half-power band.

    Args:
        model: longitudinal linear model with the given inputs and sensors as outputs.
        modes: name -> pole.
        inputs: (m,) channels of ``u``.
        u: (n, m) held deviations from trim.
        dt_s: sample time of ``u``.
        noise: sensor channel -> standard deviation of a sample, SI, and sample time, s.
        duration_s: length of the record over which the noise is summed.
    """
    outputs = list(noise)
    modal = ModalForm(model, outputs, inputs)
    std, sensor_dt_s = np.array([*noise.values()]).reshape(-1, 2).T
    out = []
    for name, pole in modes.items():
        low, high = half_power_band(pole, duration_s)
        omega = np.linspace(low, high, 201)
        U = held_spectrum(u, dt_s, omega)  # the phase matters when several inputs act on one mode
        Y = np.einsum("kpm,km->kp", modal.response(pole, omega, duration_s), U)
        signal = np.trapezoid(np.abs(Y) ** 2, omega, axis=0) / np.pi
        floor = std**2 * duration_s * sensor_dt_s * (high - low) / np.pi
        with np.errstate(divide="ignore"):
            snr = 10.0 * np.log10(np.maximum(signal, 1e-300) / np.maximum(floor, 1e-300))
        energy = np.trapezoid(energy_spectrum(u, dt_s, omega), omega, axis=0) / np.pi
        share = float(energy.sum() / total_energy(u, dt_s).sum())
        out.append(ModeExcitation(name, pole, (low, high), share, dict(zip(outputs, snr.tolist(), strict=True))))
    return out
