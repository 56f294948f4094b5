"""From a design scenario to the design problem of an aircraft: condition, limits, structure, sensors, rates, air."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from math import ceil

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import PERCENT
from testbench.core.errors import LimitError, located
from testbench.core.record import FloatArray
from testbench.design.candidates import Candidate
from testbench.design.ensemble import Flier, Member, Placed, Setting
from testbench.design.identified import identified_by, starts_free
from testbench.design.limits import Limits, Prediction
from testbench.design.problem import ModeBands, Problem, Screened, by_energy, by_information
from testbench.design.realise import Range
from testbench.evaluation.envelope import Onset, fly_envelope
from testbench.evaluation.modes import elastic_modes, modes_of, roots_of
from testbench.flight import TrimmedFlight, linearise
from testbench.information.aircraft_structure import AircraftStructure, felt_by, seen_by
from testbench.information.fisher import Experiment
from testbench.information.targets import targets, unknowns
from testbench.information.turbulence import Turbulence
from testbench.line import trim_for
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import SensorSuite

_LOWEST_RATE_HZ = 40.0  # of the inputs
_SPEEDS = 11  # that the onset of vibration is sought over


def place(scenario: DesignScenario, aircraft: Aircraft) -> Placed:
    """Return an aircraft at the condition of a scenario: trimmed, linearised, with the modes of its plane."""
    trimmed = trim_for(scenario, aircraft)
    with located(scenario.file, "condition"):
        linear = linearise(aircraft, trimmed)
    return Placed(aircraft, trimmed, linear, modes_of(linear, aircraft, scenario.plane))


def pose(scenario: DesignScenario, aircraft: Aircraft, suite: SensorSuite) -> Member:
    """Return the believed aircraft as a design problem.

    Raises:
        TestbenchError: above the onset of vibration, without room inside the limits, or at a rate that the suite's does
            not divide; with the scenario's file and key.
    """
    at = place(scenario, aircraft)
    with located(scenario.file, "condition"):
        onsets = onsets_of(aircraft, scenario)
    with located(scenario.file, "limits"):
        limits = limits_of(scenario, aircraft, at.trimmed, onsets)
        rate, wanted = at.trimmed.rate_hz, suite.rate_hz
        if scenario.realise and abs(rate / wanted - round(rate / wanted)) > 1e-9:
            raise LimitError(
                f"the rate of the suite {suite.name} must divide that of the simulation, {rate:g} Hz, got {wanted:g} "
                f"Hz; give [simulation] rate_hz = {ceil(rate / wanted) * wanted:g}"
            )
        return Member(*at, problem_of(scenario, at, suite, limits, starts=True), onsets)


def own_input(scenario: DesignScenario, problem: Problem) -> Screened:
    """Return the input that a scenario gives, at its own amplitude, judged by spectral energy and by information.

    Raises:
        ScenarioError: an entry breaks a law of its family.
    """
    start = problem.start_s
    specs = tuple(e.model_copy(update={"start_s": round(e.start_s + start, 9)}) for e in scenario.input)
    candidate = Candidate(scenario.input[0].signal, "your own", specs, problem.sampled(specs))
    largest = by_energy(problem, candidate)
    snr_db = largest.snr_db - 20.0 * np.log10(largest.factor)
    return by_information(problem, largest._replace(factor=1.0, snr_db=float(snr_db)))


def setting_of(scenario: DesignScenario, believed: Member, suite: SensorSuite) -> Setting:
    """Return how any aircraft comes to the condition, with the targets and the highest speed of the believed one.

    A mode that oscillates there keeps frequency and damping in aircraft where it splits into two real roots.
    """
    wanted = believed.problem.targets
    whole = [m for m in scenario.targets.modes if f"wn of {m}" in wanted.names]
    errors = dict(zip(wanted.names, wanted.wanted, strict=True))

    def like(aircraft: Aircraft) -> Member:
        at = place(scenario, aircraft)
        limits = limits_of(scenario, aircraft, at.trimmed, believed.onsets)
        problem = problem_of(scenario, at, suite, limits, whole, starts=True)
        own = problem.targets
        same = np.array([errors.get(name, w) for name, w in zip(own.names, own.wanted, strict=True)])
        problem = replace(problem, targets=replace(own, wanted=same), known=believed.problem.known)
        return Member(*at, problem, believed.onsets)

    return Setting(scenario.plane, partial(place, scenario), like)


def limits_of(
    scenario: DesignScenario, aircraft: Aircraft, trimmed: TrimmedFlight, onsets: Sequence[Onset] = ()
) -> Limits:
    """Return the limits of a scenario, with the aircraft's own where it has none."""
    own, at, V = aircraft.limits, trimmed.state, scenario.condition.V_m_s
    room = {n: min(at[n] - low, high - at[n]) for n, (low, high) in own.items() if n in at}
    lateral = scenario.plane == "lateral"
    speed = own.get("V", (0.0, np.inf))
    alone = {
        "alpha": own.get("alpha"),
        "beta": room.get("beta") if lateral else None,
        "speed_change_m_s": min(V - speed[0], speed[1] - V),
        "height_change_m": room.get("h"),
        "pitch_change": room.get("theta"),
        "bank": room.get("phi") if lateral else None,
    }
    first = min((o.V_m_s for o in onsets if o.V_m_s is not None), default=None)
    fastest = None if first is None or scenario.allow_above_onset else first - scenario.limits.onset_margin_m_s
    return Limits.of(scenario.limits, aircraft.controls, alone, V_max_m_s=fastest)


