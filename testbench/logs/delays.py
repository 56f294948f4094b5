"""How late attitude, climb and height are against the rates and specific forces, whose clock is the inertial unit's.

What attitude and climb change by is an integral of rates and specific forces (Klein and Morelli, Aircraft System
Identification, AIAA 2006, ch. 10). The delay is that by which the integral fits the changes best; a scale and a bias of
the instruments are fitted with it. Airspeed and flow angles are left to :mod:`testbench.inference`: gusts move them and
the specific forces together, which such a fit takes for a delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.signals import Mapped

_OVER_S = 1.0  # over which a change is taken: slower ones are drift of the instruments
_MOST_S, _GRID_S, _CLOSE_S = 0.6, 0.02, 1e-5  # delays that are sought, their steps, and where the search ends
_FEWEST = 30  # changes
_ALIKE = 0.5  # correlation below which other things than the integral move the channel
_KNOWN_S = 0.1  # standard deviation from which on nothing is said
_SURE = 3.0  # standard deviations
_SMALL_S = 0.01  # half a sample at 50 Hz: what does not matter to a rigid body

Get = Callable[[str], FloatArray]


class Delay(NamedTuple):
    """A delay, s, positive where a channel is late, its standard deviation, and the channel that it is late against."""

    s: float
    std_s: float
    against: str

    @property
    def matters(self) -> bool:
        """Whether it is told from zero, and of a size that shows in derivatives."""
        return abs(self.s) > max(_SURE * self.std_s, _SMALL_S)

    @property
    def said(self) -> str:
        """The delay in words."""
        return f"{1e3 * self.s:.0f} ± {1e3 * self.std_s:.0f} ms after {self.against}"


def _turn(x: Get) -> FloatArray:
    return x("q") * np.sin(x("phi")) + x("r") * np.cos(x("phi"))


_RATES: Mapping[str, tuple[tuple[str, ...], Callable[[Get], FloatArray]]] = {
    "phi": (("p",), lambda x: x("p") + np.tan(x("theta")) * _turn(x)),
    "theta": (("q",), lambda x: x("q") * np.cos(x("phi")) - x("r") * np.sin(x("phi"))),
    "psi": (("r", "phi"), lambda x: _turn(x) / np.cos(x("theta"))),
    "hdot": (("az", "theta"), lambda x: x("ax") * np.sin(x("theta")) - x("ay") * np.sin(x("phi")) * np.cos(x("theta"))
             - x("az") * np.cos(x("phi")) * np.cos(x("theta")) - G0_M_S2),
    "h": (("hdot",), lambda x: x("hdot")),
}  # fmt: skip
"""Channel -> what must have been logged, and what its rate of change then is; other channels are zero where absent.

The first that must have been logged is what a delay is against.
"""


def delays_of(
    record: FlightRecord, channels: Sequence[Mapped], flown: Sequence[tuple[float, float]]
) -> dict[str, Delay]:
    """Return channel -> its delay, of those of which it is told to 0.1 s.

    Args:
        record: all channels on one clock, for what is integrated.
        channels: as logged.
        flown: first and last time, s of the record, of each part that flies.
    """
    with np.errstate(all="ignore"):
        found = {c.name: _delay(record, c, flown) for c in channels if set(_needs(c.name)) <= set(record.channels)}
    return {name: delay for name, delay in found.items() if delay is not None}


def _needs(name: str) -> tuple[str, ...]:
    return _RATES[name][0] if name in _RATES else ("nothing tells",)


def _delay(record: FlightRecord, c: Mapped, flown: Sequence[tuple[float, float]]) -> Delay | None:
    def held(name: str) -> FloatArray:
        if name not in record:
            return np.zeros(len(record))
        taken = record.valid[:, record.channels.index(name)]
        return np.interp(record.t_s, record.t_s[taken], record[name][taken]) if taken.any() else np.zeros(len(record))

    if any(record.valid[:, record.channels.index(n)].mean() < 0.2 for n in _needs(c.name)):
        return None
    rate = np.nan_to_num(_RATES[c.name][1](held), nan=0.0, posinf=0.0, neginf=0.0)
    whole = np.r_[0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * record.dt_s)]
    t = c.t_s - float(record.provenance["clock_zero_s"])
    over = max(1, round(_OVER_S / c.step_s))
    if t.size <= over:
        return None
    first, last, change = t[:-over], t[over:], c.values[over:] - c.values[:-over]
    inside = (last - first < 1.5 * _OVER_S + 2.0 * c.step_s) & np.any(
        [(first >= a + _MOST_S) & (last <= b - _MOST_S) for a, b in flown] or [np.zeros(first.size, bool)], axis=0
    )
    first, last, change = first[inside], last[inside], change[inside]
    if change.size < _FEWEST or not np.ptp(change) > 0.0:
        return None

    def left(delay: float) -> tuple[float, FloatArray, FloatArray]:
        x = np.interp(last - delay, record.t_s, whole) - np.interp(first - delay, record.t_s, whole)
        columns = np.column_stack([x, np.ones(x.size)])
        values = np.linalg.lstsq(columns, change, rcond=None)[0]
        rest = change - columns @ values
        return float(values[0]), rest, x

    grid = np.arange(-_MOST_S, _MOST_S + 0.5 * _GRID_S, _GRID_S)
    sums = np.array([float(rest @ rest) for _, rest, _ in map(left, grid.tolist())])
    best = int(np.argmin(sums))
    if best in (0, grid.size - 1):
        return None
    low, high = float(grid[best - 1]), float(grid[best + 1])
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    while high - low > _CLOSE_S:
        a, b = high - golden * (high - low), low + golden * (high - low)
        ra, rb = left(a)[1], left(b)[1]
        low, high = (low, b) if ra @ ra < rb @ rb else (a, high)
    delay = 0.5 * (low + high)
    scale, rest, x = left(delay)
    if scale <= 0.0 or np.corrcoef(x, change)[0, 1] < _ALIKE:
        return None
    slope = scale * (left(delay + _GRID_S)[2] - left(delay - _GRID_S)[2]) / (2.0 * _GRID_S)
    slope -= slope.mean()
    alike = np.clip([np.corrcoef(rest[k:], rest[:-k])[0, 1] for k in range(1, min(2 * over, rest.size // 3))], 0.0, 1.0)
    seen = rest.size / (1.0 + 2.0 * float(np.sum(alike)))  # independent ones: changes overlap
    std = float(np.sqrt(rest @ rest / max(float(slope @ slope) * max(seen - 3.0, 1.0), 1e-300)))
    return Delay(delay, std, _needs(c.name)[0]) if std < _KNOWN_S else None
