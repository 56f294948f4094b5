"""Innovations of a filter with constant gain along a record, for all complex steps at once.

Steady-state Kalman filter of a sampled linear system, and its exact derivatives.

    x[k+1] = Phi x[k] + w[k],  E w w' = Q,    y[k] = C x[k] + v[k],  E v v' = R
    P = Phi (P - P C' S^-1 C P) Phi' + Q,     S = C P C' + R,     K = P C' S^-1

The eigenvalues of K C lie between 0 and 1 for every Q and R: the condition that Maine and Iliff (NASA TP 1690, 1981,
section 3) have to impose on a gain P C' R^-1 made with the innovations' covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from testbench.core.record import FloatArray
from testbench.estimators.parametric.response import Sampling, discretise, runge_kutta
from testbench.estimators.parametric.structure import STEP, AnyArray, LinearStructure, ModelStructure
from testbench.estimators.trajectories import Trajectories

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


class Rows(NamedTuple):
    """One point per row, the last one nominal, the others complex steps from it: parameters (rows, k), initial state
    (rows, n), constants added to the inputs (rows, m), gain (rows, n, p)."""

    params: AnyArray
    x0: AnyArray
    shift: AnyArray
    K: AnyArray


class Run(NamedTuple):
    """Innovations (N, rows, p), zero where not valid, and predicted states (N, rows, n)."""

    v: AnyArray
    x: AnyArray


def innovations(
    structure: ModelStructure, rows: Rows, u: FloatArray, y: AnyArray, valid: NDArray[np.bool_], sampling: Sampling
) -> Run:
    """Run x+ = prediction of (x + K v), v = y - h(x, u) over a record.

    Linear structures are predicted exactly, others by Runge-Kutta steps. Outputs that were not measured correct
    nothing: their innovations are zero.

    Args:
        structure: the equations.
        rows: where to evaluate.
        u: inputs (N, m).
        y: measured outputs less their offsets, (N, rows, p).
        valid: (N, p) which of them count.
        sampling: of the record.
    """
    if isinstance(structure, LinearStructure):
        return _linear(structure, rows, u, y, valid, sampling)
    N, count = len(u), len(rows.params)
    v, x = np.zeros((N, count, y.shape[2]), complex), np.zeros((N, count, rows.x0.shape[1]), complex)
    du = np.where(sampling.held, 0.0, np.diff(u, axis=0, append=u[-1:]))
    X = rows.x0
    for k in range(N):
        x[k] = X
        v[k] = np.where(valid[k], y[k] - structure.output(X, u[k] + rows.shift, rows.params), 0.0)
        if k == N - 1:
            break
        X = X + (rows.K @ v[k][:, :, None])[:, :, 0]
        X = runge_kutta(structure, X, u[k] + rows.shift, du[k], rows.params, sampling.dt_s, sampling.substeps)
        if not np.all(np.isfinite(X)):
            return Run(np.full_like(v, np.inf), x)
    return Run(v, x)


def _linear(
    structure: LinearStructure, rows: Rows, u: FloatArray, y: AnyArray, valid: NDArray[np.bool_], sampling: Sampling
) -> Run:
    """Run the nominal row, then the complex steps: linear, x and v known, all of them obey x+ = A (1 - K M C) x + F."""
    s = structure.matrices(rows.params)
    d = discretise(s, sampling.dt_s, sampling.held)
    N, count, n = len(u), len(rows.params), rows.x0.shape[1]
    shift = rows.shift[:, :, None]
    level, offset = d.g + (d.G @ shift)[:, :, 0], s.by + (s.D @ shift)[:, :, 0]
    du, one = np.diff(u, axis=0, append=u[-1:]), np.ones((N, 1))
    mask = valid.astype(float)
    A, K, C = d.A[-1].real, rows.K[-1].real, s.C[-1].real
    correct = A @ K
    every = bool(valid.all())
    closed = np.broadcast_to(A - np.einsum("ij,kj,jl->kil", correct, mask[: 1 if every else N], C), (N, n, n))
    drive = u @ d.G[-1].real.T + du @ d.H[-1].real.T + level[-1].real
    rest = mask * (y[:, -1].real - u @ s.D[-1].real.T - offset[-1].real)
    paths = _Paths(closed, every)
    x = paths.run((drive + rest @ correct.T)[:, :, None], rows.x0[-1].real[:, None])[:, :, 0]
    v = rest - mask * (x @ C.T)
    out = Run(np.empty((N, count, v.shape[1]), complex), np.empty((N, count, n), complex))
    out.v[:], out.x[:] = v[:, None], x[:, None]
    if count == 1:
        return out

    def moved(signals: list[AnyArray], by: list[AnyArray]) -> FloatArray:
        """Return the sum of derivatives (rows, i, j) times signals (N, j), (N, rows, i), in units of the step."""
        stacked = np.concatenate([part[:-1].imag for part in by], axis=2)
        return np.asarray((np.hstack(signals) @ stacked.reshape(-1, stacked.shape[2]).T).reshape(N, count - 1, -1))

    signals: list[AnyArray] = [x + v @ K.T, v, u, du, one]
    force = moved(signals, [d.A, A @ rows.K, d.G, d.H, level[:, :, None]])
    seen = mask[:, None] * (y[:, :-1].imag - moved([x, u, one], [s.C, s.D, offset[:, :, None]]))
    force += seen @ correct.T
    dx = paths.run(force.transpose(0, 2, 1), rows.x0[:-1].imag.T).transpose(0, 2, 1)
    out.x[:, :-1].imag = dx
    out.v[:, :-1].imag = seen - mask[:, None] * (dx @ C.T)
    return out


class _Paths:
    """x[k+1] = A[k] x[k] + f[k]: mode by mode where A (N, n, n) is one matrix that does not grow, else in turn."""

    def __init__(self, A: FloatArray, constant: bool) -> None:
        self.A = A
        bounded = constant and np.all(np.isfinite(A[0])) and np.max(np.abs(np.linalg.eigvals(A[0]))) <= 1.0
        self.modes = Trajectories(A[0], len(A) + 1) if bounded else None

    def run(self, force: FloatArray, first: FloatArray) -> FloatArray:
        """Return x (N, n, b) from ``first`` (n, b) under ``force`` (N, n, b)."""
        if self.modes is not None:
            return self.modes.forced(np.concatenate([first[None], force]))[1:]
        x = np.empty(force.shape)
        x[0] = first
        for k in range(len(force) - 1):
            np.matmul(self.A[k], x[k], out=x[k + 1])
            x[k + 1] += force[k]
        return x