def problem_of(
    scenario: DesignScenario,
    at: Placed,
    suite: SensorSuite,
    limits: Limits,
    whole: Collection[str] = (),
    starts: bool = False,
) -> Problem:
    """Return the design problem of a scenario for one suite.

    The modes ``whole`` among the targets keep frequency and damping ratio where they split into two real roots. With
    ``starts`` initial states are estimated too, where the estimator of the design does so, and the information is that
    of the turbulence in which the design will be realised.

    Raises:
        TestbenchError: sensors without noise, limits without room, or targets that do not exist.
    """
    (aircraft, trimmed, linear, modes), plane, asked = at, scenario.plane, scenario.targets
    elastic = elastic_modes(aircraft, plane)
    aimed = {name: pole for mode in asked.modes for name, pole in roots_of(modes, mode).items()}
    aims: dict[str, complex | tuple[complex, complex]] = {}
    for mode in asked.modes:
        roots = roots_of(modes, mode)
        if mode in whole and len(roots) == 2:
            slow, fast = roots.values()
            aims[mode] = (slow, fast)
        else:
            aims |= roots
    free = unknowns(aircraft, plane, scenario.controls, asked.modes, (*asked.parameters, *asked.also_unknown))
    sensors = suite.sensing()
    inputs = linear.commands(scenario.controls)

    def structure_by(driven: Sequence[str]) -> AircraftStructure:
        return seen_by(sensors, aircraft, trimmed, linear, plane, driven, free)

    structure = structure_by(inputs)
    felt = structure.moved
    if starts and not felt.all():  # the other plane's sensors would cost the estimator time and tell it nothing
        sensors = tuple(s for s, moves in zip(sensors, felt, strict=True) if moves)
        structure = structure_by(inputs)
    deflected = structure_by(scenario.controls)
    model = felt_by(sensors, linear, trimmed.state)
    of_interest = aimed or {n: p for n, p in modes.items() if n not in elastic.values() and abs(p) > 0.3}
    wn = [abs(p) for p in of_interest.values()]
    band = 0.3 * min(wn) / (2.0 * np.pi), 1.6 * max(wn) / (2.0 * np.pi)
    rate = _input_rate(suite.rate_hz, trimmed.rate_hz, 12.0 * max(wn) / (2.0 * np.pi))
    per_sample = round(rate / suite.rate_hz)
    samples = int(scenario.duration_s * suite.rate_hz + 1e-9)
    free_start = starts and starts_free(structure)
    turbulence = None
    if starts and scenario.realise:
        air, V, h = scenario.expected_air, scenario.condition.V_m_s, scenario.condition.h_m
        driven = _noise_of_inputs(deflected, structure, suite)
        turbulence = Turbulence.of(structure, sensors, air, h, V, trimmed.theta, driven)
    experiment = Experiment(
        structure, sensors, 1.0 / rate, samples, per_sample, initial_states=free_start, turbulence=turbulence
    )
    values = {**trimmed.state, "alpha": trimmed.alpha, "V": scenario.condition.V_m_s, **trimmed.controls}
    prediction = Prediction(linear, scenario.controls, limits, values, 1.0 / rate, samples * per_sample)
    noise = {
        s.channel: (float(sigma), 1.0 / (s.rate_hz or suite.rate_hz))
        for s, sigma in zip(sensors, experiment.sigma, strict=True)
    }
    states = [s for s in structure.states if not s.startswith("servo") or s in linear.states]
    bands = ModeBands(model.subsystem(states), of_interest, inputs, noise, 1.0 / rate, samples * per_sample)
    servos = {c: model.states.index(f"servo_{c}") for c in scenario.controls if f"servo_{c}" in model.states}
    wanted = {name: percent * PERCENT for name, percent in asked.parameters.items()}
    return Problem(
        experiment,
        prediction,
        targets(structure, wanted, aims, (asked.wn_percent * PERCENT, asked.zeta)),
        scenario.criterion,
        scenario.controls,
        samples * per_sample / rate,
        round(scenario.start_s * rate) / rate,
        scenario.shortest_s,
        band,
        scenario.by == "pilot",
        scenario.seed,
        bands,
        deflected,
        {c: -1.0 / float(model.A[k, k]) for c, k in servos.items()},
    )


