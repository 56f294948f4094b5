"""The data from which the page computes: linearised aircraft with free parameters, as each suite sees them.

    dx/dt = A x + B u,    y = C x + D u,    d[A B]/dp = E_p,    d[C D]/dp = P E_p

in the notation of :mod:`testbench.information.aircraft_structure`. The page discretises these, simulates response and
sensitivities, and sums the Fisher information as :class:`testbench.information.fisher.Experiment` does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import ScenarioError, TrimError
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, aircraft_names, resolve, suite_names
from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import STEP
from testbench.evaluation.modes import roots_of
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, linearise, load_aircraft, trim
from testbench.information.aircraft_structure import AircraftStructure, aircraft_structure
from testbench.information.modes import elastic_modes, modes_of
from testbench.information.targets import targets
from testbench.inputs.multisine import phases
from testbench.questions.design.build import limits_of, problem_of
from testbench.questions.design.problem import Problem
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import SensorSuite, load_suite

SPEEDS = {"taurus": (9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 16.0, 18.0), "eolo": (11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0,
          18.0, 19.0, 20.0)}  # fmt: skip
"""Speeds, m/s, that the page offers; of other aircraft the design speed alone."""
VIEWS = ("alpha", "q", "theta", "V", "az", "h")
"""Responses that the page can draw, whatever the sensors see."""
LINES = (4, 6, 8, 10, 12, 16, 20, 24)
"""Numbers of lines that a multisine may have; their phases are computed here, not on the page."""
RIGID = "rigid"
"""Group of the parameters that are always estimated; those of an elastic mode are in the group of its name."""
Json = dict[str, Any]


def studio_models(aircraft: Sequence[str] = (), progress: Callable[[str], None] | None = None) -> Json:
    """Return the data from which the page computes, in SI units and radians, ready for JSON.

    Args:
        aircraft: names or folders; all packaged ones if empty. A packaged aircraft is seen through the packaged suites
            for it, one of the user's own through those of the folder ``suites/``.
        progress: called with a few words as each aircraft begins.

    Raises:
        ScenarioError: an aircraft is not known, or no suite is for it.
    """
    say = progress or (lambda text: None)
    out: Json = {"aircraft": {}, "phases": {str(n): phases(tuple(range(1, n + 1))).tolist() for n in LINES}}
    for name in [resolve(n, AIRCRAFT) for n in aircraft] or aircraft_names():
        said = Path(name).name
        say(f"linearise {said}")
        out["aircraft"][said] = _aircraft(name)
    return out


def _aircraft(name: str) -> Json:
    aircraft = load_aircraft(name)
    packaged = name in aircraft_names()
    suites = [s for s in suite_names() if s.startswith(name)] if packaged else SENSOR_SUITES.own(Path.cwd())
    if not suites:
        where = f"whose name begins with '{name}'" if packaged else "in your folder suites/"
        raise ScenarioError([f"the studio needs a sensor suite {where}; there is none"])
    h = aircraft.design_h_m
    points = {}
    for V in SPEEDS.get(name, (aircraft.design_V_m_s,)):
        try:
            trimmed = trim(aircraft, FlightCondition(V, h))
        except TrimError:
            continue  # too slow or too fast for level flight: the page does not offer it
        points[f"{V:g}"] = _point(aircraft, trimmed, V, h, suites)
    limits = {n: list(v) for n, v in aircraft.limits.items() if n in ("alpha", "V", "theta")}
    return {
        "title": aircraft.title,
        "h_m": h,
        "design_V_m_s": aircraft.design_V_m_s,
        "full": aircraft.controls["de"].full,
        "limits": limits,
        "points": points,
    }


def _point(aircraft: Aircraft, trimmed: TrimmedFlight, V: float, h: float, suites: Sequence[str]) -> Json:
    linear = linearise(aircraft, trimmed)
    modes = modes_of(linear, aircraft, "longitudinal")
    problems = {s: _problem(aircraft, trimmed, linear, modes, V, h, s) for s in suites}
    structure = problems[suites[0]].experiment.structure
    elastic = elastic_modes(aircraft, "longitudinal")
    views = aircraft_structure(
        linear,
        V,
        trimmed.alpha,
        "longitudinal",
        list(elastic),
        structure.inputs,
        VIEWS,
        structure.parameter_names,
    )
    aimed = {n: p for mode in ("short period", *elastic.values()) for n, p in roots_of(modes, mode).items()}
    aim = targets(structure, {}, aimed, (1.0, 1.0))
    groups = {name: _of_mode(structure.parameter_names, i) for i, name in elastic.items()}
    in_groups = {p for names in groups.values() for p in names}
    groups[RIGID] = [p for p in structure.parameter_names if p not in in_groups]
    return {
        "trim": {"alpha": trimmed.alpha, "V": V, "theta": trimmed.state["theta"], "de": trimmed.controls["de"]},
        "modes": {n: [p.real, p.imag] for n, p in modes.items()},
        "parameters": list(structure.parameter_names),
        "values": structure.true.tolist(),
        "A": structure.A0.tolist(),
        "B": structure.B0[:, 0].tolist(),
        "E": [_sparse(d) for d in _slopes(structure)],
        "groups": groups,
        "targets": [
            {"name": n, "value": float(v), "row": row.tolist(), "group": _owner(n, elastic)}
            for n, v, row in zip(aim.names, aim.values, aim.jacobian, strict=True)
        ],
        "views": {"C": views.C0.tolist(), "D": views.D0[:, 0].tolist()},
        "suites": {s: _suite(p, load_suite(s)) for s, p in problems.items()},
    }


def _of_mode(parameters: Sequence[str], i: int) -> list[str]:
    return [p for p in parameters if p in (f"omega_{i}", f"zeta_{i}") or p.startswith(f"Q{i}_")]


def _owner(target: str, elastic: Mapping[int, str]) -> str:
    """Return the elastic mode that a target is of, or RIGID."""
    return next((name for name in elastic.values() if target in (f"wn of {name}", f"zeta of {name}")), RIGID)


def _slopes(structure: AircraftStructure) -> FloatArray:
    """Return d[A B]/dp at the true parameters, (k, n, n + 1), by complex steps."""
    z = structure.matrices(structure.true + 1j * STEP * np.eye(len(structure.true)))
    return np.concatenate([z.A.imag, z.B.imag], axis=2) / STEP


def _problem(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    linear: LinearModel,
    modes: Mapping[str, complex],
    V: float,
    h: float,
    suite: str,
) -> Problem:
    unknown = [f"{kind}_{i}" for i in elastic_modes(aircraft, "longitudinal") for kind in ("omega", "zeta")]
    scenario = DesignScenario.model_validate(
        {
            "title": "studio",
            "aircraft": aircraft.name,
            "condition": {"V_m_s": V, "h_m": h},
            "suites": [suite],
            "controls": ["de"],
            "duration_s": 10.0,
            # as unknowns, not as targets: the page need not move the elevator as fast as the fastest mode
            "targets": {"modes": ["short period"], "also_unknown": unknown},
        }
    )
    limits = limits_of(scenario, aircraft, trimmed)
    return problem_of(scenario, aircraft, trimmed, linear, modes, load_suite(suite), limits)


def _suite(problem: Problem, suite: SensorSuite) -> Json:
    experiment = problem.experiment
    structure = experiment.structure
    base_hz = 1.0 / (experiment.dt_s * experiment.stride)
    sensors = [
        {
            "channel": s.channel,
            "sigma": float(sigma),
            "scale": s.scale,
            "lag_s": s.lag_s,
            "delay_s": s.delay_s,
            "every": round(problem.rate_hz / (s.rate_hz or base_hz)),
            "kept": 1.0 - s.dropout,
        }
        for s, sigma in zip(experiment.sensors, experiment.sigma, strict=True)
    ]
    return {
        "rate_hz": problem.rate_hz,
        "base_hz": base_hz,
        "input": "de" if "de" in suite.channels else "de_cmd",
        "sensors": sensors,
        "moves": [
            s["channel"] for s, c, d in zip(sensors, structure.C0, structure.D0, strict=True) if c.any() or d.any()
        ],
        "C": structure.C0.tolist(),
        "D": structure.D0[:, 0].tolist(),
        "P": [_sparse(row[None, :]) for row in structure.P],
    }


def _sparse(matrix: FloatArray) -> list[list[float]]:
    """Return [row, column, value] of every entry that is not zero."""
    rows, columns = np.nonzero(matrix)
    return [[int(i), int(j), float(matrix[i, j])] for i, j in zip(rows, columns, strict=True)]
