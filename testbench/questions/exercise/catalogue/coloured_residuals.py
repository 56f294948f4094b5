"""Standard errors that lie: what turbulence does to the Cramer-Rao bound of output error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray, load_record
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import (
    PARAMETERS,
    coloured_errors,
    draw_short_period,
    fitted,
    measured,
    multistep,
    sensitivities,
    short_period_response,
    standard_errors,
    white_error,
)

_DT, _SECONDS, _FLIGHTS = 0.04, 14.0, 8
_NOISE = (0.25 * DEG_RAD, 0.5 * DEG_RAD)  # alpha, q


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a short period and the correlation time of what turbulence adds."""
    drawn = draw_short_period(rng, (2.5, 4.5), (0.4, 0.6), (-10.0, -6.0))
    return drawn | {"correlation": float(math.exp(-_DT / rng.uniform(0.15, 0.45)))}


def _input() -> FloatArray:
    return multistep(round(_SECONDS / _DT), _DT, 1.0, 0.5, 3.0 * DEG_RAD)


def hand_out(case: Case) -> Handout:
    """Return eight flights of the same 3-2-1-1."""
    u, rng, c = _input(), np.random.default_rng(case.seed), case["correlation"]
    x = short_period_response(case.hidden, u, _DT)
    records = {}
    for k in range(_FLIGHTS):
        white = rng.normal(size=(len(u) + 200, 2)) * math.sqrt(1.0 - c**2)
        y = x + lfilter([1.0], [1.0, -c], white, axis=0)[200:] * np.array(_NOISE)
        records[f"flight_{k + 1}"] = measured({"de_cmd": u, "alpha": y[:, 0], "q": y[:, 1]}, _DT)
    return Handout(records)


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the standard error of M_alpha by the white-noise formula, and by how much it is too small."""
    J = sensitivities(case.hidden, _input(), _DT, ("alpha", "q"))
    said = standard_errors(J, _NOISE)["M_alpha"]
    real = coloured_errors(J, _NOISE, case["correlation"])["M_alpha"]
    factor = real / said
    return {
        "autocorrelation": Answer(
            case["correlation"],
            (Mistake(1.0 - case["correlation"], "this is one minus it"),),
            "r[1] = sum of v[i] v[i + 1] over the sum of v[i]², for each output",
        ),
        "std_said_1_s2": Answer(
            said,
            (
                Mistake(real, "this is the true scatter; the answer is the formula for white noise, for one flight"),
                Mistake(said / math.sqrt(_FLIGHTS), "this is for all flights together; the answer is for one flight"),
            ),
            "the root of the diagonal of M^-1 with the variance of the residuals, as if they were white",
        ),
        "inflation": Answer(
            factor,
            (
                Mistake(1.0, "this is the formula for white residuals: these are not white"),
                Mistake(factor**2, "this is the ratio of variances; the answer is that of standard errors"),
                Mistake(1.0 / factor, "the other way round: the true error is the larger one"),
                Mistake(
                    factor / math.sqrt(_FLIGHTS), "the mean over the flights scatters less, a single flight does not"
                ),
            ),
            "scatter of the estimates over the flights, or the corrected formula",
        ),
        "cure": Answer(
            "repeat",
            (
                Mistake(
                    "faster",
                    (
                        "more samples of the same slow disturbance: the formula gives a smaller error, the true one "
                        "is unchanged"
                    ),
                ),
                Mistake("smooth", "smoothing colours the residuals further: the formula is then more wrong"),
                Mistake("order", "the model of the motion is right; the residual is turbulence, not dynamics"),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Estimate from each flight by output error, with plain and corrected standard errors."""
    from testbench.estimators.residuals import autocovariance

    records = [load_record(folder / "records" / f"flight_{k + 1}.nc") for k in range(_FLIGHTS)]
    said, inflation, correlation = [], [], []
    joint = fitted(records)
    for record in records:
        white, factor = white_error(fitted([record], start={n: joint.values[n] for n in PARAMETERS}), "M_alpha")
        inflation.append(factor)
        said.append(white)
        v = record.columns(("alpha", "q")) - joint.simulate(record)
        R = autocovariance(v, 1)
        correlation += (np.diag(R[1]) / np.diag(R[0])).tolist()
    return {
        "autocorrelation": float(np.mean(correlation)),
        "std_said_1_s2": float(np.mean(said)),
        "inflation": float(np.mean(inflation)),
        "cure": "repeat",
    }


TITLE, LEVEL, MINUTES = "Wrong standard errors: coloured residuals", 2, 75
QUESTIONS = (
    Number("autocorrelation", "1", "Autocorrelation of the residuals from one sample to the next", 0.0, 0.05),
    Number(
        "std_said_1_s2", "1/s2", "Standard error of M_alpha of one flight that the formula for white noise gives", 0.2
    ),
    Number("inflation", "1", "Factor by which the true standard error of one flight is larger", 0.3),
    Choice(
        "cure",
        "What reduces the true error?",
        {
            "repeat": "flying the manoeuvre again",
            "faster": "sampling faster",
            "smooth": "smoothing the outputs before the fit",
            "order": "a model of higher order",
        },
    ),
)
