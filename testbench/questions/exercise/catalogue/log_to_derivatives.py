"""From a log in units of its own, with a servo between command and surface, to derivatives."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.optimize import least_squares

from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.door import checked
from testbench.core.record import FloatArray
from testbench.questions.exercise.exercise import Answer, Case, Handout, Mistake, Number
from testbench.questions.exercise.motion import draw_short_period, multistep, short_period_response

LOG = "flight_log.csv"
_RATES = (40.0, 50.0, 80.0, 100.0)  # Hz
_SECONDS, _V_M_S = 16.0, 20.0
_NOISE = (0.08 * DEG_RAD, 0.15 * DEG_RAD)  # alpha, q
_TRIM_ALPHA, _TRIM_DE = 4.0 * DEG_RAD, -2.5 * DEG_RAD
_HEADS = ("Time (us)", "Airspeed [ft/s]", "AOA [deg]", "Pitch rate [deg/s]", "Elevator command [deg]")
_FITTED = ("Z_alpha", "M_alpha", "M_q", "M_de", "tau")


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a short period, the lag of the elevator's servo and the rate of the log."""
    drawn = draw_short_period(rng, (4.0, 6.0), (0.45, 0.65), (-40.0, -25.0))
    drawn |= {"tau": float(rng.uniform(0.06, 0.12)), "rate_hz": _RATES[int(rng.integers(len(_RATES)))]}
    return drawn


def hand_out(case: Case) -> Handout:
    """Return the log as text: microseconds, feet and degrees, absolute values."""
    dt, rng = 1.0 / case["rate_hz"], np.random.default_rng(case.seed)
    n = round(_SECONDS / dt)
    u = multistep(n, dt, 1.5, 0.3, 2.0 * DEG_RAD) + multistep(n, dt, 8.0, 0.2, 3.0 * DEG_RAD, "2112")
    y = short_period_response(case.hidden, u, dt, case["tau"]) + rng.normal(size=(n, 2)) * np.array(_NOISE)
    speed = (_V_M_S + rng.normal(size=n) * 0.1) / FT_M
    columns = (
        np.round(4.21e8 + np.arange(n) * dt * 1e6).astype(int).tolist(),
        [f"{v:.2f}" for v in speed],
        [f"{v:.4f}" for v in (_TRIM_ALPHA + y[:, 0]) / DEG_RAD],
        [f"{v:.4f}" for v in y[:, 1] / DEG_RAD],
        [f"{v:.3f}" for v in (_TRIM_DE + u) / DEG_RAD],
    )
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([_HEADS, *zip(*columns, strict=True)])
    return Handout(files={LOG: out.getvalue()})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the rate of the log, and what it tells of aircraft and servo."""
    tau, M_de, M_q = case["tau"], case["M_de"], case["M_q"]
    return {
        "rate_hz": Answer(case["rate_hz"], (), "the times are in microseconds: a million over their step"),
        "servo_ms": Answer(
            1000.0 * tau,
            (Mistake(tau, "this is in seconds; the answer is in milliseconds"),),
            "let the surface follow the command by a first-order lag, and estimate its time constant as well",
        ),
        "M_alpha_1_s2": Answer(case["M_alpha"], (), "fit alpha and q, with the servo between command and surface"),
        "M_q_1_s": Answer(M_q, (), "a servo that is left out looks like less damping"),
        "M_de_1_s2": Answer(M_de, (), "a servo that is left out looks like a weak elevator"),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Read the log, take trim off, and fit aircraft and servo by output error."""
    table = np.loadtxt(checked(folder / LOG, "table"), delimiter=",", skiprows=1)
    dt = float(np.median(np.diff(table[:, 0]))) * 1e-6
    steady = table[:, 0] < table[0, 0] + 1.4e6
    alpha, q, u = ((table[:, k] - table[steady, k].mean()) * DEG_RAD for k in (2, 3, 4))
    measured = np.column_stack([alpha, q])

    def residual(x: FloatArray) -> FloatArray:
        model = dict(zip(_FITTED, (-x[0], -x[1], -x[2], -x[3], x[4]), strict=True))
        return np.asarray(((short_period_response(model, u, dt, x[4]) - measured) / np.array(_NOISE)).ravel())

    x = least_squares(residual, [3.0, 20.0, 3.0, 30.0, 0.05], bounds=(1e-3, 1e3), x_scale=[3.0, 20.0, 3.0, 30.0, 0.1]).x
    found: dict[str, float | str] = {"rate_hz": 1.0 / dt, "servo_ms": 1000.0 * float(x[4])}
    return found | {"M_alpha_1_s2": -float(x[1]), "M_q_1_s": -float(x[2]), "M_de_1_s2": -float(x[3])}


TITLE, LEVEL, MINUTES = "A log from import to derivatives", 2, 60
QUESTIONS = (
    Number("rate_hz", "Hz", "Rate of the log", 0.01),
    Number("servo_ms", "ms", "Time constant of the elevator's servo", 0.15),
    Number("M_alpha_1_s2", "1/s2", "M_alpha", 0.08),
    Number("M_q_1_s", "1/s", "M_q", 0.15),
    Number("M_de_1_s2", "1/s2", "M_de", 0.08),
)
