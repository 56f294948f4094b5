"""Design scenarios read and checked without flying."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import stated_deviations, with_priors
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import Faults, Refusal, ScenarioError, nearest
from testbench.design.candidates import sampled
from testbench.evaluation.modes import RIGID_MODES, elastic_modes
from testbench.flight import load_aircraft
from testbench.flight.simulate import stride
from testbench.information.aircraft_structure import parameter_names
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import load_suite

_DRAWS = 20  # of an aircraft that states its uncertainty


def draws_of(scenario: DesignScenario, aircraft: Aircraft) -> int:
    """Return how many aircraft a design is judged over; 0: the believed one alone."""
    if scenario.draws is not None:
        return scenario.draws
    return _DRAWS if aircraft.uncertainty or scenario.robust else 0


def check(scenario: DesignScenario) -> list[str]:
    """Return every law of aircraft, sensors and targets that a design scenario breaks, in words, without flying."""
    faults = Faults(scenario.file)
    note = faults.note
    try:
        aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    except Refusal as error:
        note("aircraft", error.message)
        return faults
    if draws_of(scenario, aircraft):
        key = "robust" if scenario.robust and not scenario.draws else "draws"
        faults.attempt(key, stated_deviations, with_priors(aircraft))
    plane = scenario.plane
    for control in scenario.controls:
        if control not in aircraft.controls:
            note("controls", f"{aircraft.name} has no control '{control}'{nearest(control, aircraft.controls)}")
    elastic = elastic_modes(aircraft, plane)
    known = parameter_names([*aircraft.controls], plane, elastic)
    for key, names in (("parameters", scenario.targets.parameters), ("also_unknown", scenario.targets.also_unknown)):
        for name in names:
            if name not in known:
                note(f"targets.{key}", f"'{name}' is no parameter of the {plane} motion{nearest(name, known)}")
    valid = (*RIGID_MODES[plane], *elastic.values())
    for name in scenario.targets.modes:
        if name not in valid:
            note("targets.modes", f"'{name}' is no {plane} mode of {aircraft.name}{nearest(name, valid)}")
    for control, degrees in scenario.limits.deflection_deg.items():
        if control in aircraft.controls:
            reach = aircraft.controls[control]
            full = max(reach.full, -reach.low) / (PERCENT if control == "thr" else DEG_RAD)
            if degrees > full + 1e-9:
                note("limits.deflection_deg", f"{control} <= {full:g} must hold for {aircraft.name}, got {degrees:g}")
    for control in scenario.limits.rate_deg_s:
        if control in aircraft.controls and not aircraft.has_servo(control):
            note(
                "limits.rate_deg_s",
                f"the rate of {control} can be limited only where a servo moves it, but {aircraft.name} has none: "
                "give servo_lag_rad_s in its aircraft.toml, or leave the limit out",
            )
    if scenario.input:
        left = scenario.duration_s - scenario.start_s
        rate = scenario.simulation.rate_hz or aircraft.rate_hz
        faults.attempt("input", sampled, scenario.input, scenario.controls, left, rate)
    for i, name in enumerate(scenario.suites):
        try:
            suite = load_suite(name)
            rate = scenario.simulation.rate_hz or aircraft.rate_hz
            for control in scenario.controls:
                if not {control, f"{control}_cmd"} & set(suite.channels):
                    note(
                        f"suites[{i}]", f"suite '{name}' must sense {control} or {control}_cmd: no model without input"
                    )
            if not suite.sensing():
                note(f"suites[{i}]", f"suite '{name}' senses nothing but controls; add a sensor of the motion")
            for sensor in suite.sensing():
                if sensor.noise_std == 0.0 and sensor.quantum == 0.0:
                    note(f"suites[{i}]", f"sensor '{sensor.channel}' must have noise or a quantum, got none")
            stride(rate, suite.rate_hz)
        except ScenarioError as error:
            faults += [f"{scenario.file}, suites[{i}]: {fault}" for fault in error.faults]
        except Refusal as error:
            note(f"suites[{i}]", error.message)
    return faults
