"""From covariances to the poles of every order, and to the first-order change of them by each block of the data.

Covariances of outputs with reference outputs over lags, and the scatter of each by chance.

The modal assurance criterion: how alike two mode shapes are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray


def mac(one: ComplexArray, other: ComplexArray) -> float:
    """Return the modal assurance criterion |a^H b|^2 / (a^H a b^H b) of two mode shapes (r,); 0 if one vanishes."""
    size = float(np.vdot(one, one).real * np.vdot(other, other).real)
    return float(abs(np.vdot(one, other)) ** 2 / size) if size > 0.0 else 0.0


Masked = tuple[FloatArray, NDArray[np.bool_]]
"""Samples (n, r) of zero mean and which of them were taken."""


@dataclass(frozen=True, eq=False)
class Covariances:
    """R_i = E[y(k+i) y_ref(k)'] for i = 1 .. L."""

    lags: FloatArray  # (L, r, r0) R_1 to R_L
    # (b, L, r, r0) of b blocks of the data: the covariance of all elements of ``lags`` is the sum over the blocks of
    # the outer products of their deviations
    deviations: FloatArray


def covariances(data: Sequence[Masked], references: Sequence[int], count: int, blocks: int) -> Covariances:
    """Estimate R_1 to R_count over all records, each pair of samples that were both taken counting once.

    An element is the ratio of two sums, S of products over N of pairs. Blocks of consecutive k are nearly independent,
    so that to first order (Taylor expansion of the ratio; W. G. Cochran, Sampling Techniques, 1977, section 6.3)

        cov(R) = b / (b - 1) sum_b d_b d_b',  d_b = (S_b - R N_b) / N.

    The pairs of a block may reach ``count`` samples into the next one.

    Args:
        data: samples (n, r) and validity of each record, means removed; different lengths.
        references: columns that the outputs are correlated with.
        count: of lags, L.
        blocks: wanted in all records together; records are divided in proportion to their length.

    Raises:
        EstimationError: a pair of channels was never taken at the same time at some lag, or fewer than two blocks are
            left.
    """
    total = sum(len(y) for y, _ in data)
    sums, pairs = [], []
    for y, valid in data:
        if len(y) <= count:
            continue
        y, known = np.where(valid, y, 0.0), valid.astype(np.float64)
        own = max(1, round(blocks * len(y) / total))
        edges = np.linspace(0, len(y) - 1, own + 1).astype(int)
        for begin, end in pairwise(edges):
            sums.append(_products(y, references, begin, end, count))
            pairs.append(_products(known, references, begin, end, count))
    if len(sums) < 2:
        raise EstimationError(f"covariances need records longer than {count} samples and two blocks; give more data")
    S, N = np.array(sums), np.array(pairs)
    every = N.sum(axis=0)
    if not np.all(every > 0.0):
        lag, a, b = np.argwhere(every == 0.0)[0]
        raise EstimationError(
            f"every two outputs must have been sampled together, but outputs {a} and {references[b]} never were at "
            f"a lag of {lag + 1} samples; leave one of them out or give more data"
        )
    R = S.sum(axis=0) / every
    return Covariances(R, np.sqrt(len(S) / (len(S) - 1)) * (S - R * N) / every)


def _products(y: FloatArray, references: Sequence[int], begin: int, end: int, count: int) -> FloatArray:
    """Return the sums over begin <= k < end of y(k+i) y_ref(k)', (count, r, r0); none reach beyond it."""
    held = y[:, references]
    out = np.empty((count, y.shape[1], len(references)))
    for i in range(1, count + 1):
        last = min(end, len(y) - i)
        out[i - 1] = y[begin + i : last + i].T @ held[begin:last] if last > begin else 0.0
    return out


_RANK = 1e-11  # singular values below this share of the first are rounding
_REAL = 1e-9  # imaginary parts below this share of |s| are rounding


@dataclass(frozen=True, eq=False)
class OrderPoles:
    """The poles of a model of one order in the upper half plane."""

    order: int  # number of states n
    # (k,) continuous poles s = ln(z) / dt with Im s > 0, rad/s; unstable ones included, real ones not
    poles: ComplexArray
    shapes: ComplexArray  # (k, r) mode shapes C v of the (scaled) outputs, of unit length
    # (b, k) first-order changes of the poles by the deviation of each block; None without deviations
    moves: ComplexArray | None


def hankel(lags: FloatArray, columns: int) -> FloatArray:
    """Return the block Hankel matrix with R_(i+j+1) in block row i and column j; (L - columns + 1) block rows.

    Args:
        lags: (..., L, r, r0) covariances R_1 to R_L; leading axes are kept.
        columns: number of block columns.
    """
    *lead, count, r, r0 = lags.shape
    rows = count - columns + 1
    index = np.arange(rows)[:, None] + np.arange(columns)
    blocks = np.moveaxis(lags[..., index, :, :], -2, -3)  # (..., rows, r, columns, r0)
    return np.ascontiguousarray(blocks).reshape(*lead, rows * r, columns * r0)


def realise(
    lags: FloatArray, dt_s: float, columns: int, orders: Sequence[int], deviations: FloatArray | None = None
) -> tuple[list[OrderPoles], FloatArray]:
    """Return the poles of every order, and the singular values.

    Covariance-driven stochastic subspace identification (B. Peeters and G. De Roeck, "Reference-based stochastic
    subspace identification for output-only modal analysis", Mechanical Systems and Signal Processing 13(6), 1999):
    R_i = C A^(i-1) G, so that the block Hankel matrix H of R_1, R_2, ... is the product of the observability matrix
    O = [C; CA; ...] and of [G, AG, ...]. The first n left singular vectors of H span O; C is its first block row, and
    A solves O without its last block row times A = O without its first one.

    Deviations dH are carried to the poles (E. Reynders, R. Pintelon and G. De Roeck, "Uncertainty bounds on modal
    parameters obtained from stochastic subspace identification", MSSP 22(4), 2008; M. Doehler and L. Mevel, "Efficient
    multi-order uncertainty computation for stochastic subspace identification", MSSP 38(2), 2013). With H = U S V', the
    part of du_j outside of the space kept is, for i > n >= j,

        u_i' du_j = (s_j u_i' dH v_j + s_i v_i' dH' u_j) / (s_j^2 - s_i^2);

    the part inside changes the basis and no pole. A pole z with A v = z v, w A = z w and w v = 1 moves by w dA v.

    Args:
        lags: (L, r, r0) R_1 to R_L of the scaled outputs.
        dt_s: lag of one sample, s.
        columns: number of block columns, below L.
        orders: even or odd; those above the numerical rank of H, or that H has no room for, are left out.
        deviations: (b, L, r, r0) of the blocks, or None.
    """
    r = lags.shape[1]
    H = hankel(lags, columns)
    U, sigma, Vt = np.linalg.svd(H)
    rank = int(np.sum(sigma > _RANK * sigma[0])) if sigma[0] > 0.0 else 0
    usable = [n for n in orders if n <= min(rank, H.shape[0] - r, sigma.size)]
    if not usable:
        return [], sigma
    turns = None if deviations is None else _turns(hankel(deviations, columns), U, sigma, Vt, max(usable))
    return [_at_order(n, U, r, dt_s, turns) for n in usable], sigma


def _turns(dH: FloatArray, U: FloatArray, sigma: FloatArray, Vt: FloatArray, most: int) -> FloatArray:
    """Return u_i' du_j for all i and j < most, (b, m, most); what is meant for i = j is zero and never used."""
    m, s = U.shape[0], sigma[:most]
    first = U.T @ (dH @ Vt[:most].T)
    second = np.zeros_like(first)
    second[:, : Vt.shape[0]] = Vt @ (dH.transpose(0, 2, 1) @ U[:, :most])
    left = np.zeros(m)
    left[: sigma.size] = sigma
    apart = s**2 - left[:, None] ** 2
    near = apart == 0.0
    return np.asarray((first * s + second * left[:, None]) / np.where(near, 1.0, apart) * ~near)


def _at_order(n: int, U: FloatArray, r: int, dt_s: float, turns: FloatArray | None) -> OrderPoles:
    kept, rest = U[:, :n], U[:, n:]
    up, down = kept[:-r], kept[r:]
    inverse = np.asarray(np.linalg.pinv(up), np.float64)
    z, right = np.linalg.eig(inverse @ down)
    z, right = z.astype(np.complex128), right.astype(np.complex128)
    left = np.linalg.solve(right, np.eye(n))
    found = np.flatnonzero(z.imag > _REAL * np.abs(z))  # one of each pair; real ones (z <= 0 as well) are none
    s = np.log(z[found]) / dt_s
    v, w = right[:, found], left[found]
    shapes = (kept[:r] @ v).T
    size = np.linalg.norm(shapes, axis=1)
    shapes = shapes / np.where(size > 0.0, size, 1.0)[:, None]
    moves = None
    if turns is not None:
        Y = turns[:, n:, :n]
        a = w @ inverse
        ahead = a @ rest[r:] - z[found, None] * (a @ rest[:-r])  # (k, m - n), of dO without its first block row
        misfit = rest[:-r].T @ (down @ v - z[found] * (up @ v))  # (m - n, k), of the least squares' residual
        g = w @ (inverse @ inverse.T)
        dz = np.sum(ahead.T * (Y @ v), axis=1) + np.sum(misfit * (Y @ g.T), axis=1)
        moves = dz / (z[found] * dt_s)
    return OrderPoles(n, np.asarray(s, np.complex128), np.asarray(shapes, np.complex128), moves)
