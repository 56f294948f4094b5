"""The data from which the page computes: linearised aircraft with free parameters, as each suite sees them.

    dx/dt = A x + B u,    y = C x + D u,    d[A B]/dp = E_p,    d[C D]/dp = P E_p

in the notation of :mod:`testbench.information.aircraft_structure`. The page discretises these, simulates response and
sensitivities, and sums the Fisher information as :class:`testbench.information.fisher.Experiment` does. A and B are
affine in the derivatives: with E the page also moves them, to see how its figures change if the model is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import ScenarioError, TrimError
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, aircraft_names, resolve, suite_names
from testbench.core.record import FloatArray
from testbench.design.ensemble import Placed
from testbench.design.problem import Problem
from testbench.estimators.parametric.structure import STEP
from testbench.evaluation.modes import RIGID_MODES, elastic_modes, modes_of, roots_of
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, linearise, load_aircraft, trim
from testbench.information.aircraft_structure import AircraftStructure, Plane, aircraft_structure
from testbench.information.targets import targets
from testbench.inputs.multisine import phases
from testbench.questions.design.pose import limits_of, problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.plan.new import plan_head
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.suite import suite_toml

SPEEDS = {"taurus": (9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 16.0, 18.0), "eolo": (11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0,
          18.0, 19.0, 20.0)}  # fmt: skip
"""Speeds, m/s, that the page offers; of other aircraft the design speed alone."""
PLANES: dict[str, Plane] = {"de": "longitudinal", "thr": "longitudinal", "da": "lateral", "dr": "lateral"}
"""Control -> the motion that it moves, in the order of the page."""
VIEWS = {"longitudinal": ("alpha", "q", "theta", "V"), "lateral": ("beta", "p", "r", "phi")}
"""Responses that the page draws, whatever the sensors see."""
BORROWED = ("eolo_alpha", "eolo_alpha_beta", "eolo_gap")
"""Suites that are offered for an aircraft that has none of its own."""
MODELS = 16
"""Aircraft that the page draws to see what its figures are worth if the model is wrong."""
LONGEST_S = 30.0
"""Longest record of the page."""
LINES = (4, 6, 8, 10, 12, 16, 20, 24)
"""Numbers of lines that a multisine may have; their phases are computed here, not on the page."""
RIGID = "rigid"
"""Group of the parameters that are always estimated; those of an elastic mode are in the group of its name."""
Json = dict[str, Any]
_MOST = 40  # parameters of one motion, elastic modes included


def studio_models(aircraft: Sequence[str] = (), progress: Callable[[str], None] | None = None) -> Json:
    """Return the data from which the page computes, in SI units and radians, ready for JSON.

    Args:
        aircraft: names or folders; all packaged ones if empty. A packaged aircraft is seen through the packaged suites
            for it, one of the user's own through those of the folder ``suites/``; if there is none, through
            :data:`BORROWED`.
        progress: called with a few words as each aircraft begins.

    Raises:
        ScenarioError: an aircraft is not known, or it has no control that a suite senses.
    """
    say = progress or (lambda text: None)
    out: Json = {
        "aircraft": {},
        "phases": {str(n): phases(tuple(range(1, n + 1))).tolist() for n in LINES},
        "draws": np.random.default_rng(1).standard_normal((MODELS, _MOST)).round(4).tolist(),
    }
    for name in [resolve(n, AIRCRAFT) for n in aircraft] or aircraft_names():
        said = Path(name).name
        say(f"linearise {said}")
        out["aircraft"][said] = _shorter(_aircraft(name, said))
    return out


def _shorter(value: Any) -> Any:
    """Return the same with numbers of ten figures: half the size."""
    if isinstance(value, dict):
        return {k: _shorter(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_shorter(v) for v in value]
    return float(f"{value:.10g}") if isinstance(value, float) else value


def _aircraft(name: str, said: str) -> Json:
    aircraft = load_aircraft(name)
    packaged = name in aircraft_names()
    own = [s for s in suite_names() if s.startswith(name)] if packaged else SENSOR_SUITES.own(Path.cwd())
    suites = {s: load_suite(s) for s in own}
    borrowed = {s: _fitting(load_suite(s), aircraft.rate_hz) for s in BORROWED}
    h = aircraft.design_h_m
    points = {}
    for V in SPEEDS.get(name, (aircraft.design_V_m_s,)):
        try:
            trimmed = trim(aircraft, FlightCondition(V, h))
        except TrimError:
            continue  # too slow or too fast for level flight: the page does not offer it
        points[f"{V:g}"] = _point(aircraft, trimmed, suites, borrowed)
    controls = list(next(iter(points.values()))["axes"]) if points else []
    if not controls:
        raise ScenarioError(
            f"the studio needs level flight at a speed of {aircraft.name}, and a control of it that a sensor suite "
            f"senses besides the motion; put one in your folder suites/"
        )
    used = {s: suite for s, suite in (suites | borrowed).items() if _offered(s, points)}
    return {
        "name": said,
        "title": aircraft.title,
        "h_m": h,
        "design_V_m_s": aircraft.design_V_m_s,
        "full": {c: aircraft.controls[c].full for c in controls},
        "limits": {n: list(aircraft.limits[n]) for n in _LIMITED if n in aircraft.limits},
        "texts": {s: suite_toml(suite) for s, suite in used.items()},
        "borrowed": [s for s in used if s not in suites],
        "plan": plan_head(aircraft, said, "ardupilot", LONGEST_S),
        "points": points,
    }


def _fitting(suite: SensorSuite, rate_hz: float) -> SensorSuite:
    """Return a borrowed suite at the next lower rate that divides the simulation's; all its sensors sample at it."""
    rate = rate_hz / math.ceil(rate_hz / suite.rate_hz - 1e-9)
    if rate == suite.rate_hz:
        return suite
    return replace(suite, rate_hz=rate, sensors=tuple(replace(s, rate_hz=None) for s in suite.sensors))


