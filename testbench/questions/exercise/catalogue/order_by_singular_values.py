"""How many modes are there? The order of a state-space model from the singular values of a subspace method."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.record import load_record
from testbench.estimators.settings import Subspace
from testbench.questions.exercise.answers import description
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import measured, respond

_DT, _SECONDS, _NOISE, _HORIZON = 0.02, 40.0, 0.1, 30
_OUTPUTS = ("q", "strain_wing_1", "strain_wing_2")

_ESTIMATOR = {"method": "moesp", "order": 2, "past_horizon": _HORIZON, "future_horizon": _HORIZON, "decimate": 1}


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw two to four modes, well apart, and the share of each mode in each output."""
    count = int(rng.integers(2, 5))
    f = [float(rng.uniform(0.7, 1.1))]
    for _ in range(count - 1):
        f.append(float(f[-1] * rng.uniform(1.7, 2.1)))
    zeta = [float(rng.uniform(0.2, 0.35)), *(float(z) for z in rng.uniform(0.02, 0.05, count - 1))]
    shape = rng.uniform(0.5, 1.0, (len(_OUTPUTS), count)) * rng.choice([-1.0, 1.0], (len(_OUTPUTS), count))
    return {"f_hz": f, "zeta": zeta, "shape": shape.tolist()}


def hand_out(case: Case) -> Handout:
    """Return the response to binary noise on the elevator."""
    rng = np.random.default_rng(case.seed)
    w, zeta = 2.0 * np.pi * np.array(case["f_hz"]), np.array(case["zeta"])
    n, k = round(_SECONDS / _DT), w.size
    u = 2.0 * DEG_RAD * np.repeat(rng.choice([-1.0, 1.0], n // 3 + 1), 3)[:n]
    A = np.block([[np.zeros((k, k)), np.eye(k)], [-np.diag(w**2), -np.diag(2.0 * zeta * w)]])
    B = np.concatenate([np.zeros(k), np.ones(k)])[:, None]
    x = respond(A, B, u[:, None], _DT)
    x /= x.std(axis=0)
    shape = np.array(case["shape"])
    y = np.column_stack(
        [x[:, k:] @ shape[0], x[:, :k] @ shape[1:].T]
    )  # a gyro feels rates, strain gauges displacements
    y += _NOISE * rng.normal(size=y.shape)
    size = np.array([2.0 * DEG_RAD, 1e-4, 1e-4])
    record = measured({"de_cmd": u, **dict(zip(_OUTPUTS, (y * size).T, strict=True))}, _DT)
    asked = {"inputs": ["de_cmd"], "outputs": _OUTPUTS, "estimators": [_ESTIMATOR]}
    text = description(TITLE, ["binary_noise"], record.channels, asked)
    return Handout({"binary_noise": record}, files={"order_by_singular_values.toml": text})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the order and the modes at both ends."""
    f, zeta = case["f_hz"], case["zeta"]
    least = int(np.argmin(zeta))
    return {
        "order": Answer(
            2 * len(f),
            (
                Mistake(len(f), "this is the number of modes; each oscillating mode has two states"),
                Mistake(2 * len(f) - 2, "one mode too few: look at the singular values on a logarithmic scale"),
                Mistake(2 * len(f) + 2, "a pair too many: those singular values lie on the plateau of the noise"),
                Mistake(2 * len(f) - 1, "odd: half a mode is missing; the values of a mode come in pairs"),
                Mistake(
                    2 * len(f) + 1,
                    "odd: one value of the noise is taken for a state; the values of a mode come in pairs",
                ),
            ),
            "count the singular values above the plateau that the noise makes",
        ),
        "slowest_hz": Answer(
            f[0], (Mistake(f[1], "this is the second one"),), "|s| / 2 pi of the pole nearest to zero"
        ),
        "fastest_hz": Answer(
            f[-1], (Mistake(f[-2], "this is the last but one: the order is too low"),), "|s| / 2 pi of the fastest pole"
        ),
        "least_damping": Answer(
            zeta[least],
            (Mistake(zeta[least] * 2 * np.pi * f[least], "this is -Re(s) in 1/s; the damping ratio is that over |s|"),),
            "-Re(s) / |s|",
        ),
        "spurious": Answer(
            "moves",
            (
                Mistake("damped", "spurious poles are often lightly damped, and true ones may be well damped"),
                Mistake("fit", "the fit to the data it was identified from never gets worse with more states"),
                Mistake(
                    "fast", "spurious poles turn up anywhere, most often near what the noise or the input suggests"
                ),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Identify by MOESP, which finds the plateau of its singular values, with that order."""
    from testbench.estimators.subspace import family

    record = load_record(folder / "records" / "binary_noise.nc")
    settings = Subspace(method="moesp", decimate=1, past_horizon=_HORIZON, future_horizon=_HORIZON)
    model = family.estimate([record], ["de_cmd"], _OUTPUTS, settings)
    s = np.concatenate(list(model.poles().values()))
    s = s[s.imag > 0.0]
    zeta = -s.real / np.abs(s)
    return {
        "order": float(model.order),
        "slowest_hz": float(np.abs(s).min() / (2.0 * np.pi)),
        "fastest_hz": float(np.abs(s).max() / (2.0 * np.pi)),
        "least_damping": float(zeta.min()),
        "spurious": "moves",
    }


TITLE, LEVEL, MINUTES = "How many modes? The order by singular values", 2, 60
QUESTIONS = (
    Number("order", "states", "Order of the model", 0.0, 0.25),
    Number("slowest_hz", "Hz", "Natural frequency of the slowest mode", 0.05),
    Number("fastest_hz", "Hz", "Natural frequency of the fastest mode", 0.03),
    Number("least_damping", "1", "Smallest damping ratio of all modes", 0.15),
    Choice(
        "spurious",
        "Two states too many give a pair of spurious poles. How is it recognised?",
        {
            "moves": "it moves when horizons or order change, or when another part of the record is used",
            "damped": "it is well damped",
            "fit": "the fit to the record gets worse",
            "fast": "it is faster than all true modes",
        },
    ),
)
