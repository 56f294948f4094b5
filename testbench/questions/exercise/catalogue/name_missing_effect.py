"""A believed model and a flight that disagree: name the one effect that the model lacks, and its size."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.door import read_toml
from testbench.core.record import FloatArray, load_record
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import doublet, draw_short_period, measured, multistep, short_period_response

_DT, _SECONDS = 0.01, 14.0
_NOISE = (0.1 * DEG_RAD, 0.2 * DEG_RAD)  # alpha, q
_MS = 1000.0
# Sizes that may be drawn; factors may be as much below 1 as above.
_SIZES = {
    "servo_lag": (0.06, 0.14),
    "delay": (0.05, 0.12),
    "elevator_gain": (1.15, 1.35),
    "vane_gain": (1.12, 1.25),
    "stability": (1.15, 1.3),
    "damping": (1.3, 1.6),
}
_TIMES = ("servo_lag", "delay")
_OPTIONS = {
    "servo_lag": "the elevator servo lags (first order; size: time constant in s)",
    "delay": "the elevator responds late (pure delay; size: s)",
    "elevator_gain": "the elevator is stronger or weaker (size: factor on M_de)",
    "vane_gain": "the alpha vane reads too much or too little (size: factor on alpha as read)",
    "stability": "the centre of gravity lies elsewhere (size: factor on M_alpha)",
    "damping": "the tail damps more or less (size: factor on M_q)",
}


def predict(d: Mapping[str, float], u: FloatArray, effect: str = "", size: float = 1.0) -> FloatArray:
    """Return alpha and q (n, 2) that the model ``d`` with one effect answers to the command ``u``."""
    scaled = {"elevator_gain": "M_de", "stability": "M_alpha", "damping": "M_q"}.get(effect)
    if effect == "delay":
        u = np.concatenate([np.zeros(round(size / _DT)), u])[: len(u)]
    flown = {**d, scaled: d[scaled] * size} if scaled else d
    y = short_period_response(flown, u, _DT, size if effect == "servo_lag" else 0.0)
    return y * np.array([size, 1.0]) if effect == "vane_gain" else y


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw the believed aircraft, which the student knows, and the effect that it lacks, which is hidden."""
    drawn = draw_short_period(rng, (3.0, 5.0), (0.35, 0.5), (-10.0, -7.0))
    believed = {name: round(drawn[name], 3) for name in ("Z_alpha", "M_alpha", "M_q", "M_de")}
    effect = list(_SIZES)[int(rng.integers(len(_SIZES)))]
    size = float(rng.uniform(*_SIZES[effect]))
    if effect == "delay":
        size = round(size / _DT) * _DT
    elif effect != "servo_lag" and rng.uniform() < 0.5:
        size = 1.0 / size
    return {"believed": believed, "effect": effect, "size": size}


def _inputs() -> dict[str, FloatArray]:
    n = round(_SECONDS / _DT)
    naming = multistep(n, _DT, 0.5, 0.35, 3.0 * DEG_RAD) + multistep(n, _DT, 6.0, 0.12, 4.0 * DEG_RAD, "1111")
    held_out = doublet(n, _DT, 0.5, 0.5, 3.0 * DEG_RAD) + doublet(n, _DT, 6.0, 0.2, -4.0 * DEG_RAD)
    return {"naming": naming, "held_out": held_out}


def hand_out(case: Case) -> Handout:
    """Return a record to name the effect by and one to judge it by."""
    rng = np.random.default_rng(case.seed)
    records = {}
    for name, u in _inputs().items():
        y = predict(case["believed"], u, case["effect"], case["size"])
        y = y + rng.normal(size=y.shape) * np.array(_NOISE)
        records[name] = measured({"de_cmd": u, "alpha": y[:, 0], "q": y[:, 1]}, _DT)
    return Handout(records, {**case["believed"], "noise_alpha_rad": _NOISE[0], "noise_q_rad_s": _NOISE[1]})


