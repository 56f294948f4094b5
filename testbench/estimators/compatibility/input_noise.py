"""How the noise of rates and accelerations, which output error takes as exact, enters the errors of estimates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.compatibility.fit import Fit, Problem, Stretch, Whitener, noise_std
from testbench.estimators.compatibility.take_out import parameters
from testbench.estimators.parametric.response import Sampling, respond, runge_kutta
from testbench.estimators.parametric.structure import STEP


def score_of_input_noise(problem: Problem, fit: Fit, whitened: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance (c, c) that white noise of the inputs adds to the score sum_i J[i]' v[i].

    A sample u_j[k] with noise of variance s_j^2 moves all outputs after it. With the adjoint
    L[k] = L[k+1] A[k] + J[k]' H[k], the score moves by c_j[k] = L[k+1] B0_j[k] + L[k] B1_j[k-1] + J[k]' D_j[k], where
    B0 and B1 are the derivatives of a step by the input at its two ends, and the covariance is sum s_j^2 c c'. The
    variances come from third differences of the inputs. Delays of instruments, short against the record, are left out.

    Args:
        problem: the records.
        fit: where it is linearised.
        whitened: per record derivatives (N, p, c) of the whitened residuals.
    """
    columns = whitened[0].shape[2]
    out = np.zeros((columns, columns))
    variance = [noise_std(problem.stretches, j) ** 2 for j in range(len(problem.structure.inputs))]
    for s, x0, J in zip(problem.stretches, fit.x0, whitened, strict=True):
        c = _moved(problem, fit, s, x0, _adjoint_filter(J, s, fit.whiteners))
        out += np.einsum("j,kaj,kbj->ab", variance, c, c, optimize=True)
    return out


def _adjoint_filter(J: FloatArray, s: Stretch, whiteners: Sequence[Whitener]) -> FloatArray:
    """Return the transposed whitening filters applied to J (N, p, c): what multiplies residuals before whitening."""
    out = np.zeros_like(J)
    for i, w in enumerate(whiteners):
        rows = np.flatnonzero(s.valid[:, i])
        order = w.a.size
        if rows.size <= order:
            continue
        e = J[rows[order:], i] / w.std
        out[rows[order:], i] += e
        for j, a in enumerate(w.a):
            out[rows[order - 1 - j : rows.size - 1 - j], i] -= a * e
    return out


def _moved(problem: Problem, fit: Fit, s: Stretch, x0: FloatArray, J: FloatArray) -> FloatArray:
    """Return c (N, c, m): how each sample of each input moves the score."""
    structure, dt_s = problem.structure, problem.dt_s
    N, m = s.u.shape
    n = len(structure.states)
    p = parameters(structure, fit.values)
    x = respond(structure, p, (), s.u, Sampling(dt_s, problem.held), x0).x
    rows = n + 2 * m
    X = np.tile(x[:, None, :].astype(complex), (1, rows, 1))
    U = np.tile(s.u[:, None, :].astype(complex), (1, rows, 1))
    dU = np.tile(np.diff(s.u, axis=0, append=s.u[-1:])[:, None, :].astype(complex), (1, rows, 1))
    X[:, np.arange(n), np.arange(n)] += 1j * STEP
    U[:, n + np.arange(m), np.arange(m)] += 1j * STEP
    dU[:, n + np.arange(m), np.arange(m)] -= 1j * STEP  # the end of the step stays
    dU[:, n + m + np.arange(m), np.arange(m)] += 1j * STEP
    P = np.broadcast_to(p, (N, rows, p.size))
    step = runge_kutta(structure, X, U, dU, P, dt_s).imag.transpose(0, 2, 1) / STEP
    A, B0, B1 = step[:, :, :n], step[:, :, n : n + m], step[:, :, n + m :]
    read = structure.output(X, U, P).imag.transpose(0, 2, 1) / STEP
    H, D = read[:, :, :n], read[:, :, n : n + m]
    Jt = J.transpose(0, 2, 1)
    felt, c = Jt @ H, Jt @ D
    L = felt[-1]
    c[-1] += L @ B1[-2]
    for k in range(N - 2, -1, -1):
        c[k] += L @ B0[k]
        L = L @ A[k] + felt[k]
        if k:
            c[k] += L @ B1[k - 1]
    return np.asarray(c)
