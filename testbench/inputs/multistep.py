"""Inputs made of steps: step, pulse, doublets, 3-2-1-1 and any pattern of signed steps.

Every signal is a list of intervals (begin, end, level) in exact time. An edge that does not fall on a sample moves to
the nearest one (halfway: to the later one), each edge from its own exact time, so that the errors do not add up. The
signal that is flown, and whose spectrum is computed, is the rounded one.

Steps as a pilot flies them: ramps for edges, scattered timing, and none shorter than can be held.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Doublet, Multistep, Pilot, Pulse, StandardMultistep, Step

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


_TIE = 1e-9  # samples; edges computed to lie halfway round alike in spite of the last digit
_FAR = 1e15  # samples; a time beyond it lies after every manoeuvre, and is no whole number of floats
PATTERNS = {"3211": (3.0, -2.0, 1.0, -1.0), "211": (2.0, -1.0, 1.0), "123": (1.0, -2.0, 3.0)}
"""The standard multisteps in units of their step; the sign is the direction."""


def sample_count(duration_s: float, rate_hz: float) -> int:
    """Return the number of samples of a signal that lasts ``duration_s``, to the nearest sample."""
    return _sample(duration_s, rate_hz)


def step(spec: Step, duration_s: float, rate_hz: float) -> FloatArray:
    """Return a step from ``start_s`` to the end of the manoeuvre; (n,), unit of the amplitude in SI.

    Raises:
        ScenarioError: less than one sample of the manoeuvre is left at ``start_s``.
    """
    if (duration_s - spec.start_s) * rate_hz < 1.0 - 1e-6:
        raise ScenarioError(
            f"start_s <= {duration_s - 1.0 / rate_hz:g} s, one sample before the end of its manoeuvre, must hold "
            f"for a step, got {spec.start_s:g} s; start it earlier or raise duration_s"
        )
    return _flown(spec, [(spec.start_s, duration_s, spec.amplitude)], duration_s, rate_hz)


def pulse(spec: Pulse, duration_s: float, rate_hz: float) -> FloatArray:
    """Return a rectangle of ``width_s``; (n,). Its spectrum is |U|^2 = (2 A sin(w W / 2) / w)^2.

    Raises:
        ScenarioError: the pulse is shorter than one sample or ends after the manoeuvre.
    """
    return _flown(spec, [(spec.start_s, spec.start_s + spec.width_s, spec.amplitude)], duration_s, rate_hz)


def doublet(spec: Doublet, duration_s: float, rate_hz: float) -> FloatArray:
    """Return ``repeats`` doublets whose starts lie ``spacing_s`` apart (default: two periods); (n,).

    Each is ``+amplitude`` for D = ``period_s`` / 2 and ``-amplitude`` for another D. One doublet has the spectrum
    |U|^2 = (4 A sin^2(w D / 2) / w)^2, with its peak at w D = 2.33.

    Raises:
        ScenarioError: half a period is shorter than one sample, the doublets overlap or the last one ends after the
            manoeuvre.
    """
    half = 0.5 * spec.period_s
    spacing = 2.0 * spec.period_s if spec.spacing_s is None else spec.spacing_s
    if spec.repeats > 1 and spacing < spec.period_s * (1.0 - 1e-9):
        raise ScenarioError(
            f"spacing_s >= period_s must hold for repeated doublets, got {spacing:g} and {spec.period_s:g} s; "
            "leave spacing_s out for twice the period"
        )
    if spec.repeats > sample_count(duration_s, rate_hz):  # too many to list
        raise ScenarioError(end_fault(spec.start_s + (spec.repeats - 1) * spacing + spec.period_s, duration_s))
    intervals = []
    for k in range(spec.repeats):
        begin = spec.start_s + k * spacing
        intervals.append((begin, begin + half, spec.amplitude))
        intervals.append((begin + half, begin + spec.period_s, -spec.amplitude))
    return _flown(spec, intervals, duration_s, rate_hz)


def standard_multistep(spec: StandardMultistep, duration_s: float, rate_hz: float) -> FloatArray:
    """Return a 3-2-1-1, 2-1-1 or 1-2-3: steps of alternating sign whose name gives their lengths in ``step_s``; (n,).

    Raises:
        ScenarioError: a step is shorter than one sample or the last one ends after the manoeuvre.
    """
    return _pattern(PATTERNS[spec.signal], spec, duration_s, rate_hz)


def multistep(spec: Multistep, duration_s: float, rate_hz: float) -> FloatArray:
    """Return the steps of ``pattern``: sign(p) A for |p| ``step_s`` each, one after the other; (n,).

    Raises:
        ScenarioError: a step is shorter than one sample or the last one ends after the manoeuvre.
    """
    return _pattern(spec.pattern, spec, duration_s, rate_hz)


def _flown(
    spec: Step | Pulse | Doublet | StandardMultistep | Multistep,
    intervals: Sequence[tuple[float, float, float]],
    duration_s: float,
    rate_hz: float,
) -> FloatArray:
    if spec.pilot is None:
        return sample_intervals(intervals, duration_s, rate_hz)
    sample_intervals(intervals, duration_s, rate_hz)  # the laws of exact steps hold for a pilot's, too
    return by_hand(spec.pilot, intervals, sample_count(duration_s, rate_hz), rate_hz)


def sample_intervals(intervals: Sequence[tuple[float, float, float]], duration_s: float, rate_hz: float) -> FloatArray:
    """Return the held samples (n,) of a signal that has ``level`` in each interval (begin_s, end_s, level), else zero.

    Raises:
        ScenarioError: an interval is shorter than one sample or ends after ``duration_s``; every such fault is listed.
    """
    u = np.zeros(sample_count(duration_s, rate_hz))
    faults = []
    for begin, end, level in intervals:
        if (end - begin) * rate_hz < 1.0 - 1e-6:
            faults.append(
                f"a step must last at least one sample ({1.0 / rate_hz:g} s at {rate_hz:g} Hz), got {end - begin:g} s "
                f"from t = {begin:g} s; lengthen it or raise the simulation rate"
            )
        u[_sample(begin, rate_hz) : _sample(end, rate_hz)] = level
    last = max(end for _, end, _ in intervals)
    if last > duration_s + 1e-6 / rate_hz:
        faults.append(end_fault(last, duration_s))
    if faults:
        raise ScenarioError(faults)
    return u


def end_fault(end_s: float, duration_s: float) -> str:
    """Return the message for an input that ends after its manoeuvre."""
    return (
        f"an input must end within duration_s = {duration_s:g} s of its manoeuvre, got an end at {end_s:g} s; "
        f"start it earlier, shorten it or set duration_s >= {end_s:g}"
    )


def _pattern(
    pattern: Sequence[float], spec: StandardMultistep | Multistep, duration_s: float, rate_hz: float
) -> FloatArray:
    edges = spec.start_s + spec.step_s * np.concatenate([[0.0], np.cumsum(np.abs(pattern))])
    levels = spec.amplitude * np.sign(pattern)
    return _flown(spec, list(zip(edges[:-1], edges[1:], levels, strict=True)), duration_s, rate_hz)


def _sample(time_s: float, rate_hz: float) -> int:
    """Return the number of the sample nearest to ``time_s``."""
    return int(np.floor(min(time_s * rate_hz, _FAR) + 0.5 + _TIE))
