"""Innovations of a filter with constant gain along a record, all complex steps side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.estimators.parametric.response import discretise, runge_kutta
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, ModelStructure
from testbench.record import FloatArray


class Rows(NamedTuple):
    """One point per row, the last one nominal: parameters (rows, k), initial state (rows, n), constants added to the
    inputs (rows, m), gain (rows, n, p)."""

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
    s = structure.matrices(rows.params)
    d = discretise(s, dt_s, held)
    N, count = len(u), len(rows.params)
    du = np.diff(u, axis=0, append=u[-1:])
    shift = rows.shift[:, :, None]
    drive = np.einsum("rij,kj->kri", d.G, u) + np.einsum("rij,kj->kri", d.H, du) + d.g + (d.G @ shift)[:, :, 0]
    rest = y - np.einsum("rij,kj->kri", s.D, u) - s.by - (s.D @ shift)[:, :, 0]
    correct = d.A @ rows.K
    drive, rest = drive[..., None], rest[..., None]
    mask = valid[:, None, :, None]
    v, x = np.zeros((N, count, y.shape[2], 1), complex), np.zeros((N, count, rows.x0.shape[1], 1), complex)
    X = rows.x0[:, :, None]
    for k in range(N):
        x[k] = X
        v[k] = mask[k] * (rest[k] - s.C @ X)
        X = d.A @ X + correct @ v[k] + drive[k]
    return Run(v[..., 0], x[..., 0])
