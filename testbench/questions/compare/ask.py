"""Comparison scenarios: check, fly, measure the same flights through every suite, identify, judge, predict, place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar, cast

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.errors import EstimationError, Refusal, located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Manoeuvre as Entry
from testbench.estimators import estimate
from testbench.estimators.cells import contained, need_numbers
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prepare import prepared
from testbench.evaluation.derivatives import dimensional_derivatives, true_parameters
from testbench.evaluation.metrics import mrse_percent
from testbench.evaluation.modes import match_poles, modes_of
from testbench.flight import linearise, load_aircraft
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.flight.simulate import Manoeuvre
from testbench.information.targets import needed_parameters, unknowns
from testbench.line import Report, log_rate, trim_for, truth_of
from testbench.questions.compare.placement import Placed, place, templates
from testbench.questions.compare.prediction import (
    Known,
    LaggedStructure,
    Prediction,
    aircraft_poles,
    best_estimate,
    lagged_structure,
    predict,
    wanted_modes,
)
from testbench.questions.compare.result import CaseKey, CompareResult, Failure, Quantity
from testbench.questions.compare.scenario import BEST_CASE, CompareScenario, Placement
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
    flights, of_flight = 0, {}
    experiment = Experiment(scenario, known, suites, seed, simulator)
    if simulate and scenario.identification.labels:
        for k, (truths, flown) in enumerate(experiment.flights(say)):
            flights += flown
            if k == 0 and identification.best_case and not scenario.air.turbulence_rms_m_s:
                say("identify: without noise")
                of_flight = experiment.flight_errors(truths)
            say(f"identify: repetition {k + 1} of {scenario.seeds}")
            for suite in suites:
                for case, found in experiment.errors(suite, truths, k):
                    if isinstance(found, Failure):
                        failures.append(found)
                        continue
                    for quantity, error in found.items():
                        series = errors.setdefault(case, {})
                        series.setdefault(quantity, np.full(scenario.seeds, np.nan))[k] = error
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
        experiment.tally,
    )


def _known(scenario: CompareScenario, aircraft: Aircraft, seed: int) -> Known:
    trimmed = trim_for(scenario, aircraft, seed)
    linear = linearise(aircraft, trimmed)
    plane = scenario.plane
    modes = modes_of(linear, aircraft, plane)
    asked = scenario.targets.modes or (_FAST_MODE[plane],)
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    wanted = scenario.targets.parameters or needed_parameters(plane, controls, False, ())
    free = unknowns(aircraft, plane, [c for c in CONTROLS if c in controls], asked, wanted)
    return Known(aircraft, trimmed, linear, plane, modes, wanted_modes(modes, asked), wanted, free)


@dataclass(frozen=True, eq=False)
class Experiment:
    """What is flown and through what it is measured: the suites of a scenario, with the aircraft that is known.

    ``tally`` counts what flies; ``simulator`` says what may.
    """

    scenario: CompareScenario
    known: Known
    suites: Sequence[SensorSuite]
    seed: int
    simulator: Simulator = "auto"
    tally: Tally = field(default_factory=Tally)

    @property
    def inputs(self) -> list[Entry]:
        """The manoeuvres that models are identified from."""
        return [spec for spec in self.scenario.manoeuvre if spec.use == "identification"]

    def flights(self, say: Report) -> Iterator[tuple[Mapping[str, FlightRecord], int]]:
        """Yield the true records of every repetition by manoeuvre, and how many of them were flown for it.

        In still air all repetitions share those of the first; in turbulence they are flown some at a time.
        """
        scenario = self.scenario
        if not scenario.air.turbulence_rms_m_s > 0.0:
            for spec in scenario.manoeuvre:
                say(f"fly {spec.name}")
            (once,) = self._fly(range(1))
            for k in range(scenario.seeds):
                yield once, 0 if k else len(scenario.manoeuvre)
            return
        for first in range(0, scenario.seeds, _AT_ONCE):
            some = range(first, min(first + _AT_ONCE, scenario.seeds))
            say(f"fly repetitions {some[0] + 1} to {some[-1] + 1} of {scenario.seeds}")
            for truths in self._fly(some):
                yield truths, len(scenario.manoeuvre)

    def _fly(self, repetitions: range) -> list[dict[str, FlightRecord]]:
        """Return the true records by manoeuvre of each repetition."""
        from testbench.flight.batch.fly import fly_jobs

        scenario, aircraft, trimmed = self.scenario, self.known.aircraft, self.known.trimmed
        rate = log_rate(scenario.simulation, self.suites)
        needed = tuple(sorted({name for suite in self.suites for s in suite.sensors for name in s.needs}))
        jobs: list[Job] = []
        for k in repetitions:
            for i, spec in enumerate(scenario.manoeuvre):
                with located(scenario.file, f"manoeuvre[{i}]"):
                    manoeuvre = Manoeuvre.of(spec.name, spec.input, spec.duration_s, trimmed.rate_hz, spec.settle_s)
                    air = air_of(scenario.air, scenario.condition.h_m, derived_seed(self.seed, k, i))
                    jobs.append(Job(aircraft, trimmed, manoeuvre, rate, needed, air))
        out: list[dict[str, FlightRecord]] = []
        for n, (job, flown) in enumerate(zip(jobs, fly_jobs(jobs, self.simulator, self.tally), strict=True)):
            i = n % len(scenario.manoeuvre)
            with located(scenario.file, f"manoeuvre[{i}]"):
                out += [{}] if i == 0 else []
                out[-1][job.manoeuvre.name] = truth_of(job, flown)
        return out

    def _shown(self, suite: SensorSuite, spec: Entry, truth: FlightRecord, seed: int) -> FlightRecord:
        return prepared(suite.measure(truth, seed), spec.settle_s, self.scenario.preparation)

    def errors(
        self, suite: SensorSuite, truths: Mapping[str, FlightRecord], repetition: int
    ) -> Iterator[tuple[CaseKey, dict[Quantity, float] | Failure]]:
        """Yield what every estimator errs by in one repetition that one suite measures, or why it gives no model."""
        scenario, exact = self.scenario, suite.without_errors()
        measured, clean = {}, {}
        with located(scenario.file, "preparation"):
            for i, spec in enumerate(scenario.manoeuvre):
                seed, truth = derived_seed(self.seed, repetition, i), truths[spec.name]
                measured[spec.name] = self._shown(suite, spec, truth, seed)
                if spec.use == "validation":
                    clean[spec.name] = self._shown(exact, spec, truth, 0)
        judge = [measured[name] for name in clean]
        for spec in self.inputs:
            for label, method, make in self._models(suite, measured[spec.name], judge):
                case = CaseKey(spec.name, suite.name, label)
                found: dict[Quantity, float] | Failure
                try:
                    with contained(method, scenario.identification.limit_s):
                        found = errors_of(self.known, need_numbers(make()), judge, list(clean.values()))
                except Refusal as failure:  # a suite may lack a channel that a structure needs: a finding too
                    found = Failure(case, repetition, failure.message)
                yield case, found

    def _models(
        self, suite: SensorSuite, record: FlightRecord, judge: Sequence[FlightRecord]
    ) -> Iterator[tuple[str, str, Callable[[], IdentifiedModel]]]:
        """Yield label and method of every estimator, and what makes its model."""
        asked = self.scenario.identification
        outputs = tuple(s.channel for s in suite.sensing(asked.outputs))
        for spec, label in zip(asked.estimators, asked.labels, strict=False):
            yield label, spec.method, partial(estimate, spec, [record], asked.inputs, outputs, judge)
        if asked.best_case:
            yield BEST_CASE, BEST_CASE, partial(self._best, suite, record)

    def _best(self, suite: SensorSuite, record: FlightRecord) -> ParametricModel:
        asked = self.scenario.identification
        structure = lagged_structure(self.known, suite.sensing(asked.outputs), asked.inputs)
        return best_estimate(record, structure, suite)

    def flight_errors(self, truths: Mapping[str, FlightRecord]) -> dict[tuple[str, str], dict[Quantity, float]]:
        """Return what the best case errs by without noise: a flight is not quite linear, nor sampled without end."""
        out = {}
        for spec in self.inputs:
            for suite in self.suites:
                record = self._shown(suite.without_errors(), spec, truths[spec.name], 0)
                try:
                    out[spec.name, suite.name] = model_errors(self.known, self._best(suite, record))
                except Refusal:
                    continue  # the repetitions say why
        return out


def derived_seed(seed: int, repetition: int, manoeuvre: int) -> int:
    """Return the seed of one manoeuvre in one repetition: the first word of SeedSequence([seed, k, i])."""
    return int(np.random.SeedSequence([seed, repetition, manoeuvre]).generate_state(1)[0])


# --- placement --------------------------------------------------------------------------------------------------------


def _place(scenario: CompareScenario, asked: Placement, known: Known, suite: SensorSuite) -> Placed:
    """Place sensors for the modes of the placement, everything else that matters unknown too."""
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    moved = [c for c in CONTROLS if c in controls]
    free = unknowns(known.aircraft, known.plane, moved, asked.modes, ())
    aimed = replace(known, wanted_modes=wanted_modes(known.modes, asked.modes), wanted=(), free=free)
    manoeuvre = next(m for m in scenario.manoeuvre if m.use == "identification")
    sensors = suite.sensing(scenario.identification.outputs)
    return place(aimed, asked, suite, sensors, manoeuvre, templates(asked))


# --- how far a model is from the truth --------------------------------------------------------------------------------


def errors_of(
    known: Known, model: IdentifiedModel, judge: Sequence[FlightRecord], clean: Sequence[FlightRecord]
) -> dict[Quantity, float]:
    """Return the error of every quantity that a model gives: predictions of flights, modes and parameters.

    Args:
        known: the aircraft.
        model: what was identified.
        judge: measured flights that the model predicts.
        clean: the same without noise and biases; the predictions are compared with these.
    """
    out: dict[Quantity, float] = {}
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            predicted = np.vstack([np.asarray(model.simulate(r), float) for r in judge])
        true = np.vstack([r.columns(model.outputs) for r in clean])
        values = mrse_percent(true, predicted)
    except EstimationError:  # the model diverges over the judging flights
        values = np.full(len(model.outputs), np.nan)
    for name, value in zip(model.outputs, values.tolist(), strict=True):
        out[Quantity("prediction", name)] = value if np.isfinite(value) else np.nan
    return out | model_errors(known, model)


def model_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return the errors of the wanted modes and parameters that a model gives."""
    return _mode_errors(known, model) | _parameter_errors(known, model)


