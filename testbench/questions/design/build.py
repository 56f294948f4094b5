"""From a design scenario to the design problem: limits, structure, sensors, rates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.evaluation.envelope import Onset, fly_envelope
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight
from testbench.information.aircraft_structure import AircraftStructure, aircraft_structure, held_accelerations
from testbench.information.fisher import Experiment
from testbench.information.modes import elastic_modes
from testbench.information.targets import needed_parameters, targets
from testbench.information.turbulence import Turbulence
from testbench.questions.design.air import expected_air
from testbench.questions.design.identified import starts_free
from testbench.questions.design.limits import Limits
from testbench.questions.design.prediction import Prediction
from testbench.questions.design.problem import Problem
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.design.spectral_energy import ModeBands
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS

_LOWEST_RATE_HZ = 40.0  # of the inputs


def outputs_of(suite: SensorSuite, aircraft: Aircraft) -> tuple[Sensor, ...]:
    """Return the sensors of the motion: what is neither control nor command."""
    return tuple(s for s in suite.sensors if s.channel in suite.outputs)


def limits_of(
    scenario: DesignScenario, aircraft: Aircraft, trimmed: TrimmedFlight, onsets: Sequence[Onset] = ()
) -> Limits:
    """Return the limits of a scenario, with the aircraft's own where it has none."""
    given, own, at = scenario.limits, aircraft.limits, trimmed.state
    room = {n: min(at[n] - low, high - at[n]) for n, (low, high) in own.items() if n in at}
    V = scenario.condition.V_m_s

    def angle(degrees: float | None, name: str) -> float | None:
        return degrees * DEG_RAD if degrees is not None else room.get(name)

    deflection = {n: max(c.full, -c.low) for n, c in aircraft.controls.items()}
    for name, value in given.deflection_deg.items():
        deflection[name] = value * (PERCENT if name == "thr" else DEG_RAD)
    lateral = scenario.plane == "lateral"
    first = min((o.V_m_s for o in onsets if o.V_m_s is not None), default=None)
    speed = own.get("V", (0.0, np.inf))
    return Limits(
        deflection=deflection,
        rate={n: r * DEG_RAD for n, r in given.rate_deg_s.items()},
        load_factor=given.load_factor,
        alpha=(given.alpha_deg[0] * DEG_RAD, given.alpha_deg[1] * DEG_RAD) if given.alpha_deg else own.get("alpha"),
        beta=angle(given.beta_deg, "beta") if lateral or given.beta_deg else None,
        speed_change_m_s=given.speed_change_m_s or min(V - speed[0], speed[1] - V),
        height_change_m=given.height_change_m or room.get("h"),
        pitch_change=angle(given.pitch_change_deg, "theta"),
        bank=angle(given.bank_deg, "phi") if lateral or given.bank_deg else None,
        V_max_m_s=None if first is None or scenario.allow_above_onset else first - given.onset_margin_m_s,
        throw={n: (c.low, c.full) for n, c in aircraft.controls.items()},
    )


