"""One function for MOESP, N4SID, CVA, DSR, SSARX and PBSID-opt: from records to a state-space model.

Common to all: the block Hankel matrix of [u, y] of J past and L future samples, all records side by side, enters
through its R factor alone. The method makes A and C of it. B, D and the initial states of all records then follow by
one linear least squares on the free run over all valid samples, at the records' own rate, K from the VARX predictor.

Inputs whose spectrum ends far below the Nyquist frequency leave the block Hankel matrix nearly singular, and the
samples of one horizon too close together to tell the states apart. ``decimate = "auto"`` then takes A and C from data
low-passed and decimated to about ten times the bandwidth of the inputs; A goes back to the records' rate as A^(1/k),
which needs a continuous counterpart of every pole. Horizons count samples of the rate that A is identified at.

Uncertainty of a subspace estimate by a bootstrap over the residuals of its free run.

Moving-block bootstrap (H. R. Kuensch, "The jackknife and the bootstrap for general stationary observations", Annals of
Statistics 17(3), 1989): blocks of residuals, all outputs together, are drawn with replacement and added to the free run
of the model, and the whole identification is repeated. Blocks keep the colour of the residuals within their length.
The inputs stay as they are, so that inputs which react to the outputs are not covered.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.hankel import window_starts
from testbench.estimators.model import check_records, continuous_poles
from testbench.estimators.settings import Subspace
from testbench.estimators.state_space import Series, StateSpaceModel, fit_inputs, free_run
from testbench.estimators.subspace.data import LEAD, Outcome, Stretch, automatic_stride, check_order, decimate, scale
from testbench.estimators.subspace.projections import PREDICTORS, PROJECTIONS, Factor, Realisation, factorise, shortened
from testbench.estimators.subspace.tail import (
    advice_in_words,
    gain,
    lost_poles,
    other_horizon,
    pair,
    pole_shifts,
    reflect,
    to_rate,
)

# --- uncertainty of a subspace estimate by a bootstrap over the residuals of its free run -----------------------------


_POINTS = 50  # of the frequency grid


def spread(
    model: StateSpaceModel,
    out: Outcome,
    stretches: Sequence[Stretch],
    again: Subspace,
    identify: Callable[..., Outcome],
    sizes: tuple[FloatArray, FloatArray],
    replicas: int,
) -> dict[str, Any]:
    """Return deviations of poles and frequency response over replicas, as diagnostics.

    Args:
        model: the estimate in SI units.
        out: the same in units of the stretches.
        stretches: the scaled records.
        again: settings of a replica: order and stride fixed.
        identify: makes a model of scaled stretches, settings and a sample time.
        sizes: root mean squares of inputs (m,) and outputs (p,) that scaled the records.
        replicas: number of replicas, at least 2.

    Raises:
        EstimationError: fewer than two replicas succeed.
    """
    rng = np.random.default_rng(np.random.SeedSequence(again.seed))
    block = again.past_horizon + again.future_horizon
    lead = LEAD[again.offset]
    free = [free_run(out.A, out.B, out.C, out.D, Series(s.u, s.y, s.valid_y), lead) for s in stretches]
    residuals = [
        np.where(s.valid_y, s.y - y, 0.0) - np.mean(s.y - y, axis=0, where=s.valid_y | ~s.valid_y.any(axis=0))
        for s, y in zip(stretches, free, strict=True)
    ]
    (reference,) = model.poles().values()
    omega = np.geomspace(1e-3, 0.999, _POINTS) * np.pi / model.dt_s
    gains = sizes[1][:, None] / sizes[0]
    poles, responses, failed = [], [], 0
    for _ in range(replicas):
        drawn = []
        for s, y, rest in zip(stretches, free, residuals, strict=True):
            length = min(block, len(rest))
            starts = rng.integers(0, len(rest) - length + 1, size=-(-len(rest) // length))
            index = (starts[:, None] + np.arange(length)).ravel()[: len(rest)]
            drawn.append(s._replace(y=y + rest[index]))
        try:
            replica = identify(drawn, again, model.dt_s, bare=True)
        except EstimationError:
            failed += 1
            continue
        found = continuous_poles(np.linalg.eigvals(replica.A).astype(complex), model.dt_s)[0]
        if found.size != reference.size:
            failed += 1
            continue
        poles.append(pair(reference, found))
        z = np.exp(1j * omega * model.dt_s)[:, None, None]
        inner = np.linalg.solve(z * np.eye(len(replica.A)) - replica.A, replica.B.astype(complex))
        responses.append((replica.C @ inner + replica.D) * gains)
    if len(poles) < 2:
        raise EstimationError(
            f"a bootstrap needs at least 2 replicas that can be identified, got {len(poles)} of {replicas}; "
            "lower the order or give more data"
        )
    wn = np.abs(np.array(poles))
    zeta = -np.array(poles).real / np.maximum(wn, 1e-300)
    return {
        "bootstrap_reference_poles": reference,
        "wn_std": np.std(wn, axis=0, ddof=1),
        "zeta_std": np.std(zeta, axis=0, ddof=1),
        "poles_std": np.sqrt(np.sum(np.abs(np.array(poles) - reference) ** 2, axis=0) / (len(poles) - 1)),
        "response_omega_rad_s": omega,
        "response_std": np.std(np.array(responses), axis=0, ddof=1),
        "bootstrap_failed": failed,
    }


# --- from records to a state-space model ------------------------------------------------------------------------------


_PERSISTENT = 1e-3  # input Hankel matrices with weaker directions than this are decimated, if their band allows it
_SILENT = 1e-8  # directions of the inputs below this share of the strongest do not count as excitation


def estimate(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], settings: Subspace
) -> StateSpaceModel:
    """Identify an innovations model by a subspace method from one or several records of deviations from trim.

    Channels are scaled, outputs by the deviation of their innovations: units do not matter. Noise on the inputs biases
    every method of this family; inputs that react to the outputs bias all but "ssarx" and "pbsid_opt" (and DSR_e).

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: (m,) channels that drive the model.
        outputs: (p,) channels that it predicts.
        settings: the method, horizons, order and what else is asked of the model.

    Returns:
        The model at the records' sample time, with these diagnostics: ``singular_values`` over the noise floor
        (noise-free data: over the largest), ``order`` and ``order_choice``; ``decimate`` and ``identified_at_dt_s``;
        ``columns`` and ``unknowns`` per output; ``condition`` of the past; ``input_excitation``: weakest over strongest
        singular value of the input Hankel matrix; ``feedback``: share of the innovations that later inputs explain;
        ``innovations_std`` (p,) in SI units; ``output_error_percent`` (p,) of the free run on the records;
        ``free_run_over_innovations`` (p,); ``pole_shift_past``, ``pole_shift_future``: largest relative change of a
        pole with half the past and with ``other_future_horizon``; ``predictor_radius``: spectral radius of A - K C;
        ``moved_poles``: discrete z that ``stable`` moved; ``poles_without_continuous_counterpart``; with a bootstrap
        ``poles_std``, ``wn_std`` (rad/s) and ``zeta_std``, (n,) each, by the order of ``bootstrap_reference_poles``,
        ``response_std`` (k, p, m) at ``response_omega_rad_s`` (k,), ``bootstrap_failed``.

    Raises:
        EstimationError: settings against the method's laws, too few columns for the unknowns, inputs that excite fewer
            directions than the order needs, or records against those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    given = settings
    check_order(given.order, given.future_horizon, len(outputs))
    check_records(records, inputs, outputs)
    stretches, size_u, size_y = scale(records, inputs, outputs, given.offset)
    dt_s = records[0].dt_s
    out = identify(stretches, given, dt_s)
    found = out.found
    errors, sizes = _free_run_errors(out, stretches, LEAD[given.offset])
    found["output_error_percent"] = 100.0 * errors / sizes
    found["free_run_over_innovations"] = np.where(
        found["innovations_std"] > 0.0,
        errors / np.where(found["innovations_std"] > 0.0, found["innovations_std"], 1),
        0,
    )
    found["innovations_std"] = found["innovations_std"] * size_y
    advice = advice_in_words(found, outputs, given)
    model = StateSpaceModel(
        method=given.method,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        dt_s=dt_s,
        settings=given.model_dump(exclude={"label"}),
        A=out.A,
        B=out.B / size_u,
        C=size_y[:, None] * out.C,
        D=size_y[:, None] * out.D / size_u,
        K=out.K / size_y,
        diagnostics=found,
        advice=advice,
    )
    if given.bootstrap:
        again = given.model_copy(update={"order": model.order, "bootstrap": 0, "decimate": found["decimate"]})
        found.update(spread(model, out, stretches, again, identify, (size_u, size_y), given.bootstrap))
        advice = (*advice, *approximate("bootstrap", "the bootstrap's"))
    return replace(model, diagnostics=found, advice=advice)


