"""Block Hankel data matrices of one or several records, window by window, and the R factor that projections need."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrcon

from testbench.record import FloatArray

_CHUNK = 2_000_000  # numbers held at once
_LONG = 10  # windows per row of the Hankel matrix from which on its Gram matrix is tried
_TALL = 50  # rows per column from which on a Gram matrix saves time
_SQUARED = 1e-4  # reciprocal condition of the scaled columns down to which a Gram matrix keeps enough digits


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


def fold(R: FloatArray, rows: FloatArray) -> FloatArray:
    """Return :func:`triangle` of many rows, by way of their Gram matrix where their columns are far from dependent."""
    if rows.shape[0] < _TALL * rows.shape[1]:
        return triangle(R, rows)
    own = cholesky_factor(rows.T @ rows)
    return triangle(R, rows if own is None else own)


def cholesky_factor(G: FloatArray) -> FloatArray | None:
    """Return R with R'R = G for a Gram matrix, None where it would lose digits; zero columns stay zero.

    Squaring costs half the digits: columns scaled to unit length must have a condition below 1e4.
    """
    size = np.sqrt(np.diag(G))
    unit = np.where(size > 0.0, size, 1.0)
    G = G / unit / unit[:, None]
    G[size == 0.0, size == 0.0] = 1.0
    try:
        R = np.linalg.cholesky(G).T
    except np.linalg.LinAlgError:
        return None
    reciprocal, _ = dtrcon(R, norm="1", uplo="U")
    return np.asarray(R * size) if reciprocal > _SQUARED else None


def runs(known: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the stretches of consecutive known samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(begin), int(end))


def block_factor(
    series: Sequence[FloatArray], starts: Sequence[NDArray[np.intp]], length: int, lead: int = 0
) -> tuple[FloatArray, int]:
    """Return the R factor of all windows of all series, and the number of windows less what the lead columns take.

    With ``lead`` = 1 a constant per series, with 2 a constant and a linear trend in the window's first sample are
    projected out of every row of the block Hankel matrix. A constant and a linear trend of the inputs, of the outputs
    and of the states reach its rows as such, so that this removes them exactly, as extra inputs per series would.

    Long series take the Gram matrix G of the windows, whose blocks obey G[i+1, j+1] = G[i, j] + a rank-two change
    (displacement structure: N. Mastronardi et al. 2001, V. Sima 2004), and its Cholesky factor. Squaring costs half
    the digits, therefore it is used only where the columns, scaled to unit length, have a condition below 1e4;
    elsewhere windows are folded into a triangle chunk by chunk.

    Args:
        series: (N, d) each.
        starts: first samples of the windows to use, per series, increasing.
        length: of the windows, in samples.
        lead: 0, 1 or 2.
    """
    width = length * series[0].shape[1]
    columns = sum(max(s.size - lead, 0) for s in starts)
    quick = quick_factor(series, starts, length, lead)
    if quick is not None:
        return quick, columns
    R = np.zeros((0, width))
    for z, first in zip(series, starts, strict=True):
        if first.size <= lead:
            continue
        part = np.zeros((0, width + lead)) if lead else R
        for at, rows in windows(z, first, length):
            part = triangle(part, np.hstack([trend(at, first, lead), rows]) if lead else rows)
        R = triangle(R, part[lead:, lead:]) if lead else part
    return R, columns


def quick_factor(
    series: Sequence[FloatArray], starts: Sequence[NDArray[np.intp]], length: int, lead: int = 0
) -> FloatArray | None:
    """Return the R factor of :func:`block_factor` by way of the Gram matrix, None for short or ill-conditioned data."""
    if sum(max(s.size - lead, 0) for s in starts) < _LONG * length * series[0].shape[1]:
        return None
    return _gram_factor(series, starts, length, lead)


def trend(at: NDArray[np.intp], first: NDArray[np.intp], lead: int) -> FloatArray:
    """Return 1 and the time from -1 to 1 over the series, as columns."""
    middle, half = 0.5 * (first[0] + first[-1]), max(0.5 * (first[-1] - first[0]), 0.5)
    return np.stack([np.ones(at.size), (at - middle) / half], axis=1)[:, :lead]


def _gram_factor(
    series: Sequence[FloatArray], starts: Sequence[NDArray[np.intp]], length: int, lead: int
) -> FloatArray | None:
    """Return the Cholesky factor of the Gram matrix of the windows, or None where it would lose digits."""
    d = series[0].shape[1]
    width = length * d
    G = np.zeros((width, width))
    for z, first in zip(series, starts, strict=True):
        if first.size <= lead:
            continue
        if lead:
            z = z - z.mean(axis=0)
        between = np.zeros((lead, width))
        own = np.zeros((width, width))
        for part in np.split(first, np.flatnonzero(np.diff(first) > 1) + 1):
            begin, end = int(part[0]), int(part[-1]) + 1
            for j in range(length):
                own[:d, j * d : (j + 1) * d] += z[begin:end].T @ z[begin + j : end + j]
            if lead:
                line = trend(part, first, lead)
                for j in range(length):
                    between[:, j * d : (j + 1) * d] += line.T @ z[begin + j : end + j]
        # The first block row is a sum over the runs, and so are the changes from one block row to the next.
        cut = np.flatnonzero(np.diff(first) > 1)
        left, right = np.append(first[0], first[cut + 1]), np.append(first[cut], first[-1]) + 1
        padded = np.concatenate([z, np.zeros((1, d))])  # the last sample after a run is never used
        gone, come = (padded[edge[:, None] + np.arange(length)].reshape(edge.size, width) for edge in (left, right))
        for i in range(length - 1):
            here, there = slice(i * d, (i + 1) * d), slice((i + 1) * d, (i + 2) * d)
            own[there, d:] = own[here, :-d] + come[:, here].T @ come[:, :-d] - gone[:, here].T @ gone[:, :-d]
        if lead:
            line = trend(first, first, lead)
            own = own - between.T @ np.linalg.solve(line.T @ line, between)
        G += np.triu(own) + np.triu(own, 1).T  # the recursion fills the upper triangle
    return cholesky_factor(G) if np.all(np.diag(G) > 0.0) else None
