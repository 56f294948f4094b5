"""What can be said of a comparison before it is flown."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.core.errors import Refusal, nearest
from testbench.evaluation.modes import RIGID_MODES, elastic_modes
from testbench.flight import load_aircraft
from testbench.information.aircraft_structure import parameter_names
from testbench.questions.compare.placement import templates
from testbench.questions.compare.scenario import CompareScenario
from testbench.questions.run.check import check as check_flight
from testbench.sensors import load_suite


def check(scenario: CompareScenario) -> list[str]:
    """Return every law of aircraft, inputs, sensors and targets that the scenario breaks, in words, without flying."""
    faults = check_flight(scenario)  # the same keys, as far as a flight goes
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
        used = suite.sensing(identification.outputs)
        if not used:
            faults.append(f"{where}, suites[{i}]: suite '{suite.name}' senses none of the outputs; add a sensor")
        for s in used:
            if s.noise_std == 0.0 and s.quantum == 0.0:
                faults.append(f"{where}, suites[{i}]: sensor '{s.channel}' must have noise or a quantum, got none")
    controls = [name.removesuffix("_cmd") for name in identification.inputs]
    known = parameter_names([*aircraft.controls], scenario.plane, elastic_modes(aircraft, scenario.plane))
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
        templates(asked)
    except Refusal as error:
        return [f"{scenario.file}, placement: {error}"]
    if aircraft.flown_modes() is None or not aircraft.flown_stations():
        return [f"{scenario.file}, placement: {aircraft.name} must have flexible wings with stations, it has none"]
    return []
