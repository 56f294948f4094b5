"""Block Hankel data matrices of one or several records, window by window, and the R factor that projections need."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from testbench.record import FloatArray

_CHUNK = 2_000_000  # numbers held at once


def window_starts(good: NDArray[np.bool_], length: int) -> NDArray[np.intp]:
    """Return the first samples of all windows of ``length`` samples that hold good samples only."""
    if good.size < length:
        return np.empty(0, dtype=np.intp)
    bad = np.concatenate([[0], np.cumsum(~good)])
    return np.flatnonzero(bad[length:] == bad[:-length])


def windows(z: FloatArray, starts: NDArray[np.intp], length: int) -> Iterator[tuple[NDArray[np.intp], FloatArray]]:
    """Yield, chunk by chunk, starts (c,) and rows (c, length d) that hold z[start], ..., z[start + length - 1].

    The rows are columns of the block Hankel matrix of z (N, d). They are made in chunks because the whole matrix of a
    long record does not fit in memory.
    """
    if starts.size == 0:
        return
    view = sliding_window_view(z, length, axis=0)
    width = length * z.shape[1]
    size = max(2 * width, _CHUNK // width)
    for i in range(0, starts.size, size):
        part = starts[i : i + size]
        yield part, view[part].transpose(0, 2, 1).reshape(part.size, width)


def triangle(R: FloatArray, rows: FloatArray) -> FloatArray:
    """Return the R factor of the QR decomposition of [R; rows]: all that least squares needs of any number of rows."""
    out: FloatArray = np.linalg.qr(np.vstack([R, rows]), mode="r")  # type: ignore[assignment]
    return out


def runs(known: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the stretches of consecutive known samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(begin), int(end))
