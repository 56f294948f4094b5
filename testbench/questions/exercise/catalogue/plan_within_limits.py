"""A plan that would have broken a limit: which one, and how large the input may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.door import read_toml
from testbench.core.record import FloatArray
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import PARAMETERS, doublet, draw_short_period, measured, short_period_response

_DT, _SECONDS, _START_S = 0.01, 12.0, 1.0
_V_M_S = 25.0
_LIMITS = ("n_max", "n_min", "alpha_max_deg")


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw aircraft, trim, limits and a planned doublet that breaks one of the limits, and only one."""
    while True:
        drawn = draw_short_period(rng, (3.5, 5.5), (0.3, 0.5), (-30.0, -20.0))
        believed = {name: round(drawn[name], 3) for name in PARAMETERS}
        plan = {
            "amplitude_deg": round(float(rng.uniform(3.0, 6.0)), 2),
            "step_s": round(float(rng.uniform(0.35, 0.6)), 2),
            "alpha_trim_deg": round(float(rng.uniform(2.0, 4.5)), 2),
            "n_max": round(float(rng.uniform(2.5, 3.8)), 2),
            "n_min": round(float(rng.uniform(-1.5, -0.5)), 2),
            "alpha_max_deg": round(float(rng.uniform(9.0, 12.0)), 1),
            "margin_percent": 20.0,
        }
        ratios = used(believed, plan)
        over = [name for name, ratio in ratios.items() if ratio > 1.05]
        if len(over) == 1 and sorted(ratios.values())[-2] < 0.95:
            return {"believed": believed, "plan": plan}


def motion(believed: Mapping[str, float], plan: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return the deviations of alpha, rad, and of the load factor (each (n,)) that the planned doublet gives.

    The load factor of the short period is n = 1 - V Z_alpha alpha / g, lift on the elevator left out.
    """
    n = round(_SECONDS / _DT)
    u = doublet(n, _DT, _START_S, plan["step_s"], plan["amplitude_deg"] * DEG_RAD)
    alpha = short_period_response(believed, u, _DT)[:, 0]
    return alpha, -_V_M_S * believed["Z_alpha"] * alpha / G0_M_S2


def used(believed: Mapping[str, float], plan: Mapping[str, float]) -> dict[str, float]:
    """Return for every limit the share of the room between trim and limit that the planned doublet takes."""
    alpha, n = motion(believed, plan)
    return {
        "n_max": float(n.max()) / (plan["n_max"] - 1.0),
        "n_min": float(-n.min()) / (1.0 - plan["n_min"]),
        "alpha_max_deg": float(alpha.max()) / ((plan["alpha_max_deg"] - plan["alpha_trim_deg"]) * DEG_RAD),
    }


def hand_out(case: Case) -> Handout:
    """Return the believed aircraft and the plan, and a record of a small doublet flown before."""
    believed, plan = case["believed"], case["plan"]
    small = {**plan, "amplitude_deg": 1.0}
    alpha, n = motion(believed, small)
    rng = np.random.default_rng(case.seed)
    u = doublet(len(alpha), _DT, _START_S, plan["step_s"], DEG_RAD)
    columns = {
        "de_cmd": u,
        "alpha": plan["alpha_trim_deg"] * DEG_RAD + alpha + rng.normal(size=len(u)) * 0.1 * DEG_RAD,
        "az": -G0_M_S2 * (1.0 + n) + rng.normal(size=len(u)) * 0.15,
    }
    return Handout({"small_doublet": measured(columns, _DT)}, {**believed, **plan, "V_m_s": _V_M_S})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the peaks of the planned doublet, the limit that it breaks, and the largest one that keeps a margin."""
    believed, plan = case["believed"], case["plan"]
    alpha, n = motion(believed, plan)
    ratios = used(believed, plan)
    worst = max(ratios, key=lambda name: ratios[name])
    room = 1.0 - plan["margin_percent"] / 100.0
    largest = plan["amplitude_deg"] * room / ratios[worst]
    return {
        "n_peak": Answer(
            1.0 + float(n.max()),
            (Mistake(float(n.max()), "this is the change: one g of level flight belongs to it"),),
            "the largest 1 - V Z_alpha alpha / g, alpha counted from trim, in rad",
        ),
        "alpha_peak_deg": Answer(
            plan["alpha_trim_deg"] + math.degrees(float(alpha.max())),
            (Mistake(math.degrees(float(alpha.max())), "counted from trim; the limit is one of alpha itself"),),
            "trim and the largest deviation",
        ),
        "broken": Answer(
            worst,
            tuple(
                Mistake(name, "there is room left: compare the way from trim to the limit with the way flown")
                for name in _LIMITS
                if name != worst
            ),
        ),
        "largest_deg": Answer(
            largest,
            (
                Mistake(largest / room, "that reaches the limit: the margin is missing"),
                Mistake(
                    plan["amplitude_deg"] * room,
                    "the planned one less the margin still breaks the limit: scale by the share that it takes first",
                ),
            ),
            "the motion is linear: scale the amplitude until 80 % of the way from trim to the limit is taken",
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Compute the motion of the planned doublet from what is given."""
    given = {name: float(value) for name, value in read_toml(folder / "given.toml", "answers").items()}
    alpha, n = motion(given, given)
    ratios = used(given, given)
    worst = max(ratios, key=lambda name: ratios[name])
    return {
        "n_peak": 1.0 + float(n.max()),
        "alpha_peak_deg": given["alpha_trim_deg"] + math.degrees(float(alpha.max())),
        "broken": worst,
        "largest_deg": given["amplitude_deg"] * (1.0 - given["margin_percent"] / 100.0) / ratios[worst],
    }


TITLE, LEVEL, MINUTES = "A plan that would have broken a limit", 1, 45
QUESTIONS = (
    Number("n_peak", "1", "Largest load factor of the planned doublet", 0.03),
    Number("alpha_peak_deg", "deg", "Its largest angle of attack", 0.03),
    Choice(
        "broken",
        "Which limit does the planned doublet break?",
        {
            "n_max": "the largest load factor",
            "n_min": "the least load factor",
            "alpha_max_deg": "the largest angle of attack",
        },
    ),
    Number("largest_deg", "deg", "The largest amplitude of that doublet that keeps the margin", 0.03),
)
