"""Filter error: maximum likelihood estimates if turbulence shakes the aircraft and noise disturbs the measurements.

    dx/dt = f(x, u, params) + F w,    y[i] = h(x[i], u[i], params) + G e[i],    w, e white with unit intensity

A Kalman filter with its settled gain predicts each sample from those before. The parameters, F, the initial states and
the offsets of every record minimise

    J = 1/2 sum_i v[i]' R^-1 v[i] + N/2 ln |R|,    v = innovations, R diagonal,

by Gauss-Newton steps for a given R in turn with R = sum v v' / N (R. E. Maine and K. W. Iliff, NASA TP 1690, 1981; R.
V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter 5). F is diagonal and searched as
logarithms; after each change of R it is rescaled as there, so that the gain stays about what it was.

Published gains are P C' R^-1 with F F' bounded so that G G' = R - C P C' stays positive. Here the gain is that of the
filter whose measurement noise has the variances R, P C' (C P C' + R)^-1: the same family on another scale of F, in
which the eigenvalues of K C are below 1 for every F, and no constraint is needed. Since a common factor of F F' and
G G' leaves the gain alone, F and G are reported with the factor that makes C P C' + G G' agree with R on average.
The full likelihood would estimate all of G as well, but smoothed or differentiated channels (a pitch acceleration made
from the pitch rate) then draw it to the meaningless maximum of a channel without noise.

Derivatives are exact, also those of the gain (see ``kalman.gain``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbench.core.advice import AdviceList
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, advice_in_words, correlations, own_poles, whiteness
from testbench.estimators.parametric.kalman.forms import (
    ANGLES,
    FALSE_ALARM,
    Choice,
    Form,
    Sensor,
    chosen,
    flow_angle,
    with_gust,
)
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood
from testbench.estimators.parametric.likelihood import (
    Driven,
    Layout,
    Likelihood,
    check_nuisances,
    delays_found,
    lateness,
)
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.servo import none_shows
from testbench.estimators.parametric.starts import first_points
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.settings import FilterError

_BELIEVED = 0.99  # eigenvalue of K C beyond which a measurement replaces the prediction
_WORSE = 2.0  # free-run error over the start's that is said; beyond _FAR and worse than a constant it is refused
_FAR = 3.0
_ROUNDING = 1e-6  # free-run error below this share of an output is rounding
_DEFAULT = FilterError()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: FilterError = _DEFAULT
) -> ParametricModel:
    """Estimate the free parameters of a structure, and the noise, from records flown in turbulence.

    Args:
        records: measured records with one sample time; of different lengths if need be.
        structure: the equations; its parameters say what is free, bounded or has a prior.
        settings: the form of the process noise, what else is estimated, and how.

    Returns:
        The model; its ``noise_covariance`` is that of the innovations. Diagnostics as of output error, and
        ``process_noise`` by state: value and its standard error, unit of the state per square root of a second;
        ``process_noise_correlation`` (s, s) of those states; ``gust``: its ``bandwidth_rad_s``, ``rms`` and ``sensor``,
        or None; ``process_noise_model`` that was taken and ``process_noise_criteria`` by form that was tried: Schwarz's
        criterion less the least; ``process_noise_ratio``: 2 ln L of process noise against none and its probability if
        there is none, or None; ``measurement_noise`` by output, standard deviation; ``gain`` (n, p) per record, of a
        gust with its row first;
        ``kc_eigenvalue``: the largest of K C, at most 1; 1 says that some channel is taken as free of noise;
        ``free_run_error`` and ``free_run_error_start``: (p,) output error of the simulation without filter, relative to
        each output's motion, with the estimates and with the start values.

    Raises:
        EstimationError: nothing is free, fewer samples than unknowns, an unknown that no output feels (it is named), a
            state name that is none, start values at which the filter diverges, or an estimate out of the samples'
            range: a pole beyond the Nyquist frequency, or a model that only its filter holds up.
        ChannelError: a record lacks a channel.
    """
    check_records(records, structure.inputs, structure.outputs)
    if not structure.free.any():
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    noisy, fixed = _process_noise(structure, settings)
    check_nuisances(structure, settings)
    driven = Driven.of(settings, structure, records)
    plain = Likelihood.over(records, structure, driven, settings)
    stretches, layout = plain.stretches, plain.layout

    def make(form: Form) -> FilterLikelihood:
        if form.name != "gust":
            still = form.name == "none"
            return FilterLikelihood(plain, [] if still else noisy, fixed, shared=form.name == "full")
        assert form.sensor is not None
        whole = with_gust(structure, form.sensor, np.pi / records[0].dt_s)
        begun = [replace(s, x0=np.concatenate([[0.0], s.x0])) for s in stretches]
        both = layout._replace(chosen=np.flatnonzero(whole.free), states=layout.states + 1)
        base = Likelihood(whole, begun, both, plain.sampling)
        return FilterLikelihood(base, [0], np.zeros(len(whole.states)))

    values = first_points(plain, records, settings)[0]
    choice = chosen(_forms(structure, settings), make, values, settings.max_iterations, settings.against_none)
    likelihood, found = choice.fit.likelihood, choice.fit.found
    diagnostics, white, corrected = _diagnose(choice, layout)
    extra = len(likelihood.base.structure.states) - len(structure.states)  # the gust
    params = structure.values
    params[layout.chosen] = found.minimum.point[: layout.chosen.size]
    model = driven.model(
        structure,
        {
            "structure": structure.name,
            "process_noise": [structure.states[i] for i in noisy] if choice.fit.likelihood.noisy else [],
            "process_noise_model": choice.fit.form.name,
            "fixed_process_noise": dict(settings.fixed_process_noise),
            "initial_states": settings.initial_states,
            "output_biases": list(settings.output_biases),
            "output_trends": list(settings.output_trends),
            "input_biases": list(settings.input_biases),
            "late_std_s": dict(settings.late_std_s),
        },
        method="filter_error",
        dt_s=records[0].dt_s,
        diagnostics=diagnostics,
        params=params,
        covariance=layout.embedded(corrected, params.size),
        covariance_plain=layout.embedded(white, params.size),
        noise_covariance=np.diag(diagnostics["residual_std"] ** 2),
        delays_s=delays_found(structure.inputs, driven.delays_s, diagnostics),
        biased=settings.output_biases,
        trended=settings.output_trends,
        biased_inputs=settings.input_biases,
        operating_point=(
            np.mean([x[extra:] for x, _ in likelihood.points], axis=0),
            np.mean([u for _, u in likelihood.points], axis=0),
        ),
        substeps=settings.substeps,
    )
    free = _free_run_errors(model, records), _free_run_errors(replace(model, params=structure.values), records)
    _refuse_far(model, *free)
    model = replace(
        model, diagnostics={**model.diagnostics, "free_run_error": free[0], "free_run_error_start": free[1]}
    )
    return _with_filter_advice(advice_in_words(model))


def _free_run_errors(model: ParametricModel, records: Sequence[FlightRecord]) -> FloatArray:
    """Return the root mean square of measured less simulated outputs over that of their motion, (p,); inf: diverges."""
    miss, size, count = (np.zeros(len(model.outputs)) for _ in range(3))
    for record in records:
        part = record.select(model.outputs)
        try:
            with np.errstate(all="ignore"):
                y = model.simulate(record)
        except EstimationError:
            return np.full(size.size, np.inf)
        if not np.all(np.isfinite(y)):
            return np.full(size.size, np.inf)
        miss += np.sum(np.where(part.valid, part.data - y, 0.0) ** 2, axis=0)
        size += np.sum(np.where(part.valid, part.data - part.data.mean(axis=0), 0.0) ** 2, axis=0)
        count += part.valid.sum(axis=0)
    return np.asarray(np.sqrt(miss / np.maximum(size, 1e-300)))


def _refuse_far(model: ParametricModel, found: FloatArray, start: FloatArray) -> None:
    """Check that the estimate has not left the range that samples can speak of.

    With process noise on too few states the likelihood may rise without bound towards a model in which a state with
    process noise is so fast that it is itself noise, or towards one that only the filter holds up.

    Raises:
        EstimationError: a pole is faster than the sampling can show and the start's was not, or an output's free run is
            worse than a constant and far worse than the start's.
    """
    noisy = ", ".join(model.settings["process_noise"]) or "no state"
    fix = "give process noise to more states (all if not named), or fix it, or use output error"
    fastest, before = (
        float(np.max(np.abs(own_poles(m)))) for m in (model, replace(model, params=model.structure.values))
    )
    nyquist = np.pi / model.dt_s
    if fastest > nyquist > before:
        raise EstimationError(
            f"poles must stay below the Nyquist frequency of {nyquist:.4g} rad/s for the data to decide them, but with "
            f"process noise on {noisy} filter error runs to a pole of {fastest:.4g} rad/s (the start: {before:.4g}): a "
            f"state that answers at once turns process noise into noise of its output; {fix}"
        )
    far = (found > 1.0) & (found > _FAR * start)
    if np.any(far):
        name = model.outputs[int(np.argmax(np.where(far, found / np.maximum(start, 1e-12), 0.0)))]
        i = model.outputs.index(name)
        raise EstimationError(
            "without its filter, the model of filter error must predict the records about as well as the start "
            f"values, but '{name}' is then off by {found[i]:.3g} times its own size (the start: {start[i]:.2g}): "
            f"process noise on {noisy} takes the place of the model; {fix}"
        )


def _with_filter_advice(model: ParametricModel) -> ParametricModel:
    """Return the model with what its filter makes doubtful."""
    found, out = model.diagnostics, AdviceList()
    free, start = found["free_run_error"], found["free_run_error_start"]
    worse = [
        f"{name} ({100 * e:.0f} % of its motion, the start's {100 * s:.0f} %)"
        for name, e, s in zip(model.outputs, free, start, strict=True)
        if e > _WORSE * s and e > _ROUNDING
    ]
    if worse:
        out.doubt(
            "free_run",
            "without its filter the model predicts the records less well than the start values do: "
            f"{', '.join(worse)}; the process noise may absorb errors of the model; compare with output error, or give "
            "process noise to other states",
        )
    if found["kc_eigenvalue"] > _BELIEVED:
        out.doubt(
            "filter_follows_sensor",
            "the filter reproduces some channel almost exactly (largest eigenvalue of K C "
            f"{found['kc_eigenvalue']:.4f}): that channel may be smoothed, or computed from others; try without it",
        )
    if found["process_noise_ratio"] is not None and found["process_noise_ratio"][1] > FALSE_ALARM:
        ratio, probability = found["process_noise_ratio"]
        out.note(
            "no_process_noise",
            f"process noise is not significant: 2 ln L is {ratio:.2g} against it, and at least as much in "
            f"{100 * probability:.2g} % of flights in plain air; output error gives the same with fewer unknowns",
        )
    out.extend(approximate("filter_error"))
    return replace(model, advice=(*model.advice, *out))


def _process_noise(structure: ModelStructure, settings: FilterError) -> tuple[list[int], FloatArray]:
    """Return the indices of the states with unknown process noise, and (n,) the known one of the others."""
    chosen, known = settings.process_noise, settings.fixed_process_noise
    for name in (*(chosen or ()), *known):
        if name not in structure.states:
            raise EstimationError(f"process noise belongs to a state ({', '.join(structure.states)}), got '{name}'")
    shaken = [s for s in structure.states if s not in (*known, *structure.followers)]
    names = shaken if chosen is None else list(chosen)
    both = sorted(set(names) & set(known))
    if both:
        raise EstimationError(f"process noise of {', '.join(both)} is both estimated and fixed; choose one")
    return [i for i, s in enumerate(structure.states) if s in names], np.array(
        [known.get(s, 0.0) for s in structure.states]
    )


def _forms(structure: ModelStructure, settings: FilterError) -> tuple[Form, ...]:
    """Return the forms of process noise to fit."""
    model, named, fixed = settings.process_noise_model, settings.process_noise, settings.fixed_process_noise
    gusts: tuple[Form, ...] = ()
    angle = flow_angle(structure)
    if angle is not None:
        sensors: tuple[Sensor, ...] = ("inertial", "vane") if angle in structure.outputs else ("vane",)
        gusts = tuple(Form("gust", sensor) for sensor in sensors)
    if model == "auto":
        if fixed:
            return (Form("diagonal"),)
        if named is not None:
            return (Form("diagonal"), Form("none"))
        return (Form("diagonal"), *gusts, Form("full"), Form("none"))
    if model == "gust":
        if not gusts:
            raise EstimationError(
                f"a gust turns a flow angle ({' or '.join(ANGLES)}), but the states of '{structure.name}' are "
                f"{', '.join(structure.states)}; take process_noise_model = 'full'"
            )
        if named is not None or fixed:
            raise EstimationError(
                "process noise of named states does not go with process_noise_model = 'gust', which shakes all of them "
                "through the flow angle; name none, or take 'diagonal'"
            )
        return gusts
    return (Form(model),)


def _diagnose(choice: Choice, layout: Layout) -> tuple[dict[str, Any], FloatArray, FloatArray]:
    """Return diagnostics, and the plain and the corrected covariance of the free parameters (f, f)."""
    likelihood, found = choice.fit.likelihood, choice.fit.found
    base, own, parts, point = likelihood.base, likelihood.base.layout, found.parts, found.minimum.point
    f, total, states = layout.chosen.size, int(base.counts.sum()), base.structure.states
    residuals = [part.v for part in parts]
    R = found.R * total / (total - likelihood.unknowns)  # unknowns take degrees of freedom from the innovations
    names, params = likelihood.names(), base.parameters(point, base.structure.values)
    quick = none_shows(base.structure, names, found.minimum.at_bound, params)
    at_bound = found.minimum.at_bound & ~quick
    a = accuracy(
        residuals,
        lambda: (part.dv for part in parts),
        np.diag(R),
        likelihood.prior_weight,
        ~at_bound,
        names,
        likelihood.alone,
    )
    white, corrected = a.plain[:f, :f], a.corrected[:f, :f]
    deviation = np.sqrt(np.diag(white))
    share = np.mean([1.0 / np.mean(np.diag(part.gain.S) / found.R) for part in parts])
    Q, Q_std = _intensities(likelihood, point, a.corrected)
    noisy = likelihood.noisy
    there = params[None].astype(complex)
    products = [part.gain.K @ likelihood.linearised(there, i)[1][0].real for i, part in enumerate(parts)]
    nuisances = [own.split(point, i) for i in range(len(parts))]
    gust = len(states) > layout.states
    least = min(fit.criterion for fit in choice.tried)
    bandwidth = float(np.exp(point[f])) if gust else 0.0
    diagnostics = {
        "cost": base.negative_log(found.minimum.cost, np.diag(found.R)),
        "rounds": found.rounds,
        "iterations": found.minimum.iterations,
        "converged": found.converged,
        "at_bound": [n for n, b in zip(names[:f], at_bound[:f], strict=True) if b],
        "none_shows": [n for n, b in zip(names[:f], quick[:f], strict=True) if b],
        "condition": a.condition,
        "residual_std": np.sqrt(R),
        "whiteness_p": whiteness(residuals, [s.valid for s in base.stretches], base.size, np.diag(R)),
        "correlation": correlations(white),
        "error_inflation": np.divide(np.sqrt(np.diag(corrected)), deviation, out=np.ones(f), where=deviation > 0.0),
        "initial_states": [
            own.begin(n.initial, s.x0)[int(gust) :] for n, s in zip(nuisances, base.stretches, strict=True)
        ],
        "offsets": [n.offsets for n in nuisances],
        "input_biases": [n.biases for n in nuisances],
        **lateness(own, base.structure.inputs, nuisances, a.corrected),
        "process_noise": {
            states[i]: (float(np.sqrt(share) * Q[i, i] ** 0.5), float(np.sqrt(share) * Q_std[i])) for i in noisy
        },
        "process_noise_correlation": correlations(Q[np.ix_(noisy, noisy)]),
        "process_noise_model": str(choice.fit.form),
        "process_noise_criteria": {str(fit.form): fit.criterion - least for fit in choice.tried},
        "process_noise_ratio": None if choice.probability is None else (choice.against_none, choice.probability),
        "gust": {
            "bandwidth_rad_s": bandwidth,
            "rms": float(np.sqrt(share * Q[0, 0] / (2.0 * bandwidth))),
            "sensor": choice.fit.form.sensor,
        }
        if gust
        else None,
        "measurement_noise": dict(zip(base.structure.outputs, np.sqrt(share * R).tolist(), strict=True)),
        "gain": [part.gain.K for part in parts],
        "kc_eigenvalue": max(float(np.max(np.linalg.eigvals(product).real)) for product in products),
    }
    return diagnostics, white, corrected


def _intensities(
    likelihood: FilterLikelihood, point: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return F F' (n, n) and the standard error of the square root of each of its diagonal elements (n,)."""
    rows = np.tile(point.astype(complex), (point.size, 1)) + 1j * STEP * np.eye(point.size)
    F = likelihood.process_noise(rows)
    size = np.sqrt(np.sum(F**2, axis=-1))
    slope = np.nan_to_num(size.imag / STEP)
    nominal = F[0].real
    return nominal @ nominal.T, np.sqrt(np.maximum(np.einsum("ai,ab,bi->i", slope, covariance, slope), 0.0))
