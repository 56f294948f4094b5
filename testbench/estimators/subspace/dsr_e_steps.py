"""The two steps of DSR_e: innovations from the past, then A, C, B and K of a deterministic problem (see ``dsr_e``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrcon

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.hankel import BlockHankel, block_factor, predict, runs, thin_svd, trend, window_starts
from testbench.estimators.state_space import Series, fit_inputs
from testbench.estimators.subspace.data import Stretch
from testbench.estimators.subspace.order import EXACT, choose_order
from testbench.estimators.subspace.projections import by_shift

_RANK = 1e-12  # truncation of projections of noise-free data
_RANK_NOISY = 1e-8  # with noise, weaker directions only let the noise in
SAFE = 1e-7
"""Reciprocal condition down to which a triangle projects as well as singular vectors do."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """Step 1: the predictor of y^d from the past, and per record y^d and e in units of the innovations' deviation."""

    stretches: Sequence[Stretch]
    windows: BlockHankel  # of [u, y]
    known: list[NDArray[np.bool_]]  # per record: where y^d and e are
    deviation: FloatArray  # (p,) of the innovations, in the units of the stretches; floored
    noisy: NDArray[np.bool_]  # (p,)
    columns: int
    unknowns: int
    condition: float
    excitation: float  # smallest over largest singular value of the past inputs
    lead: int  # offsets and trends per record that are projected out
    J: int
    theta: FloatArray  # (unknowns, p) past -> y^d, in the units of the stretches

    @cached_property
    def series(self) -> list[tuple[FloatArray, FloatArray]]:
        """(y^d, e) of every record, rows that are not ``known`` zero."""
        J, d = self.J, self.windows.series[0].shape[1]
        theta = np.zeros((-(-len(self.theta) // d) * d, self.theta.shape[1]))
        theta[: len(self.theta)] = self.theta
        out = []
        for z, stretch, known in zip(self.windows.series, self.stretches, self.known, strict=True):
            yd, e = np.zeros(stretch.y.shape), np.zeros(stretch.y.shape)
            if known.any():
                signal = predict(z, theta, len(theta) // d)
                yd[J:] = signal[: len(z) - J]
                if not known[J:].all():
                    yd[~known] = 0.0
            starts = np.flatnonzero(known)
            if self.lead and starts.size > self.lead:
                line = trend(starts, starts, self.lead)
                yd[known] += line @ np.linalg.lstsq(line, stretch.y[known] - yd[known], rcond=None)[0]
            for i, noisy in enumerate(self.noisy):
                if noisy:
                    np.subtract(stretch.y[:, i], yd[:, i], out=e[:, i], where=known)
                else:
                    np.copyto(yd[:, i], stretch.y[:, i], where=known)
            yd /= self.deviation
            e /= self.deviation
            out.append((yd, e))
        return out


class Realisation(NamedTuple):
    """Step 2: A, C in the units of step 1, and the singular values relative to the noise floor."""

    A: FloatArray
    C: FloatArray
    singular_values: FloatArray
    order_choice: str
    columns: int


class Inputs(NamedTuple):
    """B, D, K in the units of step 1, and the free run's errors.

    ``percent``: of all outputs, before and after the refinement of B and D; ``residual``: (p,) root mean square of
    y - y_free with the B and D that were kept, in the units of the stretches.
    """

    B: FloatArray
    D: FloatArray
    K: FloatArray
    percent: tuple[float, float]
    residual: FloatArray


def innovations(stretches: Sequence[Stretch], windows: BlockHankel, J: int, direct: bool) -> Innovations:
    """Step 1: project the outputs on the past by least squares, truncated where the past is rank deficient."""
    m, p, lead = stretches[0].u.shape[1], stretches[0].y.shape[1], windows.lead
    d = m + p
    q = J * d + (m if direct else 0)
    columns = windows.columns(J + 1)
    if columns < q + p:
        touched = sum(max(len(s.u) - J - lead, 0) for s in stretches) - columns
        raise EstimationError(
            f"step 1 of DSR_e needs more columns than unknowns: past_horizon = {J} gives {q} unknowns per output, "
            f"got {columns} columns ({touched} dropped for invalid samples); shorten past_horizon, give more data"
            + (", or decimate to the rate of the slowest sensor" if touched else "")
        )
    R, _ = windows.factor(J + 1)
    past, now = R[:, :q], R[:, J * d + m :]
    U, sigma, Vt = thin_svd(past)
    theta, noisy, rest = np.zeros((q, p)), np.ones(p, bool), np.zeros(p)
    size = np.sqrt(np.sum(now**2, axis=0))
    for tolerance in (_RANK, _RANK_NOISY):
        rank = int(np.sum(sigma > tolerance * sigma[0]))
        theta[:, noisy] = Vt[:rank].T @ ((U[:, :rank].T @ now[:, noisy]) / sigma[:rank, None])
        rest = np.sqrt(np.sum((now - past @ theta) ** 2, axis=0))
        noisy = rest > EXACT * size
        if not noisy.any():
            break
    deviation = rest / np.sqrt(max(columns - rank, 1))
    deviation = np.maximum(deviation, 1e-4) if noisy.any() else np.ones(p)
    known = []
    for stretch, starts in zip(stretches, windows.starts(J + 1), strict=True):
        known.append(np.zeros(len(stretch.y), bool))
        known[-1][starts + J] = True
    su = np.linalg.svd(past[:, np.arange(q) % d < m], compute_uv=False)
    condition = float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else np.inf
    excitation = float(su[-1] / su[0])
    return Innovations(stretches, windows, known, deviation, noisy, columns, q, condition, excitation, lead, J, theta)


def realise(step1: Innovations, L: int, order: int | None) -> Realisation:
    """Step 2: A and C from the singular value decomposition of Z_{J|L}."""
    p, noisy = step1.deviation.size, step1.noisy
    mv = step1.stretches[0].u.shape[1] + int(noisy.sum())
    a = L * mv
    starts = [window_starts(known, L) for known in step1.known]
    columns = sum(max(first.size - step1.lead, 0) for first in starts)
    if columns < a + L * p:
        raise EstimationError(
            f"step 2 of DSR_e needs at least as many columns as rows: future_horizon = {L} gives {a + L * p} rows, "
            f"got {columns} columns; shorten the horizons or give more data"
        )
    raw = step1.windows.quick(step1.J + L)
    if raw is None:
        series = [np.hstack([s.u, e[:, noisy], yd]) for s, (yd, e) in zip(step1.stretches, step1.series, strict=True)]
        R, _ = block_factor(series, starts, L, step1.lead)
    else:
        R = future_of(raw, step1, L)
    is_input = np.arange(R.shape[1]) % (mv + p) < mv
    Z = left_over(R[:, is_input], R[:, ~is_input])
    _, values, Vt = thin_svd(Z)
    floor = np.sqrt(step1.unknowns) + np.sqrt(p * L) if noisy.any() else values[0]
    relative = values / floor
    n, choice = (order, "given") if order is not None else choose_order(relative, bool(noisy.any()), p * (L - 1))
    O_L = Vt[:n].T * np.sqrt(values[:n])
    return Realisation(*by_shift(O_L, p), relative, choice, columns)


def left_over(U: FloatArray, Y: FloatArray) -> FloatArray:
    """Return a matrix whose Gram matrix is that of Y less its projection on the columns of U."""
    R: FloatArray = np.linalg.qr(np.hstack([U, Y]), mode="r")  # type: ignore[assignment]
    a = U.shape[1]
    if R.shape[0] > a and dtrcon(R[:a, :a], norm="1", uplo="U")[0] > SAFE:
        Z = np.zeros((min(len(U), Y.shape[1]), Y.shape[1]))
        Z[: len(R) - a] = R[a:, a:]
        return Z
    V, sigma, _ = thin_svd(U)
    V = V[:, sigma > _RANK * sigma[0]]
    return Y - V @ (V.T @ Y)


def future_of(raw: FloatArray, step1: Innovations, L: int) -> FloatArray:
    """Return a factor F of the future [u, e, y^d], F'F its Gram matrix, from ``raw``, that of J + L samples of [u, y].

    e and y^d are linear in J + 1 samples: the windows of long records need not be gone through again.
    """
    J, m, p = step1.J, step1.stretches[0].u.shape[1], step1.deviation.size
    d, noisy = m + p, step1.noisy
    width = m + int(noisy.sum()) + p
    T = np.zeros(((J + L) * d, L * width))
    for i in range(L):
        now, at = (J + i) * d, i * width
        T[now : now + m, at : at + m] = np.eye(m)
        y, yd = np.zeros((len(T), p)), np.zeros((len(T), p))
        y[now + m : now + d] = np.eye(p)
        yd[i * d : i * d + len(step1.theta)] = step1.theta
        yd = np.where(noisy, yd, y) / step1.deviation
        T[:, at + m : at + width] = np.hstack([(y / step1.deviation - yd)[:, noisy], yd])
    return np.asarray(raw @ T)


def input_matrices(step1: Innovations, step2: Realisation, direct: bool, closed_loop: bool) -> Inputs:
    """Return B, D and K, and what the free run with them errs.

    B and K solve the deterministic problem; B and D are then replaced by those of the free run on the measured outputs
    if these leave the smaller output error, both judged with initial states of their own, and no feedback biases them.
    """
    stretches = step1.stretches
    m, noisy = stretches[0].u.shape[1], step1.noisy
    p, mv = noisy.size, m + int(noisy.sum())
    through = np.full(m, direct)
    inner = [
        Series(np.hstack([s.u[run], (e if noisy.all() else e[:, noisy])[run]]), yd[run], np.ones(yd[run].shape, bool))
        for s, (yd, e), known in zip(stretches, step1.series, step1.known, strict=True)
        for run in runs(known)
    ]
    first = fit_inputs(step2.A, step2.C, inner, np.concatenate([through, np.zeros(mv - m, bool)]), step1.lead)
    K = np.zeros((step2.A.shape[0], p))
    K[:, noisy] = first.B[:, m:]
    B, D = first.B[:, :m], first.D[:, :m]
    # Here the outputs weigh by their root mean square: the criterion is then the MRSE of the EOLO paper, squared.
    C = step1.deviation[:, None] * step2.C
    outer = [Series(s.u, s.y, s.valid_y) for s in stretches]
    refined = fit_inputs(step2.A, C, outer, through, step1.lead)
    before = refined.error(B, step1.deviation[:, None] * D, through)
    after = refined.error(refined.B, refined.D, through)
    total = sum(float(np.sum(s.y[s.valid_y] ** 2)) for s in stretches)
    errors = (100.0 * float(np.sqrt(before / total)), 100.0 * float(np.sqrt(after / total)))
    if after < before and not closed_loop:
        B, D = refined.B, refined.D / step1.deviation[:, None]
    squares = refined.free_run_errors(B, step1.deviation[:, None] * D, through)
    counts = sum((s.valid_y.sum(axis=0) for s in stretches), np.zeros(p))
    return Inputs(B, D, K, errors, np.sqrt(squares / counts))
