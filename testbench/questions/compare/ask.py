"""Comparison scenarios: check, fly, measure the same flights through every suite, identify, judge, predict, place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.errors import EstimationError, Refusal, located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators import estimate
from testbench.estimators.cells import contained, need_numbers
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.prepare import prepared
from testbench.flight import linearise, load_aircraft
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.information.modes import modes_of
from testbench.information.targets import needed_parameters
from testbench.line import Report, flown_already, log_rate, manoeuvre_of, trim_for
from testbench.questions.compare.judge import errors_of, model_errors
from testbench.questions.compare.near_zero import errors_in_own_units, near_zero, predicted_in_own_units
from testbench.questions.compare.placement import Placed, place, templates
from testbench.questions.compare.prediction import best_estimate, lagged_structure, predict
from testbench.questions.compare.result import CaseKey, CompareResult, Failure, Quantity
from testbench.questions.compare.scenario import BEST_CASE, CompareScenario, Placement
from testbench.questions.compare.seen import Known, sensors_of, unknowns, wanted_modes
from testbench.sensors import SensorSuite, load_suite

_AT_ONCE = 64  # repetitions in turbulence that are flown together
_FAST_MODE = {"longitudinal": "short period", "lateral": "Dutch roll"}


# --- the comparison ---------------------------------------------------------------------------------------------------


@on_one_thread
def compare(
    scenario: Named[CompareScenario],
    seed: int | None = None,
    simulate: bool = True,
    progress: Report | None = None,
    simulator: Simulator = "auto",
) -> CompareResult:
    """Compare the suites of a scenario.

    Every repetition is measured through every suite with one seed, so that sensors which two suites share have the
    same noise; in still air all repetitions share one flight. A model's prediction of the validation flights is
    compared with what the suite would show without noise and biases.

    Args:
        scenario: of :meth:`CompareScenario.load`.
        seed: of the first repetition, instead of the scenario's.
        simulate: False to compare by information alone.
        progress: called with a few words as each stage begins.
        simulator: "jsbsim" flies one flight after the other; "auto" flies many at once, where the model has been found
            equal to JSBSim.

    Raises:
        TestbenchError: with the file and key that it comes from.

    Example:
        >>> import testbench as tb
        >>> result = tb.compare(tb.load("compare/eolo_beta"), simulate=False)
        >>> result.errors  # nothing was flown
        {}
    """
    scenario = obtain(CompareScenario, scenario)
    say = progress or (lambda text: None)
    where, seed = scenario.file, scenario.seed if seed is None else seed
    say("trim and linearise")
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suites = tuple(load_suite(name) for name in scenario.suites)
    known = _known(scenario, aircraft, seed)
    say("predict by information")
    identification = scenario.identification
    predictions = {}
    for m in scenario.manoeuvre:
        if m.use == "identification":
            for suite in suites:
                outputs, inputs = identification.outputs, identification.inputs
                predictions[m.name, suite.name] = predict(known, suite, outputs, m, inputs)
    placed = None
    if scenario.placement is not None:
        say("place sensors along the wing")
        with located(where, "placement"):
            placed = _place(scenario, scenario.placement, known, suites[0])
    errors: dict[CaseKey, dict[Quantity, FloatArray]] = {}
    failures: list[Failure] = []
    flights, of_flight, tally = 0, {}, Tally()
    if simulate and scenario.identification.labels:
        air = _flights(scenario, known, suites, seed, say, simulator, tally)
        for k, (truths, flown) in enumerate(air):
            flights += flown
            if k == 0 and identification.best_case and not scenario.air.turbulence_rms_m_s:
                say("identify: without noise")
                of_flight = _flight_errors(scenario, known, suites, truths)
            say(f"identify: repetition {k + 1} of {scenario.seeds}")
            for suite in suites:
                _repeat(scenario, known, suite, truths, k, seed, errors, failures)
        if failures and not errors:
            raise EstimationError(
                f"some estimator must give a model of some suite, got none in {scenario.seeds} repetitions; the first "
                f"reason, of {failures[0].case.estimator} through {failures[0].case.suite}: {failures[0].reason}"
            )
    own = near_zero(known, predictions)
    return CompareResult(
        scenario,
        known,
        suites,
        seed,
        {case: errors_in_own_units(found, own) for case, found in errors.items()},
        tuple(failures),
        {case: predicted_in_own_units(found, own) for case, found in predictions.items()},
        {case: errors_in_own_units(found, own) for case, found in of_flight.items()},
        placed,
        flights,
        tally,
    )


def _known(scenario: CompareScenario, aircraft: Aircraft, seed: int) -> Known:
    trimmed = trim_for(scenario, aircraft, seed)
    linear = linearise(aircraft, trimmed)
    plane = scenario.plane
    modes = modes_of(linear, aircraft, plane)
    asked = scenario.targets.modes or (_FAST_MODE[plane],)
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    wanted = scenario.targets.parameters or needed_parameters(plane, controls, False, ())
    free = unknowns(aircraft, plane, controls, asked, wanted)
    return Known(aircraft, trimmed, linear, plane, modes, wanted_modes(modes, asked), wanted, free)


def _flights(
    scenario: CompareScenario,
    known: Known,
    suites: Sequence[SensorSuite],
    seed: int,
    say: Report,
    simulator: Simulator,
    tally: Tally,
) -> Iterator[tuple[Mapping[str, FlightRecord], int]]:
    """Yield the true records of every repetition by manoeuvre, and how many of them were flown for it.

    In still air all repetitions share those of the first; in turbulence they are flown some at a time.
    """
    names = [spec.name for spec in scenario.manoeuvre]
    if not scenario.air.turbulence_rms_m_s > 0.0:
        for spec in scenario.manoeuvre:
            say(f"fly {spec.name}")
        (once,) = _fly(scenario, known, suites, seed, range(1), simulator, tally)
        for k in range(scenario.seeds):
            yield once, 0 if k else len(names)
        return
    for first in range(0, scenario.seeds, _AT_ONCE):
        some = range(first, min(first + _AT_ONCE, scenario.seeds))
        say(f"fly repetitions {some[0] + 1} to {some[-1] + 1} of {scenario.seeds}")
        for truths in _fly(scenario, known, suites, seed, some, simulator, tally):
            yield truths, len(names)


def _fly(
    scenario: CompareScenario,
    known: Known,
    suites: Sequence[SensorSuite],
    seed: int,
    repetitions: range,
    simulator: Simulator,
    tally: Tally,
) -> list[dict[str, FlightRecord]]:
    """Return the true records by manoeuvre of each repetition."""
    from testbench.flight.batch.fly import fly_jobs

    rate = log_rate(scenario.simulation, suites)
    needed = tuple(sorted({name for suite in suites for s in suite.sensors for name in s.needs}))
    jobs: list[Job] = []
    for k in repetitions:
        for i, spec in enumerate(scenario.manoeuvre):
            with located(scenario.file, f"manoeuvre[{i}]"):
                rate_hz = known.trimmed.rate_hz
                manoeuvre = manoeuvre_of(spec.name, spec.input, spec.duration_s, spec.settle_s, rate_hz)
                air = air_of(scenario.air, scenario.condition.h_m, derived_seed(seed, k, i))
                jobs.append(Job(known.aircraft, known.trimmed, manoeuvre, rate, needed, air))
    out: list[dict[str, FlightRecord]] = []
    for n, flown in enumerate(fly_jobs(jobs, simulator, tally)):
        i = n % len(scenario.manoeuvre)
        with located(scenario.file, f"manoeuvre[{i}]"):
            out += [{}] if i == 0 else []
            spec = scenario.manoeuvre[i]
            out[-1][spec.name] = flown_already(known.aircraft, known.trimmed, spec.name, rate, flown)
    return out


def derived_seed(seed: int, repetition: int, manoeuvre: int) -> int:
    """Return the seed of one manoeuvre in one repetition: the first word of SeedSequence([seed, k, i])."""
    return int(np.random.SeedSequence([seed, repetition, manoeuvre]).generate_state(1)[0])


def _repeat(
    scenario: CompareScenario,
    known: Known,
    suite: SensorSuite,
    truths: Mapping[str, FlightRecord],
    repetition: int,
    seed: int,
    errors: dict[CaseKey, dict[Quantity, FloatArray]],
    failures: list[Failure],
) -> None:
    """Measure one repetition through one suite, identify with every estimator, and note the errors."""
    measured, clean = {}, {}
    with located(scenario.file, "preparation"):
        for i, spec in enumerate(scenario.manoeuvre):
            record = suite.measure(truths[spec.name], derived_seed(seed, repetition, i))
            measured[spec.name] = prepared(record, spec.settle_s, scenario.preparation)
            if spec.use == "validation":
                shown = suite.without_errors().measure(truths[spec.name], 0)
                clean[spec.name] = prepared(shown, spec.settle_s, scenario.preparation)
    judge = [measured[name] for name in clean]
    wanted = scenario.identification.outputs
    outputs = tuple(s.channel for s in sensors_of(suite, wanted))
    for spec in scenario.manoeuvre:
        if spec.use != "identification":
            continue
        for label, method, make in _models(scenario, known, suite, measured[spec.name], outputs, judge):
            case = CaseKey(spec.name, suite.name, label)
            try:
                with contained(method, scenario.identification.limit_s):
                    found = errors_of(known, need_numbers(make()), judge, list(clean.values()))
            except Refusal as failure:  # a suite may lack a channel that a structure needs: a finding too
                failures.append(Failure(case, repetition, failure.message))
                continue
            for quantity, error in found.items():
                series = errors.setdefault(case, {})
                series.setdefault(quantity, np.full(scenario.seeds, np.nan))[repetition] = error


def _flight_errors(
    scenario: CompareScenario, known: Known, suites: Sequence[SensorSuite], truths: Mapping[str, FlightRecord]
) -> dict[tuple[str, str], dict[Quantity, float]]:
    """Return what the best case errs by without any noise: a flight is not quite linear, nor sampled without end."""
    identification = scenario.identification
    out = {}
    for spec in scenario.manoeuvre:
        if spec.use != "identification":
            continue
        for suite in suites:
            record = prepared(suite.without_errors().measure(truths[spec.name], 0), spec.settle_s, scenario.preparation)
            structure = lagged_structure(known, sensors_of(suite, identification.outputs), identification.inputs)
            try:
                out[spec.name, suite.name] = model_errors(known, best_estimate(record, structure, suite))
            except Refusal:
                continue  # the repetitions say why
    return out


def _models(
    scenario: CompareScenario,
    known: Known,
    suite: SensorSuite,
    record: FlightRecord,
    outputs: tuple[str, ...],
    judge: Sequence[FlightRecord],
) -> Iterator[tuple[str, str, Callable[[], IdentifiedModel]]]:
    """Yield label and method of every estimator, and what makes its model."""
    identification = scenario.identification
    for spec, label in zip(identification.estimators, identification.labels, strict=False):
        yield label, spec.method, partial(estimate, spec, [record], identification.inputs, outputs, judge)
    if identification.best_case:
        structure = lagged_structure(known, sensors_of(suite, identification.outputs), identification.inputs)
        yield BEST_CASE, BEST_CASE, partial(best_estimate, record, structure, suite)


# --- placement --------------------------------------------------------------------------------------------------------


def _place(scenario: CompareScenario, asked: Placement, known: Known, suite: SensorSuite) -> Placed:
    """Place sensors for the modes of the placement, everything else that matters unknown too."""
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    free = unknowns(known.aircraft, known.plane, controls, asked.modes, ())
    aimed = replace(known, wanted_modes=wanted_modes(known.modes, asked.modes), wanted=(), free=free)
    manoeuvre = next(m for m in scenario.manoeuvre if m.use == "identification")
    sensors = sensors_of(suite, scenario.identification.outputs)
    return place(aimed, asked, suite, sensors, manoeuvre, templates(asked))
