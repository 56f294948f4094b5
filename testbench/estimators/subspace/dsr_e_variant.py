"""Step 2 of DSR_e as the EOLO paper has it: oblique projections without weight, A and C from their states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.errors import EstimationError
from testbench.estimators.hankel import block_factor, window_starts
from testbench.estimators.subspace.data import Stretch
from testbench.estimators.subspace.dsr_e_steps import Innovations
from testbench.estimators.subspace.factor import RANK
from testbench.estimators.subspace.order import choose_order
from testbench.record import FloatArray


def realise_unweighted(
    stretches: Sequence[Stretch], step1: Innovations, J: int, L: int, order: int | None
) -> tuple[FloatArray, FloatArray, FloatArray, str, int]:
    """Return A, C, singular values over the noise floor, the choice of order in words and the number of columns.

    P_L = O_L X from the samples J, ..., and one sample later P_{L-1} = O_{L-1} X+; then least squares of
    [X+; y^d] on [X; u; e] with D null (deterministic N4SID, Van Overschee and De Moor 1996, section 2.3).
    """
    m, p = stretches[0].u.shape[1], step1.deviation.size
    mv = m + int(step1.noisy.sum())
    width = m + mv + 2 * p  # u, y of the past; u, e, y^d of the future
    series = [
        np.hstack([s.u, s.y / step1.deviation, s.u, e[:, step1.noisy], yd])
        for s, yd, e in zip(stretches, step1.signal, step1.noise, strict=True)
    ]
    starts = [
        first[known[first[:, None] + np.arange(J, J + L)].all(axis=1)] if first.size else first
        for first, known in zip((window_starts(s.good, J + L) for s in stretches), step1.known, strict=True)
    ]
    R, columns = block_factor(series, starts, J + L, step1.lead)
    if columns < J * (m + p) + L * (mv + p):
        raise EstimationError(
            f"step 2 of DSR_e needs at least as many columns as rows: horizons {J} and {L} give "
            f"{J * (m + p) + L * (mv + p)} rows, got {columns} columns; shorten the horizons or give more data"
        )
    blocks = R.reshape(R.shape[0], J + L, width)
    part = {"past": slice(0, m + p), "v": slice(m + p, m + p + mv), "yd": slice(m + p + mv, width)}

    def columns_of(name: str, begin: int, end: int) -> FloatArray:
        return blocks[:, begin:end, part[name]].reshape(R.shape[0], -1)

    def oblique(shift: int) -> FloatArray:
        U, s, _ = np.linalg.svd(columns_of("v", J + shift, J + L), full_matrices=False)
        Q = U[:, s > RANK * s[0]]
        W = columns_of("past", shift, J + shift)
        future = columns_of("yd", J + shift, J + L)
        return W @ (np.linalg.pinv(W - Q @ (Q.T @ W), rcond=1e-10) @ (future - Q @ (Q.T @ future)))

    P = oblique(0)
    _, values, Vt = np.linalg.svd(P, full_matrices=False)
    relative = values / (np.sqrt(step1.unknowns) + np.sqrt(p * L) if step1.noisy.any() else values[0])
    n, choice = (order, "given") if order is not None else choose_order(relative, bool(step1.noisy.any()), p * (L - 1))
    O_L = Vt[:n].T * np.sqrt(values[:n])
    X = P @ np.linalg.pinv(O_L).T
    after = oblique(1) @ np.linalg.pinv(O_L[:-p]).T
    step: FloatArray = np.linalg.lstsq(np.hstack([X, columns_of("v", J, J + 1)]), after, rcond=RANK)[0]  # type: ignore[assignment]
    read: FloatArray = np.linalg.lstsq(X, columns_of("yd", J, J + 1), rcond=RANK)[0]  # type: ignore[assignment]
    return step[:n].T, read.T, relative, choice, columns
