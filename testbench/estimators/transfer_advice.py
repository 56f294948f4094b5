"""Warnings about poles of transfer functions that the input, the sampling or the noise put where they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.advice import Advice, doubt
from testbench.core.record import FlightRecord, FloatArray

NEAR_PEAK = 0.3  # a pole within this share of the input's spectral peak may be the input's
PART_OF_NYQUIST = 0.5  # a pole above this share of the Nyquist frequency is hardly sampled
TAIL = 0.005  # share of the input's energy below and above the band that is called excited
VAGUE = 0.1  # a frequency known to 10 % or better is the data's, wherever the input peaks


def spectral_density(records: Sequence[FlightRecord], given: str) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (k,) in rad/s and the input's energy density there, means removed, all records summed."""
    size = 8 * max(len(r) for r in records)
    density = np.sum([np.abs(np.fft.rfft(r[given] - r[given].mean(), size)) ** 2 for r in records], axis=0)
    return np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, records[0].dt_s), np.float64), np.asarray(density, np.float64)


def spectral_peak(records: Sequence[FlightRecord], given: str) -> float:
    """Return where, in rad/s, the input's energy density is largest."""
    omega, density = spectral_density(records, given)
    return float(omega[int(np.argmax(density))])


def excited_band(records: Sequence[FlightRecord], inputs: Sequence[str]) -> tuple[float, float]:
    """Return the band (low, high) in rad/s outside of which no input has more than 0.5 % of its energy on either side.

    The lowest of the inputs' low ends and the highest of their high ends.
    """
    ends = []
    for given in inputs:
        omega, density = spectral_density(records, given)
        share = np.cumsum(density) / np.sum(density)
        ends.append((omega[np.searchsorted(share, TAIL)], omega[np.searchsorted(share, 1.0 - TAIL)]))
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))


def question_poles(
    output: str,
    omega_rad_s: FloatArray,
    known: FloatArray,
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
) -> list[Advice]:
    """Return a sentence for each reason to doubt that the data put the poles of ``output`` where they are.

    Args:
        output: name of the output.
        omega_rad_s: (k,) magnitudes of its poles.
        known: (k,) relative standard errors of these; infinite where the method gives none that can be trusted.
        records: what was identified from.
        inputs: (m,) input channels.
    """
    out = []
    nyquist = np.pi / records[0].dt_s
    for given in inputs:
        peak = spectral_peak(records, given)
        near = omega_rad_s[(np.abs(omega_rad_s - peak) <= NEAR_PEAK * peak) & (known > VAGUE)]
        if near.size:
            out.append(
                doubt(
                    "poles_at_input_peak",
                    f"{output}: poles at {_list(near)} rad/s lie within {100 * NEAR_PEAK:.0f} % "
                    f"of the peak of the spectrum of {given} ({peak:.2f} rad/s): the data, not the input, should "
                    "decide where they lie; check with an input of another spectrum",
                )
            )
    fast = omega_rad_s > PART_OF_NYQUIST * nyquist
    if fast.any():
        out.append(
            doubt(
                "beyond_nyquist",
                f"{output}: poles at {_list(omega_rad_s[fast])} rad/s lie above half the Nyquist frequency "
                f"({nyquist:.2f} rad/s): such poles come from noise and from holding the input; log faster or use "
                "fewer poles",
            )
        )
    low, high = excited_band(records, inputs)
    outside = ((omega_rad_s < low) | (omega_rad_s > high)) & ~fast
    if outside.any():
        out.append(
            doubt(
                "outside_band",
                f"{output}: poles at {_list(omega_rad_s[outside])} rad/s lie outside the band {low:.2f} to {high:.2f} "
                "rad/s that holds 99 % of the input's energy: they follow from the structure and the noise more than "
                "from the data; excite that band or use fewer poles",
            )
        )
    return out


def _list(omega: FloatArray) -> str:
    return ", ".join(f"{w:.2f}" for w in omega)