def _mode_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return errors of the wanted modes; the mean over the outputs of a model that has poles output by output."""
    found: dict[Quantity, list[float]] = {}
    own = isinstance(model, ParametricModel) and isinstance(model.structure, LaggedStructure)
    sets = {"": aircraft_poles(cast(ParametricModel, model))} if own else model.poles()
    for names, poles in sets.items():
        for match in match_poles(poles, known.modes, names):
            if match.name not in known.wanted_modes:
                continue
            wn = Quantity("mode", f"wn of {match.name}")
            zeta = Quantity("mode", f"zeta of {match.name}", "")
            found.setdefault(wn, [])
            if match.true.imag != 0.0:
                found.setdefault(zeta, [])
            if match.wn_error_percent is not None and match.zeta_error is not None:
                found[wn].append(match.wn_error_percent)
                if match.true.imag != 0.0:
                    found[zeta].append(match.zeta_error)
    return {q: float(np.mean(values)) if values else float("nan") for q, values in found.items()}


def _parameter_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return relative errors of the wanted parameters, for models that have parameters of these names."""
    if not isinstance(model, ParametricModel):
        return {}
    structure = model.structure
    if isinstance(structure, LaggedStructure):
        true = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    else:
        derivatives = dimensional_derivatives(known.linear, known.trimmed)
        true = true_parameters(structure.meaning, derivatives, known.trimmed.condition.V_m_s)
    free = {p.name for p in structure.parameters if p.free}
    return {
        Quantity("parameter", name): 100.0 * (model.values[name] - true[name]) / abs(true[name])
        for name in known.wanted
        if name in free and true.get(name)
    }


