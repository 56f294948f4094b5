"""Comparison scenarios: check, fly, measure the same flights through every suite, identify, judge, predict, place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from testbench.aircraft import Aircraft, load_aircraft
from testbench.comparison.best_case import best_estimate, lagged_structure
from testbench.comparison.judge import errors_of, model_errors
from testbench.comparison.placement import Placed, place
from testbench.comparison.prediction import predict
from testbench.comparison.result import CaseKey, CompareResult, Failure, Quantity
from testbench.comparison.seen import Known, sensors_of, unknowns, wanted_modes
from testbench.constants import DEG_RAD
from testbench.design.aircraft_structure import parameter_names
from testbench.design.targets import needed_parameters
from testbench.designer import RIGID_MODES, elastic_modes, modes_of
from testbench.errors import ScenarioError, TestbenchError, located, nearest
from testbench.estimators import estimate
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.prepare import prepare
from testbench.flight import FlightCondition, fly, linearise, trim
from testbench.flight import Manoeuvre as Flown
from testbench.flight.air import air_of
from testbench.flight.preflight import check as check_flight
from testbench.flight.preflight import log_rate
from testbench.inputs import build
from testbench.paths import find_scenario
from testbench.record import FlightRecord, FloatArray
from testbench.scenario import Scenario
from testbench.scenario.compare import BEST_CASE, CompareScenario, Placement
from testbench.schema import parse, read_toml
from testbench.sensors import Sensor, SensorSuite, load_suite

Report = Callable[[str], None]
_FAST_MODE = {"longitudinal": "short period", "lateral": "Dutch roll"}


# --- reading and checking ---------------------------------------------------------------------------------------------


def load_compare(path: Path | str) -> CompareScenario:
    """Read a comparison scenario and check it against its aircraft and suites, without flying.

    Raises:
        ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
    """
    file = find_scenario(path)
    scenario, faults = parse(CompareScenario, read_toml(file), file)
    if scenario is not None:
        scenario = attach(scenario, file)
        faults = [*faults, *check(scenario)]
    if scenario is None or faults:
        raise ScenarioError(faults)
    return scenario


def attach(scenario: CompareScenario, file: Path | None) -> CompareScenario:
    """Return the scenario with the file that it came from."""
    copy = scenario.model_copy()
    copy.__pydantic_private__ = {"_file": file}
    return copy


def check(scenario: CompareScenario) -> list[str]:
    """Return every law of aircraft, inputs, sensors and targets that the scenario breaks, in words, without flying."""
    faults = check_flight(cast(Scenario, scenario))  # the same keys, as far as a flight goes
    if faults:
        return faults
    where = scenario.file
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suites = [load_suite(name) for name in scenario.suites]
    identification = scenario.identification
    for i, suite in enumerate(suites):
        for name in identification.inputs:
            if name not in suite.channels:
                hint = nearest(name, [c for c in suite.channels if c not in suite.outputs])
                faults.append(f"{where}, suites[{i}]: suite '{suite.name}' must sense the input '{name}'{hint}")
        used = sensors_of(suite, identification.outputs)
        if not used:
            faults.append(f"{where}, suites[{i}]: suite '{suite.name}' senses none of the outputs; add a sensor")
        for s in used:
            if s.noise_std == 0.0 and s.quantum == 0.0:
                faults.append(f"{where}, suites[{i}]: sensor '{s.channel}' must have noise or a quantum, got none")
    controls = [name.removesuffix("_cmd") for name in identification.inputs]
    known = parameter_names([*aircraft.controls], scenario.plane, list(elastic_modes(aircraft, scenario.plane)))
    for name in scenario.targets.parameters:
        if name not in known:
            faults.append(
                f"{where}, targets.parameters: '{name}' is no parameter of the {scenario.plane} motion"
                + nearest(name, known)
            )
    valid = (*RIGID_MODES[scenario.plane], *elastic_modes(aircraft, scenario.plane).values())
    placed = scenario.placement.modes if scenario.placement else ()
    for key, names in (("targets.modes", scenario.targets.modes), ("placement.modes", placed)):
        for name in names:
            if name not in valid:
                faults.append(
                    f"{where}, {key}: '{name}' is no {scenario.plane} mode of {aircraft.name}{nearest(name, valid)}"
                )
    for i, m in enumerate(scenario.manoeuvre):
        other = sorted({k.control for k in m.input} - set(controls))
        if m.use == "identification" and other:
            faults.append(
                f"{where}, manoeuvre[{i}].input: identification.inputs must name every control that moves, "
                f"{', '.join(controls)} do not include {', '.join(other)}"
            )
    return [*faults, *(_placement_faults(scenario, aircraft) if scenario.placement else ())]


def _placement_faults(scenario: CompareScenario, aircraft: Aircraft) -> list[str]:
    asked = scenario.placement
    assert asked is not None
    try:
        _templates(asked)
    except TestbenchError as error:
        return [f"{scenario.file}, placement: {error}"]
    if aircraft.flown_modes() is None or not aircraft.flown_stations():
        return [f"{scenario.file}, placement: {aircraft.name} must have flexible wings with stations, it has none"]
    return []


# --- the comparison ---------------------------------------------------------------------------------------------------


def compare(
    scenario: CompareScenario, seed: int | None = None, simulate: bool = True, progress: Report | None = None
) -> CompareResult:
    """Compare the suites of a scenario.

    Every repetition is measured through every suite with one seed, so that sensors which two suites share have the
    same noise; in still air all repetitions share one flight. A model's prediction of the judging flights is held
    against what the suite would show without noise and biases.

    Args:
        scenario: of :func:`load_compare`.
        seed: of the first repetition, instead of the scenario's.
        simulate: False: by information alone.
        progress: called with a few words as each stage begins.

    Raises:
        TestbenchError: with the file and key that it comes from.
    """
    say = progress or (lambda text: None)
    where, seed = scenario.file, scenario.seed if seed is None else seed
    say("trim and linearise")
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suites = tuple(load_suite(name) for name in scenario.suites)
    with located(where, "condition"):
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
    if simulate and scenario.identification.labels:
        air = _flights(scenario, known, suites, seed, say)
        for k, (truths, flown) in enumerate(air):
            flights += flown
            if k == 0 and identification.best_case and not scenario.air.turbulence_rms_m_s:
                say("identify: without noise")
                of_flight = _flight_errors(scenario, known, suites, truths)
            say(f"identify: repetition {k + 1} of {scenario.seeds}")
            for suite in suites:
                _repeat(scenario, known, suite, truths, k, seed, errors, failures)
    return CompareResult(
        scenario, known, suites, seed, errors, tuple(failures), predictions, of_flight, placed, flights
    )


def _known(scenario: CompareScenario, aircraft: Aircraft, seed: int) -> Known:
    c = scenario.condition
    condition = FlightCondition(c.V_m_s, c.h_m, c.gamma_deg * DEG_RAD)
    trimmed = trim(aircraft, condition, scenario.simulation.rate_hz, air_of(scenario.air, scenario.condition.h_m, seed))
    linear = linearise(aircraft, trimmed)
    plane = scenario.plane
    modes = modes_of(linear, aircraft, plane)
    asked = scenario.targets.modes or (_FAST_MODE[plane],)
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    wanted = scenario.targets.parameters or needed_parameters(plane, controls, False, ())
    free = unknowns(aircraft, plane, controls, asked, wanted)
    return Known(aircraft, trimmed, linear, plane, modes, wanted_modes(modes, asked), wanted, free)


def _flights(
    scenario: CompareScenario, known: Known, suites: Sequence[SensorSuite], seed: int, say: Report
) -> Iterator[tuple[Mapping[str, FlightRecord], int]]:
    """Yield the true records of every repetition by manoeuvre, and how many of them were flown for it."""
    random = scenario.air.turbulence_rms_m_s > 0.0
    rate = log_rate(cast(Scenario, scenario), suites)
    needed = {name for suite in suites for s in suite.sensors for name in s.needs}
    kept: dict[str, FlightRecord] = {}
    for k in range(scenario.seeds):
        flown = 0
        for i, spec in enumerate(scenario.manoeuvre):
            if kept.get(spec.name) is not None and not random:
                continue
            say(f"fly {spec.name}" + (f", repetition {k + 1} of {scenario.seeds}" if random else ""))
            with located(scenario.file, f"manoeuvre[{i}]"):
                signal = build(spec.input, spec.duration_s, known.trimmed.rate_hz)
                manoeuvre = Flown(spec.name, signal, spec.settle_s)
                air = air_of(scenario.air, scenario.condition.h_m, derived_seed(seed, k, i))
                kept[spec.name] = fly(known.aircraft, known.trimmed, manoeuvre, rate, sorted(needed), air)
            flown += 1
        yield dict(kept), flown


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
            measured[spec.name] = _prepared(scenario, record, spec.settle_s)
            if spec.use == "validation":
                shown = suite.without_errors().measure(truths[spec.name], 0)
                clean[spec.name] = _prepared(scenario, shown, spec.settle_s)
    judge = [measured[name] for name in clean]
    wanted = scenario.identification.outputs
    outputs = tuple(s.channel for s in sensors_of(suite, wanted))
    for spec in scenario.manoeuvre:
        if spec.use != "identification":
            continue
        for label, model in _models(scenario, known, suite, measured[spec.name], outputs, judge):
            case = CaseKey(spec.name, suite.name, label)
            if isinstance(model, str):
                failures.append(Failure(case, repetition, model))
                continue
            for quantity, error in errors_of(known, model, judge, list(clean.values())).items():
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
            record = _prepared(scenario, suite.without_errors().measure(truths[spec.name], 0), spec.settle_s)
            structure = lagged_structure(known, sensors_of(suite, identification.outputs), identification.inputs)
            try:
                out[spec.name, suite.name] = model_errors(known, best_estimate(record, structure, suite))
            except TestbenchError:
                continue  # the repetitions say why
    return out


def _models(
    scenario: CompareScenario,
    known: Known,
    suite: SensorSuite,
    record: FlightRecord,
    outputs: tuple[str, ...],
    judge: Sequence[FlightRecord],
) -> Iterator[tuple[str, IdentifiedModel | str]]:
    """Yield label and model of every estimator, or why there is none."""
    identification = scenario.identification
    for spec, label in zip(identification.estimators, identification.labels, strict=False):
        try:
            yield label, estimate(spec, [record], identification.inputs, outputs, judge)
        except TestbenchError as error:  # a suite may lack a channel that a structure needs: that is a finding too
            yield label, error.message
    if identification.best_case:
        structure = lagged_structure(known, sensors_of(suite, identification.outputs), identification.inputs)
        try:
            yield BEST_CASE, best_estimate(record, structure, suite)
        except TestbenchError as error:
            yield BEST_CASE, error.message


def _prepared(scenario: CompareScenario, record: FlightRecord, trim_s: float) -> FlightRecord:
    p = scenario.preparation
    return prepare(record, bias=p.bias, trim_s=trim_s, lowpass_hz=p.lowpass_hz, decimate=p.decimate)


# --- placement --------------------------------------------------------------------------------------------------------


def _place(scenario: CompareScenario, asked: Placement, known: Known, suite: SensorSuite) -> Placed:
    """Place sensors for the modes of the placement, everything else that matters unknown too."""
    controls = [name.removesuffix("_cmd") for name in scenario.identification.inputs]
    free = unknowns(known.aircraft, known.plane, controls, asked.modes, ())
    aimed = replace(known, wanted_modes=wanted_modes(known.modes, asked.modes), wanted=(), free=free)
    manoeuvre = next(m for m in scenario.manoeuvre if m.use == "identification")
    sensors = sensors_of(suite, scenario.identification.outputs)
    return place(aimed, asked, suite, sensors, manoeuvre, _templates(asked))


def _templates(asked: Placement) -> dict[str, Sensor]:
    """Return kind -> the sensor that every candidate is like.

    Raises:
        ScenarioError: a suite has no such sensor.
    """
    out = {}
    for kind, count, name, prefix in (
        ("accelerometer", asked.accelerometers, asked.accelerometer_suite, "az_wing_"),
        ("strain gauge", asked.strain_gauges, asked.strain_suite, "strain_wing_"),
    ):
        if not count:
            continue
        found = [s for s in load_suite(name).sensors if s.channel.startswith(prefix)]
        if not found:
            raise ScenarioError([f"suite '{name}' must hold an {kind} on the wing ({prefix}1, ...), it has none"])
        out[kind] = found[0]
    return out