def problem_of(
    scenario: DesignScenario,
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    linear: LinearModel,
    modes: Mapping[str, complex],
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
    plane, asked = scenario.plane, scenario.targets
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
    numbers = [i for i, name in elastic.items() if name in asked.modes]
    numbers += [i for i in elastic if i not in numbers and any(_belongs(p, i) for p in _asked(asked))]
    free = needed_parameters(plane, scenario.controls, "phugoid" in asked.modes, numbers)
    free = tuple(dict.fromkeys([*free, *asked.parameters, *asked.also_unknown]))
    sensors = outputs_of(suite, aircraft)
    model = with_positions(linear, sensors)
    inputs = [f"{c}_cmd" if f"{c}_cmd" in model.inputs else c for c in scenario.controls]
    held = {
        s.channel: held_accelerations(model, s.channel)
        for s in sensors
        if s.channel in ACCELEROMETERS or s.channel.startswith("az_wing_")
    }

    def structure_by(driven: Sequence[str]) -> AircraftStructure:
        V, alpha, outputs = scenario.condition.V_m_s, trimmed.alpha, [s.channel for s in sensors]
        return aircraft_structure(model, V, alpha, plane, list(elastic), driven, outputs, free, held)

    structure = structure_by(inputs)
    felt = structure.moved
    if starts and not felt.all():  # the other plane's sensors would cost the estimator time and tell it nothing
        sensors = tuple(s for s, moves in zip(sensors, felt, strict=True) if moves)
        structure = structure_by(inputs)
    deflected = structure_by(scenario.controls)
    of_interest = aimed or {n: p for n, p in modes.items() if n not in elastic.values() and abs(p) > 0.3}
    band = _band(of_interest)
    rate = _input_rate(suite.rate_hz, trimmed.rate_hz, 12.0 * max(abs(p) for p in of_interest.values()) / (2.0 * np.pi))
    per_sample = round(rate / suite.rate_hz)
    samples = int(scenario.duration_s * suite.rate_hz + 1e-9)
    free_start = starts and starts_free(structure)
    turbulence = None
    if starts and scenario.realise:
        air, V, h = expected_air(scenario, aircraft), scenario.condition.V_m_s, scenario.condition.h_m
        driven = _noise_of_inputs(deflected, structure, suite)
        turbulence = Turbulence.of(structure, sensors, air, h, V, trimmed.theta, driven)
    experiment = Experiment(
        structure, sensors, 1.0 / rate, samples, per_sample, initial_states=free_start, turbulence=turbulence
    )
    at = {**trimmed.state, "alpha": trimmed.alpha, "V": scenario.condition.V_m_s, **trimmed.controls}
    prediction = Prediction(linear, scenario.controls, limits, at, 1.0 / rate, samples * per_sample)
    noise = {
        s.channel: (float(sigma), 1.0 / (s.rate_hz or suite.rate_hz))
        for s, sigma in zip(sensors, experiment.sigma, strict=True)
    }
    states = [s for s in structure.states if not s.startswith("servo") or s in linear.states]
    bands = ModeBands(model.subsystem(states), of_interest, inputs, noise, 1.0 / rate, samples * per_sample)
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
        {c: -1.0 / float(model.A[at_servo, at_servo]) for c, at_servo in _servos(model, scenario.controls).items()},
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


def _servos(model: LinearModel, controls: Sequence[str]) -> dict[str, int]:
    """Return control -> the state of its servo, of those that have one."""
    return {c: model.states.index(f"servo_{c}") for c in controls if f"servo_{c}" in model.states}


def _asked(asked: Any) -> tuple[str, ...]:
    return (*asked.parameters, *asked.also_unknown)


def _belongs(parameter: str, mode: int) -> bool:
    return parameter in (f"omega_{mode}", f"zeta_{mode}") or parameter.startswith(f"Q{mode}_")


def _band(modes: Mapping[str, complex]) -> tuple[float, float]:
    """Return the band of frequencies that modes are excited in, Hz."""
    wn = [abs(p) for p in modes.values()]
    return 0.3 * min(wn) / (2.0 * np.pi), 1.6 * max(wn) / (2.0 * np.pi)


def _input_rate(suite_hz: float, simulation_hz: float, wanted_hz: float) -> float:
    """Return the lowest rate of inputs that the suite's divides and that divides the simulation's, fast enough."""
    whole = round(simulation_hz / suite_hz)
    rates = [suite_hz * k for k in range(1, whole + 1) if whole % k == 0]
    return next((r for r in rates if r >= max(wanted_hz, _LOWEST_RATE_HZ)), rates[-1])


def with_positions(linear: LinearModel, sensors: Sequence[Sensor]) -> LinearModel:
    """Return the linear model with its accelerations moved to the accelerometers: a + omegadot x r."""
    C, D = linear.C.copy(), linear.D.copy()
    arms = {"ax": ("qdot", 2, "rdot", 1), "ay": ("rdot", 0, "pdot", 2), "az": ("pdot", 1, "qdot", 0)}
    for sensor in sensors:
        if sensor.channel in arms and any(sensor.position_m):
            plus, i, minus, k = arms[sensor.channel]
            row, a, b = (linear.outputs.index(n) for n in (sensor.channel, plus, minus))
            for part, old in ((C, linear.C), (D, linear.D)):
                part[row] += sensor.position_m[i] * old[a] - sensor.position_m[k] * old[b]
    return replace(linear, C=C, D=D)


_SPEEDS = 11  # that the onset of vibration is sought over


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