def _mean_square(residual: FloatArray) -> float:
    return float(np.mean((residual / np.array(_NOISE)) ** 2))


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the effect, its size and the residual on the record held out, without and with it."""
    believed, effect, size = case["believed"], case["effect"], case["size"]
    u = _inputs()["held_out"]
    before = 1.0 + _mean_square(predict(believed, u, effect, size) - predict(believed, u))
    twins = {
        (
            "servo_lag",
            "delay",
        ): "a lag shows the change at once and slowly, a delay late and whole: use the short steps",
        ("delay", "servo_lag"): "a delay shows nothing at first and then everything: use the short steps",
        ("stability", "damping"): "the frequency is wrong, not the decay",
        ("damping", "stability"): "the decay is wrong, not the frequency",
        ("vane_gain", "elevator_gain"): "q agrees with the a-priori model; alpha alone does not",
        ("elevator_gain", "vane_gain"): "q disagrees as much as alpha does; a vane affects alpha alone",
    }
    other = "it removes less of the residual than another one of the list does: fit the size of each, and compare"
    wrong = tuple(Mistake(o, twins.get((effect, o), other)) for o in _OPTIONS if o != effect)
    if effect in _TIMES:
        sizes = [
            Mistake(_MS * size, "this is in ms; the answer is in s"),
            Mistake(1.0 / size, "this is the corner frequency in rad/s; the answer is the time constant in s"),
            Mistake(size / _DT, "this is in samples; the answer is in s"),
        ]
    else:
        sizes = [
            Mistake(size - 1.0, "this is the difference of the factor from 1; the answer is the factor"),
            Mistake(1.0 / size, "this is one over it: truth over model, not model over truth"),
        ]
    return {
        "effect": Answer(effect, wrong, other),
        "size": Answer(size, tuple(sizes), "least squares on the naming record, with this effect alone"),
        "before": Answer(
            before,
            (
                Mistake(before - 1.0, "the noise itself is included: it adds 1"),
                Mistake(float(np.sqrt(before)), "this is the root; the answer is the mean of the squares"),
            ),
            "mean of (measured - believed)² / noise² over samples, alpha and q, of the record held out",
        ),
        "after": Answer(1.0, (), "if the residual exceeds the noise, the effect or its size is wrong"),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Fit the size of each effect on the naming record, and name the one that leaves least."""
    from scipy.optimize import minimize_scalar

    given = read_toml(folder / "given.toml", "answers")
    naming, held_out = (load_record(folder / "records" / f"{name}.nc") for name in ("naming", "held_out"))
    y = naming.columns(("alpha", "q"))
    found: dict[str, tuple[float, float]] = {}
    for effect in _OPTIONS:

        def left(size: float, effect: str = effect) -> float:
            """Return the mean square of what is left with the effect at this size."""
            return _mean_square(y - predict(given, naming["de_cmd"], effect, size))

        if effect == "delay":
            size = min((k * _DT for k in range(1, 20)), key=left)
        else:
            bounds = (0.01, 0.4) if effect == "servo_lag" else (0.4, 2.5)
            size = float(minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 1e-3}).x)
        found[effect] = (left(size), size)
    effect = min(found, key=lambda e: found[e][0])
    y, u = held_out.columns(("alpha", "q")), held_out["de_cmd"]
    return {
        "effect": effect,
        "size": found[effect][1],
        "before": _mean_square(y - predict(given, u)),
        "after": _mean_square(y - predict(given, u, effect, found[effect][1])),
    }


TITLE, LEVEL, MINUTES = "Name the missing effect", 3, 90
QUESTIONS = (
    Choice("effect", "What does the a-priori model lack?", _OPTIONS),
    Number("size", "s or 1", "Its size: a time in s, or a factor", 0.08, 0.01),
    Number("before", "1", "Mean square of the residual over the noise, held-out record, a-priori model", 0.1),
    Number("after", "1", "The same with the effect added", 0.1),
)
