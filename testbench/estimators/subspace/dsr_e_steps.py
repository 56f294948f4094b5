"""The two steps of DSR_e: innovations from the past, then A, C, B and K of a deterministic problem (see ``dsr_e``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.errors import EstimationError
from testbench.estimators.hankel import block_factor, quick_factor, runs, trend, window_starts, windows
from testbench.estimators.state_space import Series, fit_inputs
from testbench.estimators.subspace.data import Stretch
from testbench.estimators.subspace.order import EXACT, choose_order
from testbench.estimators.subspace.projections import by_shift
from testbench.record import FloatArray

_RANK = 1e-12  # truncation of projections of noise-free data
_RANK_NOISY = 1e-8  # with noise, weaker directions only let the noise in


@dataclass(frozen=True, eq=False)
class Innovations:
    """Step 1: per record y^d, e (NaN-free; rows not in ``known`` are zero), in units of the innovations' deviation."""

    signal: list[FloatArray]
    noise: list[FloatArray]
    known: list[NDArray[np.bool_]]
    deviation: FloatArray  # (p,) of the innovations, in the units of the stretches; floored
    noisy: NDArray[np.bool_]  # (p,)
    columns: int
    unknowns: int
    condition: float
    excitation: float  # smallest over largest singular value of the past inputs
    lead: int  # offsets and trends per record that are projected out
    J: int
    theta: FloatArray  # (unknowns, p) past -> y^d, in the units of the stretches


class Realisation(NamedTuple):
    """Step 2: A, C in the units of step 1, and the singular values relative to the noise floor."""

    A: FloatArray
    C: FloatArray
    singular_values: FloatArray
    order_choice: str
    columns: int


def innovations(stretches: Sequence[Stretch], J: int, direct: bool, lead: int) -> Innovations:
    """Step 1: project the outputs on the past by least squares, truncated where the past is rank deficient."""
    m, p = stretches[0].u.shape[1], stretches[0].y.shape[1]
    d = m + p
    past = np.r_[0 : J * d + (m if direct else 0)]
    now = np.r_[J * d + m : (J + 1) * d]
    places = [window_starts(s.good, J + 1) for s in stretches]
    R, columns = block_factor([s.both for s in stretches], places, J + 1, lead)
    R = R[:, np.r_[past, now]]
    q = past.size
    if columns < q + p:
        touched = sum(max(len(s.u) - J - lead, 0) for s in stretches) - columns
        raise EstimationError(
            f"step 1 of DSR_e needs more columns than unknowns: past_horizon = {J} gives {q} unknowns per output, "
            f"got {columns} columns ({touched} dropped for invalid samples); shorten past_horizon, give more data"
            + (", or decimate to the rate of the slowest sensor" if touched else "")
        )
    U, sigma, Vt = np.linalg.svd(R[:, :q], full_matrices=False)
    theta, noisy, rest = np.zeros((q, p)), np.ones(p, bool), np.zeros(p)
    size = np.sqrt(np.sum(R[:, q:] ** 2, axis=0))
    for tolerance in (_RANK, _RANK_NOISY):
        rank = int(np.sum(sigma > tolerance * sigma[0]))
        theta[:, noisy] = Vt[:rank].T @ ((U[:, :rank].T @ R[:, q:][:, noisy]) / sigma[:rank, None])
        rest = np.sqrt(np.sum((R[:, q:] - R[:, :q] @ theta) ** 2, axis=0))
        noisy = rest > EXACT * size
        if not noisy.any():
            break
    deviation = rest / np.sqrt(max(columns - rank, 1))
    deviation = np.maximum(deviation, 1e-4) if noisy.any() else np.ones(p)
    signal, noise, known = [], [], []
    for stretch, starts in zip(stretches, places, strict=True):
        yd, e, at = np.zeros(stretch.y.shape), np.zeros(stretch.y.shape), np.zeros(len(stretch.y), bool)
        for part, rows in windows(stretch.both, starts, J + 1):
            yd[part + J] = rows[:, past] @ theta
        at[starts + J] = True
        if lead and starts.size > lead:
            line = trend(starts, starts, lead)
            yd[at] += line @ np.linalg.lstsq(line, stretch.y[at] - yd[at], rcond=None)[0]
        e[at] = np.where(noisy, stretch.y[at] - yd[at], 0.0)
        yd[at] = stretch.y[at] - e[at]
        signal.append(yd / deviation)
        noise.append(e / deviation)
        known.append(at)
    past_inputs = np.flatnonzero(past % d < m)
    su = np.linalg.svd(R[:, past_inputs], compute_uv=False)
    condition = float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else np.inf
    return Innovations(
        signal, noise, known, deviation, noisy, columns, q, condition, float(su[-1] / su[0]), lead, J, theta
    )


