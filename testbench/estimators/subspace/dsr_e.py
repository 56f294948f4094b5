"""DSR_e: subspace identification in two steps, innovations first and a deterministic problem after.

D. Di Ruscio, "Closed and Open Loop Subspace System Identification of the Kalman Filter", Modeling, Identification
and Control 30(2), 2009, and the variant of the EOLO paper (section 2.1, equations 1 to 3). Symbols as there: past
horizon J, future horizon L; subscript f marks the block Hankel matrix of L future samples.

Step 1. The row space of the past is W = [U_past; Y_past], J samples of each (with D free, U_k joins it). The signal
part y^d = Y / W is the orthogonal projection of the outputs on it, and e = y - y^d are the innovations.

Step 2. x[k+1] = A x[k] + [B K] [u; e][k], y^d[k] = C x[k] is a deterministic problem. The oblique projection of the
future outputs along the future inputs on the past, P_L = Y^d_f /_[U_f; E_f] W = O_L X, shows the order in its singular
values. Its columns are weighted by the projection on the orthogonal complement of the future inputs:

    P_L Pi = Y^d_f Pi = Z_{J|L},    Pi = I - [U_f; E_f]^+ [U_f; E_f],

where the first equality holds because Y^d_f lies in the row space of W and of the future inputs. Weights from the
right leave the column space alone (Van Overschee and De Moor 1996, unifying theorem); this one makes the EOLO paper's
P_L Di Ruscio's own Z_{J|L}. It is needed: inputs confined to a fraction of the Nyquist frequency are nearly predictable
from their past, the two factors of the oblique projection then cannot be told apart, and P_L unweighted turns a short
period of 3 rad/s, excited by a sweep at 50 Hz with 5 % noise, into poles beyond 100 rad/s.

That is the default, ``variant = "original"``; ``variant = "eolo"`` is the unweighted one (:func:`realise_unweighted`),
which is compared with it. Steps 1 and 2 do not ask why the inputs moved: with D = 0 they hold in closed loop, and so do
their B and K, while the last step below does not (``closed_loop``).

With P_L Pi = U S V': O_L = U_n S_n^(1/2), C is its first block, A its shift. Given A and C, B and K follow by linear
least squares from the deterministic problem, the initial states eliminated. A last linear least squares then fits B, D
and the initial states to the measured outputs in free run over all records together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtrcon

from testbench.core.advice import Advice, doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.relative import share_in_words
from testbench.estimators.hankel import (
    SAFE,
    BlockHankel,
    block_factor,
    extreme_singular_values,
    predict,
    runs,
    thin_svd,
    trend,
    window_starts,
)
from testbench.estimators.model import check_records, continuous_poles
from testbench.estimators.settings import DsrE
from testbench.estimators.state_space import Series, StateSpaceModel, fit_inputs
from testbench.estimators.subspace.data import (
    EXACT,
    LEAD,
    Stretch,
    automatic_stride,
    check_order,
    choose_order,
    decimate,
    scale,
)
from testbench.estimators.subspace.projections import RANK, by_shift
from testbench.estimators.subspace.tail import (
    doubts,
    lost_poles,
    other_horizon,
    pole_distance,
    pole_shifts,
    reflect,
    to_rate,
)

_RANK = 1e-12  # truncation of projections of noise-free data
_RANK_NOISY = 1e-8  # with noise, weaker directions only let the noise in


def estimate(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], settings: DsrE
) -> StateSpaceModel:
    """Identify an innovations model by DSR_e (module docstring) from one or several records of deviations from trim.

    Hankel columns of all records are put side by side; none reaches across a joint or touches an invalid sample.
    Channels are scaled by their root mean square and outputs by the deviation of their innovations, so that units do
    not matter. Noise on the inputs biases the estimate, as in every method of this family.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: (m,) channels that drive the model.
        outputs: (p,) channels that it predicts.
        settings: horizons, order and what else is asked of the model.

    Returns:
        The model, with these diagnostics:
        ``singular_values``: of Z_{J|L}, in multiples of the noise floor that step 1 makes one expect (of noise-free
        data: of the largest); ``order`` and ``order_choice`` in words;
        ``columns`` and ``unknowns`` per output of step 1, ``columns_step_2``;
        ``condition``: of the past W; ``input_excitation``: weakest over strongest singular value of the past inputs;
        ``innovations_std``: (p,) in SI units, 0 for an output free of noise;
        ``output_error_percent``: (p,) 100 ||y - y_free|| / ||y|| of the free run on the records, and
        ``output_error_deterministic_B``, ``output_error_refined_B``: of all outputs before and after the last step;
        ``free_run_over_innovations``: (p,) near 1 if measurement noise is all that the model leaves, 0 without noise;
        ``pole_shift_past``, ``pole_shift_future``: largest relative change of a pole with J halved, and with
        ``other_future_horizon`` (2 L; from L = 20 on L / 2); None without noise;
        ``poles_without_continuous_counterpart``: discrete z.

    Raises:
        EstimationError: settings against the method's laws, too few columns for the unknowns, or records against
            those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    J, L, order, free = settings.past_horizon, settings.future_horizon, settings.order, settings.direct_feedthrough
    check_order(order, L, len(outputs))
    check_records(records, inputs, outputs)
    stretches, size_u, size_y = scale(records, inputs, outputs, settings.offset)
    lead, dt_s = LEAD[settings.offset], records[0].dt_s
    stride = automatic_stride(stretches, dt_s) if settings.decimate == "auto" else settings.decimate
    slow, through = decimate(stretches, stride), free or stride > 1
    other = other_horizon(L)
    low = innovations(slow, _hankel(slow, (J + 1, J + L, J // 2 + 1, J // 2 + L, J + other), lead), J, through)
    step2 = realise(low, L, order)
    parted = None
    if settings.variant == "eolo":
        plain = Realisation(*realise_unweighted(low, L, order))
        if plain.A.shape == step2.A.shape:
            parted = pole_distance(step2.A, plain.A)
        step2 = plain
    shifts = _pole_shifts(low, step2, L, other, through)
    step1 = low
    if stride > 1:
        A, lost = to_rate(step2.A, stride)
        if lost.size:
            raise EstimationError(lost_poles(lost, stride))
        full = _hankel(stretches, (J + 1,), lead)
        step1 = replace(innovations(stretches, full, J, free), excitation=low.excitation)
        step2 = step2._replace(A=A, C=low.deviation[:, None] * step2.C / step1.deviation[:, None])
    moved = np.zeros(0, np.complex128)
    if settings.stable:
        A, moved = reflect(step2.A)
        step2 = step2._replace(A=A)
    found = input_matrices(step1, step2, free, settings.closed_loop)
    unit = size_y * step1.deviation  # of the outputs, in SI
    model = StateSpaceModel(
        method="dsr_e",
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        dt_s=dt_s,
        settings=settings.model_dump(exclude={"method", "label"}),
        A=step2.A,
        B=found.B / size_u,
        C=unit[:, None] * step2.C,
        D=unit[:, None] * found.D / size_u,
        K=found.K / unit,
    )
    diagnostics = _diagnostics(step1, step2, found, size_y, shifts, model.dt_s)
    diagnostics |= {
        "decimate": stride,
        "identified_at_dt_s": stride * model.dt_s,
        "moved_poles": moved,
        "pole_shift_variant": parted,
    }
    advice = doubts(diagnostics, outputs, J, L) + _advice_on_variant(settings.variant, parted)
    return replace(model, diagnostics=diagnostics, advice=advice)


def _advice_on_variant(variant: str, parted: float | None) -> tuple[Advice, ...]:
    if variant != "eolo" or (parted is not None and parted <= 0.1):
        return ()
    apart = "of another order" if parted is None else f"{share_in_words(parted)} away"
    said = (
        f"the original DSR_e finds poles {apart}: the unweighted projection divides by what the inputs do not "
        'excite; use variant = "original", excite a wider band or decimate'
    )
    return (doubt("weak_excitation", said),)


def _diagnostics(
    step1: Innovations, step2: Realisation, inputs: Inputs, size_y: FloatArray, shifts: dict[str, Any], dt_s: float
) -> dict[str, Any]:
    unit = size_y * step1.deviation
    return {
        "singular_values": step2.singular_values,
        "order": step2.A.shape[0],
        "order_choice": step2.order_choice,
        "columns": step1.columns,
        "unknowns": step1.unknowns,
        "columns_step_2": step2.columns,
        "condition": step1.condition,
        "input_excitation": step1.excitation,
        "innovations_std": np.where(step1.noisy, unit, 0.0),
        "output_error_percent": 100.0 * inputs.residual,
        "free_run_over_innovations": np.where(step1.noisy, inputs.residual / step1.deviation, 0.0),
        "output_error_deterministic_B": inputs.percent[0],
        "output_error_refined_B": inputs.percent[1],
        **shifts,
        "poles_without_continuous_counterpart": continuous_poles(
            np.linalg.eigvals(step2.A).astype(np.complex128), dt_s
        )[1],
    }


def _hankel(stretches: Sequence[Stretch], lengths: Sequence[int], lead: int) -> BlockHankel:
    return BlockHankel([s.both for s in stretches], [s.good for s in stretches], lengths, lead)


def _pole_shifts(step1: Innovations, step2: Realisation, L: int, other: int, direct: bool) -> dict[str, Any]:
    """Return how far the poles move with other horizons; see :func:`.tail.pole_shifts`."""
    n, p, J = step2.A.shape[0], step1.deviation.size, step1.J

    def past() -> FloatArray:
        return realise(innovations(step1.stretches, step1.windows, J // 2, direct), L, n).A

    def future() -> FloatArray:
        return realise(step1, other, n).A

    if not step1.noisy.any():
        return pole_shifts(step2.A, other, None, None)
    columns = sum(window_starts(known, other).size for known in step1.known)
    wide = n <= p * (other - 1) and columns >= other * (step1.stretches[0].u.shape[1] + 2 * p)
    return pole_shifts(step2.A, other, past if J >= 2 else None, future if wide else None)


# --- the two steps ----------------------------------------------------------------------------------------------------


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


def shortage(
    good: Sequence[NDArray[np.bool_]], inputs: int, outputs: int, past_horizon: int, future_horizon: int
) -> tuple[int, int] | None:
    """Return columns and the fewest that are needed, of the first step that has too few of noisy data; None if none.

    Args:
        good: (N,) of each record, True where every channel was sampled.
        inputs: their number; the model has no direct feedthrough.
        outputs: their number.
        past_horizon: as of :func:`estimate`, with no offset and no decimation.
        future_horizon: likewise.
    """
    first = [window_starts(own, past_horizon + 1) for own in good]
    second = 0
    for own, starts in zip(good, first, strict=True):
        known = np.zeros(own.size, bool)
        known[starts + past_horizon] = True
        second += window_starts(known, future_horizon).size
    steps = (
        (sum(starts.size for starts in first), past_horizon * (inputs + outputs) + outputs),
        (second, future_horizon * (inputs + 2 * outputs)),
    )
    return next(((columns, needed) for columns, needed in steps if columns < needed), None)


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
    theta, noisy, rest, rank, condition = _projected(past, now)
    deviation = rest / np.sqrt(max(columns - rank, 1))
    deviation = np.maximum(deviation, 1e-4) if noisy.any() else np.ones(p)
    known = []
    for stretch, starts in zip(stretches, windows.starts(J + 1), strict=True):
        known.append(np.zeros(len(stretch.y), bool))
        known[-1][starts + J] = True
    su = np.linalg.svd(past[:, np.arange(q) % d < m], compute_uv=False)
    excitation = float(su[-1] / su[0])
    return Innovations(stretches, windows, known, deviation, noisy, columns, q, condition, excitation, lead, J, theta)


def _projected(past: FloatArray, now: FloatArray) -> tuple[FloatArray, NDArray[np.bool_], FloatArray, int, float]:
    """Return the regression of ``now`` on ``past``, which outputs are noisy, their residual, rank and condition.

    ``past`` is the first columns of a triangle. Where its condition is far from the truncation, back substitution is
    the least squares; else singular vectors are.
    """
    q, p = past.shape[1], now.shape[1]
    size = np.sqrt(np.sum(now**2, axis=0))
    extremes = extreme_singular_values(past[:q])
    if extremes is not None and extremes[1] > SAFE * extremes[0]:
        theta = solve_triangular(past[:q], now[:q], check_finite=False)
        rest = np.sqrt(np.sum(now[q:] ** 2, axis=0))
        noisy = rest > EXACT * size
        if noisy.all():
            return theta, noisy, rest, q, extremes[0] / extremes[1]
    U, sigma, Vt = thin_svd(past)
    theta, noisy, rest, rank = np.zeros((q, p)), np.ones(p, bool), np.zeros(p), q
    for tolerance in (_RANK, _RANK_NOISY):
        rank = int(np.sum(sigma > tolerance * sigma[0]))
        theta[:, noisy] = Vt[:rank].T @ ((U[:, :rank].T @ now[:, noisy]) / sigma[:rank, None])
        rest = np.sqrt(np.sum((now - past @ theta) ** 2, axis=0))
        noisy = rest > EXACT * size
        if not noisy.any():
            break
    return theta, noisy, rest, rank, float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else np.inf


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
        R, _ = block_factor(series, step1.known, L, step1.lead)
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


# --- step 2 as the EOLO paper has it: without weights -----------------------------------------------------------------


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
    R, _ = block_factor(series, [s.good for s in step1.stretches], J + L, step1.lead)
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
