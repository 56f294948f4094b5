"""An input while it is drawn: what it does and tells, by the functions that `testbench design` asks, and its file.

A page asks of a design, that of a file or a new one of an aircraft, and of entries ``input`` that it would have. The
believed aircraft is posed once; a request then costs some milliseconds. What a flight, the air and the estimator add is
for the command itself, which takes the same file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import with_priors
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.door import read_text, read_toml
from testbench.core.errors import LimitError, RecordError, ScenarioError
from testbench.core.escape import table_lines
from testbench.core.paths import AIRCRAFT, SCENARIOS, SENSOR_SUITES, aircraft_names, as_named, resolve, suite_names
from testbench.core.record import FloatArray
from testbench.design.ensemble import Draws, Flier, Member, draw, told
from testbench.design.limits import limit_words
from testbench.design.problem import Design, Problem, design_of
from testbench.flight import load_aircraft
from testbench.flight.simulate import stride
from testbench.information.targets import needed_parameters
from testbench.inputs.signal import energy_spectrum
from testbench.page.explore import View, to_json
from testbench.page.figure import COLOURS, QUIET, Curve, Panel, Rule
from testbench.page.labels import axis_label, number, shown_unit, symbol
from testbench.page.words import listed
from testbench.questions.app.records import inside
from testbench.questions.design.answer import controls_words, family_label, is_ratio, peak_words
from testbench.questions.design.check import draws_of
from testbench.questions.design.pose import own_input, pose, setting_of
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.files import kinds_of
from testbench.questions.plan.new import suite_of
from testbench.sensors import load_suite

KNOWN = 8
"""Designs that are kept posed."""
DRAWS = 20  # aircraft, where a design does not say how many
_NEW = {"duration_s": 20.0, "start_s": 2.0, "percent": 5.0}  # of a design of an aircraft alone
_FIRST = 0.6  # share of the largest admissible amplitude that a first input has
_NEAR = 3.0  # times what a channel moves by: a limit that is farther is told in words alone
_POINTS = 1500  # of a signal that is no sum of steps
_DECADES, _FREQUENCIES = 6.0, 240  # of a spectrum


@dataclass(frozen=True, eq=False)
class _Posed:
    """A design, posed for the believed aircraft, with the aircraft that were drawn."""

    scenario: DesignScenario
    believed: Member
    draws: dict[int, Draws]

    @property
    def problem(self) -> Problem:
        return self.believed.problem


def list_designs(folder: Path) -> dict[str, Any]:
    """Return the designs of a folder and the packaged ones with their titles, aircraft, and sensor suites."""
    found = []
    for file in sorted(folder.glob("*.toml")):
        with suppress(RecordError, ScenarioError):
            if "design" in [q.command for q in kinds_of(file)]:
                found.append({"of": file.name, "title": str(read_toml(file).get("title", "")), "own": True})
    packaged = sorted((SCENARIOS / "design").glob("*.toml"))
    found += [{"of": p.stem, "title": str(read_toml(p).get("title", "")), "own": False} for p in packaged]
    return {
        "designs": found,
        "aircraft": [*AIRCRAFT.own(folder), *aircraft_names()],
        "suites": [*SENSOR_SUITES.own(folder), *suite_names()],
    }


def design_told(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a page says of a design: condition, controls, targets, and the input that it begins with.

    Raises:
        TestbenchError: as `testbench design` does of the same file.
    """
    posed = _posed(folder, given)
    s, problem = posed.scenario, posed.problem
    controls = []
    for name in s.controls:
        factor, unit = shown_unit(name)
        low, high = problem.envelope.bands[name]
        most = factor * min(high - problem.envelope.trim[name], problem.envelope.trim[name] - low)
        controls.append({"name": name, "label": symbol(name), "unit": unit, "most": round(most, 2)})
    return {
        "title": s.title,
        "aircraft": posed.believed.aircraft.title,
        "own_input": bool(s.input),
        "suite": s.suites[0],
        "V_m_s": s.condition.V_m_s,
        "h_m": s.condition.h_m,
        "duration_s": s.duration_s,
        "start_s": problem.start_s,
        "controls": controls,
        "draws": draws_of(s, posed.believed.aircraft) or DRAWS,
        "input": [_entry(e.model_dump(exclude_defaults=True)) for e in s.input] or [_first(posed)],
    }


