"""MOESP, N4SID, CVA and DSR: the future outputs, projected on the past, without what the future inputs do.

The first three are one algorithm with three weights (P. Van Overschee and B. De Moor, "A unifying theorem for three
subspace system identification algorithms", Automatica 31(12), 1995, table 1). With the past W, future inputs U_f,
future outputs Y_f, Pi the projection on the orthogonal complement of U_f, and the oblique projection
O = Y_f /_(U_f) W, the singular vectors of W1 O W2 give the range of W1 times the extended observability matrix:

    N4SID   W1 = I                       W2 = I
    MOESP   W1 = I                       W2 = Pi                (past outputs as instruments: PO-MOESP)
    CVA     W1 = (Y_f Pi Y_f')^(-1/2)    W2 = Pi

O Pi is the orthogonal projection of Y_f Pi on W Pi, so that only N4SID needs the oblique projection proper. Inputs
that are nearly predictable from their past make W Pi nearly singular, and N4SID divides by it; directions of W Pi
are therefore weighted by Tikhonov's s / (s^2 + (|w| / 2)^2) instead of 1 / s, with s what Pi leaves of a direction of
length |w|; a weight from the right leaves the range alone. A is the shift of the observability matrix.

DSR (D. Di Ruscio, "Combined deterministic and stochastic system identification and realization: DSR", Modeling,
Identification and Control 17(3), 1996) takes MOESP's projection with one more block row and A from
Z_{J+1|L} = A~ Z_{J|L}, A~ = O_L A O_L^+, instead of the shift: all L block rows bear on A.

All four correlate the noise with future inputs if these react to outputs: in closed loop they are biased.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.hankel import thin_svd
from testbench.estimators.subspace.factor import Factor, basis
from testbench.estimators.subspace.order import choose_order

_OBLIQUE = 0.5  # N4SID damps directions of the past of which the future inputs hide more than about this share


class Realisation(NamedTuple):
    """A (n, n), C (p, n) in the factor's units; singular values over the noise floor; B, D, K if regressed along."""

    A: FloatArray
    C: FloatArray
    singular_values: FloatArray
    order_choice: str
    B: FloatArray | None = None
    D: FloatArray | None = None
    K: FloatArray | None = None


def noise_floor(f: Factor, rows: int, largest: float) -> float:
    """Return the largest singular value that unit white noise projected on the past would have; for exact data, max."""
    return largest if f.exact else np.sqrt(f.R[:, : f.J * (f.m + f.p)].shape[1]) + np.sqrt(rows)


def pick(values: FloatArray, f: Factor, order: int | None, most: int) -> tuple[int, str]:
    """Return the given order, or the one that the singular values show."""
    return (order, "given") if order is not None else choose_order(values, not f.exact, most)


def _cleared(f: Factor, L: int) -> tuple[FloatArray, FloatArray]:
    """Return past and future outputs (columns) without what the future inputs explain."""
    Q = basis(f.inputs(f.J, f.J + L), f.tolerance)
    past, future = f.blocks(0, f.J), f.outputs(f.J, f.J + L)
    return past - Q @ (Q.T @ past), future - Q @ (Q.T @ future)


def _past_basis(f: Factor, past: FloatArray) -> FloatArray:
    """Basis of the cleared past; directions that were wholly in the future inputs are rounding and left out."""
    U, s, _ = thin_svd(past)
    size = np.linalg.norm(f.blocks(0, f.J), 2)
    out: FloatArray = U[:, s > max(f.tolerance, 1e-11) * size]
    return out


def by_shift(O_L: FloatArray, p: int) -> tuple[FloatArray, FloatArray]:
    """Return A and C from the extended observability matrix: O_L without its last block, times A, is its shift."""
    A: FloatArray = np.linalg.lstsq(O_L[:-p], O_L[p:], rcond=None)[0]  # type: ignore[assignment]
    return A, O_L[:p]


def moesp(f: Factor, L: int, order: int | None) -> Realisation:
    """PO-MOESP (M. Verhaegen 1994)."""
    past, future = _cleared(f, L)
    Z = _past_basis(f, past).T @ future
    _, s, Vt = thin_svd(Z)
    values = s / noise_floor(f, f.p * L, s[0])
    n, choice = pick(values, f, order, f.p * (L - 1))
    return Realisation(*by_shift(Vt[:n].T * np.sqrt(s[:n]), f.p), values, choice)


def n4sid(f: Factor, L: int, order: int | None) -> Realisation:
    """N4SID: the oblique projection without weights, A from the shift (its "robust" form takes states)."""
    if f.exact:
        return moesp(f, L, order)
    past, future = _cleared(f, L)
    U, s, Vt = thin_svd(past)
    W = f.blocks(0, f.J) @ Vt.T  # the same directions of the past, future inputs not taken out
    gain = W * s / np.maximum(s**2 + _OBLIQUE**2 * np.sum(W**2, axis=0), 1e-300)
    _, values, Vt = thin_svd(gain @ (U.T @ future))
    # unit noise times gain: the expected norm of a Gaussian matrix between given weights (Chevet's inequality)
    floor = np.linalg.norm(gain) + np.linalg.norm(gain, 2) * np.sqrt(f.p * L)
    n, choice = pick(values / floor, f, order, f.p * (L - 1))
    return Realisation(*by_shift(Vt[:n].T * np.sqrt(values[:n]), f.p), values / floor, choice)


def cva(f: Factor, L: int, order: int | None) -> Realisation:
    """CVA (W. E. Larimore 1990): canonical correlations c, shown as c / sqrt(1 - c^2), which noise leaves near 1."""
    if f.exact:
        return moesp(f, L, order)
    past, future = _cleared(f, L)
    O_L, values, _ = canonical(f, _past_basis(f, past), future)
    n, choice = pick(values, f, order, f.p * (L - 1))
    return Realisation(*by_shift(O_L[:, :n], f.p), values, choice)


def canonical(f: Factor, Q: FloatArray, future: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return O_L, singular values over the noise floor and states in the basis Q of the past, best correlated first.

    With the residual covariance E'E of the future, Z (E'E)^(-1/2) has the same singular vectors as the correlations.
    """
    Z = Q.T @ future
    rest = future - Q @ Z
    _, s, Vt = thin_svd(rest)
    unit = np.sqrt(max(f.columns - Q.shape[1], 1))
    s = np.maximum(s, 1e-6 * s[0]) / unit  # a future known exactly in some direction would weigh without bound
    X, values, Wt = thin_svd((Z @ Vt.T) / s)
    O_L = (Vt.T * s) @ Wt.T * np.sqrt(values)
    return O_L, values / noise_floor(f, future.shape[1], values[0]), X * np.sqrt(values)


def dsr(f: Factor, L: int, order: int | None) -> Realisation:
    """DSR: A from Z_{J+1|L} = A~ Z_{J|L}; the factor holds one more future block than L."""
    past, future = _cleared(f, L + 1)
    Z = _past_basis(f, past).T @ future
    p = f.p
    U, s, Vt = thin_svd(Z[:, : p * L])
    values = s / noise_floor(f, p * L, s[0])
    n, choice = pick(values, f, order, p * (L - 1))
    A = Vt[:n] @ Z[:, p:].T @ U[:, :n] / s[:n]
    return Realisation(A, Vt[:n, :p].T, values, choice)


PROJECTIONS: dict[str, Callable[[Factor, int, int | None], Realisation]] = {
    "moesp": moesp,
    "n4sid": n4sid,
    "cva": cva,
    "dsr": dsr,
}
