"""Read the frequency of the short period off a record, and choose the doublet that puts its energy there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.record import load_record
from testbench.estimators.settings import Srivc
from testbench.questions.exercise.exercise import Answer, Case, Handout, Mistake, Number
from testbench.questions.exercise.motion import draw_short_period, measured, short_period_response

PEAK = 2.3311  # w T of the peak of sin^2(w T / 2) / w, where tan(w T / 2) = w T
_DT, _SECONDS, _NOISE = 0.02, 12.0, 0.15 * DEG_RAD
_PULSE = (1.0, 0.2, 4.0 * DEG_RAD)  # start, width, size


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a lightly damped short period between 0.4 and 1 Hz."""
    return draw_short_period(rng, (2.5, 6.0), (0.25, 0.4), (-12.0, -8.0))


def hand_out(case: Case) -> Handout:
    """Return the response to an elevator pulse."""
    n = round(_SECONDS / _DT)
    t = np.arange(n) * _DT
    start, width, size = _PULSE
    de = np.where((t >= start - 1e-9) & (t < start + width - 1e-9), size, 0.0)
    x = short_period_response(case.hidden, de, _DT)
    noise = np.random.default_rng(case.seed).normal(0.0, _NOISE, n)
    return Handout({"pulse": measured({"de_cmd": de, "q": x[:, 1] + noise}, _DT)})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return frequency, step and first zero."""
    wn, zeta = case["omega"], case["zeta"]
    step = PEAK / wn
    rule = (
        "with T = pi / wn the doublet's period is that of the mode, but the peak of its spectrum then lies at 0.74 wn"
    )
    return {
        "omega_n_rad_s": Answer(
            wn,
            (Mistake(wn * np.sqrt(1 - zeta**2), "this is the damped frequency wd = wn sqrt(1 - zeta^2)"),),
            "measure several crossings of zero, after the pulse has ended",
        ),
        "step_s": Answer(
            step,
            (
                Mistake(np.pi / wn, rule),
                Mistake(
                    2.0 * step, "this is the length of the whole doublet; the answer is that of one of its two steps"
                ),
                Mistake(
                    2.0 * np.pi / wn,
                    "this is the period of the mode; a step that long has no energy at the mode at all",
                ),
                Mistake(PEAK / (wn / (2 * np.pi)), "the frequency was in Hz; w T = 2.33 holds for rad/s"),
                Mistake(0.5 * PEAK / wn, "wn T / 2 = 1.17 at the peak: the half was lost"),
            ),
            "the peak lies where tan(w T / 2) = w T",
        ),
        "zero_rad_s": Answer(
            2.0 * np.pi / step,
            (
                Mistake(np.pi / step, "there sin(w T / 2) = 1; the first zero is where w T / 2 = pi"),
                Mistake(4.0 * np.pi / step, "this is the second zero"),
            ),
            "the spectrum is zero where w T / 2 is a multiple of pi",
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Fit two poles to the record by refined instrumental variables; the rest follows."""
    from testbench.estimators import srivc

    record = load_record(folder / "records" / "pulse.nc")
    model = srivc.estimate([record], ["de_cmd"], ["q"], Srivc(poles=(2,), zeros=(1,)))
    wn = float(np.abs(model.poles()["q"]).max())
    step = PEAK / wn
    return {"omega_n_rad_s": wn, "step_s": step, "zero_rad_s": 2.0 * np.pi / step}


TITLE, LEVEL, MINUTES = "Read the spectrum and choose the doublet's length", 1, 30
QUESTIONS = (
    Number("omega_n_rad_s", "rad/s", "Natural frequency of the short period", 0.06),
    Number("step_s", "s", "Length T of one step of the doublet whose spectrum peaks at that frequency", 0.08),
    Number("zero_rad_s", "rad/s", "Lowest frequency above zero at which this doublet has no energy", 0.08),
)
