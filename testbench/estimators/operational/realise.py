"""From covariances to the poles of every order, and to the first-order change of them by each block of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray

_RANK = 1e-11  # singular values below this share of the first are rounding
_REAL = 1e-9  # imaginary parts below this share of |s| are rounding


@dataclass(frozen=True, eq=False)
class OrderPoles:
    """The poles of a model of one order in the upper half plane.

    Attributes:
        order: number of states n.
        poles: (k,) continuous poles s = ln(z) / dt with Im s > 0, rad/s; unstable ones included, real ones not.
        shapes: (k, r) mode shapes C v of the (scaled) outputs, of unit length.
        moves: (b, k) first-order changes of the poles by the deviation of each block; None without deviations.
    """

    order: int
    poles: ComplexArray
    shapes: ComplexArray
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
    found = _upper(z)
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


def _upper(z: ComplexArray) -> NDArray[np.intp]:
    """Return which poles stand for a pair: those of the upper half plane, real ones (z <= 0 as well) left out."""
    return np.flatnonzero(z.imag > _REAL * np.abs(z))