def _realise(f: Factor, given: Subspace, L: int, order: int | None, direct: bool) -> Realisation:
    if given.method in PREDICTORS:
        return PREDICTORS[given.method](f, L, order, direct)
    return PROJECTIONS[given.method](f, L, order)


def _length(given: Subspace, L: int) -> int:
    """Samples of a window: DSR takes one more block."""
    return given.past_horizon + L + (given.method == "dsr")


def _factor(stretches: Sequence[Stretch], given: Subspace, L: int, direct: bool) -> Factor:
    length = _length(given, L)
    return factorise(stretches, given.past_horizon, length, direct, LEAD[given.offset], given.method)


def identify(stretches: Sequence[Stretch], given: Subspace, dt_s: float, bare: bool = False) -> Outcome:
    """Return the model of scaled stretches; see :func:`estimate`. ``bare``: only A, B, C, D; K is zero."""
    L, direct = given.future_horizon, given.direct_feedthrough
    full = _factor(stretches, given, L, direct)
    strides = _strides(stretches, full, given, dt_s)
    for stride in strides:
        low, slow = full, list(stretches)
        if stride > 1:
            slow = decimate(stretches, stride)
            if sum(window_starts(s.good, _length(given, L)).size for s in slow) < 2 * full.R.shape[1] and (
                given.decimate == "auto"
            ):
                continue  # too few samples would be left
            low = _factor(slow, given, L, True)
        real = _realise(low, given, L, given.order, direct or stride > 1)
        _check_excitation(low, real.A.shape[0], L)
        A, lost = to_rate(real.A, stride)
        if lost.size == 0:
            break
        if given.decimate != "auto":
            raise EstimationError(lost_poles(lost, stride))
    moved = np.zeros(0, np.complex128)
    if given.stable:
        A, moved = reflect(A)
    C = low.deviation[:, None] * real.C
    through = np.full(full.m, direct)
    if given.closed_loop and real.B is not None and real.D is not None and real.K is not None:
        B, D, K = real.B, low.deviation[:, None] * real.D, real.K / low.deviation
    else:
        fit = fit_inputs(A, C, [Series(s.u, s.y, s.valid_y) for s in stretches], through, LEAD[given.offset])
        B, D = fit.B, fit.D
        if bare:
            return Outcome(A, B, C, D, np.zeros(C.T.shape), {})
        K = gain(A, C / full.deviation[:, None], full) / full.deviation
    found = {
        "singular_values": real.singular_values,
        "order": real.A.shape[0],
        "order_choice": real.order_choice,
        "decimate": stride,
        "identified_at_dt_s": stride * dt_s,
        "columns": low.columns,
        "unknowns": low.J * (low.m + low.p) + (low.m if direct else 0),
        "condition": low.condition,
        "input_excitation": low.excitation,
        "feedback": full.feedback,
        "innovations_std": np.where(full.noisy, full.deviation, 0.0),
        "predictor_radius": float(np.max(np.abs(np.linalg.eigvals(A - K @ C)))),
        "moved_poles": moved,
        "poles_without_continuous_counterpart": continuous_poles(np.linalg.eigvals(A).astype(complex), dt_s)[1],
        **_pole_shifts(slow, low, real, given, direct or stride > 1),
    }
    return Outcome(A, B, C, D, K, found)


