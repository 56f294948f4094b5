"""What may lie between a command and a recorded surface: gain, delay, lag, limits, play, feedback, interconnect.

A path is simulated alone, driven by the recorded command and by recorded motions. Only differences to the believed
path are used, and these are added to the flight of the believed model: where nothing differs, nothing is approximate.
Its own lag and delay are brought to what that flight shows, as frames of the simulation delay it, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from testbench.core.record import FloatArray
from testbench.flight.batch.compiled import compiled

INSTANT = 1e3  # rad/s: a servo as fast is none at the rates of records


@dataclass(frozen=True)
class Path:
    """A path from command to surface.

    Attributes:
        corner_rad_s: of the servo.
        limit_rad_s: of its rate.
        rate_hz: of the simulation, a multiple of the record's: servos move between the samples of commands.
        zeta: damping of a servo of second order; of first order if None.
        gain: of the command, as a deviation from trim.
        delay_s: of the command.
        dead_rad: half of the band of errors within which the servo rests.
        play_rad: width of the play behind it.
        fed: quantity -> what is added to the command per unit of it.
        washout_rad_s: corner of the washout that fed quantities pass; none at 0.
    """

    corner_rad_s: float
    limit_rad_s: float
    rate_hz: float
    zeta: float | None = None
    gain: float = 1.0
    delay_s: float = 0.0
    dead_rad: float = 0.0
    play_rad: float = 0.0
    fed: Mapping[str, float] = field(default_factory=dict)
    washout_rad_s: float = 0.0

    def surface(
        self,
        command: FloatArray,
        motion: Mapping[str, FloatArray],
        dt_s: float,
        moves_on: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """Return where the surface stands (n,) under a command (n,) and with motions (n,), in rad.

        The command is held until the next sample, or moves on to it on a straight line where ``moves_on`` (n,) says so.
        """
        fine = max(1, round(self.rate_hz * dt_s))
        drive = self.gain * np.repeat(command, fine)
        at, dt_s = np.arange(drive.size) / fine, dt_s / fine
        if moves_on is not None:
            on = np.repeat(moves_on, fine)
            drive[on] = self.gain * np.interp(at[on], np.arange(command.size), command)
        for name, k in self.fed.items():
            x = np.interp(at, np.arange(command.size), motion[name])
            if self.washout_rad_s > 0.0:
                a = math.exp(-self.washout_rad_s * dt_s)
                x = lfilter([1.0, -1.0], [1.0, -a], x)
            drive = drive + k * 0.5 * (x + np.append(x[1:], x[-1]))  # the mean over the time until the next sample
        return self._servo(_late(drive, self.delay_s / dt_s), dt_s)[::fine]

    def _servo(self, drive: FloatArray, dt_s: float) -> FloatArray:
        corner = min(self.corner_rad_s, INSTANT)
        if self.zeta is not None:
            system = ([corner**2], [1.0, 2.0 * self.zeta * corner, corner**2])
            num, den, _ = cont2discrete(system, dt_s)
            moved = np.asarray(lfilter(num.ravel(), den, drive))
            return np.asarray(_first_order(moved, 0.0, math.inf, 0.0, 0.5 * self.play_rad))
        before = np.concatenate([drive[:1], drive[:-1]])  # a command moves the servo until the next sample
        whole = math.exp(-corner * dt_s)
        limit = self.limit_rad_s * dt_s
        return np.asarray(_first_order(before, whole, limit, self.dead_rad, 0.5 * self.play_rad))


@compiled
def _first_order(drive: Any, whole: float, most: float, dead: float, half: float) -> Any:
    """Return where a surface stands (n,): a lag that keeps the share ``whole`` of its error from sample to sample.

    It moves by no more than ``most`` from one to the next, rests within the error ``dead``, and draws along what stands
    within ``half`` of it to either side.
    """
    out, d, at = np.empty_like(drive), 0.0, 0.0
    for i in range(drive.size):
        error = drive[i] - d
        step = (1.0 - whole) * (error - max(-dead, min(dead, error)))
        d += max(-most, min(most, step))
        at = min(max(at, d - half), d + half)
        out[i] = at
    return out


def _late(x: FloatArray, samples: float) -> FloatArray:
    """Return a held signal so many samples later, or earlier; in part, as its mean over the time between two."""
    whole = math.floor(samples)
    part, at = samples - whole, np.arange(x.size) - whole
    last = x.size - 1
    return np.asarray((1.0 - part) * x[np.clip(at, 0, last)] + part * x[np.clip(at - 1, 0, last)])


@dataclass(frozen=True)
class Kind:
    """One way in which a path may differ.

    Attributes:
        name: short, told by :data:`WORDS`, or "fed QUANTITY".
        low, high: bounds of its parameters.
        starts: values that a fit may start from, each (p,).
        units: of the parameters.
    """

    name: str
    low: tuple[float, ...]
    high: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    units: tuple[str, ...]

    def put_in(self, path: Path, x: FloatArray) -> Path:
        """Return the path with it at the parameters x (p,)."""
        v = [float(e) for e in x]
        if self.name.startswith("fed "):
            washout = v[1] if len(v) > 1 else path.washout_rad_s
            return replace(path, fed={**path.fed, self.name.split()[1]: v[0]}, washout_rad_s=washout)
        match self.name:
            case "lag":
                return replace(path, corner_rad_s=v[0], zeta=None)
            case "second order":
                return replace(path, corner_rad_s=v[0], zeta=v[1])
            case "delay":
                return replace(path, delay_s=path.delay_s + v[0])
            case "rate limit":
                return replace(path, limit_rad_s=v[0])
            case "gain":
                return replace(path, gain=v[0])
            case "dead band":
                return replace(path, dead_rad=v[0])
            case _:
                return replace(path, play_rad=v[0])


def kinds(believed: Path, fed: Mapping[str, str]) -> tuple[Kind, ...]:
    """Return every way in which a path is looked at; ``fed`` are quantities that move -> the unit of their gain."""
    corner = min(believed.corner_rad_s, INSTANT)
    limit = min(believed.limit_rad_s, 20.0)
    frames = max(2, int(0.5 * believed.rate_hz))  # between them commands that are held have other shapes, and no slope
    out = [
        Kind("lag", (1.0,), (INSTANT,), ((0.5 * corner,), (2.0 * corner,)), ("rad/s",)),
        Kind(
            "second order",
            (2.0, 0.2),
            (300.0, 2.0),
            ((0.6 * corner, 0.7), (corner, 0.7), (corner, 1.2)),
            ("rad/s", "1"),
        ),
        Kind("delay", (0.0,), (0.5,), tuple((k / believed.rate_hz,) for k in range(1, frames)), ("s",)),
        Kind("rate limit", (0.02,), (20.0,), ((0.5 * limit,), (0.2 * limit,), (0.08 * limit,)), ("rad/s",)),
        Kind("gain", (0.0,), (3.0,), ((0.9,),), ("1",)),
        Kind("dead band", (0.0,), (0.06,), ((0.002,), (0.008,)), ("rad",)),
        Kind("play", (0.0,), (0.06,), ((0.004,), (0.015,)), ("rad",)),
    ]
    out += [Kind(f"fed {n}", (-3.0,), (3.0,), ((0.0,),), (unit,)) for n, unit in fed.items()]
    if "r" in fed:
        out.append(Kind("fed r washed", (-3.0, 0.05), (3.0, 5.0), ((0.1, 0.5), (-0.1, 0.5)), (fed["r"], "rad/s")))
    return tuple(out)
