"""Transfer functions in continuous time by simplified refined instrumental variables (SRIVC), one per output.

P. C. Young and A. Jakeman, "Refined instrumental variable methods of recursive time-series analysis, part III",
International Journal of Control 31(4), 1980; H. Garnier and P. C. Young, "The advantages of directly identifying
continuous-time transfer function models in practical applications", International Journal of Control 87(7), 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, AdviceList, note
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import (
    ContinuousTransferModel,
    Hold,
    StateVariableFilter,
    delayed,
    fit_free,
    free_basis,
    holds,
)
from testbench.estimators.coverage import approximate
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import coloured_covariance
from testbench.estimators.parametric.gauss_newton import Sensitivities
from testbench.estimators.residuals import ljung_box
from testbench.estimators.settings import Srivc
from testbench.estimators.transfer_function import excited_band, question_poles

_DEFICIENT = 1e-9  # condition of the scaled instruments beyond which they count as rank deficient
_SILENT = 1e-6  # output error below this share of an output is rounding: no doubt about its poles
_TIE = 1.01  # structures within 1 % of the best error on the judges count as equal: the smallest is kept
_ITERATIONS = 60
_FASTEST = 20.0  # radians per sample; a pole beyond it has died out within the sample
_STEP = 1e-6  # converged: the output moves by less than this share of what one standard error would move it
_EXACT = 1e-12  # or by less than this share of itself
_UPHILL = 1.001  # a fixed point of the instruments need not be the minimum of the output error to the last digit
_NUDGE = 0.02  # samples; central differences in the delay


def estimate(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    settings: Srivc,
    validation: Sequence[FlightRecord] = (),
) -> ContinuousTransferModel:
    """Fit y(t) = sum_j B_j(s)/A(s) u_j(t - tau_j) + e(t) for each output by itself, directly in continuous time.

    Inputs and output pass the filters s^k/A(s) of the last iteration; the instruments are the output of the last
    iteration's model passed through the same filters. At the fixed point the residual is the output error and the
    instruments are its gradient, so that noise which is not correlated with the input does not bias the estimate,
    and for white noise no estimate is more accurate. Every record brings its own free response (initial state), which
    is eliminated; so is, with ``offset``, a constant. Samples of the output that were not taken are filled with the
    model and do not count. Unstable poles need no reflection: the filters run them backwards in time, and what
    this adds is a free response.

    Structures are judged by 100 (1 - ||y - y_model|| / ||y - mean(y)||) on ``validation``, initial states fitted; among
    those within 1 % of the smallest error the one with the fewest coefficients is kept.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: (m,) input channels; they share the denominator of an output.
        outputs: (p,) output channels.
        settings: the candidates, and how the inputs run.
        validation: measured records that choose among the candidates.

    Returns:
        The model, with the covariance of all coefficients (and delays, if refined): white-noise formula where the
        Ljung-Box test lets the residuals pass as white at 1 %, else corrected for their colour. Its diagnostics hold,
        by output: ``structure`` (poles, zeros), ``fit_percent`` ("n/nz" -> fit on the judges), ``residual_std``,
        ``residual_percent`` of the output, ``white_probability`` (Ljung-Box), ``error_factor`` (how much the
        colour changes the standard errors, median), ``condition``, ``converged``; and ``excited_band_rad_s``.

    Raises:
        EstimationError: settings against the laws above, too few samples, an output that does not move, or records
            against those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    pairs = {(n, nz) for n in settings.poles for nz in settings.zeros if nz <= n}
    structures = sorted(pairs, key=lambda s: (sum(s), s))
    delays = sorted(set(settings.delay_samples))
    check_records(records, inputs, outputs)
    check_records([*records, *validation], inputs, outputs)
    words, recognised = holds(inputs, settings.hold, records)
    setup = Setup(records[0].dt_s, words, settings.offset)
    advice = [] if validation or len(structures) * len(delays) == 1 else [_UNJUDGED]
    advice += _untaken(records, inputs)
    found: dict[str, _Outcome] = {}
    for name in outputs:
        data = [_series(r, inputs, name) for r in records]
        judges = [_series(r, inputs, name) for r in validation] or data
        found[name] = _identify(name, data, judges, structures, delays, settings.refine_delay, setup)
    band = excited_band(records, inputs)
    model = _model(found, tuple(inputs), setup)
    for name, modes in model.modes().items():
        advice += found[name].advice
        if found[name].diagnostics["residual_percent"] > 100.0 * _SILENT:
            sizes = np.array([mode.wn_rad_s for mode in modes])
            known = np.array([mode.wn_error_rad_s / mode.wn_rad_s if mode.wn_rad_s else np.inf for mode in modes])
            advice += question_poles(name, sizes, known, records, inputs)
    if advice:
        advice += approximate("srivc")
    keys = next(iter(found.values())).diagnostics
    said = {
        "poles": sorted({n for n, _ in structures}),
        "zeros": sorted({nz for _, nz in structures}),
        "delay_samples": delays,
        "refine_delay": settings.refine_delay,
        "hold": dict(zip(inputs, setup.hold, strict=True)),
        "offset": settings.offset,
        **said_of_hold(recognised),
    }
    return replace(
        model,
        settings=said,
        advice=tuple(advice),
        diagnostics={
            **{key: {name: found[name].diagnostics[key] for name in outputs} for key in keys},
            "excited_band_rad_s": band,
        },
    )