def _noise_of_inputs(deflected: AircraftStructure, structure: AircraftStructure, suite: SensorSuite) -> FloatArray:
    """Return (states, m) what white noise of unit intensity does through sensed deflections; servos do not feel it."""
    out = np.zeros((len(structure.states), len(deflected.inputs)))
    for sensor in suite.sensors:
        if sensor.channel in deflected.inputs:
            j = deflected.inputs.index(sensor.channel)
            density = np.hypot(sensor.noise_std, sensor.quantum / np.sqrt(12.0)) / np.sqrt(
                sensor.rate_hz or suite.rate_hz
            )
            out[: len(deflected.states), j] = density * deflected.B0[:, j]
    return out


def _input_rate(suite_hz: float, simulation_hz: float, wanted_hz: float) -> float:
    """Return the lowest rate of inputs that the suite's divides and that divides the simulation's, fast enough."""
    whole = round(simulation_hz / suite_hz)
    rates = [suite_hz * k for k in range(1, whole + 1) if whole % k == 0]
    return next((r for r in rates if r >= max(wanted_hz, _LOWEST_RATE_HZ)), rates[-1])


def onsets_of(aircraft: Aircraft, scenario: DesignScenario) -> tuple[Onset, ...]:
    """Return the onsets of elastic modes over the speeds from the condition up.

    Raises:
        LimitError: the condition lies above an onset, or nearer to it than the margin.
    """
    elastic = aircraft.flown_modes()
    if elastic is None or not len(elastic):
        return ()
    V, margin = scenario.condition.V_m_s, scenario.limits.onset_margin_m_s
    fastest = aircraft.limits.get("V", (0.5 * V, 2.0 * V))[1]
    speeds = np.linspace(V, max(fastest, V), _SPEEDS)
    found = fly_envelope(aircraft, speeds.tolist(), scenario.condition.h_m)
    onsets = tuple(found.onset(name) for name in found.elastic)
    for onset in onsets:
        if onset.V_m_s is not None and onset.V_m_s - margin < V and not scenario.allow_above_onset:
            raise LimitError(
                f"V_m_s <= onset - margin = {onset.V_m_s:.3g} - {margin:g} m/s must hold for a design, got {V:g} m/s "
                f"({onset.sentence}); fly slower, or set allow_above_onset = true"
            )
    return onsets


def range_of(scenario: DesignScenario, believed: Member, suite: SensorSuite, flier: Flier) -> Range:
    """Return where designs are flown and identified."""
    problem = believed.problem
    assert problem.deflected is not None
    air = scenario.expected_air
    moves = air.turbulence_rms_m_s > 0.0
    identified = identified_by(problem.deflected, suite, problem.servo_lag_s, problem.experiment.samples, moves)
    return Range(believed, suite, identified, air, scenario.condition.h_m, scenario.seed, flier)
