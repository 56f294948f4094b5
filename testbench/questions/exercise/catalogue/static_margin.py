"""Trim flights at several speeds: the slope of the elevator, the static margin, and the trim at another speed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient
from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number

_RATE, _H = 200.0, 100.0
_SPEEDS = (12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0)
_FASTER = 20.0
_NOISE = 0.05  # deg, of alpha and de after averaging


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw stability and trim moment of the student's aircraft."""
    return {"Cm_alpha": float(rng.uniform(0.5, 1.15)), "CL_alpha": float(rng.uniform(0.92, 1.08))}


def _aircraft(Cm_alpha: float, CL_alpha: float) -> Aircraft:
    changes = (ScaleCoefficient("Cm_alpha", Cm_alpha), ScaleCoefficient("CL_alpha", CL_alpha))
    return load_aircraft("taurus").amended(Amendment("exercise", "a student's own aircraft", changes))


@lru_cache(maxsize=4)
def _trims(Cm_alpha: float, CL_alpha: float) -> tuple[tuple[float, float, float], ...]:
    """Return (V, alpha, de) at every speed of the table and at the faster one."""
    aircraft = _aircraft(Cm_alpha, CL_alpha)
    found = [(V, trim(aircraft, FlightCondition(V, _H), _RATE)) for V in (*_SPEEDS, _FASTER)]
    return tuple((V, t.alpha, t.controls["de"]) for V, t in found)


def _given(case: Case) -> dict[str, float]:
    aircraft = load_aircraft("taurus")
    return {
        "CL_alpha": round(case["CL_alpha"] * aircraft.coefficient("CL_alpha"), 2),
        "Cm_de": aircraft.coefficient("Cm_de"),
        "faster_m_s": _FASTER,
    }


def hand_out(case: Case) -> Handout:
    """Return a table of trims with some noise of the instruments."""
    rng = np.random.default_rng(case.seed)
    lines = ["V [m/s],alpha [deg],de [deg]"]
    for V, alpha, de in _trims(case["Cm_alpha"], case["CL_alpha"])[:-1]:
        a, d = np.array([alpha, de]) / DEG_RAD + rng.normal(0.0, _NOISE, 2)
        lines.append(f"{V:g},{a:.2f},{d:.2f}")
    return Handout(given=_given(case), files={"trims.csv": "\n".join(lines) + "\n"})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return slope, static margin and predicted trim."""
    table = np.array(_trims(case["Cm_alpha"], case["CL_alpha"]))
    slope = float(np.polyfit(table[:-1, 1], table[:-1, 2], 1)[0])
    nominal = load_aircraft("taurus")
    Cm_alpha = case["Cm_alpha"] * nominal.coefficient("Cm_alpha")
    CL_alpha = case["CL_alpha"] * nominal.coefficient("CL_alpha")
    margin = -100.0 * Cm_alpha / CL_alpha
    faster = float(table[-1, 2] / DEG_RAD)
    last = float(table[-2, 2] / DEG_RAD)
    linear = float(np.polyval(np.polyfit(table[:-1, 0], table[:-1, 2], 1), _FASTER) / DEG_RAD)
    return {
        "slope": Answer(
            slope,
            (Mistake(1.0 / slope, "this is dalpha/dde; the answer is dde/dalpha"),),
            "a straight line through de over alpha",
        ),
        "static_margin_percent": Answer(
            margin,
            (
                Mistake(-100.0 * Cm_alpha, "this is -Cm_alpha; the static margin is -dCm/dCL, so divide by CL_alpha"),
                Mistake(
                    -100.0 * slope, "this is the elevator's slope; it still has to be multiplied by Cm_de / CL_alpha"
                ),
                Mistake(-100.0 * slope / CL_alpha, "Cm_de was left out: a weak elevator moves much for a small moment"),
            ),
            "static margin = Cm_de (dde/dalpha) / CL_alpha",
        ),
        "de_faster_deg": Answer(
            faster,
            (
                Mistake(linear, "a straight line over V: alpha, and with it de, is linear in 1 / V²"),
                Mistake(last, "this is the trim at the fastest speed of the table"),
            ),
            "draw de over 1 / V²: it is nearly a straight line",
        ),
        "stable": Answer(
            "up" if slope < 0.0 else "down",
            (
                Mistake("down", "the table shows the elevator going up (more negative) as alpha grows"),
                Mistake("same", "that would be an aircraft of neutral stability"),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Fit straight lines: de over alpha, and de over 1 / V²."""
    from testbench.core.door import checked, read_toml

    table: FloatArray = np.loadtxt(checked(folder / "trims.csv", "table"), delimiter=",", skiprows=1)
    given = read_toml(folder / "given.toml", "answers")
    V, alpha, de = table.T
    slope = float(np.polyfit(alpha, de, 1)[0])
    faster = float(np.polyval(np.polyfit(1.0 / V**2, de, 1), 1.0 / given["faster_m_s"] ** 2))
    margin = 100.0 * given["Cm_de"] * slope / given["CL_alpha"]
    return {"slope": slope, "static_margin_percent": margin, "de_faster_deg": faster, "stable": "up"}


TITLE, LEVEL, MINUTES = "Trim and static margin from flights at seven speeds", 1, 45
QUESTIONS = (
    Number("slope", "1", "Slope of the trim elevator over the angle of attack, dde/dalpha", 0.08),
    Number("static_margin_percent", "%", "Static margin in percent of the mean chord (positive: stable)", 0.12),
    Number("de_faster_deg", "deg", "Trim elevator at the faster speed", 0.0, 0.2),
    Choice(
        "stable",
        "To fly slower, the elevator of this aircraft must go",
        {"up": "trailing edge up (negative)", "down": "trailing edge down (positive)", "same": "nowhere"},
    ),
)
