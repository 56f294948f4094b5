"""Turn a measured record into deviations from trim: bridge gaps, remove the bias, filter and decimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Preparation

Bias = Literal["trim", "mean", "trend", "none"]


def prepare(
    record: FlightRecord, *, bias: Bias, trim_s: float, lowpass_hz: float | None = None, decimate: int = 1
) -> FlightRecord:
    """Return the record as deviations from trim, ready for an estimator.

    In this order: samples that were not taken are interpolated linearly between their neighbours (the validity mask
    is kept); the bias is subtracted; all channels pass one zero-phase low-pass filter; every ``decimate``-th
    sample is kept.

    Args:
        record: measured record.
        bias: "trim" subtracts the mean of the valid samples in the first ``trim_s`` seconds, "mean" that of the whole
            record, "trend" a straight line fitted by least squares, "none" nothing.
        trim_s: duration of undisturbed flight at the start, s; used by "trim" only.
        lowpass_hz: cut-off of a 4th-order Butterworth filter run forwards and backwards (zero phase; its gain at the
            cut-off is -6 dB), on inputs and outputs alike, so that it cancels from input to output.
        decimate: keep every ``decimate``-th sample. Noise folds down unless ``lowpass_hz`` is below the new Nyquist
            frequency.

    Returns:
        The prepared record; its provenance holds under "prepared" what was done and the bias subtracted (at the first
        sample, for a trend), in SI units.

    Raises:
        EstimationError: fewer than 2 valid samples to take a bias from, a cut-off at or above the Nyquist frequency, a
            record too short to filter, or a decimation below 1.
        RecordError: the record is to be filtered but not uniformly sampled.
    """
    if decimate < 1:
        raise EstimationError(f"decimate >= 1 must hold, got {decimate}")
    data = _interpolate(record)
    level = _bias(record, bias, trim_s)
    data = data - level
    if lowpass_hz is not None:
        data = _lowpass(data, record.dt_s, lowpass_hz)
    done = {
        "bias": bias,
        "trim_s": trim_s,
        "lowpass_hz": lowpass_hz,
        "decimate": decimate,
        "removed": dict(zip(record.channels, level[0].tolist(), strict=True)),
    }
    out = replace(record, data=data, provenance={**record.provenance, "prepared": done})
    return out.decimate(decimate) if decimate > 1 else out


def _interpolate(record: FlightRecord) -> FloatArray:
    """Return the samples (n, m) with those that were not taken interpolated; beyond the ends the nearest is held."""
    data = np.array(record.data)
    for i, name in enumerate(record.channels):
        valid = record.valid[:, i]
        if not valid.any():
            raise EstimationError(f"channel '{name}' must hold at least one valid sample, got none; leave it out")
        if not valid.all():
            data[~valid, i] = np.interp(record.t_s[~valid], record.t_s[valid], data[valid, i])
    return data


def _bias(record: FlightRecord, bias: Bias, trim_s: float) -> FloatArray:
    """Return what is to be subtracted from each sample, shape (n, m)."""
    level = np.zeros(record.data.shape)
    if bias == "none":
        return level
    chosen: NDArray[np.bool_] = np.ones(len(record), bool)
    if bias == "trim":
        chosen = record.t_s < record.t_s[0] + trim_s
    for i, name in enumerate(record.channels):
        rows = chosen & record.valid[:, i]
        if rows.sum() < 2:
            where = f"the first trim_s = {trim_s:g} s" if bias == "trim" else "the record"
            raise EstimationError(
                f"bias '{bias}' needs at least 2 valid samples of channel '{name}' in {where}, got {rows.sum()}; "
                "record more undisturbed flight, or choose bias 'mean' or 'trend'"
            )
        t, y = record.t_s[rows], record.data[rows, i]
        if bias == "trend":
            middle = t.mean()
            slope = np.sum((t - middle) * y) / np.sum((t - middle) ** 2)
            level[:, i] = y.mean() + slope * (record.t_s - middle)
        else:
            level[:, i] = y.mean()
    return level


def _lowpass(data: FloatArray, dt_s: float, cutoff_hz: float) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    nyquist_hz = 0.5 / dt_s
    if not 0.0 < cutoff_hz < nyquist_hz:
        raise EstimationError(
            f"0 < lowpass_hz < Nyquist frequency = {nyquist_hz:g} Hz must hold, got {cutoff_hz:g}; lower or omit it"
        )
    sections = butter(4, cutoff_hz, fs=1.0 / dt_s, output="sos")
    pad = 3 * (2 * len(sections) + 1)  # the samples that sosfiltfilt reflects at either end
    if len(data) <= pad:
        raise EstimationError(
            f"the low-pass filter needs more than {pad} samples, got {len(data)}; give a longer record"
        )
    filtered: FloatArray = sosfiltfilt(sections, data, axis=0, padlen=pad)
    return filtered


def prepared(record: FlightRecord, trim_s: float, asked: Preparation) -> FlightRecord:
    """Return the record prepared as the table ``[preparation]`` of a scenario asks, see :func:`prepare`."""
    return prepare(record, bias=asked.bias, trim_s=trim_s, lowpass_hz=asked.lowpass_hz, decimate=asked.decimate)
