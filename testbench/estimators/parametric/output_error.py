"""Output error: maximum likelihood estimates if only measurement noise disturbs the data.

The parameters, the initial states and the offsets of every record minimise

    J = 1/2 sum_i v[i]' R^-1 v[i] + N/2 ln |R|,    v = measured - simulated outputs,

by Gauss-Newton steps for a given R in turn with R = sum v v' / N (R. E. Maine and K. W. Iliff, NASA RP 1138, 1985; R.
V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter 4). Sensitivities are exact (see
``response``). Standard errors come from the information matrix and are corrected for residuals that are not white (see
``residuals``): sums over coloured residuals average out more slowly than the plain Cramer-Rao bound assumes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.call import with_settings
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, correlations, whiteness
from testbench.estimators.parametric.advice import advice_in_words
from testbench.estimators.parametric.gauss_newton import Minimum, minimise
from testbench.estimators.parametric.likelihood import Initial, Layout, Likelihood, held_inputs, stretch
from testbench.estimators.parametric.model import ParametricModel, named
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.settings import OutputError

_SETTLED = 1e-3  # relative change of the noise covariance between two rounds that ends them
_EXACT = 1e-11  # residuals below this share of every output's size are rounding
_ROUNDS = 50
_SPREAD = 0.5  # of the start values in a multi-start, relative


@with_settings(OutputError)
def estimate(
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    *,
    initial_states: Initial,
    output_biases: Sequence[str],
    output_trends: Sequence[str],
    input_biases: Sequence[str],
    delays_s: Mapping[str, float] | None,
    held: Sequence[str] | None,
    noise: Literal["diagonal", "full"],
    starts: int,
    seed: int,
    max_iterations: int,
    substeps: int,
) -> ParametricModel:
    """Estimate the free parameters of a structure from one or several records.

    Args:
        records: measured records with one sample time; of different lengths if need be.
        structure: the equations; its parameters say what is free, bounded or has a prior.
        initial_states: "free" estimates one per record; "record" takes the first sample of the channels of that name,
            "zero" takes trim.
        output_biases: outputs with a constant of their own in every record.
        output_trends: outputs with a line of their own in every record.
        input_biases: inputs with a constant error of their own in every record.
        delays_s: known delay per input, s.
        held: inputs that are held between samples; None takes those called ``*_cmd``, and others that the records
            show to be held (see :mod:`testbench.estimators.hold`). The others run linearly.
        noise: "diagonal" or "full" covariance of the residuals.
        starts: how many start points; the others scatter by half of the values, or over finite bounds. The best wins.
        seed: of the start points.
        max_iterations: Gauss-Newton steps per round.
        substeps: Runge-Kutta steps per sample of a nonlinear structure.

    Returns:
        The model. Its diagnostics: ``cost`` (log likelihood without constants, smaller is better), ``rounds``,
        ``iterations``, ``converged``, ``condition`` of the scaled information matrix, ``residual_std`` (p,),
        ``whiteness_p`` (p,), ``correlation`` (f, f), ``initial_states``, ``offsets`` and ``input_biases`` per record,
        ``error_inflation`` (f,) corrected over plain standard errors, ``starts`` with the cost of each.

    Raises:
        EstimationError: nothing is free, fewer samples than unknowns, an unknown that no output feels (its direction
            is named), or a start that diverges.
        ChannelError: a record lacks a channel.
    """
    _check(records, structure, output_biases, output_trends, input_biases, starts)
    holding, recognised = held_inputs(structure.inputs, held, records)
    delays = named(delays_s, structure.inputs, "a delay")
    stretches = [
        stretch(r, structure, delays, initial_states, tuple(output_biases), tuple(output_trends)) for r in records
    ]
    layout = Layout(
        np.flatnonzero(structure.free),
        initial_states == "free",
        tuple(structure.inputs.index(name) for name in input_biases),
        len(structure.states) - len(structure.followers),
        len(output_biases) + len(output_trends),
    )
    likelihood = Likelihood(
        structure, stretches, layout, records[0].dt_s, holding, substeps=substeps, full=noise == "full"
    )
    results, failures = [], []
    for values in start_points(structure, starts, seed):
        try:
            results.append(_search(likelihood, values, max_iterations))
        except EstimationError as error:
            failures.append(error)
    if not results:
        raise failures[0]
    best = min(results, key=lambda r: r.likelihood)
    settings = {
        "structure": structure.name,
        "initial_states": initial_states,
        "output_biases": list(output_biases),
        "output_trends": list(output_trends),
        "input_biases": list(input_biases),
        "noise": noise,
        "starts": starts,
        "seed": seed,
        **said_of_hold(recognised),
    }
    model = _model(likelihood, best, settings, tuple(delays.tolist()))
    return advice_in_words(replace(model, diagnostics={**model.diagnostics, "starts": [r.likelihood for r in results]}))


def _check(
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    output_biases: Sequence[str],
    output_trends: Sequence[str],
    input_biases: Sequence[str],
    starts: int,
) -> None:
    check_records(records, structure.must_move, structure.outputs)
    if not structure.free.any():
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    if starts < 1:
        raise EstimationError(f"starts >= 1 must hold, got {starts}")
    for name in input_biases:
        if name not in structure.inputs:
            raise EstimationError(f"an input bias belongs to an input ({', '.join(structure.inputs)}), got '{name}'")
    for name in (*output_biases, *output_trends):
        if name not in structure.outputs:
            raise EstimationError(
                f"an output bias or trend belongs to an output ({', '.join(structure.outputs)}), got '{name}'"
            )


def start_points(structure: ModelStructure, starts: int, seed: int) -> list[FloatArray]:
    """Return the structure's own start and ``starts - 1`` scattered ones, (k,) each."""
    rng = np.random.default_rng(seed)
    values, (low, high) = structure.values, structure.bounds
    points = [values]
    bounded = np.isfinite(low) & np.isfinite(high)
    for _ in range(starts - 1):
        scattered = values + _SPREAD * np.abs(values) * rng.standard_normal(values.size)
        inside = rng.uniform(np.where(bounded, low, 0.0), np.where(bounded, high, 1.0))
        point = np.where(bounded, inside, np.clip(scattered, low, high))
        points.append(np.where(structure.free, point, values))
    return points


