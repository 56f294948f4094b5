"""The unknown motion: forces, moments and deflections that no hypothesis describes, as pulses of random size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.linear_model import LinearModel

PULSE_S = 0.5
"""Length of a pulse: about half of a short period, so that slower forces are sums of pulses, and noise is none."""
PATH_S = 0.1
"""Between the knots of an unknown deflection: about the time constant of a servo."""
_FORCED = ("u", "V", "w", "alpha", "v", "beta", "p", "q", "r")
_READ_AT_ONCE = {"u": "ax", "V": "ax", "w": "az", "alpha": "az", "v": "ay", "beta": "ay"}
"""State -> the accelerometer that reads its derivative at once."""
_SEEN_AS = {"u": "V", "w": "alpha", "v": "beta"}
_SMOOTHED = 9  # samples that derivatives of the measured motion are smoothed over


def pulses(linear: LinearModel, channels: Sequence[str], V_m_s: float, record: FlightRecord) -> FloatArray:
    """Return what pulses of acceleration, and of deflection of surfaces that are compared, do to the channels.

    Each pulse of acceleration in a state is one of the record's consecutive stretches of 0.5 s, and as large as the
    acceleration in that state is on the whole (rms) in the motion that was measured: a pulse of size kappa is a share
    kappa of the motion. Where a surface is among the channels, what its command does not explain moves surface and
    aircraft: straight lines between knots 0.1 s apart, as large as its deflection is on the whole.

    Args:
        linear: the believed aircraft about trim; its states of motion are forced, whatever else it holds follows.
        channels: (p,) that are compared; those that the model does not give are not moved, inputs of it are surfaces.
        V_m_s: airspeed at trim, which turns velocities into flow angles.
        record: measured; gives times and the size of the motion.

    Returns:
        (n, p, m) in SI: m = states that are forced times stretches, and surfaces times knots.

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
    width, knot = (max(1, round(t / dt)) for t in (PULSE_S, PATH_S))
    rows = [list(linear.outputs).index(c) if c in linear.outputs else None for c in channels]
    out = []
    for state in states:
        push, direct = np.zeros(len(linear.states)), np.zeros(len(channels))
        push[linear.states.index(state)] = 1.0
        if (read := _READ_AT_ONCE.get(state)) in channels:
            direct[list(channels).index(str(read))] = V_m_s if state in ("alpha", "beta") else 1.0
        size = _acceleration(state, V_m_s, record)
        out += _shifted(size * _response(linear, push, direct, rows, np.ones(width), n, dt), width)
    hat = np.concatenate([np.arange(knot), np.arange(knot, 0, -1)]) / knot
    for surface in (c for c in channels if c in linear.inputs):
        k = linear.inputs.index(surface)
        direct = np.array([0.0 if row is None else linear.D[row, k] for row in rows])
        size = float(np.nanstd(record[surface]))
        out += _shifted(size * _response(linear, linear.B[:, k], direct, rows, hat, n, dt), knot)
    return np.stack(out, axis=2)


def _response(
    linear: LinearModel,
    push: FloatArray,
    direct: FloatArray,
    rows: Sequence[int | None],
    pulse: FloatArray,
    n: int,
    dt: float,
) -> FloatArray:
    """Return what a pulse (k,) of an input, held from sample to sample, does to the channels (n, p).

    The input moves the states by ``push`` (states,) and the channels at once by ``direct`` (p,); ``rows`` are the
    outputs that the channels are.
    """
    size = len(push)
    M = np.zeros((size + 1, size + 1))
    M[:size, :size], M[:size, size] = linear.A, push
    step = expm(M * dt)
    u = np.zeros(n)
    u[: len(pulse)] = pulse[:n]
    x, response = np.zeros(size), np.zeros((n, len(rows)))
    for t in range(n):
        y = linear.C @ x
        response[t] = [0.0 if row is None else y[row] for row in rows]
        x = step[:size, :size] @ x + step[:size, size] * u[t]
    return response + u[:, None] * direct


def _shifted(response: FloatArray, by: int) -> list[FloatArray]:
    """Return a response (n, p) as it begins at every ``by``-th sample."""
    n = len(response)
    return [np.concatenate([np.zeros_like(response[:begin]), response[: n - begin]]) for begin in range(0, n, by)]


def _acceleration(state: str, V_m_s: float, record: FlightRecord) -> float:
    """Return the rms of a state's derivative in the measured motion, SI; 0.1 if the state is not measured."""
    seen = _SEEN_AS.get(state, state)
    if seen not in record or len(record) <= 2 * _SMOOTHED:
        return 0.1
    smooth = np.convolve(record[seen], np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    rms = float(np.nanstd(np.gradient(smooth, record.dt_s)))
    return rms * (V_m_s if state in ("w", "v") else 1.0)