_UNJUDGED = note(
    "structure_not_judged",
    "the structure was chosen on the records it was fitted to, which favours more poles and zeros; "
    "give validation records",
)


class _Outcome(NamedTuple):
    """One output's transfer function, its covariance, and what is to be said of it."""

    fit: Fit
    zeros: int
    refined: tuple[int, ...]
    covariance: FloatArray
    diagnostics: dict[str, Any]
    advice: list[Advice]


def _series(record: FlightRecord, inputs: Sequence[str], output: str) -> Series:
    part = record.select([output])
    return Series(record.columns(inputs), part.data[:, 0], part.valid[:, 0])


def _untaken(records: Sequence[FlightRecord], inputs: Sequence[str]) -> list[Advice]:
    """Return a sentence on each input whose samples were not all taken and not bridged by ``prepare``."""
    out = AdviceList()
    for name in inputs:
        share = np.mean(np.concatenate([r.select([name]).valid[:, 0] for r in records]))
        if share < 1.0 and not all("prepared" in r.provenance for r in records):
            out.doubt(
                "interpolated",
                f"{name}: {100 * (1.0 - share):.1f} % of its samples were not taken and hold the value before; "
                "bridge the gaps with prepare",
            )
    return out


def _identify(
    name: str,
    data: list[Series],
    judges: list[Series],
    structures: list[tuple[int, int]],
    delays: list[float],
    refine: bool,
    setup: Setup,
) -> _Outcome:
    """Return the best transfer function of one output among structures and delays."""
    m = len(setup.hold)
    taken = sum(int(s.valid.sum()) for s in data)
    spread = sum(float(np.sum((s.y[s.valid] - s.y[s.valid].mean()) ** 2)) for s in judges if s.valid.any())
    if spread == 0.0 or not any(np.ptp(s.y[s.valid]) > 0.0 for s in data if s.valid.any()):
        raise EstimationError(f"output '{name}' must move to be modelled, but it is constant")
    fits: dict[tuple[int, int], Fit] = {}
    errors: dict[tuple[int, int], float] = {}
    for n, nz in structures:
        unknowns = n + m * (nz + 1 + refine) + len(data) * (n + setup.offset)
        if taken < 2 * unknowns:
            raise EstimationError(
                f"SRIVC of output '{name}' needs at least twice as many samples as its {unknowns} unknowns, got "
                f"{taken} that were taken; give more data or fewer poles"
            )
        fits[n, nz], errors[n, nz] = _best_delays(data, judges, n, nz, delays, setup)
    best = min(errors.values())
    floor = (1e-9**2) * spread
    chosen = next(s for s in structures if errors[s] <= max(_TIE**2 * best, floor))
    fit = fits[chosen]
    free = tuple(range(m)) if refine else ()
    while free:
        fit = iterate(data, fit.point, chosen[1], setup, refine=free)
        left = tuple(j for j in free if fit.point.delays[j] > 0.0)
        if left == free:
            break
        free = left  # a delay that ends at zero stays there, and the rest converges without it
        fit = iterate(data, fit.point, chosen[1], setup, refine=free)
    percent = {f"{n}/{nz}": 100.0 * (1.0 - float(np.sqrt(errors[n, nz] / spread))) for n, nz in structures}
    covariance, diagnostics = errors_of(data, fit, chosen[1], setup, free)
    diagnostics = {"structure": {"poles": chosen[0], "zeros": chosen[1]}, "fit_percent": percent, **diagnostics}
    return _Outcome(
        fit, chosen[1], free, covariance, diagnostics, _advice(name, diagnostics, bool(refine and len(free) < m))
    )


def _best_delays(
    data: list[Series], judges: list[Series], n: int, nz: int, delays: list[float], setup: Setup
) -> tuple[Fit, float]:
    """Return the fit with the delays that predict the judges best, one input after the other until none changes."""
    m = len(setup.hold)
    chosen = [delays[0]] * m
    seen: dict[tuple[float, ...], tuple[Fit, float]] = {}

    def trial(candidate: tuple[float, ...]) -> float:
        if candidate not in seen:
            fit = solve(data, n, nz, np.array(candidate), setup)
            seen[candidate] = fit, sum(cost for _, cost in runs_of(judges, fit.point, setup))
        return seen[candidate][1]

    for _ in range(m if m > 1 else 1):
        before = list(chosen)
        for j in range(m):
            options = [(*chosen[:j], d, *chosen[j + 1 :]) for d in delays]
            chosen = list(options[int(np.argmin([trial(option) for option in options]))])
        if chosen == before:
            break
    trial(tuple(chosen))
    return seen[tuple(chosen)]


