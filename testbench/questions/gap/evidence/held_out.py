"""How different a flight that was held out is from those used: a good fit to the same excitation warns of nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import MOVED, commands

ALIKE = 0.2  # difference below which a flight warns of little; that of the same command with half of its amplitude
_BAND_HZ = 0.25  # spectra are compared in bands as wide


@dataclass(frozen=True)
class HeldOutFlight:
    """How far a flight that was held out is from the nearest of those used.

    Attributes:
        name: of the flight.
        nearest: the flight used that is most like it.
        difference: 0 for the same controls, amplitudes and spectra at the same dynamic pressure, 1 for nothing shared.
    """

    name: str
    nearest: str
    difference: float

    @property
    def sentence(self) -> str:
        """That in words."""
        found = (
            f"held-out {self.name} differs by {100.0 * self.difference:.0f} % from {self.nearest}, the most similar "
            "flight that was used (control, amplitude and spectrum of the command, dynamic pressure)"
        )
        return f"{found}: so similar a flight is a weak test" if self.difference < ALIKE else found


def differences(
    believed: Believed, used: Mapping[str, FlightRecord], held_out: Mapping[str, FlightRecord]
) -> tuple[HeldOutFlight, ...]:
    """Return how different each flight held out is from those used.

    The likeness of two flights is 2 a'b / (a'a + b'b) of the amplitudes a and b of their commands, by control and band
    of frequency, each control in units of its rms over all flights; times the ratio of their dynamic pressures. It is
    one for equal commands whenever they come, and falls with the shape of the spectrum as with its size.

    Raises:
        RecordError: a record holds no command, or no quiet flight.
    """
    flights = [*used.values(), *held_out.values()]
    spectra = _spectra(flights)
    pressures = [believed.at(r).condition.qbar_Pa for r in flights]
    out = []
    for i, name in enumerate(held_out, len(used)):
        likeness = [
            _likeness(spectra[i], spectra[k]) * min(pressures[i], pressures[k]) / max(pressures[i], pressures[k])
            for k in range(len(used))
        ]
        k = int(np.argmax(likeness))
        out.append(HeldOutFlight(name, list(used)[k], 1.0 - likeness[k]))
    return tuple(out)


def _likeness(a: FloatArray, b: FloatArray) -> float:
    whole = float(np.sum(a * a) + np.sum(b * b))
    return float(2.0 * np.sum(a * b)) / whole if whole > 0.0 else 1.0


def _spectra(flights: list[FlightRecord]) -> list[FloatArray]:
    """Return the amplitudes (controls, bands) of the commands of each flight, each control over its rms in all."""
    given = [commands(r) for r in flights]
    controls = list(dict.fromkeys(n for names, _ in given for n in names))
    dt_s, longest = flights[0].dt_s, max(len(u) for _, u in given)
    wide = max(1, round(_BAND_HZ * longest * dt_s))
    amplitudes = []
    for names, u in given:
        own = np.zeros((len(controls), longest))
        for name, column in zip(names, u.T, strict=True):
            if np.ptp(column) > MOVED:
                own[controls.index(name), : len(column)] = column
        power = np.abs(np.fft.rfft(own, axis=1)) ** 2
        bands = np.add.reduceat(power, np.arange(0, power.shape[1], wide), axis=1)
        amplitudes.append(np.sqrt(bands))
    rms = np.sqrt(np.mean([np.sum(a * a, axis=1) for a in amplitudes], axis=0))
    return [a / np.where(rms > 0.0, rms, 1.0)[:, None] for a in amplitudes]
