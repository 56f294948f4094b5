"""Channels with clocks of their own put on one even clock while they come, and what the link gives, measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from testbench.core.channels import channel
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.schema import OF_CHANNELS
from testbench.logs.noise import white_std
from testbench.questions.live.stream import Sample

FASTEST_HZ = 50.0
"""Rigid bodies move below 5 Hz: what comes faster is averaged."""
_GAP = 2.5  # times the usual step: samples between are lost
_STALL_S = 1.0  # a channel that is late by more is not waited for
_MEMORY_S = 60.0
_LATEST_S = 1e12
_FEWEST = 20  # samples that noise is told by


@dataclass
class _Channel:
    t: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    count: int = 0
    lost: int = 0
    first_s: float = 0.0


@dataclass(frozen=True)
class Rate:
    """What a link gives of a channel: samples a second, the share that is lost, jitter of the arrival, s."""

    hz: float
    lost: float
    jitter_s: float


class Clock:
    """Takes samples as they come, and gives blocks of them on an even clock.

    Args:
        behind_s: channel -> time by which its instrument is known to be behind, s: delays, and lags for slow motion.
    """

    def __init__(self, behind_s: Mapping[str, float] | None = None) -> None:
        self.behind_s = behind_s or {}
        self._channels: dict[str, _Channel] = {}
        self.newest_s = -np.inf
        self.first_s = np.inf
        self._next: float | None = None

    def add(self, sample: Sample) -> None:
        """Take a sample; of a channel only what is newer than what it has: reordered and repeated ones are dropped.

        So is what no clock and no instrument can give: a message that was never filled, a line that was damaged.
        """
        if not max(abs(sample.t_s), abs(sample.arrived_s)) <= _LATEST_S:
            return
        for name, value in sample.values.items():
            if not abs(value) <= OF_CHANNELS[channel(name).unit]:
                continue
            taken_s = sample.t_s - self.behind_s.get(name, 0.0)
            c = self._channels.setdefault(name, _Channel(first_s=taken_s))
            if c.t and taken_s <= c.t[-1]:
                continue
            c.t.append(taken_s)
            c.x.append(value)
            c.late.append(sample.arrived_s - sample.t_s)
            c.count += 1
        self.newest_s = max(self.newest_s, sample.t_s)
        self.first_s = min(self.first_s, sample.t_s)

    def rates(self) -> dict[str, Rate]:
        """Return channel -> what the link gives of it, of those with four samples or more."""
        out = {}
        for name, c in self._channels.items():
            if len(c.t) > 3:
                steps = np.diff(c.t)
                usual = float(np.median(steps))
                missing = float(np.sum(np.maximum(np.rint(steps / usual) - 1.0, 0.0)))
                out[name] = Rate(1.0 / usual, missing / (missing + len(c.t)), float(np.std(c.late)))
        return out

    def mean(self, name: str, last_s: float, otherwise: float) -> float:
        """Return the mean of a channel over the last seconds; another value if it has not come in them."""
        c = self._channels.get(name, _Channel())
        kept = [x for t, x in zip(c.t, c.x, strict=True) if t > self.newest_s - last_s]
        return float(np.mean(kept)) if kept else otherwise

    def noise(self, name: str, last_s: float) -> float:
        """Return the standard deviation of the white noise of a channel over the last seconds, on the even clock.

        What is interpolated hides its noise from differences: it is told by the samples as they came.
        """
        c = self._channels[name]
        t, x = np.array(c.t), np.array(c.x)
        kept = t > self.newest_s - last_s
        kept = kept if kept.sum() >= _FEWEST else np.ones(len(t), bool)
        averaged = max(self.dt_s / float(np.median(np.diff(t[kept]))), 1.0) if kept.sum() > 1 else 1.0
        return white_std(x[kept]) / float(np.sqrt(averaged))

    def start(self, rate_hz: float) -> None:
        """Begin the even clock at what is newest."""
        self.dt_s = 1.0 / rate_hz
        self._next = np.ceil(self.newest_s * rate_hz) / rate_hz

    def block(self, names: Sequence[str]) -> FlightRecord | None:
        """Return the samples of some channels since the block before; None if there is none yet."""
        assert self._next is not None
        last = min(self._channels[n].t[-2] for n in names)
        end = max(last, self.newest_s - _STALL_S) - 0.5 * self.dt_s
        if end - self._next > _MEMORY_S:  # nothing is made of so long a silence
            self._next = float(np.ceil((end - _STALL_S) / self.dt_s) * self.dt_s)
        count = int(np.floor((end - self._next) / self.dt_s + 1e-6)) + 1
        if count < 1:
            return None
        grid: FloatArray = self._next + self.dt_s * np.arange(count, dtype=np.float64)
        self._next = float(grid[-1] + self.dt_s)
        columns = [self._on(grid, n) for n in names]
        self._forget(float(grid[0]) - _MEMORY_S)
        data, valid = (np.column_stack(part) for part in zip(*columns, strict=True))
        return FlightRecord(grid, tuple(names), data, "measured", valid)

    def _on(self, grid: FloatArray, name: str) -> tuple[FloatArray, NDArray[np.bool_]]:
        t, x = np.array(self._channels[name].t), np.array(self._channels[name].x)
        usual = float(np.median(np.diff(t[-200:]))) if t.size > 1 else self.dt_s
        at = np.searchsorted(t, grid + 1e-9, side="right") - 1
        before, after = np.clip(at, 0, t.size - 1), np.clip(at + 1, 0, t.size - 1)
        near = (grid - t[before] <= _GAP * max(usual, self.dt_s)) & (grid <= t[-1] + usual) & (at >= 0)
        if name.endswith("_cmd"):
            return x[before], near
        taken = near & (t[after] - t[before] <= _GAP * max(usual, self.dt_s))
        if usual < 0.7 * self.dt_s:
            area = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])
            half = 0.5 * self.dt_s
            return (np.interp(grid + half, t, area) - np.interp(grid - half, t, area)) / self.dt_s, taken
        # A straight line between samples would take 3 % of what swings in 12 of them, of each channel another part.
        near_by = slice(max(int(at[0]) - 3, 0), int(at[-1]) + 5)
        t, x = t[near_by], x[near_by]
        if t.size < 4:
            return np.interp(grid, t, x), taken
        inside = np.clip(grid, t[0], t[-1])
        return CubicHermiteSpline(t, x, np.gradient(x, t))(inside), taken

    def _forget(self, before_s: float) -> None:
        for c in self._channels.values():
            if len(c.t) > 2 and c.t[0] < before_s - _MEMORY_S:
                k = min(int(np.searchsorted(c.t, before_s)), len(c.t) - 2)  # a block looks at the last two
                del c.t[:k], c.x[:k], c.late[:k]
