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
PATH_S = 0.1  #: between the knots of an unknown deflection: about the time constant of a servo
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
        (n, p, m) in SI; m counts states that are forced times stretches, and surfaces times knots.

    Raises:
        EstimationError: the model has no state of motion.

    Example:
        >>> import testbench as tb
        >>> tb.pulses(linear, ("q", "alpha"), 13.0, record).shape  # doctest: +SKIP
    """
    states = forced_states(linear)
    n, dt = len(record), record.dt_s
    width = max(1, round(PULSE_S / dt))
    out = []
    for state in states:
        push, direct = np.zeros(len(linear.states)), np.zeros(len(channels))
        push[linear.states.index(state)] = 1.0
        if (read := _READ_AT_ONCE.get(state)) in channels:
            direct[list(channels).index(str(read))] = V_m_s if state in ("alpha", "beta") else 1.0
        pulse = np.where(np.arange(n) < width, rms_acceleration(state, V_m_s, record), 0.0)
        out += _shifted(forced(linear, channels, push, direct, pulse[:, None], dt)[:, :, 0], width)
    for surface in (c for c in channels if c in linear.inputs):
        out += deflections(linear, channels, surface, float(np.nanstd(record[surface])), n, dt)
    return np.stack(out, axis=2)


def deflections(
    linear: LinearModel, channels: Sequence[str], control: str, size: float, n: int, dt_s: float
) -> list[FloatArray]:
    """Return what deflections of an input of the model do to ``n`` samples of the channels, (n, p) each.

    Each is ``size`` at one of the knots, 0.1 s apart, and straight lines to zero at those beside it.
    """
    k, outputs = linear.inputs.index(control), list(linear.outputs)
    knot = max(1, round(PATH_S / dt_s))
    hat = np.concatenate([np.arange(knot), np.arange(knot, 0, -1)]) / knot
    direct = np.array([linear.D[outputs.index(c), k] if c in outputs else 0.0 for c in channels])
    pulse = size * np.pad(hat, (0, n))[:n]
    return _shifted(forced(linear, channels, linear.B[:, k], direct, pulse[:, None], dt_s)[:, :, 0], knot)


def forced_states(linear: LinearModel) -> list[str]:
    """Return the states of motion that pulses of acceleration force."""
    states = [s for s in _FORCED if s in linear.states]
    if not states:
        raise EstimationError(f"a model must have a state of motion, {', '.join(_FORCED)}, got {linear.states}")
    return states


def forced(
    linear: LinearModel, channels: Sequence[str], push: FloatArray, direct: FloatArray, inputs: FloatArray, dt_s: float
) -> FloatArray:
    """Return what inputs (n, h), held from sample to sample, do to the channels from rest, (n, p, h).

    An input moves the states by ``push`` (states,) and the channels (p,) at once by ``direct`` (p,); channels that the
    model does not give are moved at once alone.
    """
    size = len(push)
    M = np.zeros((size + 1, size + 1))
    M[:size, :size], M[:size, size] = linear.A, push
    step = expm(M * dt_s)
    A, b = step[:size, :size], step[:size, size, None]
    x = np.zeros((len(inputs), size, inputs.shape[1]))
    for t in range(len(inputs) - 1):
        x[t + 1] = A @ x[t] + b * inputs[t]
    C = np.zeros((len(channels), size))
    for i, c in enumerate(channels):
        if c in linear.outputs:
            C[i] = linear.C[list(linear.outputs).index(c)]
    return np.asarray(C @ x + direct[:, None] * inputs[:, None, :])


def _shifted(response: FloatArray, by: int) -> list[FloatArray]:
    """Return a response (n, p) as it begins at every ``by``-th sample."""
    n = len(response)
    return [np.concatenate([np.zeros_like(response[:begin]), response[: n - begin]]) for begin in range(0, n, by)]


def rms_acceleration(state: str, V_m_s: float, record: FlightRecord) -> float:
    """Return the rms of a state's derivative in the measured motion, SI; 0.1 if the state is not measured."""
    seen = _SEEN_AS.get(state, state)
    if seen not in record or len(record) <= 2 * _SMOOTHED:
        return 0.1
    smooth = np.convolve(record[seen], np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    rms = float(np.nanstd(np.gradient(smooth, record.dt_s)))
    return rms * (V_m_s if state in ("w", "v") else 1.0)
