"""How accurate one record is, and how many flights, or how much more elevator, would make it accurate enough."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray, load_record
from testbench.questions.exercise.exercise import Answer, Case, Handout, Mistake, Number
from testbench.questions.exercise.motion import (
    doublet,
    draw_short_period,
    fitted,
    measured,
    sensitivities,
    short_period_response,
    standard_errors,
    white_error,
)

_DT, _SECONDS, _WANTED = 0.02, 12.0, 0.5  # s; s; percent
_NOISE = (0.1 * DEG_RAD, 0.2 * DEG_RAD)  # alpha, q


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a short period, and an amplitude."""
    drawn = draw_short_period(rng, (2.5, 5.0), (0.4, 0.6), (-10.0, -6.0))
    return drawn | {"amplitude_rad": float(rng.uniform(1.2, 2.4) * DEG_RAD)}


def _input(case: Case) -> FloatArray:
    return doublet(round(_SECONDS / _DT), _DT, 1.0, 0.6, case["amplitude_rad"])


def hand_out(case: Case) -> Handout:
    """Return one doublet."""
    u = _input(case)
    x = short_period_response(case.hidden, u, _DT)
    y = x + np.random.default_rng(case.seed).normal(size=x.shape) * np.array(_NOISE)
    return Handout(
        {"doublet": measured({"de_cmd": u, "alpha": y[:, 0], "q": y[:, 1]}, _DT)}, {"wanted_percent": _WANTED}
    )


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the standard error of M_alpha of one record, and what follows from it."""
    J = sensitivities(case.hidden, _input(case), _DT, ("alpha", "q"))
    absolute = standard_errors(J, _NOISE)["M_alpha"]
    percent = 100.0 * absolute / abs(case["M_alpha"])
    ratio = percent / _WANTED
    alone = 100.0 / math.sqrt(float(np.sum((J[:, :, 1] / np.array(_NOISE)) ** 2))) / abs(case["M_alpha"])
    return {
        "std_percent": Answer(
            percent,
            (
                Mistake(absolute, "this is the standard error in 1/s²; divide it by the size of M_alpha"),
                Mistake(
                    alone,
                    ("this assumes that the other parameters are known: invert the whole matrix, not its diagonal"),
                ),
                Mistake(percent**2 / 100.0, "this is a variance; the standard error is its root"),
            ),
            "the root of the diagonal of the inverse of the information matrix, over M_alpha",
        ),
        "repeats": Answer(
            math.ceil(ratio**2),
            (
                Mistake(math.ceil(ratio), "errors fall with the root of the number of flights: square the ratio"),
                Mistake(math.ceil(math.sqrt(ratio)), "the root goes the other way: square the ratio"),
            ),
            "N records hold N times the information",
        ),
        "amplitude_factor": Answer(
            ratio,
            (
                Mistake(
                    ratio**2,
                    "information grows with the square of the amplitude, errors fall with the amplitude itself",
                ),
                Mistake(math.sqrt(ratio), "errors fall with the amplitude itself, not with its root"),
                Mistake(1.0 / ratio, "the other way round: more accuracy needs more amplitude"),
            ),
            "twice the amplitude, half the error",
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Estimate by output error; the plain Cramer-Rao bound belongs to the white noise of this record."""
    model = fitted([load_record(folder / "records" / "doublet.nc")])
    percent = 100.0 * white_error(model, "M_alpha")[0] / abs(model.values["M_alpha"])
    ratio = percent / _WANTED
    return {"std_percent": percent, "repeats": float(math.ceil(ratio**2)), "amplitude_factor": ratio}


TITLE, LEVEL, MINUTES = "How many repeats: what one record is worth", 2, 60
QUESTIONS = (
    Number("std_percent", "%", "Standard error of M_alpha from this one record, in percent of M_alpha", 0.15),
    Number("repeats", "flights", "Flights like this one that bring it to the wanted standard error", 0.35, 1.0),
    Number("amplitude_factor", "1", "Or: factor on the amplitude that does it in one flight", 0.15),
)
