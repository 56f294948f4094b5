"""Step 2 of DSR_e as the EOLO paper has it: oblique projections without weight, A and C from their states."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtrcon

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.hankel import block_factor, thin_svd
from testbench.estimators.subspace.dsr_e_steps import SAFE, Innovations, future_of
from testbench.estimators.subspace.factor import RANK
from testbench.estimators.subspace.order import choose_order


def realise_unweighted(
    step1: Innovations, L: int, order: int | None
) -> tuple[FloatArray, FloatArray, FloatArray, str, int]:
    """Return A, C, singular values over the noise floor, the choice of order in words and the number of columns.

    P_L = O_L X from the samples J, ..., and one sample later P_{L-1} = O_{L-1} X+; then least squares of
    [X+; y^d] on [X; u; e] with D null (deterministic N4SID, Van Overschee and De Moor 1996, section 2.3).
    """
    J, m, p = step1.J, step1.stretches[0].u.shape[1], step1.deviation.size
    mv = m + int(step1.noisy.sum())
    columns = step1.windows.columns(J + L)
    if columns < J * (m + p) + L * (mv + p):
        raise EstimationError(
            f"step 2 of DSR_e needs at least as many columns as rows: horizons {J} and {L} give "
            f"{J * (m + p) + L * (mv + p)} rows, got {columns} columns; shorten the horizons or give more data"
        )
    past, future = _past_and_future(step1, L)
    d, width = m + p, mv + p
    inputs = np.arange(L * width) % width < mv
    v, yd = future[:, inputs], future[:, ~inputs]

    def oblique(shift: int) -> FloatArray:
        W = past[:, shift * d : (J + shift) * d]
        return W @ _along(v[:, shift * mv :], W, yd[:, shift * p :])

    P = oblique(0)
    _, values, Vt = thin_svd(P)
    relative = values / (np.sqrt(step1.unknowns) + np.sqrt(p * L) if step1.noisy.any() else values[0])
    n, choice = (order, "given") if order is not None else choose_order(relative, bool(step1.noisy.any()), p * (L - 1))
    O_L = Vt[:n].T * np.sqrt(values[:n])
    X = P @ np.linalg.pinv(O_L).T
    after = oblique(1) @ np.linalg.pinv(O_L[:-p]).T
    step: FloatArray = np.linalg.lstsq(np.hstack([X, v[:, :mv]]), after, rcond=RANK)[0]
    read: FloatArray = np.linalg.lstsq(X, yd[:, :p], rcond=RANK)[0]  # type: ignore[assignment]
    return step[:n].T, read.T, relative, choice, columns


def _past_and_future(step1: Innovations, L: int) -> tuple[FloatArray, FloatArray]:
    """Return factors of the past [u, y] of J + 1 samples and of the future [u, e, y^d] of L, in one basis."""
    J, m, p = step1.J, step1.stretches[0].u.shape[1], step1.deviation.size
    d = m + p
    raw = step1.windows.quick(J + L)
    if raw is not None:
        unit = np.tile(np.concatenate([np.ones(m), step1.deviation]), J + 1)
        return raw[:, : (J + 1) * d] / unit, future_of(raw, step1, L)
    series = [
        np.hstack([s.u, s.y / step1.deviation, s.u, e[:, step1.noisy], yd])
        for s, (yd, e) in zip(step1.stretches, step1.series, strict=True)
    ]
    R, _ = block_factor(series, step1.windows.starts(J + L), J + L, step1.lead)
    blocks = R.reshape(R.shape[0], J + L, -1)
    return blocks[:, : J + 1, :d].reshape(R.shape[0], -1), blocks[:, J:, d:].reshape(R.shape[0], -1)


def _along(v: FloatArray, W: FloatArray, Y: FloatArray) -> FloatArray:
    """Return the coefficients on W of the regression of Y on W and v."""
    a, b = v.shape[1], W.shape[1]
    R: FloatArray = np.linalg.qr(np.hstack([v, W, Y]), mode="r")  # type: ignore[assignment]
    if R.shape[0] >= a + b and dtrcon(R[: a + b, : a + b], norm="1", uplo="U")[0] > SAFE:
        out: FloatArray = solve_triangular(R[a : a + b, a : a + b], R[a : a + b, a + b :])
        return out
    U, s, _ = thin_svd(v)
    Q = U[:, s > RANK * s[0]]
    return np.asarray(np.linalg.pinv(W - Q @ (Q.T @ W), rcond=1e-10) @ (Y - Q @ (Q.T @ Y)))