_LIMITED = ("alpha", "V", "theta", "beta", "phi")


def _offered(suite: str, points: Mapping[str, Json]) -> bool:
    return any(suite in axis["suites"] for point in points.values() for axis in point["axes"].values())


def _point(
    aircraft: Aircraft, trimmed: TrimmedFlight, suites: Mapping[str, SensorSuite], borrowed: Mapping[str, SensorSuite]
) -> Json:
    linear = linearise(aircraft, trimmed)
    modes = {plane: modes_of(linear, aircraft, plane) for plane in ("longitudinal", "lateral")}
    axes = {}
    for control, plane in PLANES.items():
        if control not in aircraft.controls:
            continue
        seen = _seen_by(suites, control, plane) or _seen_by(borrowed, control, plane)
        if seen:
            axes[control] = _axis(aircraft, trimmed, linear, modes[plane], control, seen)
    state = {n: float(trimmed.state.get(n, 0.0)) for n in ("theta", "beta", "p", "q", "r", "phi")}
    return {"trim": state | {"alpha": trimmed.alpha, "V": trimmed.condition.V_m_s}, "axes": axes}


def _seen_by(suites: Mapping[str, SensorSuite], control: str, plane: Plane) -> dict[str, SensorSuite]:
    """Return the suites that sense a control, or its command, and the motion that it moves."""
    felt = set(_FELT[plane])
    return {n: s for n, s in suites.items() if {control, f"{control}_cmd"} & {*s.channels} and felt & {*s.channels}}


_FELT = {"longitudinal": ("V", "u", "alpha", "q", "theta", "ax", "az"), "lateral": ("beta", "p", "r", "phi", "ay")}


