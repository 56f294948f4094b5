"""The straight line: scenario, aircraft, trim, fly, measure, estimate, evaluate; and the same for real records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.aircraft import Aircraft, load_aircraft
from testbench.constants import DEG_RAD
from testbench.errors import ScenarioError, located
from testbench.estimators import estimate
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.prepare import prepare
from testbench.evaluation import evaluate
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.excitation import excitation
from testbench.evaluation.modes import longitudinal_modes
from testbench.evaluation.parameters import true_parameters
from testbench.flight import FlightCondition, Manoeuvre, TrimmedFlight, fly, linearise, trim
from testbench.flight.air import Air, air_of
from testbench.flight.preflight import check, log_rate
from testbench.inputs import build
from testbench.inputs.signal import energy_spectrum
from testbench.record import FlightRecord, FloatArray
from testbench.results import Case, Flight, RunResult, Truth
from testbench.scenario import Identification, Preparation, Scenario, attach_file
from testbench.schema import parse, read_toml
from testbench.sensors import SensorSuite, load_suite

if TYPE_CHECKING:
    from testbench.estimators.frequency.response import FrequencyResponse
    from testbench.logs.description import RecordDescription

Keep = Callable[[str, FlightRecord], None]
Report = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Prepared:
    """What a run needs before it flies; made once where many runs share it, or change it.

    Attributes:
        aircraft: possibly not the one of the scenario's name.
        suites: possibly not those of the scenario's names.
        trimmed: at the scenario's condition and steady wind.
        truth: of this aircraft and trim, or None if estimates need no truth beside them.
        channels: of the truth to log; all if None.
    """

    aircraft: Aircraft
    suites: tuple[SensorSuite, ...]
    trimmed: TrimmedFlight
    truth: Truth | None = None
    channels: tuple[str, ...] | None = None


def run(
    scenario: Scenario,
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    prepared: Prepared | None = None,
) -> RunResult:
    """Fly, measure, identify and judge one scenario.

    Args:
        scenario: what to do.
        seed: replaces the scenario's own.
        keep: called with a name and each record as soon as it exists, so that a later failure loses none of them.
        progress: called with a few words as each stage begins.
        prepared: takes the place of loading, trimming and linearising what the scenario names.

    Raises:
        TestbenchError: with the file and key of the scenario that it comes from.
    """
    seed = scenario.seed if seed is None else seed
    keep, say = keep or (lambda name, record: None), progress or (lambda text: None)
    where = scenario.file
    ready = prepared or _ready(scenario, seed, say)
    aircraft, suites, trimmed = ready.aircraft, ready.suites, ready.trimmed
    flights = []
    for i, spec in enumerate(scenario.manoeuvre):
        say(f"fly {spec.name}")
        with located(where, f"manoeuvre[{i}]"):
            manoeuvre = Manoeuvre(spec.name, build(spec.input, spec.duration_s, trimmed.rate_hz), spec.settle_s)
            truth = _fly(
                aircraft,
                trimmed,
                manoeuvre,
                log_rate(scenario, suites),
                keep,
                air_of(scenario.air, scenario.condition.h_m, seed + i),
                ready.channels,
            )
        measured = {}
        for suite in suites:
            measured[suite.name] = suite.measure(truth, seed + i)
            keep(f"{spec.name}_{suite.name}", measured[suite.name])
        flights.append(Flight(spec.name, spec.use, truth, measured, spec.settle_s))
    known = ready.truth
    if prepared is None:
        say("linearise")
        known = _truth(scenario, aircraft, trimmed, flights, suites)
    noise = {s.name: s.noise_std for s in suites} if scenario.preparation.lowpass_hz is None else {}
    cases = _identify(
        flights, [s.name for s in suites], scenario.preparation, scenario.identification, where, say, known, noise
    )
    return RunResult(
        scenario.name, scenario.title, scenario.question, scenario, seed, tuple(flights), cases, known, suites
    )


def identify(
    description: RecordDescription,
    data_folder: Path | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
) -> RunResult:
    """Run the same estimators and evaluation on recorded flights.

    Args:
        description: which file, column and unit is which channel.
        data_folder: where the files lie, instead of the folder that the description names.
        keep: called with a name and each record as soon as it has been read.
        progress: called with a few words as each stage begins.

    Raises:
        TestbenchError: with the file and key of the description that it comes from.
    """
    from testbench.logs import read_records

    keep, say = keep or (lambda name, record: None), progress or (lambda text: None)
    say("read records")
    flights = [
        Flight(name, use, None, {"recorded": record}, description.trim_s)
        for name, use, record in read_records(description, data_folder)
    ]
    for flight in flights:
        keep(f"{flight.name}_recorded", flight.measured["recorded"])
    cases = _identify(
        flights, ["recorded"], description.preparation, description.identification, description.file, say, None, {}
    )
    return RunResult(
        description.name,
        description.title,
        description.question,
        description,
        0,
        tuple(flights),
        cases,
        reference=description.reference_values,
    )


def frequency_responses(
    description: RecordDescription, records: Sequence[FlightRecord], window_s: Sequence[float]
) -> FrequencyResponse:
    """Return the frequency responses of recorded flights, prepared as the description says, all records together.

    Raises:
        TestbenchError: with the file of the description that it comes from.
    """
    from testbench.estimators.frequency.spectra import estimate_frequency_response

    with located(description.file, "identification"):
        prepared = [_prepared(r, description.trim_s, description.preparation) for r in records]
        inputs, outputs = description.identification.inputs, description.outputs
        return estimate_frequency_response(prepared, inputs, outputs, window_s=window_s)


def load_scenario(path: Path | str) -> Scenario:
    """Read a scenario and check it against its aircraft and suites, without flying.

    Raises:
        ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
    """
    from testbench.paths import find_scenario

    file = find_scenario(path)
    scenario, faults = parse(Scenario, read_toml(file), file)
    if scenario is not None:
        scenario = attach_file(scenario, file)
        faults = [*faults, *check(scenario)]
    if scenario is None or faults:
        raise ScenarioError(faults)
    return scenario


def _ready(scenario: Scenario, seed: int, say: Report) -> Prepared:
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suites = tuple(_suite(scenario, name) for name in scenario.suites)
    say(f"trim {aircraft.name}")
    return Prepared(aircraft, suites, trim_for(scenario, aircraft, seed))


def trim_for(scenario: Scenario, aircraft: Aircraft, seed: int = 0) -> TrimmedFlight:
    """Return ``aircraft`` trimmed at the condition, rate and steady wind of the scenario.

    Raises:
        TrimError: there is no equilibrium.
    """
    with located(scenario.file, "condition"):
        return trim(
            aircraft,
            _condition(scenario),
            scenario.simulation.rate_hz,
            air_of(scenario.air, scenario.condition.h_m, seed),
        )


def _suite(scenario: Scenario, name: str) -> SensorSuite:
    with located(scenario.file, "suites"):
        return load_suite(name)


def _condition(scenario: Scenario) -> FlightCondition:
    c = scenario.condition
    return FlightCondition(c.V_m_s, c.h_m, c.gamma_deg * DEG_RAD)


def _fly(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    manoeuvre: Manoeuvre,
    log_rate_hz: float,
    keep: Keep,
    air: Air | None,
    channels: Sequence[str] | None = None,
) -> FlightRecord:
    from testbench.errors import FlightAborted

    try:
        truth = fly(aircraft, trimmed, manoeuvre, log_rate_hz, channels, air)
    except FlightAborted as error:
        if error.record is not None and len(error.record):
            keep(f"{manoeuvre.name}_aborted", error.record)
        raise
    keep(f"{manoeuvre.name}_truth", truth)
    return truth


def _truth(
    scenario: Scenario,
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    flights: Sequence[Flight],
    suites: Sequence[SensorSuite],
) -> Truth:
    known = true_model(aircraft, trimmed)
    linear, modes = known.linear, known.modes
    symmetric = _symmetric(aircraft)
    flight = next(f for f in flights if f.use != "validation")
    assert flight.truth is not None
    inputs = [n.removesuffix("_cmd") for n in scenario.identification.inputs]
    u = flight.truth.columns(inputs)
    sensors = {
        s.channel: s.noise_std
        for suite in suites
        for s in suite.sensors
        if s.channel not in scenario.identification.inputs
    }
    used = {n: s for n, s in sensors.items() if s > 0.0 and n in linear.outputs}
    found = excitation(
        linear.longitudinal(tuple(symmetric)),
        modes,
        inputs,
        u - u[0],
        flight.truth.dt_s,
        used,
        1.0 / suites[0].rate_hz,
        flight.truth.duration_s,
    )
    return replace(known, excitation=tuple(found))


def true_model(aircraft: Aircraft, trimmed: TrimmedFlight) -> Truth:
    """Return the linear model and modes of an aircraft at trim; nothing is said of what an input does to them."""
    linear = linearise(aircraft, trimmed)
    return Truth(aircraft, trimmed, linear, longitudinal_modes(linear, _symmetric(aircraft)), ())


def _symmetric(aircraft: Aircraft) -> dict[int, str]:
    elastic = aircraft.flown_modes()
    return {i: m.name for i, m in enumerate(elastic.modes if elastic else (), 1) if m.symmetry == "symmetric"}


def _identify(
    flights: Sequence[Flight],
    suites: Sequence[str],
    preparation: Preparation,
    identification: Identification,
    where: Path | None,
    say: Report,
    truth: Truth | None,
    noise: Mapping[str, Mapping[str, float]],
) -> tuple[Case, ...]:
    cases = []
    for suite in suites:
        with located(where, "preparation"):
            parts = [(f.use, _prepared(f.measured[suite], f.trim_s, preparation)) for f in flights]
        fit, judge = _divide(parts, preparation.identification_fraction)
        sensed = fit[0].channels
        outputs = tuple(n for n in (identification.outputs or sensed) if n in sensed and n not in identification.inputs)
        for k, spec in enumerate(identification.estimators):
            say(f"identify {suite} with {spec.method}")
            with located(where, f"identification.estimators[{k}]"):
                model = estimate(spec, fit, identification.inputs, outputs, judge)
                scores = evaluate(model, fit, judge, noise_std=noise.get(suite), **_known(truth, model, fit))
            cases.append(Case(suite, spec, tuple(fit), tuple(judge), model, scores))
    return tuple(cases)


def _prepared(record: FlightRecord, trim_s: float, preparation: Preparation) -> FlightRecord:
    return prepare(
        record,
        bias=preparation.bias,
        trim_s=trim_s,
        lowpass_hz=preparation.lowpass_hz,
        decimate=preparation.decimate,
    )


def _divide(
    parts: Sequence[tuple[str, FlightRecord]], fraction: float
) -> tuple[list[FlightRecord], list[FlightRecord]]:
    """Return the records to identify on and those to judge on."""
    fit = [r for use, r in parts if use == "identification"]
    judge = [r for use, r in parts if use == "validation"]
    for use, record in parts:
        if use == "split":
            first, second = record.split(fraction)
            fit.append(first)
            judge.append(second)
    return fit, judge


def _known(truth: Truth | None, model: IdentifiedModel, records: Sequence[FlightRecord]) -> dict[str, Any]:
    """Return what evaluation may be told of the truth: poles, and the response over the band that the input excites."""
    if truth is None:
        return {}
    omega = excited_band(records, model.inputs)
    response = truth.response(omega, model.outputs, model.inputs, model.dt_s, model.continuous)
    known = {"true_poles": dict(truth.modes), "true_response": response, "omega": omega}
    structure = getattr(model, "structure", None)
    if structure is not None:
        derivatives = dimensional_derivatives(truth.linear, truth.trimmed)
        known["true_parameters"] = true_parameters(structure.name, derivatives, truth.trimmed.condition.V_m_s)
    return known


def excited_band(records: Sequence[FlightRecord], inputs: Sequence[str], floor: float = 0.01) -> FloatArray:
    """Return 60 frequencies, rad/s, over the band where the inputs' energy density exceeds ``floor`` of its peak."""
    dt = records[0].dt_s
    omega = np.geomspace(0.1, 0.8 * np.pi / dt, 400)
    density = np.sum([energy_spectrum(r.columns(inputs), dt, omega).sum(axis=1) for r in records], axis=0)
    inside = omega[density >= floor * density.max()]
    return np.geomspace(inside[0], inside[-1], 60)