@on_one_thread
def input_told(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an input does and tells: signal, response with limits, spectrum, errors of the targets, a sentence.

    All is linear and of the believed aircraft; with ``draws`` errors are those over so many drawn aircraft, too.

    Raises:
        TestbenchError: as `testbench design` does of the same file.
    """
    posed, design = _designed(folder, given)
    problem, t = posed.problem, posed.problem.targets
    response = problem.prediction.response(design.u)
    used = np.maximum(response.max(axis=0) / problem.prediction.high, response.min(axis=0) / problem.prediction.low)
    limits = sorted(zip(problem.prediction.names, used.tolist(), strict=True), key=lambda x: -x[1])
    rows = []
    for name, value, wanted, error in zip(t.names, t.values, t.wanted, design.errors, strict=True):
        factor = 100.0 / abs(value) if is_ratio(name) else 1.0
        row = {"name": name, "unit": "%" if is_ratio(name) else "", "value": float(value), "wanted": factor * wanted}
        rows.append({**row, "error": factor * error if np.isfinite(error) else None})
    said = {
        "signal": _signal(posed, design),
        "response": json.loads(_response_figure(problem, design, response)),
        "spectrum": json.loads(_spectrum_figure(posed, design)),
        "limits": [{"name": limit_words(name).removeprefix("the "), "used": share} for name, share in limits],
        "errors": rows,
        "answer": _answer(problem, design, limits),
        "reached": bool(design.cost <= 1.0) and limits[0][1] <= 1.0,
    }
    if "draws" in given:
        said["drawn"] = _over(posed, design, given["draws"])
    return said


def design_text(folder: Path, given: Mapping[str, Any]) -> tuple[str, str]:
    """Return name and text of the file that asks of a design what a page does: with its input, or for a search.

    Comments of the design's own file stay. A name in the folder that stands for another text is not taken.

    Raises:
        TestbenchError: as `testbench design` does of that file.
    """
    posed = _posed(folder, given)
    entries = [_entry(e) for e in _input(given)]
    if entries:
        _designed(folder, given)
    file = _file(folder, given)
    if file is None:
        table = posed.scenario.model_dump(exclude_unset=True, exclude={"input"})
        table["aircraft"] = as_named(posed.scenario.aircraft, AIRCRAFT, folder)
        table["suites"] = [as_named(name, SENSOR_SUITES, folder) for name in posed.scenario.suites]
        lines = table_lines(table)
        stem = f"{Path(posed.scenario.aircraft).name}_{posed.scenario.controls[0]}"
    else:
        duration = f"duration_s = {posed.scenario.duration_s!r}"
        text = re.sub(r"(?m)^duration_s *=[^#\n]*", duration, read_text(file, "scenario"))
        lines, stem = _without_input(text), file.stem
    text = "\n".join([*lines, *table_lines({"input": entries})]) + "\n"
    stem = re.sub(r"(_input)?(_\d+)?$", "", stem) + ("_input" if entries else "")
    for k in range(1, 1000):
        name = f"{stem}{'' if k == 1 else f'_{k}'}.toml"
        if not (folder / name).exists() or read_text(folder / name, "scenario") == text:
            return name, text
    raise RecordError(f"files {stem}_*.toml of the folder are too many; remove those that are not needed")


def _without_input(text: str) -> list[str]:
    """Return the lines of a design's file but for its tables ``input``."""
    out, within = list[str](), False
    for line in text.rstrip().splitlines():
        if head := re.match(r"\s*\[\[?\s*([\w.]+)\s*\]\]?\s*(#.*)?$", line):
            within = head[1].partition(".")[0] == "input"
        out += [] if within else [line]
    return out


def plan_words(folder: Path, given: Mapping[str, Any]) -> list[str]:
    """Return the words of the command that plans a ``design`` of the folder's results: its plan, if it has one."""
    name = str(given.get("design"))
    stem = Path(name).name.removeprefix("design_")
    made = folder / "results" / f"plan_{stem}" / f"{stem}.toml"
    with suppress(OSError, ValueError):
        if made.is_file():
            return ["plan", made.relative_to(folder).as_posix(), "--out", "results"]
    return ["plan", "--from", name, "--out", "results"]


def amended_words(folder: Path, given: Mapping[str, Any]) -> list[str]:
    """Return the words of the command that surveys the aircraft which a ``gap`` of the folder's results amended.

    Raises:
        RecordError: it amended none, or lies elsewhere.
    """
    place = (folder / str(given.get("gap")).replace("\0", "") / "amended").resolve()
    inside_it = place.is_relative_to(folder.resolve()) and place.is_dir()
    found = sorted(p for p in place.iterdir() if p.is_dir()) if inside_it else []
    if not found:
        raise RecordError(
            "an aircraft must be amended before it is looked at, but this search changed none; its page says why"
        )
    return ["aircraft", found[0].relative_to(folder.resolve()).as_posix(), "--out", "results"]


# --- the design -------------------------------------------------------------------------------------------------------


def _file(folder: Path, given: Mapping[str, Any]) -> Path | None:
    """Return the file of a design that is ``of`` a file of the folder or a packaged one; None for a new one."""
    of = given.get("of")
    if of is None:
        return None
    if str(of).endswith(".toml"):
        return inside(folder, of, ".toml")
    packaged = {p.stem: p for p in (SCENARIOS / "design").glob("*.toml")}
    if of not in packaged:
        raise RecordError(f"a design must be a file of the folder or a packaged one, got '{str(of)[:200]}'")
    return packaged[str(of)]


def _posed(folder: Path, given: Mapping[str, Any]) -> _Posed:
    file = _file(folder, given)
    content = _new(folder, given) if file is None else read_toml(file)
    if isinstance(given.get("duration_s"), (int, float)):
        content["duration_s"] = float(given["duration_s"])
    if "input" in given:
        content.pop("input", None)
    at = folder / "new.toml" if file is None else file
    return _pose(json.dumps(content, default=str), at, at.stat().st_mtime_ns if file else 0)


@lru_cache(maxsize=KNOWN)
@on_one_thread
def _pose(content: str, file: Path, changed: int) -> _Posed:
    scenario = DesignScenario.of(json.loads(content), file)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    return _Posed(scenario, pose(scenario, aircraft, load_suite(scenario.suites[0])), {})


def _new(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a new design of an ``aircraft``, with a ``suite``, ``control`` and speed if they are given.

    Its targets are the derivatives that every design of the plane needs, but for those that are zero or follow from
    the speed alone; limits are the aircraft's own.
    """
    name = resolve(str(given.get("aircraft")), AIRCRAFT, folder)
    aircraft = load_aircraft(name)
    control = str(given.get("control") or next((c for c in CONTROLS if c in aircraft.controls), "de"))
    V = given.get("V_m_s")
    plane = "longitudinal" if control in ("de", "thr") else "lateral"
    names = [n for n in needed_parameters(plane, [control], False, []) if n.split("_")[1] in _MAIN[control]]
    suite = str(given.get("suite") or _suite(folder, aircraft, control))
    return {
        "title": f"{aircraft.title}: {symbol(control)} at {_speed(aircraft, V):g} m/s",
        "aircraft": str(given.get("aircraft")),
        "suites": [suite],
        "controls": [control],
        "duration_s": _NEW["duration_s"],
        "start_s": _NEW["start_s"],
        "condition": {"V_m_s": _speed(aircraft, V), "h_m": float(aircraft.design_h_m)},
        "targets": {"parameters": dict.fromkeys(_told_by(names, control), _NEW["percent"])},
    }


_MAIN = {"de": ("alpha", "q", "de"), "thr": ("alpha", "q", "thr"), "da": ("p", "da"), "dr": ("beta", "r", "dr")}
"""Control -> what the derivatives that it tells best are by."""
_AXIS = {"de": "M", "thr": "X", "da": "L", "dr": "N"}


def _told_by(names: list[str], control: str) -> list[str]:
    """Return the derivatives of the moment that a control works on."""
    return [n for n in names if n.split("_")[0] == _AXIS[control]] or names


def _speed(aircraft: Aircraft, given: object) -> float:
    return float(given) if isinstance(given, (int, float)) else float(aircraft.design_V_m_s)


def _suite(folder: Path, aircraft: Aircraft, control: str) -> str:
    """Return a suite that senses a control, or its command, at a rate that divides the aircraft's.

    One of the folder comes first, then those of its name, and those that are lent to others; else what a plan takes.
    """
    own = [n for n in suite_names() if n.startswith(aircraft.name.split(",")[0])]
    mine = {name: str(folder / "suites" / f"{name}.toml") for name in SENSOR_SUITES.own(folder)}
    for name in (*mine, *own, "eolo_alpha", "eolo_alpha_beta", *suite_names()):
        suite = load_suite(mine.get(name, name))
        with suppress(LimitError):
            stride(aircraft.rate_hz, suite.rate_hz)
            if {control, f"{control}_cmd"} & {*suite.channels}:
                return name
    return suite_of(aircraft)[0]


# --- the input --------------------------------------------------------------------------------------------------------


def _input(given: Mapping[str, Any]) -> list[dict[str, Any]]:
    entries = given.get("input", [])
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise RecordError(f"the input must be a list of entries, got {str(entries)[:200]}")
    return entries


def _entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry with times and amplitudes of no more digits than a person would write."""
    return {k: _rounded(v) for k, v in entry.items() if v is not None}


def _rounded(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_rounded(v) for v in value]
    return round(value, 4) if isinstance(value, float) else value


def _designed(folder: Path, given: Mapping[str, Any]) -> tuple[_Posed, Design]:
    """Return a design posed, and its input at the amplitude that it has."""
    posed, file = _posed(folder, given), _file(folder, given)
    at = folder / "new.toml" if file is None else file
    table = posed.scenario.model_dump(exclude_unset=True) | {"input": _input(given)}
    scenario = DesignScenario.of(table, at)
    if not scenario.input:
        raise ScenarioError("an input must have an entry; give one")
    return posed, design_of(posed.problem, own_input(scenario, posed.problem))


def _first(posed: _Posed) -> dict[str, Any]:
    """Return a doublet at the fastest mode that is looked for, within the limits: where drawing begins."""
    problem, s = posed.problem, posed.scenario
    control, left = s.controls[0], problem.duration_s - problem.start_s
    modes = problem.bands.modes if problem.bands is not None else {}
    fastest = max((abs(p) for p in modes.values()), default=2.0)
    period = float(np.clip(2.0 * np.pi / fastest, 2.0 * problem.shortest_s, 0.5 * left))
    entry = {"signal": "doublet", "control": control, "period_s": round(period, 2), "start_s": 0.0}
    key, unit = ("amplitude_percent", PERCENT) if control == "thr" else ("amplitude_deg", DEG_RAD)
    given = DesignScenario.model_validate({**s.model_dump(), "input": [{**entry, key: 1.0}]})
    factor = own_input(given, problem).candidate.u
    most, _ = problem.prediction.largest_factor(factor)
    limit = problem.envelope.bands[control][1] / unit
    return {**entry, key: max(0.1, round(_FIRST * min(most, limit), 1))}


def _signal(posed: _Posed, design: Design) -> dict[str, Any]:
    """Return the commands after the undisturbed flight, (time, value) where a line through them bends, shown units."""
    problem = posed.problem
    rows = np.arange(len(design.u)) / problem.rate_hz >= problem.start_s - 1e-9
    u, t = design.u[rows], np.arange(int(rows.sum())) / problem.rate_hz
    out: dict[str, Any] = {}
    for k, control in enumerate(problem.controls):
        x = shown_unit(control)[0] * u[:, k]
        at = np.flatnonzero(np.diff(x, prepend=0.0))
        if at.size > _POINTS // 2:
            every = max(1, x.size // _POINTS)
            points = [*zip(t[::every].tolist(), x[::every].tolist(), strict=True)]
        else:
            before = np.concatenate([[0.0], x])[at]
            ends = [(0.0, 0.0), *(p for i, b in zip(at, before, strict=True) for p in ((t[i], b), (t[i], x[i])))]
            points = [(float(a), float(b)) for a, b in [*ends, (t[-1], x[-1])]]
        out[control] = [[round(a, 4), round(b, 5)] for a, b in points]
    return out


# --- figures and words ------------------------------------------------------------------------------------------------


def _response_figure(problem: Problem, design: Design, response: FloatArray) -> str:
    """Return the response of the believed aircraft, linearised, to a command, over its limits where these are near."""
    prediction, t = problem.prediction, np.arange(len(response)) / problem.rate_hz - problem.start_s
    panels = []
    for k, name in enumerate(prediction.names):
        if name.startswith(("rate of", "command of")):
            continue
        factor, at = shown_unit(name)[0], prediction.trim.get(name, 0.0)
        x = factor * (at + response[:, k])
        low, high = factor * (at + prediction.low[k]), factor * (at + prediction.high[k])
        half = max(float(np.ptp(x)), 1e-9) * _NEAR
        near = [limit for limit in (low, high) if x.min() - half < limit < x.max() + half]
        ends = t[[0, -1]]
        draws: list[Any] = [Curve(x=t, y=x, name="response", colour=COLOURS[0])]
        draws += [Curve(x=ends, y=[at, at], name="limit", colour=COLOURS[1], dash=(4, 2)) for at in near]
        panels.append(Panel(draws=draws, x="t, s", y=axis_label(name)))
    return to_json([View(name="response", panels=panels)])


def _spectrum_figure(posed: _Posed, design: Design) -> str:
    """Return the energy spectrum of a command below its peak, dB, and where the modes of the plane lie, rad/s."""
    problem, modes = posed.problem, posed.believed.modes
    high = max([60.0, *(1.5 * abs(p) for p in modes.values())])
    omega = np.geomspace(0.1, min(high, np.pi * problem.rate_hz), _FREQUENCIES)
    energy = energy_spectrum(design.u, 1.0 / problem.rate_hz, omega).sum(axis=1)
    level = 10.0 * np.log10(np.maximum(energy / max(float(energy.max()), 1e-300), 10.0**-_DECADES))
    marks = [Rule(at=abs(pole), text=name, colour=QUIET) for name, pole in modes.items() if 0.1 < abs(pole) < high]
    line = Curve(x=omega, y=level, name="input", colour=COLOURS[0])
    panel = Panel(draws=[line, *marks], x="frequency, rad/s", y="energy below its peak, dB", log_x=True)
    return to_json([View(name="spectrum", panels=[panel])])


def _answer(problem: Problem, design: Design, limits: list[tuple[str, float]]) -> str:
    """Return in a sentence which wanted errors the input reaches, and the limit that it breaks or comes nearest to."""
    ratios = design.errors / problem.targets.wanted
    k, reached = int(np.argmax(ratios)), int(np.sum(ratios <= 1.0))
    name, share = limits[0]
    words = f"The {family_label(design.family)} on the {controls_words(design)}, peak {peak_words(design)}"
    if not np.isfinite(ratios[k]):
        lost = [n for n, r in zip(problem.targets.names, ratios, strict=True) if r == np.inf]
        said = f"tells nothing of {listed(lost)}"
    elif reached == len(ratios):
        said = "reaches every wanted accuracy"
    else:
        worst = f"{problem.targets.names[k]}, known to {number(float(ratios[k]), 2)} times the wanted error"
        said = f"reaches {reached} of {len(ratios)} wanted accuracies; the worst is {worst}"
    if share > 1.0:
        return f"{words}, breaks the limit on {limit_words(name)} ({100.0 * share:.0f} % of it); it {said}."
    return f"{words}, {said}. It uses {100.0 * share:.0f} % of the limit on {limit_words(name)}."


@on_one_thread
def _over(posed: _Posed, design: Design, count: object) -> dict[str, Any]:
    """Return the errors of an input over drawn aircraft: medians and worst, as the page shows errors."""
    if not isinstance(count, int) or not 0 < count <= 200:
        raise RecordError(f"aircraft that are drawn must be 1 to 200, got {str(count)[:80]}")
    s = posed.scenario
    if count not in posed.draws:
        setting = setting_of(s, posed.believed, load_suite(s.suites[0]))
        posed.draws[count] = draw(setting, with_priors(posed.believed.aircraft), count, s.seed, design, Flier())
    members, t = posed.draws[count], posed.problem.targets
    if not members.judged:
        raise RecordError(f"of {count} drawn aircraft none can be judged: {members.lost[0].reason}")
    found = told(design, members.judged, t.names)
    shown = [100.0 * w / abs(v) if is_ratio(n) else w for n, v, w in zip(t.names, t.values, t.wanted, strict=True)]
    medians, worst = (found.over(how) * shown for how in (np.median, np.max))
    return {
        "judged": len(members.judged),
        "asked": members.asked,
        "reached": found.reached,
        "median": [float(x) if np.isfinite(x) else None for x in medians],
        "worst": [float(x) if np.isfinite(x) else None for x in worst],
    }
