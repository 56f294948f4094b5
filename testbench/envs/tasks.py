"""The tasks: one design scenario per aircraft, turned into the design problem that an agent solves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.flight import TrimmedFlight, load_aircraft
from testbench.questions.design.check import check
from testbench.questions.design.pose import limits_of, place, problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import SensorSuite, load_suite

# Limits and wanted accuracies are estimates. What is wanted are bounds, that white residuals alone would reach: well
# below what one would ask of an estimate from a real record.
_TASKS: dict[str, dict[str, Any]] = {
    "eolo": {
        "title": "EOLO: an elevator input for the short period, through the air data boom",
        "suites": ["eolo_alpha"],
        "duration_s": 20.0,
        "shortest_step_s": 0.1,
        "condition": {"V_m_s": 16.0, "h_m": 547.0},
        "targets": {"parameters": {"Z_alpha": 0.5, "M_alpha": 0.5, "M_q": 0.5, "M_de": 0.5}},
        "limits": {
            "deflection_deg": {"de": 12.5},
            "load_factor": [0.3, 1.8],
            "alpha_deg": [-4.0, 12.0],
            "speed_change_m_s": 3.0,
        },
    },
    "taurus": {
        "title": "Taurus: an elevator input for the short period, through an 8 Hz log without angle of attack",
        "suites": ["taurus_8hz"],
        "duration_s": 30.0,
        "shortest_step_s": 0.25,
        "condition": {"V_m_s": 12.0, "h_m": 100.0},
        "targets": {"parameters": {"M_alpha": 0.2, "M_q": 0.2, "M_de": 0.2}},
        "limits": {
            "load_factor": [0.2, 2.0],
            "alpha_deg": [-8.0, 12.0],
            "speed_change_m_s": 4.0,
            "pitch_change_deg": 30.0,
        },
    },
    "b1": {
        "title": "B-1-like: an elevator input for the short period",
        "suites": ["b1_alpha"],
        "duration_s": 60.0,
        "shortest_step_s": 0.4,
        "condition": {"V_m_s": 200.6, "h_m": 1524.0},
        "targets": {"parameters": {"Z_alpha": 0.5, "M_alpha": 0.5, "M_q": 0.5, "M_de": 0.5}},
        "limits": {"load_factor": [0.5, 1.5], "speed_change_m_s": 10.0, "pitch_change_deg": 10.0},
    },
}
_AMPLITUDE_DEG = {"eolo": 5.0, "taurus": 4.0, "b1": 2.0}
TASKS = tuple(_TASKS)
"""Names of the aircraft that have a task."""


@dataclass(frozen=True, eq=False)
class Task:
    """A design problem ready to be flown: scenario, aircraft, trim and sensors."""

    scenario: DesignScenario
    aircraft: Aircraft
    trimmed: TrimmedFlight
    suite: SensorSuite
    problem: Problem


def task_scenario(name: str, wings: str = "rigid") -> DesignScenario:
    """Return the design scenario of an aircraft's task, or of a design scenario's file, its own wings kept.

    Raises:
        ScenarioError: there is neither a task nor a file of that name, or the scenario breaks a law.
    """
    if name not in _TASKS:
        if not name.endswith(".toml"):
            raise ScenarioError(
                f"a task must be one of {', '.join(TASKS)} or the path of a design scenario (*.toml), got '{name}'"
            )
        return DesignScenario.load(Path(name))
    return DesignScenario(aircraft=name, wings=wings, start_s=2.0, controls=("de",), **_TASKS[name])  # type: ignore[arg-type]


def amplitude(name: str, task: Task) -> FloatArray:
    """Return the command (m,) either side of trim, rad (1 for the throttle), that a full action means.

    A task has its own amplitude: one step held to the end breaks a limit, and a few short steps do not. For a
    scenario's file it is the largest that the limits on the commands allow.
    """
    prediction, controls = task.problem.prediction, task.problem.controls
    at = [prediction.names.index(f"command of {c}") for c in controls]
    room = np.minimum(-prediction.low[at], prediction.high[at])
    if name in _AMPLITUDE_DEG:
        room = np.minimum(room, _AMPLITUDE_DEG[name] * DEG_RAD)
    return np.asarray(room)


@lru_cache(maxsize=16)
def prepare(name: str, wings: str = "rigid") -> Task:
    """Trim and linearise the aircraft of a task and return its design problem; kept, as parallel copies share it.

    Raises:
        TestbenchError: no such task, no trim, or limits without room.
    """
    scenario = task_scenario(name, wings)
    faults = check(scenario)
    if faults:
        raise ScenarioError(faults)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    at, suite = place(scenario, aircraft), load_suite(scenario.suites[0])
    problem = problem_of(scenario, at, suite, limits_of(scenario, aircraft, at.trimmed))
    return Task(scenario, aircraft, at.trimmed, suite, problem)
