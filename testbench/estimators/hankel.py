"""Block Hankel data matrices of one or several records, window by window, and the R factor that projections need."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import svd
from scipy.linalg.blas import dtrmv, dtrsv
from scipy.linalg.lapack import dtrcon
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from testbench.core.record import FloatArray

TALL = 50
"""Rows per column from which on a Gram matrix saves time."""
_CHUNK = 2_000_000  # numbers held at once
_LONG = 10  # windows per row of the Hankel matrix from which on its Gram matrix is tried
_COSTLY = 3e8  # multiplications of a QR decomposition from which on the Gram matrix of shorter series is tried, too
_BLOCK = 80  # numbers in a block of samples that is multiplied as one row
_WIDE = 100  # columns from which on two singular values are found sooner than all
SAFE = 1e-7
"""Reciprocal condition down to which a triangle projects as well as singular vectors do."""
_SQUARED = 1e-4  # reciprocal condition of the scaled columns down to which a Gram matrix keeps enough digits


def thin_svd(M: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return U, s, V^T of M, with min(M.shape) singular values.

    The divide-and-conquer algorithm sometimes does not converge if half of the singular values are zero to rounding;
    the slower QR algorithm does.
    """
    try:
        return np.linalg.svd(M, full_matrices=False)
    except np.linalg.LinAlgError:
        U, s, Vt = svd(M, full_matrices=False, lapack_driver="gesvd")
        return U, s, Vt


def extreme_singular_values(R: FloatArray) -> tuple[float, float] | None:
    """Return the largest and the smallest singular value of a wide triangle whose condition is far from 1 / rounding.

    They are found by Lanczos' method on R'R and on its inverse, to rounding, in some fifty products and solutions: a
    hundredth of the time of the decomposition of 1000 columns. None where the triangle is narrow or nearly singular.
    """
    n = R.shape[1]
    if R.shape[0] != n or n < _WIDE or dtrcon(R, norm="1", uplo="U")[0] <= SAFE:
        return None
    F, start = np.asfortranarray(R), np.random.default_rng(0).standard_normal(n)
    pairs = (lambda x: dtrmv(F, dtrmv(F, x), trans=1), lambda x: dtrsv(F, dtrsv(F, x, trans=1)))
    try:
        largest, inverse = (
            float(eigsh(LinearOperator((n, n), matvec=f, dtype=float), k=1, v0=start, return_eigenvectors=False)[0])
            for f in pairs
        )
    except ArpackError:
        return None
    return float(np.sqrt(largest)), float(1.0 / np.sqrt(inverse))


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
    if rows.shape[0] < TALL * rows.shape[1]:
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
    series: Sequence[FloatArray], good: Sequence[NDArray[np.bool_]], length: int, lead: int = 0
) -> tuple[FloatArray, int]:
    """Return the R factor of all windows of all series, and the number of windows less that of the lead columns.

    With ``lead`` = 1 a constant per series, with 2 a constant and a linear trend in the window's first sample are
    projected out of every row of the block Hankel matrix. A constant and a linear trend of the inputs, of the outputs
    and of the states reach its rows as such, so that this removes them exactly, as extra inputs per series would.

    Long series take the Gram matrix G of the windows, whose blocks obey G[i+1, j+1] = G[i, j] + a rank-two change
    (displacement structure: N. Mastronardi et al. 2001, V. Sima 2004), and its Cholesky factor. Squaring costs half
    the digits, therefore it is used only where the columns, scaled to unit length, have a condition below 1e4;
    elsewhere windows are folded into a triangle chunk by chunk.

    Args:
        series: (N, d) each.
        good: (N,) each, False for samples that no window may touch.
        length: of the windows, in samples.
        lead: 0, 1 or 2.
    """
    windows_of = BlockHankel(series, good, (length,), lead)
    quick = windows_of.quick(length)
    return (quick, windows_of.columns(length)) if quick is not None else windows_of.folded(length)


def trend(at: NDArray[np.intp], first: NDArray[np.intp], lead: int) -> FloatArray:
    """Return 1 and the time from -1 to 1 over the series, as columns."""
    middle, half = 0.5 * (first[0] + first[-1]), max(0.5 * (first[-1] - first[0]), 0.5)
    return np.stack([np.ones(at.size), (at - middle) / half], axis=1)[:, :lead]


