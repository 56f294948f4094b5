"""Innovations of a filter with constant gain along a record, for all complex steps at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.estimators.parametric.response import discretise, runge_kutta
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, ModelStructure
from testbench.estimators.trajectories import Trajectories


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
    structure: ModelStructure,
    rows: Rows,
    u: FloatArray,
    y: AnyArray,
    valid: NDArray[np.bool_],
    dt_s: float,
    held: NDArray[np.bool_],
    substeps: int = 1,
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
        dt_s: sample time, s.
        held: (m,) inputs that are held between samples; the others run linearly.
        substeps: Runge-Kutta steps per sample of a nonlinear structure.
    """
    if isinstance(structure, LinearStructure):
        return _linear(structure, rows, u, y, valid, dt_s, held)
    N, count = len(u), len(rows.params)
    v, x = np.zeros((N, count, y.shape[2]), complex), np.zeros((N, count, rows.x0.shape[1]), complex)
    du = np.where(held, 0.0, np.diff(u, axis=0, append=u[-1:]))
    X = rows.x0
    for k in range(N):
        x[k] = X
        v[k] = np.where(valid[k], y[k] - structure.output(X, u[k] + rows.shift, rows.params), 0.0)
        if k == N - 1:
            break
        X = X + (rows.K @ v[k][:, :, None])[:, :, 0]
        X = runge_kutta(structure, X, u[k] + rows.shift, du[k], rows.params, dt_s, substeps)
        if not np.all(np.isfinite(X)):
            return Run(np.full_like(v, np.inf), x)
    return Run(v, x)


def _linear(
    structure: LinearStructure,
    rows: Rows,
    u: FloatArray,
    y: AnyArray,
    valid: NDArray[np.bool_],
    dt_s: float,
    held: NDArray[np.bool_],
) -> Run:
    """Run the nominal row, then the complex steps: linear, x and v known, all of them obey x+ = A (1 - K M C) x + F."""
    s = structure.matrices(rows.params)
    d = discretise(s, dt_s, held)
    N, count, n = len(u), len(rows.params), rows.x0.shape[1]
    shift = rows.shift[:, :, None]
    level, offset = d.g + (d.G @ shift)[:, :, 0], s.by + (s.D @ shift)[:, :, 0]
    du, one = np.diff(u, axis=0, append=u[-1:]), np.ones((N, 1))
    mask = valid.astype(float)
    A, K, C = d.A[-1].real, rows.K[-1].real, s.C[-1].real
    correct = A @ K
    closed = A - np.einsum("ij,kj,jl->kil", correct, mask, C)
    drive = u @ d.G[-1].real.T + du @ d.H[-1].real.T + level[-1].real
    rest = mask * (y[:, -1].real - u @ s.D[-1].real.T - offset[-1].real)
    paths = _Paths(closed, bool(valid.all()))
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
