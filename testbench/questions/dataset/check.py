"""What can be checked in the file of a data set before anything is flown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from testbench.core.errors import Faults, LimitError, nearest
from testbench.effects import Effect, catalogue, left_out
from testbench.flight import load_aircraft
from testbench.inputs import build
from testbench.questions.campaign.draws import check_target, is_scenario_key, middle
from testbench.questions.campaign.scenario import Uncertainty
from testbench.questions.dataset.draws import MOST_HIDDEN
from testbench.questions.dataset.scenario import DatasetScenario, Level
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.sensor import whole_ratio


def dataset_faults(scenario: DatasetScenario) -> list[str]:
    """Return every law that the file of a data set breaks beyond its schema."""
    faults = Faults(scenario.file)
    suite = faults.attempt("suite", load_suite, scenario.suite)
    if suite is None:
        return faults
    for i, level in enumerate(scenario.level):
        _check_level(faults, f"level[{i}]", scenario, level, suite)
    places: dict[str, str] = {}
    for i, level in enumerate(scenario.level):
        for name in level.aircraft:
            if places.setdefault(Path(name).name, name) != name:
                faults.note(
                    f"level[{i}].aircraft", f"folders of aircraft must differ in name, got '{Path(name).name}' twice"
                )
    rate = scenario.samples_hz or suite.rate_hz
    for i, manoeuvre in enumerate(scenario.manoeuvre):
        faults.attempt(f"manoeuvre[{i}]", build, manoeuvre.input, manoeuvre.duration_s, rate)
    return faults


def _check_level(faults: Faults, key: str, scenario: DatasetScenario, level: Level, suite: SensorSuite) -> None:
    commanded, known = {s.control for m in scenario.manoeuvre for s in m.input}, catalogue(suite)
    for fault in _hidden_faults(level, known):
        faults.note(f"{key}.hidden", fault)
    for name in level.aircraft:
        aircraft = faults.attempt(f"{key}.aircraft", load_aircraft, name, level.wings)
        if aircraft is None:
            continue
        for control in sorted(commanded - set(aircraft.controls)):
            faults.note(f"{key}.aircraft", f"{name} must have every control that is moved, but it has no '{control}'")
        effects = {n: known[n] for entry in level.hidden for n in entry.split(" + ") if n in known}
        for effect, why in left_out(effects, aircraft, suite).items():
            faults.note(f"{key}.hidden", f"{name} cannot have {effect}: {why}")
        rate = scenario.simulation.rate_hz or aircraft.rate_hz
        faults.attempt(f"{key}.aircraft", _check_rates, scenario, name, rate, suite)
        for target, law in level.vary.items():
            where = f'{key}.vary."{target}"'
            if isinstance(law, Uncertainty):
                faults.note(where, "kind 'uncertainty' belongs to campaigns; give 'normal' with its std")
            elif is_scenario_key(target):
                faults.note(
                    where,
                    f"a key must begin with aircraft., coefficient., property. or sensor., got '{target}'; condition, "
                    "air and inputs are drawn by the keys of the level",
                )
            else:
                for fault in check_target(target, middle(law), aircraft, (suite,)):
                    faults.note(where, fault)


def _hidden_faults(level: Level, known: Mapping[str, Effect]) -> Iterator[str]:
    """Yield every law that the effects of a level break on any aircraft."""
    for entry in level.hidden:
        names = entry.split(" + ")
        if len(names) > MOST_HIDDEN:
            yield f"at most {MOST_HIDDEN} effects can act together, got {len(names)} in '{entry}'"
        for name in names:
            if name not in known:
                yield f"unknown effect '{name}'{nearest(name, known)}"
            elif known[name].over_time is not None:
                yield f"{name} grows over hours of a flight, and flights of a data set have no time after take-off"


def _check_rates(scenario: DatasetScenario, name: str, rate_hz: float, suite: SensorSuite) -> None:
    samples = scenario.samples_hz or suite.rate_hz
    if whole_ratio(rate_hz, samples) is None:
        raise LimitError(
            f"samples_hz must divide the frames of {name}, got {samples:g} Hz into {rate_hz:g} Hz; set "
            "simulation.rate_hz to a multiple"
        )
    for sensor in suite.sensors:
        if sensor.rate_hz and whole_ratio(samples, sensor.rate_hz) is None:
            raise LimitError(
                f"samples_hz must be a multiple of the rate of every sensor, got {samples:g} Hz, and "
                f"{sensor.rate_hz:g} Hz of {sensor.channel}"
            )
