"""Steps as a pilot flies them: ramps for edges, scattered timing, and none shorter than can be held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Pilot

_ROOM = 0.4  # share of the shorter neighbouring step by which an edge may move at most, so that none changes places


def by_hand(pilot: Pilot, intervals: Sequence[tuple[float, float, float]], count: int, rate_hz: float) -> FloatArray:
    """Return the samples (count,) of a stepped signal flown by hand.

    Every edge is a ramp of ``rise_s`` that begins at its time. All edges but the first are early or late by a normal
    deviate of ``jitter_s``, cut off at 0.4 of the shorter step beside them.

    Args:
        pilot: the pilot.
        intervals: (begin_s, end_s, level) in order of time; the signal is zero elsewhere.
        count: number of samples.
        rate_hz: their rate, Hz.

    Raises:
        ScenarioError: a step is shorter than the pilot's shortest, or shorter than its rise takes.
    """
    least = max(pilot.shortest_s, pilot.rise_s)
    short = [(begin, end) for begin, end, _ in intervals if end - begin < least * (1.0 - 1e-9)]
    if short:
        raise ScenarioError(
            [
                f"a pilot's step must last at least {least:g} s (pilot.shortest_s, pilot.rise_s), got "
                f"{end - begin:g} s from t = {begin:g} s; lengthen it, or let an autopilot fly it"
                for begin, end in short
            ]
        )
    edges, levels = [intervals[0][0]], [intervals[0][2]]
    for (_, before, _), (begin, _, level) in pairwise(intervals):
        if begin > before + 0.5 / rate_hz:  # a pause at zero
            edges.append(before)
            levels.append(0.0)
        edges.append(begin)
        levels.append(level)
    edges.append(intervals[-1][1])
    levels.append(0.0)
    exact = np.array(edges)
    length = np.diff(exact)
    room = _ROOM * np.minimum(length, np.append(length[1:], length[-1]))
    scatter = pilot.jitter_s * np.random.default_rng(pilot.seed).standard_normal(length.size)
    times = exact + np.concatenate([[0.0], np.clip(scatter, -room, room)])
    t = np.arange(count) / rate_hz
    u = np.zeros(count)
    for time, jump in zip(times, np.diff(levels, prepend=0.0), strict=True):
        late = t - time + 1e-9 / rate_hz
        u += jump * (np.clip(late / pilot.rise_s, 0.0, 1.0) if pilot.rise_s > 0.0 else (late >= 0.0))
    return u
