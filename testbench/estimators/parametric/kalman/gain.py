"""Steady-state Kalman filter of a sampled linear system, and its exact derivatives.

    x[k+1] = Phi x[k] + w[k],  E w w' = Q,    y[k] = C x[k] + v[k],  E v v' = R
    P = Phi (P - P C' S^-1 C P) Phi' + Q,     S = C P C' + R,     K = P C' S^-1

The eigenvalues of K C lie between 0 and 1 for every Q and R: the condition that Maine and Iliff (NASA TP 1690, 1981,
section 3) have to impose on a gain P C' R^-1 made with the innovations' covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import STEP, AnyArray

_DOUBLINGS = 60  # 2^60 samples: what has not converged by then never will


class Gain(NamedTuple):
    """Gain K (..., n, p), and S (..., p, p), the covariance that the innovations should have."""

    K: AnyArray
    S: AnyArray


def sampled_noise(A: AnyArray, F: AnyArray, dt_s: float) -> tuple[AnyArray, AnyArray]:
    """Return the transition matrix and the covariance of the process noise gathered over one sample.

        Phi = exp(A dt),    Q = integral exp(A s) F F' exp(A' s) ds

    C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978.

    Args:
        A: (..., n, n) continuous state matrix.
        F: (..., n) noise of every state, unit of the state per square root of a second, each of its own; or (..., n, n)
            noise of every state, by rows, from sources that states share.
        dt_s: sample time, s.
    """
    n = A.shape[-1]
    M = np.zeros((*A.shape[:-2], 2 * n, 2 * n), np.result_type(A, F))
    M[..., :n, :n], M[..., n:, n:] = -A, np.swapaxes(A, -1, -2)
    if F.ndim < A.ndim:
        M[..., range(n), range(n, 2 * n)] = F**2
    else:
        M[..., :n, n:] = F @ np.swapaxes(F, -1, -2)
    E = expm(M * dt_s)
    Phi = np.swapaxes(E[..., n:, n:], -1, -2)
    return Phi, Phi @ E[..., :n, n:]


def steady_covariance(Phi: FloatArray, C: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """Return the covariance P (n, n) of the predicted states once the filter has settled.

    Structure-preserving doubling (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, International Journal of Control
    77, 2004): step i holds the covariance after 2^i samples from a known state.

    Args:
        Phi: (n, n) transition matrix.
        C: (p, n) output matrix.
        Q: (n, n) covariance of the process noise.
        R: (p,) variances of the measurement noise.

    Returns:
        P; not finite where it grows without bound (an unstable mode that no output shows).
    """
    n = len(Phi)
    A, G, H = Phi.T, (C.T / R) @ C, Q
    for _ in range(_DOUBLINGS):
        inner = np.linalg.solve(np.eye(n) + G @ H, np.hstack([A, G]))
        grown = A.T @ H @ inner[:, :n]
        A, G, H = A @ inner[:, :n], G + A @ inner[:, n:] @ A.T, H + 0.5 * (grown + grown.T)
        if not np.all(np.isfinite(H)):
            return np.full((n, n), np.inf)
        size = np.sqrt(np.maximum(np.diag(H), 0.0))  # a variance of nothing may round below it
        if np.all(np.abs(grown) <= 1e-15 * np.outer(size, size)):
            break
    return H


def steady_gain(A: AnyArray, C: AnyArray, F: AnyArray, G: FloatArray, dt_s: float) -> Gain | None:
    """Return the steady filter of the last row, with complex steps along the other rows carried through exactly.

    At the solution dP = M dP M' + W with M = Phi (I - K C), where W is the derivative of the right-hand side of the
    Riccati equation at fixed P: a linear equation for every row at once, nothing is iterated or subtracted.

    Args:
        A: (rows, n, n) continuous state matrix; complex.
        C: (rows, p, n) output matrix; complex.
        F: (rows, n) or (rows, n, n) process noise per square root of a second, as of :func:`sampled_noise`; complex.
        G: (p,) standard deviation of the measurements.
        dt_s: sample time, s.

    Returns:
        The gain, complex; None where the filter does not settle.
    """
    n = A.shape[-1]
    Phi, Q = sampled_noise(A, F, dt_s)
    if not np.all(np.isfinite(Phi)) or not np.all(np.isfinite(Q)):
        return None
    P = steady_covariance(Phi[-1].real, C[-1].real, Q[-1].real, G**2)
    if not np.all(np.isfinite(P)):
        return None
    R = np.diag(G**2)
    CP = C @ P
    S = CP @ C.transpose(0, 2, 1) + R
    after = Phi @ (P - CP.transpose(0, 2, 1) @ np.linalg.solve(S, CP)) @ Phi.transpose(0, 2, 1) + Q
    W = after.imag / STEP
    closed = Phi[-1].real @ (np.eye(n) - np.linalg.solve(S[-1].real, CP[-1].real).T @ C[-1].real)
    dP = np.linalg.solve(np.eye(n * n) - np.kron(closed, closed), W.reshape(len(W), -1).T).T.reshape(W.shape)
    P = P + 1j * STEP * dP
    CP = C @ P
    S = CP @ C.transpose(0, 2, 1) + R
    return Gain(np.linalg.solve(S, CP).transpose(0, 2, 1), S)