def _advice(name: str, diagnostics: Mapping[str, Any], no_delay: bool) -> list[Advice]:
    out = AdviceList()
    if not diagnostics["converged"]:
        out.wrong(
            "not_converged",
            f"{name}: the instrumental variables did not converge: its coefficients are those with the smallest "
            "error found; use fewer poles or zeros, or filter out what the model cannot follow",
        )
    if diagnostics["condition"] > 1.0 / _DEFICIENT:
        out.doubt(
            "not_told_apart",
            f"{name}: the instruments are rank deficient (condition {diagnostics['condition']:.1e}): the data hold "
            "fewer poles and zeros than asked for; lower them or excite a wider band",
        )
    if no_delay:
        out.note(
            "no_delay",
            f"{name}: a refined delay ended at zero and was fixed there: there is no delay, or other terms of the "
            "structure represent it",
        )
    if diagnostics["residual_percent"] > 100.0 * _SILENT and diagnostics["white_probability"] < WHITE:
        errors_hold = (
            f"standard errors were corrected by a factor {diagnostics['error_factor']:.1f}; if the colour comes from a "
            "missing term of the model, the bias of the coefficients exceeds them"
            if diagnostics["converged"]
            else "the standard errors are not reliable, because the iterations did not converge"
        )
        out.doubt(
            "coloured_residuals",
            f"{name}: the residuals are coloured (Ljung-Box probability {diagnostics['white_probability']:.1e}): "
            f"{errors_hold}",
        )
    return out


def _model(found: Mapping[str, _Outcome], inputs: tuple[str, ...], setup: Setup) -> ContinuousTransferModel:
    """Return the model in seconds, all outputs padded to the highest order."""
    order = max(out.fit.point.a.size for out in found.values())
    p, m = len(found), len(inputs)
    numerators, denominators = np.zeros((p, m, order)), np.zeros((p, order))
    delays, names, values, blocks = np.zeros((p, m)), [], [], []
    for i, (name, out) in enumerate(found.items()):
        a, b, tau = out.fit.point
        n, nz = a.size - 1, out.zeros
        denominators[i, -a.size :], numerators[i, :, -a.size :], delays[i] = a, b, tau * setup.dt_s
        names += [f"{name}: a{k}" for k in range(1, n + 1)]
        names += [f"{name}/{given}: b{k}" for given in inputs for k in range(nz, -1, -1)]
        values += [*a[1:], *b[:, n - nz :].ravel()]
        unit = np.ones(len(out.covariance))
        if out.refined:
            names += [f"{name}/{inputs[j]}: delay_s" for j in out.refined]
            values += list(delays[i, list(out.refined)])
            unit[-len(out.refined) :] = setup.dt_s
        blocks.append(out.covariance * np.outer(unit, unit))
    ends = np.cumsum([0, *(len(block) for block in blocks)])
    covariance = np.zeros((ends[-1], ends[-1]))
    for block, at in zip(blocks, ends, strict=False):
        covariance[at : at + len(block), at : at + len(block)] = block
    return ContinuousTransferModel(
        method="srivc",
        inputs=inputs,
        outputs=tuple(found),
        dt_s=setup.dt_s,
        numerators=numerators,
        denominators=denominators,
        delays_s=delays,
        hold=setup.hold,
        offset=setup.offset,
        parameter_names=tuple(names),
        parameters=np.array(values),
        covariance=covariance,
    )


# --- the iteration: filters, instruments, steps from one transfer function to the next, and its errors ----------------


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
    """One record at a point of the search: filters, input states (N, n, m), delayed inputs (N, m), output (N,),
    basis."""

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
            f"{n} poles and {nz} zeros must describe the output within the band of its samples, but least squares puts "
            "them far beyond; use fewer poles or zeros"
        )
    fits = []
    for _, point in starts[:3]:
        fits.append(iterate(data, point, nz, setup))
        if fits[-1].converged:
            break
    return min(fits, key=lambda fit: fit.cost)


def runs_of(series: list[Series], point: Point, setup: Setup) -> list[tuple[Run, float]]:
    """Return for every record its filters and states at the point, and the summed squared error of the samples taken.

    Poles that no sampling could show have an infinite error.
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
        felt = [Sensitivities.of_all(z[:, None, :]) for z in Z]
        residuals = [v[:, None] for v in e]
        coloured = coloured_covariance(residuals, lambda: felt, np.array([[variance]]), plain, np.zeros(q))
        covariance = coloured * (taken / free)
        known = np.diag(plain) > 0.0
        out["error_factor"] = float(np.median(np.sqrt(np.diag(covariance)[known] / np.diag(plain)[known])))
    return covariance / np.outer(size, size), out
