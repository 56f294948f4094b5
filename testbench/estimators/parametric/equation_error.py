"""Equation error for a structure: least squares on the state equations, all states measured.

    smoothed dx/dt = f(smoothed x, smoothed u, params) + error

If f is linear in its parameters, as in all structures with dimensional derivatives, this is one linear least squares;
otherwise it takes Gauss-Newton steps. It needs no start values and cannot diverge, so it gives output error its start.
But noise of the measured states biases it, mostly towards zero, and so does what smoothing takes from the motion: both
are estimated and taken out (see ``equation_bias``). Where they are large, or cannot be told, the advice says so, and
results/estimators how far the errors fall short.
V. Klein and E. A. Morelli, Aircraft System Identification, AIAA, 2006, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, doubt, note
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.hold import said_of_hold
from testbench.estimators.parametric.accuracy import accuracy, correlations, whiteness
from testbench.estimators.parametric.advice import advice_in_words
from testbench.estimators.parametric.equation_bias import Bias, bias_of
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.sensitivities import Sensitivities
from testbench.estimators.parametric.servo import by_surfaces, in_front
from testbench.estimators.parametric.state_equations import Regression, SmoothedStates, equations, free_of, smoothed
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.settings import EquationError

_STEPS = 20
_LITTLE = 0.1  # bias, in standard errors, that is not worth a word
_MUCH = 5.0  # bias, in standard errors, of which what its correction leaves may be an error (see results/estimators)
_STILL = 1e-10  # relative change of the parameters, in standard errors, that ends the steps


_DEFAULT = EquationError()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: EquationError = _DEFAULT
) -> ParametricModel:
    """Estimate the free parameters of a structure whose states are all channels of the records.

    Bounds are not enforced: an estimate beyond one is moved onto it, and the advice says so. Priors count as data.

    Args:
        records: measured records with one sample time.
        structure: the equations; every state is a channel.
        settings: of the smoothing, and how the inputs act.

    Returns:
        The model; diagnostics as of output error where they apply, ``residual_std`` and ``whiteness_p`` per state.

    Raises:
        EstimationError: a state is not measured, nothing is free, too few samples, or a parameter is not decided.
        ChannelError: a record lacks a channel.
    """
    if in_front(structure):
        return by_surfaces(records, structure, settings, estimate)
    free = free_of(records, structure, "equation error")
    driven = Driven.of(settings, structure, records)
    data = [smoothed(r, structure, driven.delays_s, driven.held, settings.cutoff_hz) for r in records]
    count = sum(int(d.taken.sum()) for d in data)
    if count <= 2 * free.size:
        raise EstimationError(
            f"equation error of '{structure.name}' needs more than twice as many samples as its {free.size} "
            f"parameters, got {count} with all states and inputs sampled; give more data or fix some parameters"
        )
    params = structure.values
    stds = (structure.parameters[i].prior_std for i in free)
    prior = np.array([0.0 if std is None else 1.0 / std for std in stds])
    residuals, jacobians = equations(structure, data, params, free)
    size = np.sqrt(np.mean(np.vstack([d.xdot for d in data]) ** 2, axis=0))
    R = np.where(size > 0.0, size**2, 1.0)  # what never moves decides nothing, which the accuracy will say
    for _ in range(_STEPS):
        left = np.vstack([*[(j / np.sqrt(R)[:, None]).reshape(-1, free.size) for j in jacobians], np.diag(prior)])
        centre = prior * (params[free] - structure.values[free])
        right = np.concatenate([*[(e / np.sqrt(R)).ravel() for e in residuals], centre])
        scale = np.linalg.norm(left, axis=0)
        scale = np.where(scale > 0.0, scale, 1.0)
        step = -np.linalg.lstsq(left / scale, right, rcond=1e-12)[0] / scale
        params = params.copy()
        params[free] += step
        residuals, jacobians = equations(structure, data, params, free)
        new = np.maximum(np.sum(np.vstack(residuals) ** 2, axis=0) / count, (1e-11 * size) ** 2 + 1e-300)
        settled = float(np.max(np.abs(step) * scale)) <= _STILL * float(np.linalg.norm(right))
        settled = settled and bool(np.all(np.abs(new - R) <= 1e-6 * R))
        R = new
        if settled:
            break
    return _model(Regression(structure, data, params, free), records, driven, R, prior, (residuals, jacobians))


def _model(
    fit: Regression,
    records: Sequence[FlightRecord],
    driven: Driven,
    R: FloatArray,
    prior: FloatArray,
    errors: tuple[list[FloatArray], list[FloatArray]],
) -> ParametricModel:
    """Return the model of estimates from the errors of the equations, their slopes and their variances R (n,)."""
    structure, data, params, free = fit
    (residuals, jacobians), k = errors, params.size
    size = np.sqrt(np.mean(np.vstack([d.xdot for d in data]) ** 2, axis=0))
    names = [structure.parameter_names[i] for i in free]
    felt = np.array([any(np.any(j[:, s]) for j in jacobians) for s in range(size.size)])
    found = accuracy(
        [e[:, felt] for e in residuals],
        lambda: (Sensitivities.of_all(j[:, felt]) for j in jacobians),
        np.diag(R[felt]),
        prior,
        np.ones(free.size, bool),
        names,
    )
    bias = bias_of(fit, R, found.plain, prior, driven.held)
    corrected = params.copy()
    corrected[free] -= bias.total
    low, high = structure.bounds
    beyond = [structure.parameter_names[i] for i in free if not low[i] <= corrected[i] <= high[i]]
    covariance, white = np.zeros((k, k)), np.zeros((k, k))
    few = _of_few_lines(data, jacobians)
    covariance[np.ix_(free, free)] = (
        bias.widening @ (found.corrected * np.outer(few, few)) @ bias.widening.T + bias.left
    )
    white[np.ix_(free, free)] = bias.widening @ found.plain @ bias.widening.T
    deviation = np.sqrt(np.diag(found.plain))
    valid = [np.tile(d.taken[:, None], size.size) for d in data]
    white_p = np.where(felt, whiteness(residuals, valid, size, np.diag(R)), 1.0)
    y = np.vstack([r.columns(structure.outputs) for r in records])
    spread = np.maximum(y.var(axis=0), 1e-300)
    model = ParametricModel(
        method="equation_error",
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=records[0].dt_s,
        settings={
            "delays_s": dict(zip(structure.inputs, driven.delays_s.tolist(), strict=True)),
            **said_of_hold(driven.recognised),
        },
        diagnostics={
            "converged": True,
            "at_bound": beyond,
            "condition": found.condition,
            "residual_std": np.sqrt(R),
            "whiteness_p": white_p,
            "correlation": correlations(found.plain),
            "error_inflation": np.sqrt(np.diag(found.corrected)) / np.maximum(deviation, 1e-300),
            "noise_bias": bias.noise,
            "smoothing_bias": bias.smoothing,
        },
        structure=structure,
        params=np.clip(corrected, low, high),
        covariance=covariance,
        covariance_plain=white,
        noise_covariance=np.diag(spread),
        held=tuple(driven.held.tolist()),
        delays_s=tuple(driven.delays_s.tolist()),
        operating_point=(
            np.mean([d.x[0, 0] for d in data], axis=0),
            np.mean([d.u[0, 0] for d in data], axis=0),
        ),
    )
    # what advice says of outputs holds of states here
    said = replace(advice_in_words(replace(model, outputs=structure.states)), outputs=structure.outputs)
    return replace(said, advice=(*said.advice, *_bias_in_words(said, bias, free)))


def _of_few_lines(data: Sequence[SmoothedStates], jacobians: Sequence[FloatArray]) -> FloatArray:
    """Return by how much errors (f,) grow as their equation has passed few frequencies.

    A low pass at f leaves 2 f T independent values of a record of length T; as many as an equation has parameters are
    used up by them, and its residuals, smaller for it, tell too small a variance.
    """
    lines = np.sum([np.minimum(2.0 * d.cutoffs_hz * d.dt_s, 1.0) * len(d.taken) for d in data], axis=0)
    felt = np.any([np.any(J != 0.0, axis=0) for J in jacobians], axis=0)  # (n, f)
    factor = np.sqrt(lines / np.maximum(lines - felt.sum(axis=1), 1.0))
    return np.asarray(np.max(np.where(felt, np.maximum(factor, 1.0)[:, None], 1.0), axis=0))


def _bias_in_words(model: ParametricModel, bias: Bias, free: NDArray[np.intp]) -> tuple[Advice, ...]:
    """Return by how much the estimates were biased: a doubt where what is left of it may be an error, else a note."""
    error, names = np.sqrt(np.diag(model.covariance))[free], [model.structure.parameter_names[i] for i in free]
    value, total = model.params[free], bias.total

    def said(i: int) -> str:
        large = abs(total[i]) > abs(value[i])  # percent of a value near zero say nothing
        share = "" if large else f"{100.0 * abs(total[i] / value[i]):.2g} % of it, "
        return f"{names[i]} by {total[i]:.2g} ({share}{abs(total[i]) / error[i]:.2g} of its errors)"

    out: list[Advice] = []
    if bias.untold.any():
        which = ", ".join(name for name, there in zip(names, bias.untold, strict=True) if there)
        out.append(
            doubt(
                "noisy_terms",
                f"noise of the measured states is half or more of what decides {which}: how it biases them cannot be "
                "told; their standard errors hold what it may do, and the other estimates are corrected; excite that "
                "motion, fix them at a believed value, or refine the estimates by output error",
            )
        )
    if not bias.smoothing_known and not bias.untold.all():
        why = "the response of these estimates diverges or is far from the record"
        out.append(note("noisy_terms", f"what smoothing took from the motion is not corrected for, because {why}"))
    worth = [int(i) for i in np.flatnonzero(error > 0.0) if abs(total[i]) > _LITTLE * error[i]]
    worth.sort(key=lambda i: -abs(total[i]) / error[i])
    much = [i for i in worth if abs(total[i]) > _MUCH * error[i]]
    cause = "noise of the measured states and smoothing biased"
    if much:
        left = "they are corrected, but what that leaves may be an error: refine the estimates by output error"
        out.append(doubt("noisy_terms", f"{cause} {', '.join(said(i) for i in much)}; {left}"))
    elif worth:
        out.append(note("noisy_terms", f"{cause} these estimates, most {said(worth[0])}; they are corrected for it"))
    return (*out, *approximate("equation_error")) if out else ()