def _strides(stretches: Sequence[Stretch], full: Factor, given: Subspace, dt_s: float) -> list[int]:
    """Return the strides to try, in turn."""
    if given.decimate != "auto":
        return [int(given.decimate)]
    if full.exact or given.closed_loop or full.excitation > _PERSISTENT:
        return [1]
    first = automatic_stride(stretches, dt_s)
    return [*range(first, 1, -1), 1]


def _check_excitation(f: Factor, n: int, L: int) -> None:
    """Check that the inputs excite more directions than the order: a single sine cannot show two poles."""
    s = np.linalg.svd(f.inputs(0, f.J + L), compute_uv=False)
    rank = int(np.sum(s > _SILENT * s[0]))
    if rank <= min(n, s.size - 1):
        raise EstimationError(
            f"inputs must excite more directions than the order = {n}, got {rank} of {s.size} in J + L samples; "
            "add lines to the multisine, excite a wider band or lower the order"
        )


def _pole_shifts(
    stretches: Sequence[Stretch], f: Factor, real: Realisation, given: Subspace, direct: bool
) -> dict[str, Any]:
    """Return how far the poles move with other horizons; see :func:`.tail.pole_shifts`."""
    n, J, L = real.A.shape[0], f.J, given.future_horizon
    other = other_horizon(L)

    def past() -> FloatArray:
        return _realise(shortened(f, J // 2, direct), given, L, n, direct).A

    def future() -> FloatArray:
        return _realise(f if other < L else _factor(stretches, given, other, direct), given, other, n, direct).A

    if f.exact:
        return pole_shifts(real.A, other, None, None)
    windows = sum(window_starts(s.good, _length(given, other)).size - LEAD[given.offset] for s in stretches)
    halved = J // 2 >= 1 and n <= (J // 2) * (f.m + f.p)
    wide = n <= f.p * (other - 1) and windows >= 1.2 * _length(given, other) * (f.m + f.p)
    return pole_shifts(real.A, other, past if halved else None, future if wide else None)


def _free_run_errors(out: Outcome, stretches: Sequence[Stretch], lead: int) -> tuple[FloatArray, FloatArray]:
    """Return the root mean squares of y - y_free and of y per output, over the valid samples of all stretches."""
    error, size, count = (np.zeros(out.C.shape[0]) for _ in range(3))
    for s in stretches:
        y = free_run(out.A, out.B, out.C, out.D, Series(s.u, s.y, s.valid_y), lead)
        error += np.sum(np.where(s.valid_y, s.y - y, 0.0) ** 2, axis=0)
        size += np.sum(np.where(s.valid_y, s.y, 0.0) ** 2, axis=0)
        count += s.valid_y.sum(axis=0)
    return np.sqrt(error / count), np.sqrt(size / count)
