"""The iteration of SRIVC: filters, instruments and steps from one transfer function to the next, and its errors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.continuous import fit_free, free_basis
from testbench.estimators.residuals import coloured_information, corrected_covariance, ljung_box
from testbench.estimators.state_variable import Hold, StateVariableFilter, delayed

_ITERATIONS = 60
_FASTEST = 20.0  # radians per sample; a pole beyond it has died out within the sample
_STEP = 1e-6  # converged: the output moves by less than this share of what one standard error would move it
_EXACT = 1e-12  # or by less than this share of itself
_UPHILL = 1.001  # a fixed point of the instruments need not be the minimum of the output error to the last digit
_NUDGE = 0.02  # samples; central differences in the delay
WHITE = 0.01  # Ljung-Box probability below which residuals count as coloured


class Series(NamedTuple):
    """One record for one output: inputs (N, m), output (N,), and which of its samples were taken (N,)."""

    u: FloatArray
    y: FloatArray
    valid: NDArray[np.bool_]


class Point(NamedTuple):
    """A transfer function: a (n + 1,) = 1, a1 ...; b (m, n + 1), of s^n ... 1; delays (m,) in samples."""

    a: FloatArray
    b: FloatArray
    delays: FloatArray


class Run(NamedTuple):
    """What a point makes of one record: filters, input states (N, n, m), delayed inputs (N, m), output (N,), basis."""

    filters: StateVariableFilter
    x: FloatArray
    v: FloatArray
    output: FloatArray
    basis: FloatArray


_NOTHING: Any = None  # the run of a point that is none


class Fit(NamedTuple):
    """A fixed point of the instrumental variables, and what belongs to it."""

    point: Point
    runs: list[Run]
    cost: float
    converged: bool


class Setup(NamedTuple):
    """What stays the same in a search: sample time, holds of the inputs, and whether constants are fitted."""

    dt_s: float
    hold: tuple[Hold, ...]
    offset: bool


def solve(data: list[Series], n: int, nz: int, delays: FloatArray, setup: Setup) -> Fit:
    """Return the fixed point from the best of several least-squares starts with the filters 1/(s + cut-off)^n."""
    slowest = 2.0 * np.pi / (setup.dt_s * max(len(s.y) for s in data))
    starts = []
    for cutoff in np.geomspace(3.0 * slowest, 0.6 * np.pi / setup.dt_s, 5):
        a = np.asarray(np.poly(np.full(n, -cutoff)), np.float64)
        start = Point(a, np.zeros((delays.size, n + 1)), delays)
        runs = [run for run, _ in runs_of(data, start, setup)]
        step = _step(data, start, runs, nz, setup, least_squares=True)[0]
        for part in 0.5 ** np.arange(6.0):
            point = _moved(start, step, nz, float(part))
            cost = sum(cost for _, cost in runs_of(data, point, setup))
            if np.isfinite(cost):
                break
        starts.append((cost, point))
    starts = sorted((s for s in starts if np.isfinite(s[0])), key=lambda s: s[0])
    if not starts:
        raise EstimationError(
            f"{n} poles and {nz} zeros must describe the output within what its sampling can show, but least squares "
            "puts them far beyond; use fewer poles or zeros"
        )
    fits = []
    for _, point in starts[:3]:
        fits.append(iterate(data, point, nz, setup))
        if fits[-1].converged:
            break
    return min(fits, key=lambda fit: fit.cost)


def runs_of(series: list[Series], point: Point, setup: Setup) -> list[tuple[Run, float]]:
    """Return for every record what the point makes of it, and the summed squared error of the samples taken.

    The error of poles that no sampling could show is infinite.
    """
    if not np.all(np.isfinite(point.a)) or np.any(np.abs(np.roots(point.a)) * setup.dt_s > _FASTEST):
        return [(_NOTHING, np.inf)] * len(series)
    out = []
    for u, y, valid in series:
        filters = StateVariableFilter(point.a, setup.dt_s, y.size)
        x = filters.states(u, setup.hold, point.delays.tolist())
        v = np.column_stack([delayed(c, h, d) for c, h, d in zip(u.T, setup.hold, point.delays, strict=True)])
        forced = np.zeros(y.size)
        for j in range(v.shape[1]):
            forced += filters.output(point.b[j], x[:, :, j], v[:, j])
        basis = free_basis(filters, setup.offset)
        output = forced + basis @ fit_free(basis, y - forced, valid)
        out.append((Run(filters, x, v, output, basis), float(np.sum((y - output)[valid] ** 2))))
    return out


def iterate(data: list[Series], start: Point, nz: int, setup: Setup, refine: tuple[int, ...] = ()) -> Fit:
    """Return the fixed point that the instrumental variables reach from ``start``; a step uphill is halved."""
    results = runs_of(data, start, setup)
    point, runs, cost = start, [r for r, _ in results], sum(c for _, c in results)
    taken = sum(int(s.valid.sum()) for s in data)
    total = sum(float(np.sum(s.y[s.valid] ** 2)) for s in data)
    for _ in range(_ITERATIONS):
        step = _step(data, point, runs, nz, setup, refine=refine)[0]
        for part in 0.5 ** np.arange(8.0):
            trial = _moved(point, step, nz, float(part), refine)
            results = runs_of(data, trial, setup)
            trial_cost = sum(c for _, c in results)
            if trial_cost <= _UPHILL * cost + (_EXACT**2) * total:
                break
        else:
            return Fit(point, runs, cost, False)
        moved = sum(
            float(np.sum((new.output - old.output)[s.valid] ** 2))
            for (new, _), old, s in zip(results, runs, data, strict=True)
        )
        point, runs, cost = trial, [r for r, _ in results], trial_cost
        if moved <= max(_STEP**2 * cost / taken, (_EXACT**2) * total):
            return Fit(point, runs, cost, True)
    return Fit(point, runs, cost, False)


def _moved(point: Point, step: FloatArray, nz: int, part: float, refine: tuple[int, ...] = ()) -> Point:
    """Return the point after ``part`` of a step in the coefficients (and the delays of inputs ``refine``, >= 0)."""
    n, m = point.a.size - 1, len(point.b)
    a, b, delays = point.a.copy(), point.b.copy(), point.delays.copy()
    a[1:] += part * step[:n]
    b[:, n - nz :] += part * step[n : n + m * (nz + 1)].reshape(m, nz + 1)
    if refine:
        delays[list(refine)] = np.maximum(delays[list(refine)] + part * step[-len(refine) :], 0.0)
    return Point(a, b, delays)


def _step(
    data: list[Series],
    point: Point,
    runs: list[Run],
    nz: int,
    setup: Setup,
    *,
    refine: tuple[int, ...] = (),
    least_squares: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray, list[FloatArray]]:
    """Return the step (q,) in the coefficients, the instruments' scale (q,) and singular values, and the instruments.

    With regressors P, instruments Z and output error e, all freed of free responses and constants, the new
    coefficients of the instrumental variables are the old ones + (Z'P)^-1 Z'e.
    """
    instruments, regressors, rest = [], [], []
    for (u, y, valid), run in zip(data, runs, strict=True):
        filled = np.where(valid, y, run.output)
        pair = run.filters.states(np.column_stack([filled, run.output]), ("foh", "foh"), (0.0, 0.0))
        driven = _driven(u, run, point, nz, setup, refine)
        N = run.basis[valid]
        size = np.sqrt(np.sum(N**2, axis=0))
        U, s, _ = np.linalg.svd(N / np.where(size > 0.0, size, 1.0), full_matrices=False)
        Q = U[:, s > 1e-12 * s[0]]
        P, Z = (np.hstack([-pair[:, :, i], driven])[valid] for i in (0, 1))
        e = (y - run.output)[valid]
        regressors.append(P - Q @ (Q.T @ P))
        instruments.append(regressors[-1] if least_squares else Z - Q @ (Q.T @ Z))
        rest.append(e - Q @ (Q.T @ e))
    Z, P = np.vstack(instruments), np.vstack(regressors)
    size = np.sqrt(np.sum(Z**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    U, s, _ = np.linalg.svd(Z / size, full_matrices=False)
    step = np.linalg.lstsq(U.T @ (P / size), U.T @ np.concatenate(rest), rcond=1e-13)[0] / size
    return step, size, s, instruments


def _driven(u: FloatArray, run: Run, point: Point, nz: int, setup: Setup, refine: tuple[int, ...]) -> FloatArray:
    """Return the columns that the inputs give: s^nz ... 1 of each, and what each delay does (per sample)."""
    n = point.a.size - 1
    columns = []
    for j in range(u.shape[1]):
        x = run.x[:, :, j]
        if nz == n:
            columns.append((run.v[:, j] - x @ point.a[1:])[:, None])
        columns.append(x[:, max(0, n - 1 - nz) :])
    for j in refine:
        sides, word = [], setup.hold[j]
        for d in (point.delays[j] + _NUDGE, max(point.delays[j] - _NUDGE, 0.0)):
            x = run.filters.states(u[:, [j]], (word,), (d,))[:, :, 0]
            sides.append(run.filters.output(point.b[j], x, delayed(u[:, j], word, d)))
        columns.append(((sides[0] - sides[1]) / (point.delays[j] + _NUDGE - d))[:, None])
    return np.hstack(columns)


def errors_of(
    data: list[Series], fit: Fit, nz: int, setup: Setup, refine: tuple[int, ...]
) -> tuple[FloatArray, dict[str, Any]]:
    """Return the covariance (q, q) of coefficients and delays (in samples), and what the residuals say."""
    _, size, s, instruments = _step(data, fit.point, fit.runs, nz, setup, refine=refine)
    e = [(d.y - run.output)[d.valid] for d, run in zip(data, fit.runs, strict=True)]
    taken, q = sum(v.size for v in e), size.size
    free = taken - q - sum(run.basis.shape[1] for run in fit.runs)
    variance = fit.cost / free
    power = sum(float(np.sum(d.y[d.valid] ** 2)) for d in data)
    out = {
        "residual_std": float(np.sqrt(variance)),
        "residual_percent": 100.0 * float(np.sqrt(fit.cost / power)) if power else 0.0,
        "condition": float(s[0] / s[-1]) if s[-1] > 0.0 else np.inf,
        "converged": fit.converged,
    }
    longest = max(e, key=len)
    out["white_probability"] = ljung_box(longest, max(1, min(longest.size // 5, 20)))
    out["error_factor"] = 1.0
    Z = [z / size for z in instruments]
    plain = np.linalg.pinv(sum(z.T @ z for z in Z), hermitian=True, rcond=1e-15) * variance
    covariance = plain
    if out["white_probability"] < WHITE and variance > 0.0:
        score = coloured_information([z[:, None, :] / variance for z in Z], [v[:, None] for v in e])
        covariance = corrected_covariance(plain, score) * (taken / free)
        known = np.diag(plain) > 0.0
        out["error_factor"] = float(np.median(np.sqrt(np.diag(covariance)[known] / np.diag(plain)[known])))
    return covariance / np.outer(size, size), out
