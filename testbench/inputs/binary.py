"""Binary signals: pseudo-random sequences of maximal length, and generalised binary noise."""

from __future__ import annotations

import numpy as np

from testbench.core.door import require_room
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import BinaryNoise, Prbs
from testbench.inputs.multistep import sample_intervals

_EDGE = 200  # bytes of a step while the signal is made
_TAPS = {
    2: (2, 1),
    3: (3, 2),
    4: (4, 3),
    5: (5, 3),
    6: (6, 5),
    7: (7, 6),
    8: (8, 6, 5, 4),
    9: (9, 5),
    10: (10, 7),
    11: (11, 9),
    12: (12, 11, 10, 4),
    13: (13, 12, 11, 8),
    14: (14, 13, 12, 2),
    15: (15, 14),
    16: (16, 15, 13, 4),
}
"""Register length -> taps of a shift register of maximal length 2^n - 1 (a test runs every one through its period)."""


def prbs_bits(register: int, seed: int, count: int) -> FloatArray:
    """Return ``count`` bits, +1 or -1, of the maximal-length sequence of a shift register started at ``seed``.

    Over a period of 2^register - 1 bits the autocorrelation is 1 at lag 0 and -1 / (2^register - 1) elsewhere.

    Raises:
        ScenarioError: the seed leaves the register empty.
    """
    state = seed % (1 << register)
    if state == 0:
        raise ScenarioError(f"seed must leave the register of {register} bits not empty, got {seed}")
    out = np.empty(count)
    for i in range(count):
        out[i] = 1.0 if state & 1 else -1.0
        bit = 0
        for tap in _TAPS[register]:
            bit ^= state >> (register - tap)
        state = (state >> 1) | ((bit & 1) << (register - 1))
    return out


def prbs(spec: Prbs, duration_s: float, rate_hz: float) -> FloatArray:
    """Return the sequence, one bit per ``step_s`` for ``prbs_s``; (n,), unit of the amplitude in SI.

    Raises:
        ScenarioError: ``prbs_s`` is shorter than a step, a step is shorter than one sample, or it ends too late.
    """
    count = _steps(spec.prbs_s, spec.step_s, "prbs_s", rate_hz)
    return _clocked(prbs_bits(spec.bits, spec.seed, count), spec, duration_s, rate_hz)


def binary_noise(spec: BinaryNoise, duration_s: float, rate_hz: float) -> FloatArray:
    """Return generalised binary noise for ``gbn_s``; (n,), unit of the amplitude in SI.

    With switching probability s per step, lag k has the correlation (1 - 2 s)^k (H. J. A. F. Tulleken, Automatica
    26(1), 1990).

    Raises:
        ScenarioError: ``gbn_s`` is shorter than a step, a step is shorter than one sample, or it ends too late.
    """
    count = _steps(spec.gbn_s, spec.step_s, "gbn_s", rate_hz)
    change = np.random.default_rng(spec.seed).random(count) < spec.switching
    change[0] = False
    return _clocked(np.where(np.cumsum(change) % 2 == 0, 1.0, -1.0), spec, duration_s, rate_hz)


def _steps(length_s: float, step_s: float, key: str, rate_hz: float) -> int:
    if step_s * rate_hz < 1.0 - 1e-6:
        raise ScenarioError(
            f"a step must last at least one sample ({1.0 / rate_hz:g} s at {rate_hz:g} Hz), got {step_s:g} s"
        )
    size = length_s / step_s
    require_room(f"a sequence of {length_s:g} s ({key}) in steps of {step_s:g} s", _EDGE * size, "shorten it")
    count = int(np.floor(length_s / step_s + 1e-9))
    if count < 1:
        raise ScenarioError(f"{key} >= step_s must hold, got {length_s:g} and {step_s:g} s")
    return count


def _clocked(bits: FloatArray, spec: Prbs | BinaryNoise, duration_s: float, rate_hz: float) -> FloatArray:
    edges = spec.start_s + spec.step_s * np.arange(bits.size + 1)
    levels = spec.amplitude * bits
    return sample_intervals(list(zip(edges[:-1], edges[1:], levels.tolist(), strict=True)), duration_s, rate_hz)
