"""Messages of a log that follow each other without a gap, found many at a time.

A log is a chain: each message ends where the next begins. The places where a message may begin are found by comparing
bytes; a run of places, each the end of the message before, is then taken at once. What breaks the run (a new format, a
rare message, damage) is looked at message by message, by the readers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]

CHUNK = 1 << 22
"""Bytes that are searched at once: few enough that a new format, for which they are searched again, costs little."""
_FIRST, _MOST = 64, 1 << 20  # messages compared at once: few after a break, more the longer none comes


def run_length(starts: Places, ends: Callable[[int, int], Places], first: int) -> int:
    """Return how many messages, from the one with index ``first`` on, end where the next one begins.

    Args:
        starts: (n,) places where messages may begin, increasing.
        ends: gives the ends of the messages with indices a to b - 1; one that is not known ends where it begins.
        first: index of the first message.
    """
    at, width = first, _FIRST
    while (stop := min(at + width, starts.size - 1)) > at:
        breaks = np.flatnonzero(ends(at, stop) != starts[at + 1 : stop + 1])
        if breaks.size:
            return at + int(breaks[0]) - first
        at, width = stop, min(2 * width, _MOST)
    return at - first


def field(
    whole: NDArray[np.uint8], places: Places, offset: int, dtype: np.dtype[np.generic] | str
) -> NDArray[np.generic]:
    """Return the (n,) values that lie ``offset`` bytes behind each of the ``places``."""
    kind = np.dtype(dtype)
    view = np.ndarray((max(0, whole.size - offset - kind.itemsize + 1),), kind, whole, offset, (1,))
    return np.asarray(view[places])


def grouped(kinds: NDArray[Any], places: Places) -> dict[int, Places]:
    """Return kind -> its places, in the order in which they are given."""
    order = np.argsort(kinds, kind="stable")
    ordered = kinds[order]
    cuts = np.flatnonzero(ordered[1:] != ordered[:-1]) + 1
    return {int(kinds[part[0]]): places[part] for part in np.split(order, cuts) if part.size}
