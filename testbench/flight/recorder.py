"""Rows of a log: the channels as JSBSim has them now, held against the limits of the aircraft.

A row is read once, and the limits are checked on what was read. It is packed by ``struct``, which takes half as long as
the assignment of a list to the row of an array does.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from operator import call

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.flight.executive import Executive


class Recorder:
    """Logs the channels ``names`` of an executive, in this order.

    Attributes:
        take: ``take(rows, i)`` writes the channels as they are now into row ``i`` of :meth:`empty` rows and returns how
            they break a limit of the aircraft, or "".
    """

    def __init__(self, fdm: Executive, names: Sequence[str]) -> None:
        limits = _limits(fdm)
        columns = [*names, *(n for n in limits if n not in names)]
        index = [fdm.channels.index(n) for n in columns]
        factors = [fdm.factors[i] for i in index]
        watched = []
        for name, (low, high) in limits.items():
            at = columns.index(name)
            reason = partial(limit_broken, name, factors[at], low, high)
            watched.append((at, low / factors[at], high / factors[at], reason))
        self._count = len(names)
        self._factors = np.array(factors)
        self.take = _taker([fdm.channel_nodes[i].get_double_value for i in index], watched)

    def read(self) -> FloatArray:
        """Return the channels as they are now (names,), SI."""
        rows = self.empty(1)
        self.take(rows, 0)
        return self.si(rows, 1)[0]

    def empty(self, count: int) -> bytearray:
        """Return ``count`` rows to be taken, in JSBSim's units: the channels, then limited ones beside them."""
        return bytearray(8 * count * self._factors.size)

    def si(self, rows: bytearray, count: int) -> FloatArray:
        """Return the first ``count`` of the rows as the channels (count, names), SI. The rows are used up."""
        data: FloatArray = np.ndarray((count, self._factors.size), buffer=rows)
        data *= self._factors
        return data[:, : self._count]


def _taker(
    readers: Sequence[Callable[[], float]], watched: Sequence[tuple[int, float, float, Callable[[float], str]]]
) -> Callable[[bytearray, int], str]:
    """Return :attr:`Recorder.take`; a closure, as the attributes of an object would be looked up in every row."""
    row = struct.Struct(f"{len(readers)}d")
    pack_into, size = row.pack_into, row.size

    def take(rows: bytearray, i: int) -> str:
        now = list(map(call, readers))
        pack_into(rows, i * size, *now)
        for column, low, high, reason in watched:
            # written so that NaN, for which every comparison fails, counts as outside
            if not low <= now[column] <= high:
                return reason(now[column])
        return ""

    return take


def _limits(fdm: Executive) -> dict[str, tuple[float, float]]:
    """Return limited channel of the simulator -> (low, high), SI."""
    out = {}
    for name, limits in fdm.aircraft.limits.items():
        targets = [n for n in fdm.channels if n.startswith("eta_")] if name == "eta" else [name]
        out.update(dict.fromkeys(targets, limits))
    return out


def limit_broken(name: str, factor: float, low: float, high: float, value: float) -> str:
    """Return how ``value``, in JSBSim's unit, breaks the limits of the channel, SI."""
    scale, unit = (1.0 / DEG_RAD, " deg") if name in {"alpha", "beta", "theta", "phi"} else (1.0, "")
    got = value * factor * scale
    if not math.isfinite(got):
        return f"{name} ceased to be a finite number"
    return f"{low * scale:g} <= {name} <= {high * scale:g}{unit} must hold, got {got:.3g}{unit}"
