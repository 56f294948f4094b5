"""The clock of a signal in a log: its usual rate, the longest step that it makes by habit, and its gaps.

Loggers rarely count evenly. They thin a fast topic (steps of 2.5, 2.5 and 5 ms), empty a queue in bursts, write every
twentieth sample late, or drift. Such steps recur and lose nothing. A gap is a step beyond what recurs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray

GAP = 1.75  # a step this many times the longest usual one means that samples were lost; clocks jitter by half a step
_CHUNK = 512  # steps over which the rate is taken to be the same; rates drift, and loggers change them
_OFTEN = 0.1  # a step that makes up this share of all is a habit of the clock
_REGULAR = 0.25  # spread over mean of the distances between long steps; 1 where samples are lost at random
_FEW = 4.0  # usual steps: a longer one that recurs is an outage that recurs, unless it takes
_MOST = 0.5  # of the time, because then the samples come in bursts, unless the bursts are further apart than
_BURST_S = 0.04  # s: short beside the motions of an aircraft
_FINEST = 0.125  # of the median step; two samples closer than this say nothing on the rate


def usual_step(t: FloatArray, lost: NDArray[np.intp] | None = None) -> float:
    """Return the mean step outside gaps, s, of increasing times (n,), n >= 2; ``lost`` is what :func:`gaps` gives."""
    return float(np.mean(np.delete(np.diff(t), gaps(t) if lost is None else lost)))


def shortest_step(t: FloatArray) -> float:
    """Return the step that a tenth of the steps do not exceed, s: signals may hold what fits between such samples."""
    steps = np.diff(t)
    return max(float(np.quantile(steps, 0.1)), _FINEST * float(np.median(steps)))


def gaps(t: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the samples after which samples were lost."""
    return np.flatnonzero(_beyond(np.diff(t)))


def _beyond(steps: FloatArray) -> NDArray[np.bool_]:
    """Say for every step whether it is a gap: longer than 1.75 times the longest usual one around it.

    The longest usual step is that of three neighbouring parts of 512 steps, so that a rate that changes makes no gaps.
    The last part is the last 512 steps.
    """
    full = steps.size // _CHUNK
    rows = steps[: full * _CHUNK].reshape(full, _CHUNK)
    parts = [*rows, steps[-_CHUNK:]] if steps.size % _CHUNK else list(rows)
    usual = np.array([_longest_usual(part) for part in parts])
    around = np.maximum(usual, np.maximum(np.r_[usual[1:], 0.0], np.r_[0.0, usual[:-1]]))
    return np.asarray(steps > GAP * around[np.arange(steps.size) // _CHUNK])


def _longest_usual(steps: FloatArray) -> float:
    """Return the median step, or the longer one that makes up a tenth of the steps or comes at even distances."""
    middle = steps.size // 2
    median = float(np.partition(steps, middle)[middle])
    long = np.flatnonzero(steps > GAP * median)
    if long.size < 3:
        return median
    apart = np.diff(long)
    if long.size < _OFTEN * steps.size and np.std(apart) > _REGULAR * np.mean(apart):
        return median  # lost at random
    usual = float(np.median(steps[long]))
    in_bursts = usual <= _BURST_S and float(np.sum(steps[long])) > _MOST * float(np.sum(steps))
    return usual if usual <= _FEW * median or in_bursts else median