def realise(stretches: Sequence[Stretch], step1: Innovations, L: int, order: int | None) -> Realisation:
    """Step 2: A and C from the singular value decomposition of Z_{J|L}."""
    m, p = stretches[0].u.shape[1], step1.deviation.size
    mv = m + int(step1.noisy.sum())
    a = L * mv
    starts = [window_starts(known, L) for known in step1.known]
    columns = sum(max(first.size - step1.lead, 0) for first in starts)
    R = _from_raw_windows(stretches, step1, starts, L)
    if R is None:
        series = [
            np.hstack([s.u, e[:, step1.noisy], yd])
            for s, yd, e in zip(stretches, step1.signal, step1.noise, strict=True)
        ]
        R, columns = block_factor(series, starts, L, step1.lead)
    future = np.arange(L * (mv + p))
    is_input = future % (mv + p) < mv
    R = np.hstack([R[:, is_input], R[:, ~is_input]])
    if columns < future.size:
        raise EstimationError(
            f"step 2 of DSR_e needs at least as many columns as rows: future_horizon = {L} gives {future.size} rows, "
            f"got {columns} columns; shorten the horizons or give more data"
        )
    U, sigma, _ = np.linalg.svd(R[:, :a], full_matrices=False)
    U = U[:, sigma > _RANK * sigma[0]]
    Z = R[:, a:] - U @ (U.T @ R[:, a:])  # the orthogonal complement of the future inputs, in the basis of R
    _, values, Vt = np.linalg.svd(Z, full_matrices=False)
    floor = np.sqrt(step1.unknowns) + np.sqrt(p * L) if step1.noisy.any() else values[0]
    relative = values / floor
    n, choice = (order, "given") if order is not None else choose_order(relative, bool(step1.noisy.any()), p * (L - 1))
    O_L = Vt[:n].T * np.sqrt(values[:n])
    return Realisation(*by_shift(O_L, p), relative, choice, columns)


def _from_raw_windows(
    stretches: Sequence[Stretch], step1: Innovations, starts: Sequence[NDArray[np.intp]], L: int
) -> FloatArray | None:
    """Return a factor F of the future [u, e, y^d], F'F its Gram matrix, from that of J + L samples of [u, y].

    e and y^d are linear in J + 1 samples: the windows of long records need not be gone through again. None for short
    records, and where the raw windows are too ill-conditioned for their Gram matrix.
    """
    J, m, p = step1.J, stretches[0].u.shape[1], step1.deviation.size
    d, noisy = m + p, step1.noisy
    raw = quick_factor([s.both for s in stretches], [first - J for first in starts], J + L, step1.lead)
    if raw is None:
        return None
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


def input_matrices(
    stretches: Sequence[Stretch], step1: Innovations, step2: Realisation, direct: bool, closed_loop: bool
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float]]:
    """Return B, D, K in scaled units, and the output error in percent before and after the refinement of B and D.

    B and K solve the deterministic problem; B and D are then replaced by those of the free run on the measured outputs
    if these leave the smaller output error, both judged with initial states of their own, and no feedback biases them.
    """
    m, noisy = stretches[0].u.shape[1], step1.noisy
    p, mv = noisy.size, m + int(noisy.sum())
    through = np.full(m, direct)
    inner = [
        Series(np.hstack([s.u, e[:, noisy]])[run], yd[run], np.ones(yd[run].shape, bool))
        for s, yd, e, known in zip(stretches, step1.signal, step1.noise, step1.known, strict=True)
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
    return B, D, K, errors