# --- quantities whose true value is near zero: their errors are told in their own units, as percent of it say nothing -


PERCENT = "%"
_Errors = TypeVar("_Errors", float, FloatArray)
OwnUnits = Mapping[str, tuple[str, float]]
"""Quantity -> its unit, and the factor from percent of its true value to that unit."""


def near_zero(known: Known, predictions: Mapping[tuple[str, str], Prediction]) -> OwnUnits:
    """Return the quantities whose standard error by information is above 100 % by every input, through every suite.

    Through such sensors the sign of the quantity is not known, whichever suite and input are chosen.
    """
    least: dict[str, float] = {}
    values: dict[str, float] = {}
    for p in predictions.values():
        for name, unit, std, value in zip(p.names, p.units, p.std.tolist(), p.values.tolist(), strict=True):
            if unit == PERCENT and np.isfinite(std):
                least[name] = min(std, least.get(name, np.inf))
                values[name] = value
    unknown = [name for name, std in least.items() if std > 100.0]
    units = {d.name: d.unit for d in dimensional_derivatives(known.linear, known.trimmed)} if unknown else {}
    return {
        name: ("rad/s" if name.startswith("wn of ") else units.get(name, "SI"), abs(values[name]) / 100.0)
        for name in unknown
    }


def predicted_in_own_units(prediction: Prediction, own: OwnUnits) -> Prediction:
    """Return a prediction with the errors of these quantities in their own units."""
    factors = np.array([own[n][1] if n in own else 1.0 for n in prediction.names])
    units = tuple(own[n][0] if n in own else u for n, u in zip(prediction.names, prediction.units, strict=True))
    return replace(prediction, std=prediction.std * factors, units=units)


def errors_in_own_units(errors: Mapping[Quantity, _Errors], own: OwnUnits) -> dict[Quantity, _Errors]:
    """Return errors (numbers or arrays) with those of these quantities in their own units."""
    out: dict[Quantity, _Errors] = {}
    for quantity, error in errors.items():
        if quantity.kind != "prediction" and quantity.unit == PERCENT and quantity.name in own:
            unit, factor = own[quantity.name]
            out[quantity._replace(unit=unit)] = error * factor
        else:
            out[quantity] = error
    return out
