"""Why DSR_e fails with a future of four samples: the horizon must span enough of the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, load_record
from testbench.estimators.settings import DsrE
from testbench.questions.exercise.answers import description
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import doublet, draw_short_period, measured, multistep, short_period_response

_SECONDS, _NOISE, _SHORT, _PAST_S, _FUTURE_S = 25.0, 0.8 * DEG_RAD, 4, 0.8, 0.5


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a short period and the rate of the log."""
    drawn = draw_short_period(rng, (2.2, 3.5), (0.35, 0.5), (-9.0, -7.0))
    return drawn | {"rate_hz": float(rng.choice([80.0, 100.0, 125.0]))}


def _records(case: Case) -> dict[str, FlightRecord]:
    rng, dt = np.random.default_rng(case.seed), 1.0 / case["rate_hz"]
    n = round(_SECONDS / dt)
    inputs = {"3211": multistep(n, dt, 1.0, 0.35, 4.0 * DEG_RAD), "doublet": doublet(n, dt, 1.0, 0.7, 4.0 * DEG_RAD)}
    out = {}
    for name, u in inputs.items():
        q = short_period_response(case.hidden, u, dt)[:, 1]
        out[name] = measured({"de_cmd": u, "q": q + rng.normal(0.0, _NOISE, n)}, dt)
    return out


def hand_out(case: Case) -> Handout:
    """Return a 3-2-1-1 with a noisy gyro, and a doublet to judge by."""
    past = round(_PAST_S * case["rate_hz"])
    estimators = [
        {"method": "dsr_e", "label": f"L = {L}", "order": 2, "past_horizon": past, "future_horizon": L}
        for L in (_SHORT, 2 * _SHORT)
    ]
    asked = {"inputs": ["de_cmd"], "outputs": ["q"], "estimators": estimators}
    text = description(TITLE, ["3211"], ["de_cmd", "q"], asked, held_out=["doublet"])
    given = {"rate_hz": case["rate_hz"], "short_horizon": float(_SHORT)}
    return Handout(_records(case), given, {"dsr_horizon.toml": text})


def estimate(record: FlightRecord, future_horizon: int, past_horizon: int) -> tuple[float, float] | None:
    """Return natural frequency and damping ratio that DSR_e of order 2 finds; None if it finds no oscillation."""
    from testbench.estimators.subspace import dsr_e

    try:
        model = dsr_e.estimate(
            [record], ["de_cmd"], ["q"], DsrE(past_horizon=past_horizon, future_horizon=future_horizon, order=2)
        )
    except EstimationError:
        return None
    poles = [s for s in next(iter(model.poles().values())) if s.imag > 0.0]
    return (float(abs(poles[0])), float(-poles[0].real / abs(poles[0]))) if poles else None


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the short period, what four samples span of it, and the horizon that spans a quarter of a period."""
    wn, zeta, rate = case["omega"], case["zeta"], case["rate_hz"]
    failed = estimate(_records(case)["3211"], _SHORT, round(_PAST_S * rate))
    of_short = "this is the result of a future of four samples"
    frequency = [Mistake(wn * math.sqrt(1.0 - zeta**2), "this is the damped frequency, the imaginary part of the pole")]
    damping = [Mistake(zeta * wn, "this is zeta wn, minus the real part of the pole; divide it by wn")]
    if failed is not None:
        frequency.append(Mistake(failed[0], of_short))
        damping.append(Mistake(failed[1], of_short))
    turn = math.degrees(wn * _SHORT / rate)
    quarter = 0.5 * math.pi / wn * rate
    return {
        "omega_n_rad_s": Answer(wn, tuple(frequency), "lengthen the future until the poles no longer change"),
        "zeta": Answer(zeta, tuple(damping), "lengthen the future until the poles no longer change"),
        "turn_deg": Answer(
            turn,
            (
                Mistake(math.radians(turn), "this is in radians"),
                Mistake(360.0 * wn * _SHORT / rate, "wn is in rad/s, not in Hz: no 360 but 180 / pi"),
                Mistake(
                    turn * 3.0 / 4.0, "this is the way from the first to the last of four samples; four steps are meant"
                ),
            ),
            "wn times the time that the horizon spans, in degrees",
        ),
        "quarter_period_samples": Answer(
            quarter,
            (
                Mistake(4.0 * quarter, "this is a whole period"),
                Mistake(rate / (4.0 * wn), "wn is in rad/s: a quarter of a period is pi / (2 wn)"),
            ),
            "pi / (2 wn) seconds, times the rate",
        ),
        "cause": Answer(
            "horizon",
            (
                Mistake("order", "the motion has two states, and the longer horizon finds both with the same order"),
                Mistake("noise", "the longer horizon has the same noise and succeeds; noise alone is not the cause"),
                Mistake("input", "the longer horizon finds the mode in the same record, so the input excites it"),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Identify by DSR_e with a future of half a second."""
    record = load_record(folder / "records" / "3211.nc")
    rate = 1.0 / record.dt_s
    found = estimate(record, round(_FUTURE_S * rate), round(_PAST_S * rate))
    if found is None:
        raise EstimationError("DSR_e must find an oscillation with a future of half a second, got none")
    wn, zeta = found
    return {
        "omega_n_rad_s": wn,
        "zeta": zeta,
        "turn_deg": math.degrees(wn * _SHORT / rate),
        "quarter_period_samples": 0.5 * math.pi / wn * rate,
        "cause": "horizon",
    }


TITLE, LEVEL, MINUTES = "Why does DSR_e fail with L = 4?", 3, 75
QUESTIONS = (
    Number("omega_n_rad_s", "rad/s", "Natural frequency of the short period, with a sufficient horizon", 0.1),
    Number("zeta", "1", "Its damping ratio", 0.1, 0.06),
    Number("turn_deg", "deg", "Angle wn L dt by which the mode turns during a future of 4 samples", 0.12),
    Number("quarter_period_samples", "samples", "Future horizon that spans a quarter of the mode's period", 0.12),
    Choice(
        "cause",
        "Why does DSR_e fail with L = 4?",
        {
            "horizon": "the future spans so little of the motion that its rows differ almost only by noise",
            "order": "the order is too low",
            "noise": "the sensor is too noisy for any subspace method",
            "input": "the input does not excite the mode",
        },
    ),
)
