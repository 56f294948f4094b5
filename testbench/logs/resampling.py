"""Join channels with clocks of their own in one record, without aliasing and without inventing samples in gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.door import NUMBER, require_room
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.clocks import shortest_step
from testbench.logs.signals import Mapped

DEFAULT_RATE_HZ = 50.0
STOP_DB = 60.0  # what the filter leaves of what would fold down
_PASS, _STOP = 0.4, 0.6  # of the new rate: what lies between folds down to above 0.4 of it only
_SLOW = 0.8  # a channel below this part of the new rate is sampled where it was sampled
_SMOOTH = 4.0  # longest over shortest step: beyond it a cubic through noise overshoots between the samples
_SHORTEST_S = 1e-9  # no logger counts finer
_BLOCK, _LAP = 1 << 18, 64  # samples of a spline at once, and beyond: the end of one is felt as 0.27^n n samples away
_EVEN = 0.01  # of a step: the steps of an even clock differ by less; a straight line does between its samples
_LONG = 500_000  # samples from which on a log that shares one clock is put to the default rate too


def common_rate(channels: Sequence[Mapped]) -> float:
    """Return the rate for all of ``channels``: their own if they share one even clock, else the fastest's up to 50 Hz.

    A long log (half a million samples: an hour at 140 Hz) is put to 50 Hz too: rigid bodies move below 5 Hz, and what
    lies above passes the filter of :func:`resample` and is not folded down. A rate of your own keeps every sample.

    Raises:
        RecordError: there is no channel, or its times hardly move.
    """
    if not channels:
        raise RecordError("at least one channel must have been found to make a record, got none")
    for c in channels:
        if not c.step_s >= _SHORTEST_S:
            raise RecordError(
                f"times must run on by at least {_SHORTEST_S:g} s a sample, got steps of {c.step_s:g} s in {c.source}; "
                "the times of the log are damaged, or in another unit"
            )
    first = channels[0].t_s
    steps = np.diff(first)
    usual = float(np.median(steps))
    even = np.abs(np.delete(steps, channels[0].lost) - usual) <= 0.01 * usual
    brief = first.size <= _LONG or usual >= 1.0 / DEFAULT_RATE_HZ
    if brief and all(np.array_equal(c.t_s, first) for c in channels) and even.all():
        return 1.0 / usual if abs(round(1.0 / usual) * usual - 1.0) > 1e-3 else float(round(1.0 / usual))
    fastest = max(c.rate_hz for c in channels)
    return min(DEFAULT_RATE_HZ, max(1.0, float(round(fastest))) if fastest > 1.0 else fastest)


def resample(
    channels: Sequence[Mapped],
    rate_hz: float,
    provenance: Mapping[str, Any],
    stepped: Sequence[str] = (),
    held: Sequence[str] = (),
) -> FlightRecord:
    """Return one record of all channels at ``rate_hz``, time counted from the first sample of any of them.

    A channel that was logged faster first passes a zero-phase low pass (Kaiser window, passband to 0.4, 60 dB from
    0.6 of the new rate; Oppenheim and Schafer, Discrete-Time Signal Processing, sec. 7.6) at its own rate. Between
    samples a cubic interpolates; a straight line does for the channels in ``stepped`` and where steps differ by more
    than a factor of 4. A slower channel (below 0.8 of the
    new rate) is sampled at the time of the grid nearest to each of its samples. Everywhere else, in gaps
    (:mod:`testbench.logs.clocks`; a step that is no longer than one of the record is none) and before the first and
    after the last sample, the last value is held and marked. A channel without a stretch that is long enough is left
    out; :mod:`testbench.questions.importing.balance` says so.

    Args:
        channels: channels in SI units, each with its own times on one clock.
        rate_hz: rate of the record.
        provenance: kept with the record.
        stepped: channels that move in steps, whose cubic would overshoot.
        held: commands, held by a computer from one sample to the next: each new sample is the mean of what was held
            until the one after it, so that a step between two samples keeps its time.

    Raises:
        RecordError: the rate is not positive, there is no channel, or there is no stretch without gaps.
        SizeError: the times span more than the limit of :mod:`testbench.core.door` holds.
    """
    if not 0.0 < rate_hz < np.inf:
        raise RecordError(f"the rate of a record must be > 0 Hz and finite, got {rate_hz:g}")
    if not channels:
        raise RecordError("at least one channel must have been found to make a record, got none")
    zero = min(float(c.t_s[0]) for c in channels)
    end = max(float(c.t_s[-1]) for c in channels)
    require_room(
        f"a record from {zero:g} to {end:g} s at {rate_hz:g} Hz",
        NUMBER * len(channels) * (end - zero) * rate_hz,
        "the times of the log are damaged, or give a lower rate",
    )
    count = int(np.floor((end - zero) * rate_hz + 1e-3)) + 1
    grid = np.arange(count) / rate_hz
    kept, data, valid = [], [], []
    for c in channels:
        values, taken = _on_grid(c, zero, grid, 1.0 / rate_hz, c.name in stepped, c.name in held)
        if not taken.any():
            continue
        last = np.maximum.accumulate(np.where(taken, np.arange(count), -1))
        kept.append(c.name)
        data.append(values[np.where(last < 0, int(np.argmax(taken)), last)])
        valid.append(taken)
    if not kept:
        raise RecordError(f"some channel must hold a stretch without gaps, got none at {rate_hz:g} Hz")
    return FlightRecord(
        t_s=grid,
        channels=tuple(kept),
        data=np.column_stack(data),
        kind="measured",
        valid=np.column_stack(valid),
        provenance={**provenance, "clock_zero_s": zero, "rate_hz": rate_hz},
    )


def _on_grid(
    channel: Mapped, zero: float, grid: FloatArray, dt: float, stepped: bool, held: bool
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the values on the grid, 0 where none was taken, and where one was."""
    values, taken = np.zeros(grid.size), np.zeros(grid.size, bool)
    t, x, step = channel.t_s - zero, channel.values, channel.step_s
    cuts = channel.lost[np.diff(t)[channel.lost] > dt] + 1
    finest = shortest_step(t) if step < _SLOW * dt else step
    slack = 1e-3 * min(step, dt)  # times are rounded to microseconds
    for part in np.split(np.arange(t.size), cuts):
        tp, xp = t[part], x[part]
        inside = np.arange(*np.searchsorted(grid, [tp[0] - slack, tp[-1] + slack], side="left"))
        if step > dt / _SLOW:
            inside = np.unique(np.clip(np.rint(tp / dt), 0, grid.size - 1).astype(int))
        elif step < _SLOW * dt and not held:
            low = _lowpass(tp, xp, finest, dt, stepped)
            if low is None:
                continue  # too short to be filtered, and unfiltered it would fold
            tp, xp = low
        if inside.size:
            fast = held and step <= dt / _SLOW
            values[inside] = _mean_held(tp, xp, grid[inside], dt) if fast else _between(tp, xp, grid[inside], stepped)
            taken[inside] = True
    return values, taken


