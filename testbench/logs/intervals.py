"""Signals of several clocks over common intervals."""

from __future__ import annotations

import numpy as np

from testbench.core.record import FloatArray
from testbench.logs.question import Signals


def times_of_all(signals: Signals, names: tuple[str, ...], step_s: float) -> FloatArray | None:
    """Return times ``step_s`` apart that all ``names`` cover; None if one is missing or they share too short a time."""
    if not set(names) <= set(signals):
        return None
    used = [signals[name][0] for name in (*names, "phi") if name in signals]
    start, end = max(float(t[0]) for t in used), min(float(t[-1]) for t in used)
    return np.arange(start, end, step_s) if end - start > 11.0 * step_s else None


def means(signal: tuple[FloatArray, FloatArray], start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the means of a signal over intervals."""
    t, x = signal
    integral = np.r_[0.0, np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))]
    return np.asarray((np.interp(end, t, integral) - np.interp(start, t, integral)) / (end - start))


def about(signal: tuple[FloatArray, FloatArray], at: FloatArray, half_s: float) -> FloatArray:
    """Return the means of a signal over a short time about each of ``at``, against its noise."""
    return means(signal, np.maximum(at - half_s, at[0]), np.minimum(at + half_s, at[-1]))
