"""A wing mode in logs at 8 and 9 Hz: what it seems to be, what it is, and what would have helped."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.record import FlightRecord, load_record
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import measured, respond

_FAST, _SECONDS, _ZETA, _NOISE = 360, 120.0, 0.008, 0.05  # Hz; s; 1; m/s2
_RATES = (8, 9)
_HIGHEST = 20.0


def apparent(f_hz: float, rate_hz: float) -> float:
    """Return where a tone of ``f_hz`` appears in samples taken at ``rate_hz``, Hz."""
    return float(abs(f_hz - rate_hz * round(f_hz / rate_hz)))


def candidates(f8_hz: float, f9_hz: float) -> list[tuple[float, float]]:
    """Return (disagreement, frequency) below 20 Hz, best first, of the frequencies that appear at f8 and at f9."""
    near = [
        (abs(a - b), 0.5 * (a + b))
        for k in range(4)
        for a in (8 * k + f8_hz, 8 * k - f8_hz)
        for j in range(4)
        for b in (9 * j + f9_hz, 9 * j - f9_hz)
        if 0.0 < a < _HIGHEST + 0.5 and 0.0 < b < _HIGHEST + 0.5
    ]
    return sorted(near)


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a frequency above the Nyquist frequency that both logs together tell without doubt."""
    while True:
        f = float(rng.uniform(5.0, 18.5))
        f8, f9 = (apparent(f, rate) for rate in _RATES)
        second = next(d for d, g in candidates(f8, f9) if abs(g - f) > 0.5)
        if 0.6 < f8 < 3.4 and 0.6 < f9 < 3.9 and second > 0.5:
            return {"f_hz": f}


def hand_out(case: Case) -> Handout:
    """Return the acceleration of the wing tip in turbulence, as both recorders logged it."""
    rng = np.random.default_rng(case.seed)
    n, w = round(_SECONDS * _FAST), 2.0 * np.pi * case["f_hz"]
    A, B = np.array([[0.0, 1.0], [-(w**2), -2.0 * _ZETA * w]]), np.array([[0.0], [1.0]])
    x = respond(A, B, rng.normal(size=(n, 1)), 1.0 / _FAST) @ A[1]  # what spring and damper make of the acceleration
    x /= x.std()
    records = {}
    for rate in _RATES:
        y = x[:: _FAST // rate]
        records[f"tip_{rate}hz"] = measured({"az_wing_1": y + rng.normal(0.0, _NOISE, y.size)}, 1.0 / rate)
    return Handout(records)


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the apparent and the true frequency, and the rate that shows it."""
    f = case["f_hz"]
    f8, f9 = (apparent(f, rate) for rate in _RATES)
    folds = tuple(
        Mistake(g, "this would appear at the right place in the log at 8 Hz, but not in the one at 9 Hz")
        for k in range(1, 4)
        for g in (8 * k + f8, 8 * k - f8)
        if abs(g - f) > 0.5
    )
    return {
        "apparent_hz": Answer(f8, (Mistake(f9, "this is where it appears in the log at 9 Hz"),)),
        "true_hz": Answer(
            f,
            (
                Mistake(
                    f8, "this is where it appears at 8 Hz; the log at 9 Hz shows it elsewhere, so it cannot lie there"
                ),
                Mistake(
                    f9, "this is where it appears at 9 Hz; the log at 8 Hz shows it elsewhere, so it cannot lie there"
                ),
                *folds,
            ),
            "list k 8 Hz +- what you see at 8 Hz and j 9 Hz +- what you see at 9 Hz: one number is in both lists",
        ),
        "lowest_rate_hz": Answer(
            2.0 * f,
            (Mistake(f, "one sample per period shows a constant; more than two are needed"),),
            "the Nyquist frequency, half the rate, must lie above the true frequency",
        ),
        "cure": Answer(
            "filter_before",
            (
                Mistake("filter_after", "once sampled, the mode is where it appears, among the motion that is wanted"),
                Mistake("interpolate", "interpolation adds samples, not information; the alias stays where it is"),
                Mistake("longer", "a longer record resolves the alias more finely; it stays an alias"),
            ),
        ),
    }


def _peak(record: FlightRecord) -> float:
    from scipy.signal import welch

    f, power = welch(record["az_wing_1"], 1.0 / record.dt_s, nperseg=256)
    k = int(np.argmax(power[1:-1])) + 1
    near = slice(max(k - 4, 1), k + 5)
    return float(np.sum(f[near] * power[near]) / np.sum(power[near]))


def solve(folder: Path) -> dict[str, float | str]:
    """Find the peak of both spectra; the one frequency that folds to both is the mode."""
    f8, f9 = (_peak(load_record(folder / "records" / f"tip_{rate}hz.nc")) for rate in _RATES)
    f = candidates(f8, f9)[0][1]
    return {"apparent_hz": f8, "true_hz": f, "lowest_rate_hz": 2.0 * f, "cure": "filter_before"}


TITLE, LEVEL, MINUTES = "Sampling at 8 Hz: a mode at the wrong frequency", 1, 30
QUESTIONS = (
    Number("apparent_hz", "Hz", "Frequency at which the mode appears in the log at 8 Hz", 0.0, 0.15),
    Number("true_hz", "Hz", "Its true frequency; below 20 Hz according to a ground vibration test", 0.0, 0.25),
    Number(
        "lowest_rate_hz",
        "Hz",
        ("Sample rate that must be exceeded for the mode to appear at its true frequency"),
        0.0,
        0.5,
    ),
    Choice(
        "cure",
        "The log must stay at 8 Hz. What keeps the mode out of the motion below 4 Hz?",
        {
            "filter_before": "a low-pass filter before the samples are taken",
            "filter_after": "a digital low-pass filter on the logged samples",
            "interpolate": "interpolating the log to a higher rate",
            "longer": "a longer record",
        },
    ),
)
