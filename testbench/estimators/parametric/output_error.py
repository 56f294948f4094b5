"""Output error: maximum likelihood estimates if only measurement noise disturbs the data.

The parameters, the initial states and the offsets of every record minimise

    J = 1/2 sum_i v[i]' R^-1 v[i] + N/2 ln |R|,    v = measured - simulated outputs,

by Gauss-Newton steps for a given R in turn with R = sum v v' / N (R. E. Maine and K. W. Iliff, NASA RP 1138, 1985; R.
V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter 4). Sensitivities are exact (see
``response``). Standard errors come from the information matrix and are corrected for residuals that are not white (see
``residuals``): sums over coloured residuals average out more slowly than the plain Cramer-Rao bound assumes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from testbench.core.advice import AdviceList, doubt, wrong
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, advice_in_words, correlations, whiteness
from testbench.estimators.parametric.gauss_newton import Minimum, Rounds, minimise
from testbench.estimators.parametric.likelihood import Driven, Likelihood, check_nuisances, delays_found, lateness
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.servo import none_shows
from testbench.estimators.parametric.starts import first_points, point_of_filter_error, scattered
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.settings import OutputError

_SETTLED = 1e-3  # relative change of the noise covariance between two rounds that ends them
_EXACT = 1e-11  # residuals below this share of every output's size are rounding
_ROUNDS = 50
_FOLLOWING = 2  # steps of a round between the first and the last: R moves as fast as the parameters
_FINE = 1e-5  # residuals relative to an output's motion that no false minimum leaves, whatever their colour (judged)
_POOR = 0.3  # residuals relative to an output's motion from which on a third start must agree (judged)
_SCATTERED = 4  # start points besides the structure's, equation error's and filter error's
_SAME = 2.0  # difference of ln L within which two ends are one minimum, or as good as one
_DEFAULT = OutputError()
_APART = 4.0  # standard errors between ends of the same cost that are not one


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: OutputError = _DEFAULT
) -> ParametricModel:
    """Estimate the free parameters of a structure from one or several records.

    Args:
        records: measured records with one sample time; of different lengths if need be.
        structure: the equations; its parameters say what is free, bounded or has a prior.
        settings: what else is estimated, and how.

    Returns:
        The model. Its diagnostics: ``cost`` (log likelihood without constants, smaller is better), ``rounds``,
        ``iterations``, ``converged``, ``condition`` of the scaled information matrix, ``residual_std`` (p,),
        ``whiteness_p`` (p,), ``correlation`` (f, f), ``initial_states``, ``offsets``, ``input_biases`` and, by input,
        ``lateness_s`` with ``lateness_std_s`` per record,
        ``error_inflation`` (f,) corrected over plain standard errors, ``starts`` with the cost of each.

    Raises:
        EstimationError: nothing is free, fewer samples than unknowns, an unknown that no output feels (its direction
            is named), or a start that diverges.
        ChannelError: a record lacks a channel.
    """
    check_records(records, structure.must_move, structure.outputs)
    if not structure.free.any():
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    check_nuisances(structure, settings)
    driven = Driven.of(settings, structure, records)
    likelihood = Likelihood.over(records, structure, driven, settings)
    first = first_points(likelihood, records, settings)
    ends, failure = _ends(likelihood, first, settings)
    if not ends:
        assert failure is not None
        raise failure
    best = min(ends, key=lambda end: end.likelihood)
    model = _model(likelihood, best, settings, driven)
    model = replace(model, diagnostics={**model.diagnostics, "starts": [end.likelihood for end in ends]})
    return _with_advice_on_starts(advice_in_words(model), likelihood, ends)


class _Found(NamedTuple):
    """Where one search ended."""

    minimum: Minimum
    params: FloatArray
    R: FloatArray
    likelihood: float
    rounds: int
    settled: bool


def _ends(
    likelihood: Likelihood, first: list[FloatArray], settings: OutputError
) -> tuple[list[_Found], EstimationError | None]:
    """Return where searches ended, and why the first failed that did: ``starts`` of them, or as many as it takes."""
    ends: list[_Found] = []
    failure: EstimationError | None = None
    for point in _points(likelihood, first, settings.starts, np.random.default_rng(settings.seed)):
        try:
            least = min((end.likelihood for end in ends), default=-np.inf)
            ends.append(_search(likelihood, point, settings.max_iterations, least))
        except EstimationError as error:
            failure = failure or error
            continue
        if settings.starts is None and _settled(likelihood, ends):
            break
    return ends, failure


def _points(
    likelihood: Likelihood, first: list[FloatArray], starts: int | None, rng: np.random.Generator
) -> Iterator[FloatArray]:
    """Yield start points, made when they are wanted."""
    structure = likelihood.structure
    if starts is not None:
        yield from [*first, *scattered(structure, structure.values, max(0, starts - len(first)), rng)][:starts]
        return
    yield from first
    if (filtered := point_of_filter_error(likelihood, first[0])) is not None:
        yield filtered
    yield from scattered(structure, first[0], _SCATTERED, rng)


def _settled(likelihood: Likelihood, ends: list[_Found]) -> bool:
    """Whether the best end needs no other start: its residuals look like noise, or enough starts have ended there."""
    best = min(ends, key=lambda end: end.likelihood)
    if not _looks_bad(likelihood, best):
        return True
    return _reached(ends) >= (3 if _poor(likelihood, best) else 2)


def _looks_bad(likelihood: Likelihood, end: _Found) -> bool:
    quick = none_shows(likelihood.structure, likelihood.names(), end.minimum.at_bound, end.params)
    if not (end.minimum.converged and end.settled) or np.any(end.minimum.at_bound & ~quick):
        return True
    if np.all(np.sqrt(np.diag(end.R)) < _FINE * likelihood.size):
        return False
    residuals = likelihood.residuals(end.minimum.point, end.params)
    white = whiteness(residuals, [s.valid for s in likelihood.stretches], likelihood.size, end.R)
    return bool(np.any(white < WHITE))


def _poor(likelihood: Likelihood, end: _Found) -> bool:
    return bool(np.any(np.sqrt(np.diag(end.R)) > _POOR * likelihood.size))


def _reached(ends: list[_Found]) -> int:
    """Return how many searches ended at the least cost."""
    costs = np.array([end.likelihood for end in ends])
    return int(np.sum(costs - costs.min() < _SAME))


def _with_advice_on_starts(model: ParametricModel, likelihood: Likelihood, ends: list[_Found]) -> ParametricModel:
    """Return the model with what its starts say of its minimum."""
    best = min(ends, key=lambda end: end.likelihood)
    above = np.array([end.likelihood - best.likelihood for end in ends])
    worse, reached, out = above[above >= _SAME], _reached(ends), AdviceList()
    if worse.size:
        others = f"{worse.min():.3g} to {worse.max():.3g}" if worse.size > 1 else f"{worse[0]:.3g}"
        said = (
            f"{reached} of {len(ends)} starts ended at this minimum, {worse.size} at others, {others} higher in -ln L"
        )
        if reached > 1 or not _looks_bad(likelihood, best):
            out.note("starts_disagree", said)
        else:
            judge = wrong if _poor(likelihood, best) or not model.diagnostics["converged"] else doubt
            fix = "there may be a better one; give start values or bounds, or more starts, or check the structure"
            out.append(judge("starts_disagree", f"only {said}: {fix}"))
    free, names = model.structure.free, model.structure.parameter_names
    error = np.sqrt(np.diag(model.covariance))
    apart = np.array([np.where(free, np.abs(end.params - best.params), 0.0) for end in ends])[above < _SAME].max(axis=0)
    if far := [n for n, a, e in zip(names, apart, error, strict=True) if e > 0.0 and a > _APART * e]:
        out.doubt(
            "equal_minima",
            f"other values of {', '.join(far)} fit these records as well (beyond {_APART:g} standard errors); fix "
            "some of them, or give bounds that leave one answer",
        )
    return replace(model, advice=(*model.advice, *out))


def _search(likelihood: Likelihood, values: FloatArray, max_iterations: int, least: float) -> _Found:
    """Search from one vector of parameter values (k,): Gauss-Newton for a given R in turns with a new R.

    A search that comes as low as an earlier one did (``least``) has found the same minimum, and ends there.
    """
    low, high = likelihood.bounds()
    point = likelihood.start(values)
    R = np.diag(likelihood.size**2)
    total = float(likelihood.counts.sum())
    settled, rounds, following = False, 0, Rounds(np.diag(R))
    while True:
        rounds += 1
        # The rounds only have to bring the residuals to their size; the last one ends at 1e-5 of an error.
        tolerance = max(1e-10 / total, 1e-15) if settled else 1e-3 / total
        most = max_iterations if settled or rounds == 1 else min(_FOLLOWING, max_iterations)
        minimum = minimise(likelihood.problem(values, R), point, low, high, tolerance=tolerance, max_iterations=most)
        point = minimum.point
        if settled or rounds == _ROUNDS:
            break
        new = likelihood.noise(likelihood.residuals(point, values))
        settled = bool(np.max(np.abs(np.diag(new) - np.diag(R)) / np.diag(R)) < _SETTLED)
        if np.all(np.diag(new) <= (_EXACT * likelihood.size) ** 2):  # data without noise: nothing left to weigh
            minimum, settled, R = minimum._replace(converged=True), True, new
            break
        if likelihood.negative_log(total, new) < least + _SAME:
            minimum, settled, R = minimum._replace(converged=True, cost=total), True, new
            break
        variances = following.follow(np.diag(new), settled)
        R = new if likelihood.full else np.diag(variances)
    params = likelihood.parameters(point, values)
    return _Found(minimum, params, R, likelihood.negative_log(minimum.cost, R), rounds, settled)


def _diagnose(likelihood: Likelihood, found: _Found) -> tuple[dict[str, Any], FloatArray, FloatArray, FloatArray]:
    """Return diagnostics, the plain and the corrected covariance of the free parameters (f, f), and R."""
    layout, stretches, point = likelihood.layout, likelihood.stretches, found.minimum.point
    f, total = layout.chosen.size, int(likelihood.counts.sum())
    residuals = likelihood.residuals(point, found.params)
    if np.any(np.diag(found.R) > likelihood.size**2) and not found.minimum.converged:
        raise EstimationError(
            "the search ended with a fit worse than a constant; start from other values, e.g. those of equation "
            "error, or give bounds and several starts"
        )
    quick = none_shows(likelihood.structure, likelihood.names(), found.minimum.at_bound, found.params)
    at_bound = found.minimum.at_bound & ~quick
    R = found.R * total / (total - likelihood.unknowns)  # unknowns take degrees of freedom from the residuals
    found_accuracy = accuracy(
        residuals,
        lambda: (s for _, s in likelihood.evaluate(point, found.params)),
        R,
        likelihood.prior_weight,
        ~at_bound,
        likelihood.names(),
        np.arange(likelihood.unknowns) >= f,
    )
    white, corrected = found_accuracy.plain[:f, :f], found_accuracy.corrected[:f, :f]
    deviation = np.sqrt(np.diag(white))
    nuisances = [layout.split(point, i) for i in range(len(stretches))]
    diagnostics = {
        "cost": found.likelihood,
        "rounds": found.rounds,
        "iterations": found.minimum.iterations,
        "converged": found.minimum.converged and found.settled,
        "at_bound": [n for n, b in zip(likelihood.names()[:f], at_bound[:f], strict=True) if b],
        "none_shows": [n for n, b in zip(likelihood.names()[:f], quick[:f], strict=True) if b],
        "condition": found_accuracy.condition,
        "residual_std": np.sqrt(np.diag(R)),
        "whiteness_p": whiteness(residuals, [s.valid for s in stretches], likelihood.size, R),
        "correlation": correlations(white),
        "error_inflation": np.divide(np.sqrt(np.diag(corrected)), deviation, out=np.ones(f), where=deviation > 0.0),
        "initial_states": [layout.begin(n.initial, s.x0) for n, s in zip(nuisances, stretches, strict=True)],
        "offsets": [n.offsets for n in nuisances],
        "input_biases": [n.biases for n in nuisances],
        **lateness(layout, likelihood.structure.inputs, nuisances, found_accuracy.corrected),
    }
    return diagnostics, white, corrected, R


def _model(likelihood: Likelihood, found: _Found, settings: OutputError, driven: Driven) -> ParametricModel:
    """Return the model at the end of the best search."""
    structure, layout, stretches = likelihood.structure, likelihood.layout, likelihood.stretches
    diagnostics, white, corrected, R = _diagnose(likelihood, found)
    return driven.model(
        structure,
        {
            "structure": structure.name,
            "initial_states": settings.initial_states,
            "output_biases": list(settings.output_biases),
            "output_trends": list(settings.output_trends),
            "input_biases": list(settings.input_biases),
            "late_std_s": dict(settings.late_std_s),
            "noise": settings.noise,
            "starts": settings.starts,
            "seed": settings.seed,
        },
        method="output_error",
        dt_s=likelihood.sampling.dt_s,
        diagnostics=diagnostics,
        params=found.params,
        covariance=layout.embedded(corrected, found.params.size),
        covariance_plain=layout.embedded(white, found.params.size),
        noise_covariance=R,
        delays_s=delays_found(structure.inputs, driven.delays_s, diagnostics),
        biased=settings.output_biases,
        trended=settings.output_trends,
        biased_inputs=settings.input_biases,
        operating_point=(np.mean(diagnostics["initial_states"], axis=0), np.mean([s.u[0] for s in stretches], axis=0)),
        substeps=settings.substeps,
    )