def _axis(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    linear: LinearModel,
    modes: Mapping[str, complex],
    control: str,
    suites: Mapping[str, SensorSuite],
) -> Json:
    """Return one motion as one control moves it."""
    plane = PLANES[control]
    problems = {n: _problem(aircraft, trimmed, linear, modes, control, suite) for n, suite in suites.items()}
    structure = next(iter(problems.values())).experiment.structure
    elastic = elastic_modes(aircraft, plane)
    views = aircraft_structure(
        linear, trimmed, plane, elastic, structure.inputs, VIEWS[plane], structure.parameter_names
    )
    of_interest = (_main_mode(modes, plane), *elastic.values())
    aimed = {n: p for mode in of_interest for n, p in roots_of(modes, mode).items()}
    aim = targets(structure, {}, aimed, (1.0, 1.0))
    groups = {name: _of_mode(structure.parameter_names, i) for i, name in elastic.items()}
    in_groups = {p for names in groups.values() for p in names}
    groups[RIGID] = [p for p in structure.parameter_names if p not in in_groups]
    return {
        "plane": plane,
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
        "suites": {n: _suite(p, suites[n], control) for n, p in problems.items()},
    }


def _main_mode(modes: Mapping[str, complex], plane: Plane) -> str:
    """Return the mode that an input to this motion is aimed at; where it does not exist, the fastest rigid one."""
    wanted = "short period" if plane == "longitudinal" else "Dutch roll"
    if roots_of(modes, wanted):
        return wanted
    rigid = {n: p for n, p in modes.items() if n.split(",")[0] in RIGID_MODES[plane]} or modes
    return max(rigid, key=lambda n: abs(rigid[n])).split(",")[0]


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
    control: str,
    suite: SensorSuite,
) -> Problem:
    plane = PLANES[control]
    unknown = [f"{kind}_{i}" for i in elastic_modes(aircraft, plane) for kind in ("omega", "zeta")]
    V, h = trimmed.condition.V_m_s, trimmed.condition.h_m
    scenario = DesignScenario.model_validate(
        {
            "title": "studio",
            "aircraft": aircraft.name,
            "condition": {"V_m_s": V, "h_m": h},
            "suites": [BORROWED[0]],  # a name; the suite itself is given below
            "controls": [control],
            "duration_s": 1.0,  # the page has lengths of its own; a short one costs little here
            "start_s": 0.5,
            # as unknowns, not as targets: the page need not move a control as fast as the fastest mode
            "targets": {"modes": [_main_mode(modes, plane)], "also_unknown": unknown},
        }
    )
    limits = limits_of(scenario, aircraft, trimmed)
    return problem_of(scenario, Placed(aircraft, trimmed, linear, modes), suite, limits)


def _suite(problem: Problem, suite: SensorSuite, control: str) -> Json:
    """Return the sensors of a suite that the motion moves."""
    experiment = problem.experiment
    structure = experiment.structure
    base_hz = 1.0 / (experiment.dt_s * experiment.stride)
    moves = np.flatnonzero(structure.moved)
    sensors = [
        {
            "channel": s.channel,
            "sigma": float(experiment.sigma[i]),
            "scale": s.scale,
            "lag_s": s.lag_s,
            "delay_s": s.delay_s,
            "every": round(problem.rate_hz / (s.rate_hz or base_hz)),
            "kept": 1.0 - s.dropout,
        }
        for i, s in enumerate(experiment.sensors)
        if i in moves
    ]
    return {
        "rate_hz": problem.rate_hz,
        "base_hz": base_hz,
        "input": control if control in suite.channels else f"{control}_cmd",
        "sensors": sensors,
        "C": structure.C0[moves].tolist(),
        "D": structure.D0[moves, 0].tolist(),
        "P": [_sparse(structure.P[i][None, :]) for i in moves],
    }


def _sparse(matrix: FloatArray) -> list[list[float]]:
    """Return [row, column, value] of every entry that is not zero."""
    rows, columns = np.nonzero(matrix)
    return [[int(i), int(j), float(matrix[i, j])] for i, j in zip(rows, columns, strict=True)]