class _Found(NamedTuple):
    """Where one search ended."""

    minimum: Minimum
    params: FloatArray
    R: FloatArray
    likelihood: float
    rounds: int
    settled: bool


def _search(likelihood: Likelihood, values: FloatArray, max_iterations: int) -> _Found:
    """Search from one vector of parameter values (k,): Gauss-Newton for a given R in turns with a new R."""
    low, high = likelihood.bounds()
    point = likelihood.start(values)
    R = np.diag(likelihood.size**2)
    total = float(likelihood.counts.sum())
    settled, rounds = False, 0
    while True:
        rounds += 1
        # The first rounds only have to bring the residuals to their size; the last one ends at 1e-5 of an error.
        tolerance = max(1e-10 / total, 1e-15) if settled else 1e-3 / total
        minimum = minimise(
            likelihood.problem(values, R), point, low, high, tolerance=tolerance, max_iterations=max_iterations
        )
        point = minimum.point
        if settled or rounds == _ROUNDS:
            break
        new = likelihood.noise([v for v, _ in likelihood.evaluate(point, values)])
        settled = bool(np.max(np.abs(np.diag(new) - np.diag(R)) / np.diag(R)) < _SETTLED)
        R = new
        if np.all(np.diag(R) <= (_EXACT * likelihood.size) ** 2):  # data without noise: nothing left to weigh
            minimum, settled = minimum._replace(converged=True), True
            break
    params = likelihood.parameters(point, values)
    return _Found(minimum, params, R, likelihood.negative_log(minimum.cost, R), rounds, settled)


def _diagnose(likelihood: Likelihood, found: _Found) -> tuple[dict[str, Any], FloatArray, FloatArray, FloatArray]:
    """Return diagnostics, the plain and the corrected covariance of the free parameters (f, f), and R."""
    layout, stretches, point = likelihood.layout, likelihood.stretches, found.minimum.point
    f, total = layout.chosen.size, int(likelihood.counts.sum())
    parts = likelihood.evaluate(point, found.params)
    residuals = [v for v, _ in parts]
    if np.any(np.diag(found.R) > likelihood.size**2) and not found.minimum.converged:
        raise EstimationError(
            "the search ended where the model fits worse than a constant; start from other values, e.g. those of "
            "equation error, or give bounds and several starts"
        )
    R = found.R * total / (total - likelihood.unknowns)  # unknowns take degrees of freedom from the residuals
    prior_weight = np.concatenate([likelihood.prior_weight, np.zeros(likelihood.unknowns - f)])
    found_accuracy = accuracy(
        residuals, [j for _, j in parts], R, prior_weight, ~found.minimum.at_bound, likelihood.names()
    )
    white, corrected = found_accuracy.plain[:f, :f], found_accuracy.corrected[:f, :f]
    deviation = np.sqrt(np.diag(white))
    nuisances = [layout.split(point, i) for i in range(len(stretches))]
    diagnostics = {
        "cost": found.likelihood,
        "rounds": found.rounds,
        "iterations": found.minimum.iterations,
        "converged": found.minimum.converged and found.settled,
        "at_bound": [n for n, b in zip(likelihood.names()[:f], found.minimum.at_bound[:f], strict=True) if b],
        "condition": found_accuracy.condition,
        "residual_std": np.sqrt(np.diag(R)),
        "whiteness_p": whiteness(residuals, [s.valid for s in stretches], likelihood.size, R),
        "correlation": correlations(white),
        "error_inflation": np.divide(np.sqrt(np.diag(corrected)), deviation, out=np.ones(f), where=deviation > 0.0),
        "initial_states": [layout.begin(x, s.x0) for (x, _, _), s in zip(nuisances, stretches, strict=True)],
        "offsets": [o for _, o, _ in nuisances],
        "input_biases": [b for _, _, b in nuisances],
    }
    return diagnostics, white, corrected, R


def _model(
    likelihood: Likelihood, found: _Found, settings: Mapping[str, Any], delays_s: tuple[float, ...]
) -> ParametricModel:
    """Return the model at the end of the best search."""
    structure, layout, stretches = likelihood.structure, likelihood.layout, likelihood.stretches
    diagnostics, white, corrected, R = _diagnose(likelihood, found)
    return ParametricModel(
        method="output_error",
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=likelihood.dt_s,
        settings=settings,
        diagnostics=diagnostics,
        structure=structure,
        params=found.params,
        covariance=layout.embedded(corrected, found.params.size),
        covariance_plain=layout.embedded(white, found.params.size),
        noise_covariance=R,
        held=tuple(likelihood.held.tolist()),
        delays_s=delays_s,
        biased=tuple(settings["output_biases"]),
        trended=tuple(settings["output_trends"]),
        biased_inputs=tuple(settings["input_biases"]),
        operating_point=(
            np.mean(diagnostics["initial_states"], axis=0),
            np.mean([s.u[0] for s in stretches], axis=0),
        ),
        substeps=likelihood.substeps,
    )