def _mean_held(t: FloatArray, x: FloatArray, at: FloatArray, dt: float) -> FloatArray:
    """Return the mean over ``dt`` after each of ``at`` of what is held from each sample until the next."""
    near = np.clip(np.rint((at - t[0]) / max(dt, 1e-300)).astype(int), 0, t.size - 1)
    if np.all(np.abs(t[near] - at) <= _EVEN * dt):  # one clock: the samples themselves, to the last digit
        return x[near]
    area = np.concatenate([[0.0], np.cumsum(x[:-1] * np.diff(t))])

    def until(when: FloatArray) -> FloatArray:
        last = np.clip(np.searchsorted(t, when, side="right") - 1, 0, t.size - 1)
        return np.asarray(area[last] + x[last] * (when - t[last]))

    mean = (until(at + dt) - until(at)) / dt
    return np.asarray(np.clip(mean, x.min(), x.max()))  # rounding would let a command that rests move


def _between(t: FloatArray, x: FloatArray, at: FloatArray, stepped: bool) -> FloatArray:
    steps = np.diff(t)
    if t.size < 4 or stepped or steps.max() > _SMOOTH * steps.min():
        return np.interp(at, t, x)
    from scipy.interpolate import CubicSpline

    at, out = np.clip(at, t[0], t[-1]), np.empty(at.size)
    for first in range(0, t.size - 1, _BLOCK):  # a spline of all samples takes forty numbers a sample
        last = min(first + _BLOCK, t.size - 1)
        part = slice(max(0, first - _LAP), last + _LAP + 1)
        own = slice(*np.searchsorted(at, [t[first] if first else -np.inf, t[last] if last < t.size - 1 else np.inf]))
        out[own] = CubicSpline(t[part], x[part])(at[own])
    return out


def _lowpass(
    t: FloatArray, x: FloatArray, step: float, dt: float, stepped: bool
) -> tuple[FloatArray, FloatArray] | None:
    """Return a stretch without gaps on an even grid of its own rate, low-passed for ``dt``; None if it is too short."""
    from scipy.signal import firwin, kaiserord

    ratio = step / dt  # own samples per new one, inverted
    taps, beta = kaiserord(STOP_DB, 2.0 * (_STOP - _PASS) * ratio)
    taps |= 1
    half = taps // 2
    require_room(
        f"a channel with steps of {step:g} s from {t[0]:g} to {t[-1]:g} s",
        NUMBER * (t[-1] - t[0]) / step,
        "the times of the log are damaged",
    )
    even = t[0] + step * np.arange(int(np.floor((t[-1] - t[0]) / step + 1e-6)) + 1)
    if even.size <= half:
        return None
    kernel = firwin(taps, (_PASS + _STOP) * ratio, window=("kaiser", beta))
    steps = np.diff(t)
    y = _between(t, x, even, stepped or float(np.ptp(steps)) < _EVEN * step)
    left, right = 2.0 * y[0] - y[half:0:-1], 2.0 * y[-1] - y[-2 : -half - 2 : -1]  # odd about the ends: keeps trends
    return even, np.convolve(np.concatenate([left, y, right]), kernel, mode="valid")
