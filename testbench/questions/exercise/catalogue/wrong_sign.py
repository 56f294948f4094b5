"""Adopt somebody else's aircraft, find the coefficient whose sign is wrong, and mend it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.door import read_text
from testbench.core.record import FlightRecord
from testbench.evaluation.modes import frequency_of, modes_of
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.inputs import InputSignal
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import multistep

MODEL = "stranger.xml"
_V, _H, _DT, _SECONDS = 14.0, 100.0, 0.02, 10.0
# What may stand in the file with the wrong sign, and what a student is asked to choose from.
_OPTIONS = {
    "Cm_alpha": "pitching moment due to alpha",
    "Cm_q": "pitching moment due to pitch rate",
    "Cm_de": "pitching moment due to elevator",
    "Cl_beta": "rolling moment due to sideslip",
    "Cl_p": "rolling moment due to roll rate",
    "Cl_da": "rolling moment due to aileron",
    "Cn_beta": "yawing moment due to sideslip",
    "Cn_r": "yawing moment due to yaw rate",
    "Cn_dr": "yawing moment due to rudder",
}
_MOTIONS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")
_SURFACES = ("de", "da", "dr")


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw which coefficient stands in the file with the wrong sign, and how far each is from the packaged aircraft."""
    factors = {name: float(rng.uniform(0.85, 1.2)) for name in _OPTIONS}
    return {"wrong": list(_OPTIONS)[int(rng.integers(len(_OPTIONS)))], "factors": factors}


def model_text(factors: Mapping[str, float]) -> str:
    """Return the JSBSim model of the aircraft with some coefficients times a factor, rounded as people write them."""
    base = load_aircraft("taurus")
    text = base.model_xml(base.rate_hz, 0.0, base.design_V_m_s)
    for name, factor in factors.items():
        text = changed(text, name, lambda value, factor=factor: value * factor)
    return text


def changed(text: str, coefficient: str, by: Any) -> str:
    """Return a model with the number of one coefficient changed by a function."""
    function = re.compile(rf'(<function name="aero/coefficient/{coefficient}">.*?<value>)([^<]+)(</value>)', re.DOTALL)
    return function.sub(lambda m: f"{m[1]}{by(float(m[2])):.4g}{m[3]}", text, count=1)


def adopted(text: str, engines: Mapping[str, str]) -> Aircraft:
    """Return the aircraft that a model and the files of its engines make."""
    with TemporaryDirectory() as folder:
        place = Path(folder) / "stranger"
        for name, content in {MODEL: text, **engines}.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text(content, encoding="utf-8")
        return load_aircraft(place / MODEL)


def _engines() -> dict[str, str]:
    return {f"Engines/{name}": text for name, text in load_aircraft("taurus").engine_files.items()}


@lru_cache(maxsize=8)
def _true(factors: tuple[tuple[str, float], ...]) -> Aircraft:
    return adopted(model_text(dict(factors)), _engines())


def frequencies(aircraft: Aircraft) -> tuple[float, float]:
    """Return the natural frequencies of short period and Dutch roll at the condition of the flight, rad/s."""
    linear = linearise(aircraft, trim(aircraft, FlightCondition(_V, _H), 100.0))
    found = modes_of(linear, aircraft, "longitudinal") | modes_of(linear, aircraft, "lateral-directional")
    short, dutch = frequency_of(found, "short period"), frequency_of(found, "Dutch roll")
    assert short is not None
    assert dutch is not None
    return short, dutch


def hand_out(case: Case) -> Handout:
    """Return the model with its wrong sign, and a flight of the real aircraft."""
    aircraft, rng = _true(tuple(case["factors"].items())), np.random.default_rng(case.seed)
    trimmed = trim(aircraft, FlightCondition(_V, _H), 1.0 / _DT * 4)
    n = round(_SECONDS * trimmed.rate_hz)
    dt = 1.0 / trimmed.rate_hz
    parts = [multistep(n, dt, start, 0.25, 3.0 * DEG_RAD, "2112") for start in (0.5, 3.0, 6.0)]
    signal = InputSignal(np.asarray(np.arange(n) * dt, np.float64), np.column_stack(parts), _SURFACES)
    flown = fly(aircraft, trimmed, Manoeuvre("flight", signal), 1.0 / _DT)
    columns = (*_MOTIONS, *_SURFACES)
    noise = np.array([0.1, *[0.1 * DEG_RAD] * (len(columns) - 1)])
    noise[-len(_SURFACES) :] = 0.0
    data = flown.columns(columns) + rng.normal(size=(len(flown), len(columns))) * noise
    record = FlightRecord(flown.t_s, columns, data, "measured")
    text = changed(model_text(case["factors"]), case["wrong"], lambda value: -value)
    return Handout({"flight": record}, {"V_m_s": _V, "h_m": _H}, {MODEL: text, **_engines()})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return which sign is wrong, and the frequencies of the mended model."""
    short, dutch = frequencies(_true(tuple(case["factors"].items())))
    lateral = case["wrong"].startswith(("Cl", "Cn"))
    moves = "the roll and yaw rates" if lateral else "the pitch rate"
    hint = f"fly the commands of the record through the model: {moves} of the two part at once"
    wrong = tuple(
        Mistake(name, "its sign is right: a stable aircraft of this form has this sign")
        for name in _OPTIONS
        if name != case["wrong"]
    )
    damped = "natural frequency, not the damped one: the size of the pole"
    return {
        "wrong": Answer(case["wrong"], wrong, hint),
        "short_period_rad_s": Answer(short, (), f"of the corrected model at {_V:g} m/s and {_H:g} m; {damped}"),
        "dutch_roll_rad_s": Answer(dutch, (), f"of the corrected model at {_V:g} m/s and {_H:g} m; {damped}"),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Hold the signs of the file against those of a stable aircraft, mend the one that differs, and linearise.

    A stable aircraft that turns as its controls are named has these signs (J. Roskam, Airplane Flight Dynamics and
    Automatic Flight Controls, part I, chapter 4): all of the list negative but Cl_da and Cn_beta.
    """
    text = read_text(folder / MODEL, "JSBSim model")
    engines = {f"Engines/{p.name}": read_text(p, "JSBSim model") for p in (folder / "Engines").iterdir()}
    wrong = ""
    for name in _OPTIONS:
        values: list[float] = []
        changed(text, name, lambda value, values=values: values.append(value) or value)
        if (values[0] > 0.0) != (name in ("Cl_da", "Cn_beta")):
            wrong = name
    short, dutch = frequencies(adopted(changed(text, wrong, lambda value: -value), engines))
    return {"wrong": wrong, "short_period_rad_s": short, "dutch_roll_rad_s": dutch}


TITLE, LEVEL, MINUTES = "Adopt an aircraft and find its wrong sign", 2, 60
QUESTIONS = (
    Choice("wrong", "Which coefficient has the wrong sign in the file?", _OPTIONS),
    Number("short_period_rad_s", "rad/s", "Natural frequency of the short period of the corrected model", 0.02),
    Number("dutch_roll_rad_s", "rad/s", "Natural frequency of the Dutch roll of the corrected model", 0.02),
)
