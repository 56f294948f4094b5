"""The standard error of a derivative with and without an angle-of-attack vane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray, load_record
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import (
    draw_short_period,
    fitted,
    measured,
    multistep,
    sensitivities,
    short_period_response,
    standard_errors,
    white_error,
)

_DT, _SECONDS = 0.02, 15.0
_NOISE_Q = 0.2 * DEG_RAD


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a well damped short period and the noise of the vane, until the vane is worth at least two flights."""
    while True:
        drawn = draw_short_period(rng, (2.5, 4.5), (0.5, 0.75), (-10.0, -6.0))
        drawn |= {"noise_alpha_rad": float(rng.uniform(0.08, 0.25) * DEG_RAD)}
        without, with_vane = _bounds(drawn)
        if without**2 > 2.0 * with_vane**2:
            return drawn


def _bounds(d: Mapping[str, float]) -> tuple[float, float]:
    """Return the standard error of Z_alpha without and with the vane."""
    u = _input()
    without = standard_errors(sensitivities(d, u, _DT, ("q",)), (_NOISE_Q,))
    with_vane = standard_errors(sensitivities(d, u, _DT, ("alpha", "q")), (d["noise_alpha_rad"], _NOISE_Q))
    return without["Z_alpha"], with_vane["Z_alpha"]


def _input() -> FloatArray:
    return multistep(round(_SECONDS / _DT), _DT, 1.0, 0.4, 3.0 * DEG_RAD)


def hand_out(case: Case) -> Handout:
    """Return one 3-2-1-1 with a vane on board."""
    u = _input()
    x = short_period_response(case.hidden, u, _DT)
    y = x + np.random.default_rng(case.seed).normal(size=x.shape) * np.array([case["noise_alpha_rad"], _NOISE_Q])
    return Handout({"3211": measured({"de_cmd": u, "alpha": y[:, 0], "q": y[:, 1]}, _DT)})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return both standard errors of Z_alpha, and the number of flights that the vane saves."""
    without, with_vane = _bounds(case.hidden)
    ratio = without / with_vane
    percent = 100.0 / abs(case["Z_alpha"])
    return {
        "std_without_1_s": Answer(
            without,
            (
                Mistake(with_vane, "this is the one with the vane: leave alpha out of the outputs"),
                Mistake(without * percent, "this is in percent of Z_alpha; the answer is in 1/s"),
            ),
            "outputs: q alone, all four derivatives free",
        ),
        "std_with_1_s": Answer(
            with_vane,
            (
                Mistake(without, "this is the one without the vane: both alpha and q are outputs"),
                Mistake(with_vane * percent, "this is in percent of Z_alpha; the answer is in 1/s"),
            ),
            "outputs: alpha and q, all four derivatives free",
        ),
        "flights_saved_for": Answer(
            ratio**2,
            (
                Mistake(ratio, "errors fall with the root of the number of flights: square the ratio"),
                Mistake(1.0 / ratio**2, "the other way round: without the vane more flights are needed"),
            ),
            "the square of the ratio of the standard errors",
        ),
        "why": Answer(
            "zero",
            (
                Mistake("noise", "the gyro is the better of the two instruments; the information is still missing"),
                Mistake(
                    "poles",
                    "the poles give Z_alpha + M_q and Z_alpha M_q - M_alpha, and q alone shows both of them well",
                ),
                Mistake(
                    "gain", ("the gain from de to q determines M_de from the first moment on, with or without a vane")
                ),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Estimate twice by output error, with q alone and with alpha and q."""
    record = load_record(folder / "records" / "3211.nc")
    without, with_vane = (white_error(fitted([record], seen), "Z_alpha")[0] for seen in (["q"], ["alpha", "q"]))
    return {
        "std_without_1_s": without,
        "std_with_1_s": with_vane,
        "flights_saved_for": math.pow(without / with_vane, 2),
        "why": "zero",
    }


TITLE, LEVEL, MINUTES = "The gain from alpha: a derivative with and without a vane", 2, 60
QUESTIONS = (
    Number("std_without_1_s", "1/s", "Standard error of Z_alpha from q alone", 0.2),
    Number("std_with_1_s", "1/s", "Standard error of Z_alpha from alpha and q", 0.2),
    Number("flights_saved_for", "flights", "Flights without a vane that are worth one flight with it", 0.35),
    Choice(
        "why",
        "Why does q alone determine Z_alpha so poorly?",
        {
            "zero": "only the zero of the transfer function from de to q, -Z_alpha, distinguishes it from M_q",
            "poles": "q alone does not show the poles of the short period",
            "gain": "q alone does not show the gain M_de",
            "noise": "the gyro is noisier than the vane",
        },
    ),
)
