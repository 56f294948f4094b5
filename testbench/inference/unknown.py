"""The unknown motion: forces and moments that no hypothesis describes, as pulses of random size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.linear_model import LinearModel

PULSE_S = 0.5
"""Length of a pulse: about half of a short period, so that slower forces are sums of pulses, and noise is none."""
_FORCED = ("u", "V", "w", "alpha", "v", "beta", "p", "q", "r")
_READ_AT_ONCE = {"u": "ax", "V": "ax", "w": "az", "alpha": "az", "v": "ay", "beta": "ay"}
"""State -> the accelerometer that reads its derivative at once."""
_SEEN_AS = {"u": "V", "w": "alpha", "v": "beta"}
_SMOOTHED = 9  # samples that derivatives of the measured motion are smoothed over


def pulses(linear: LinearModel, channels: Sequence[str], V_m_s: float, record: FlightRecord) -> FloatArray:
    """Return what pulses of acceleration in each state of motion do to the channels of a record.

    Each pulse is one of the record's consecutive stretches of 0.5 s, and as large as the acceleration in that state is
    on the whole (rms) in the motion that was measured: a pulse of size kappa is a share kappa of the motion.

    Args:
        linear: the believed aircraft about trim; its states of motion are forced, whatever else it holds follows.
        channels: (p,) that are compared; those that the model does not give are not moved.
        V_m_s: airspeed at trim, which turns velocities into flow angles.
        record: measured; gives times and the size of the motion.

    Returns:
        (n, p, m) in SI: m = states that are forced times stretches.

    Raises:
        EstimationError: the model has no state of motion.

    Example:
        >>> import testbench as tb
        >>> tb.pulses(linear, ("q", "alpha"), 13.0, record).shape  # doctest: +SKIP
    """
    states = [s for s in _FORCED if s in linear.states]
    if not states:
        raise EstimationError(f"a model must have a state of motion, {', '.join(_FORCED)}, got {linear.states}")
    n, dt = len(record), record.dt_s
    width = max(1, round(PULSE_S / dt))
    outputs = list(linear.outputs)
    rows = [outputs.index(c) if c in outputs else None for c in channels]
    size = len(linear.states)
    out = np.zeros((n, len(channels), len(states) * -(-n // width)))
    at = 0
    for state in states:
        i = linear.states.index(state)
        M = np.zeros((size + 1, size + 1))
        M[:size, :size], M[i, size] = linear.A, 1.0
        step = expm(M * dt)
        x, response = np.zeros(size), np.zeros((n, len(channels)))
        for t in range(n):
            y = linear.C @ x
            response[t] = [0.0 if row is None else y[row] for row in rows]
            if t < width and (read := _READ_AT_ONCE.get(state)) in channels:
                response[t, list(channels).index(str(read))] += V_m_s if state in ("alpha", "beta") else 1.0
            x = step[:size, :size] @ x + (step[:size, size] if t < width else 0.0)
        response *= _acceleration(state, V_m_s, record)
        for begin in range(0, n, width):
            out[begin:, :, at] = response[: n - begin]
            at += 1
    return out


def _acceleration(state: str, V_m_s: float, record: FlightRecord) -> float:
    """Return the rms of a state's derivative in the measured motion, SI; 0.1 if the state is not measured."""
    seen = _SEEN_AS.get(state, state)
    if seen not in record or len(record) <= 2 * _SMOOTHED:
        return 0.1
    smooth = np.convolve(record[seen], np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    rms = float(np.nanstd(np.gradient(smooth, record.dt_s)))
    return rms * (V_m_s if state in ("w", "v") else 1.0)