def centred(z: FloatArray, lead: int) -> FloatArray:
    """Return the series less its mean where constants are projected out anyway: sums of squares then keep digits.

    Time first in memory, so that blocks of samples are views.
    """
    return np.ascontiguousarray(z - z.mean(axis=0) if lead else z)


def lag_products(z: FloatArray, begin: int, end: int, length: int) -> FloatArray:
    """Return sum over k = begin, ..., end - 1 of z[k]' [z[k], ..., z[k + length - 1]], shape (d, length d).

    Samples are taken in blocks of B, which are views: the products of the blocks with themselves and with the blocks
    after them hold every product of samples less than ``length`` apart once, in matrices large enough to be quick.
    """
    d = z.shape[1]
    out = np.zeros((d, length * d))
    B = max(_BLOCK // d, 4)
    following = -(-(B - 1 + length) // B)
    count = min((end - begin) // B, (len(z) - begin) // B - following + 1)
    if count > B:
        X = z[begin : begin + count * B].reshape(count, B * d)
        P = np.hstack(
            [X.T @ z[begin + i * B :][: count * B].reshape(count, B * d) for i in range(following)]
        )  # P[a, b] = sum of z[iB + a]' z[iB + b]: lag b - a
        for a in range(B):
            out += P[a * d : (a + 1) * d, a * d : (a + length) * d]
        begin += count * B
    for j in range(length if begin < end else 0):
        out[:, j * d : (j + 1) * d] += z[begin:end].T @ z[begin + j : end + j]
    return out


def _gram(z: FloatArray, first: NDArray[np.intp], row: FloatArray, length: int, lead: int) -> FloatArray:
    """Return the Gram matrix of a series' windows, trends projected out, from its first block row (d, length d)."""
    d = z.shape[1]
    width = length * d
    own = np.zeros((width, width))
    own[:d] = row
    # The first block row is a sum over the runs, and so are the changes from one block row to the next.
    cut = np.flatnonzero(np.diff(first) > 1)
    left, right = np.append(first[0], first[cut + 1]), np.append(first[cut], first[-1]) + 1
    gone, come = (
        z[np.minimum(edge[:, None] + np.arange(length), len(z) - 1)].reshape(edge.size, width) for edge in (left, right)
    )  # the last sample after a run is never used
    for i in range(length - 1):
        here, there = slice(i * d, (i + 1) * d), slice((i + 1) * d, (i + 2) * d)
        own[there, d:] = own[here, :-d] + come[:, here].T @ come[:, :-d] - gone[:, here].T @ gone[:, :-d]
    if lead:
        between = np.zeros((lead, width))
        for part in np.split(first, cut + 1):
            begin, end = int(part[0]), int(part[-1]) + 1
            line = trend(part, first, lead)
            for j in range(length):
                between[:, j * d : (j + 1) * d] += line.T @ z[begin + j : end + j]
        line = trend(first, first, lead)
        own = own - between.T @ np.linalg.solve(line.T @ line, between)
    return np.triu(own) + np.triu(own, 1).T  # the recursion fills the upper triangle


class BlockHankel:
    """The block Hankel matrices of one set of series for windows of several lengths: R factors that share their work.

    The Gram matrix of every length begins with the same products of samples; they are summed once, for the windows of
    the greatest length, and the few windows that a shorter length has beyond those are added.

    Args:
        series: (N, d) each.
        good: (N,) each, False for samples that no window may touch.
        lengths: of windows that will be asked for.
        lead: 0, 1 or 2, see :func:`block_factor`.
    """

    def __init__(
        self, series: Sequence[FloatArray], good: Sequence[NDArray[np.bool_]], lengths: Sequence[int], lead: int = 0
    ) -> None:
        self.series = [np.ascontiguousarray(z) for z in series]
        self.lead, self._good, self._runs = lead, good, [list(runs(known)) for known in good]
        self._width = series[0].shape[1]
        long = [length for length in lengths if self._long(length)]
        self._longest = max(long, default=0)
        self._centred: list[FloatArray] = []
        self._rows: list[dict[int, FloatArray]] = []

    def starts(self, length: int) -> list[NDArray[np.intp]]:
        """Return the first samples of all windows of that length, per series."""
        return [window_starts(good, length) for good in self._good]

    def columns(self, length: int) -> int:
        """Return the number of windows, less what the lead columns take."""
        windows_of = (sum(max(run.stop - run.start - length + 1, 0) for run in known) for known in self._runs)
        return sum(max(count - self.lead, 0) for count in windows_of)

    def factor(self, length: int) -> tuple[FloatArray, int]:
        """Return what :func:`block_factor` does of all windows of that length, sooner where that would take long."""
        quick = self._by_gram(length) if self._long(length) or self._costly(length) else None
        if quick is not None:
            return quick, self.columns(length)
        return self.folded(length)

    def folded(self, length: int) -> tuple[FloatArray, int]:
        """Return the same, windows folded into a triangle chunk by chunk."""
        lead, width = self.lead, length * self._width
        R = np.zeros((0, width))
        for z, first in zip(self.series, self.starts(length), strict=True):
            if first.size <= lead:
                continue
            part = np.zeros((0, width + lead)) if lead else R
            for at, rows in windows(z, first, length):
                part = triangle(part, np.hstack([trend(at, first, lead), rows]) if lead else rows)
            R = triangle(R, part[lead:, lead:]) if lead else part
        return R, self.columns(length)

    def quick(self, length: int) -> FloatArray | None:
        """Return the factor by way of the Gram matrix, None for short or ill-conditioned data."""
        return self._by_gram(length) if self._long(length) else None

    def _by_gram(self, length: int) -> FloatArray | None:
        if length > self._longest or not self._rows:
            self._longest = max(length, self._longest)
            self._centred = [centred(z, self.lead) for z in self.series]
            self._rows = [self._shared(z, known) for z, known in zip(self._centred, self._runs, strict=True)]
        grams = [
            _gram(z, first, self._row(z, known, shared, length), length, self.lead)
            for z, known, shared, first in zip(self._centred, self._runs, self._rows, self.starts(length), strict=True)
            if first.size > self.lead
        ]
        G = np.sum(grams, axis=0)
        return cholesky_factor(G) if grams and np.all(np.diag(G) > 0.0) else None

    def _long(self, length: int) -> bool:
        return self.columns(length) >= _LONG * length * self._width

    def _costly(self, length: int) -> bool:
        columns, width = self.columns(length), length * self._width
        return columns >= width and columns * width**2 > _COSTLY

    def _base(self, run: slice) -> int:
        """Length of the windows of a run whose lag products are shared."""
        return min(self._longest, run.stop - run.start)

    def _shared(self, z: FloatArray, known: Sequence[slice]) -> dict[int, FloatArray]:
        """Return base length -> lag products of the windows of that length, summed over the runs with that base."""
        out: dict[int, FloatArray] = {}
        for run in known:
            base = self._base(run)
            row = lag_products(z, run.start, run.stop - base + 1, base)
            out[base] = out[base] + row if base in out else row
        return out

    def _row(self, z: FloatArray, known: Sequence[slice], shared: dict[int, FloatArray], length: int) -> FloatArray:
        """Return the first block row of the Gram matrix of the windows of ``length``, from shared lag products."""
        width = length * self._width
        out = np.zeros((self._width, width))
        for base, row in shared.items():
            if base >= length:
                out += row[:, :width]
        more = [  # windows beyond the shared ones
            np.arange(run.stop - self._base(run) + 1, run.stop - length + 1)
            for run in known
            if run.stop - run.start >= length
        ]
        for part, rows in windows(z, np.concatenate(more), length):
            out += z[part].T @ rows
        return out


def predict(z: FloatArray, theta: FloatArray, length: int) -> FloatArray:
    """Return [z[k], ..., z[k + length - 1]] theta for all k, shape (N - length + 1, p), of theta (length d, p).

    Done for blocks of samples at once, which are views, with theta set out as a block Toeplitz matrix.
    """
    d, p = z.shape[1], theta.shape[1]
    total = len(z) - length + 1
    out = np.zeros((max(total, 0), p))
    B = max(_BLOCK // d, 4)
    following = -(-(B - 1 + length) // B)
    count = max(len(z) // B - following + 1, 0)
    T = np.zeros((following * B * d, B * p))
    for b in range(B):
        T[b * d : (b + length) * d, b * p : (b + 1) * p] = theta
    done = count * B
    inner = out[:done].reshape(count, B * p)
    for i in range(following if count else 0):
        inner += z[i * B :][: count * B].reshape(count, B * d) @ T[i * B * d : (i + 1) * B * d]
    for part, rows in windows(z, np.arange(done, total), length):
        out[part] = rows @ theta
    return out
