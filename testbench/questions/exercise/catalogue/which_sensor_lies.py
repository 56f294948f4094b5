"""One instrument of six is wrong: data compatibility finds which, how, and by how much."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.core.constants import DEG_RAD
from testbench.core.record import load_record
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.inputs.signal import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.exercise.answers import description
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import multistep
from testbench.sensors import Sensor, SensorSuite

_RATE = 200.0
_GRAVITY = 9.78  # of the simulated place, on the equator, to what matters here
_NOISE = {"V": 0.1, "alpha": 0.1 * DEG_RAD, "q": 0.1 * DEG_RAD, "theta": 0.1 * DEG_RAD, "ax": 0.05, "az": 0.08}
_WORDS = {
    "V": "airspeed",
    "alpha": "angle of attack",
    "q": "pitch rate gyro",
    "theta": "pitch angle",
    "ax": "forward accelerometer",
    "az": "downward accelerometer",
}
# Smallest and largest size of each error that may be drawn; of a scale error, the share by which it reads too much. A
# bias of theta and one of ax turn or add to gravity alike: neither is drawn, these data hardly tell them apart.
_ERRORS = {
    ("q", "bias"): (0.4 * DEG_RAD, 1.2 * DEG_RAD),
    ("q", "scale"): (0.06, 0.12),
    ("alpha", "scale"): (0.16, 0.28),
    ("V", "scale"): (0.05, 0.08),
    ("theta", "scale"): (0.12, 0.2),
    ("az", "bias"): (0.15, 0.4),
}

_ESTIMATOR = {"method": "transfer_function", "poles": 2, "zeros": [0]}  # none is asked for


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw which instrument errs, how, and by how much."""
    keys = list(_ERRORS)
    channel, kind = keys[int(rng.integers(len(keys)))]
    size = float(rng.uniform(*_ERRORS[channel, kind]) * rng.choice([-1.0, 1.0]))
    return {"channel": channel, "kind": kind, "size": size, "V_m_s": float(rng.uniform(14.5, 16.0))}


def hand_out(case: Case) -> Handout:
    """Fly a 3-2-1-1, a 2-1-1 and a pulse of throttle, and record them with the wrong instrument on board."""
    aircraft = load_aircraft("taurus")
    trimmed = trim(aircraft, FlightCondition(case["V_m_s"], 100.0), _RATE)
    n = round(24.0 * _RATE)
    t = np.arange(n) / _RATE
    de = multistep(n, 1.0 / _RATE, 1.0, 0.3, 3.0 * DEG_RAD)
    de += multistep(n, 1.0 / _RATE, 8.0, 0.6, -2.0 * DEG_RAD, "211")
    thr = np.where((t > 14.0) & (t < 18.0), 0.15, 0.0)
    signal = InputSignal(t, np.column_stack([de, thr]), ("de", "thr"))
    sensors = []
    for channel, noise in _NOISE.items():
        wrong = channel == case["channel"]
        bias = case["size"] if wrong and case["kind"] == "bias" else 0.0
        scale = 1.0 + case["size"] if wrong and case["kind"] == "scale" else 1.0
        sensors.append(Sensor(channel, noise_std=noise, bias=bias, scale=scale))
    suite = SensorSuite("exercise", "six instruments", 50.0, tuple(sensors))
    job = Job(aircraft, trimmed, Manoeuvre("compatibility", signal, 1.0), suite.rate_hz)
    flight = fly_and_measure(job, [suite], case.seed)
    record = flight.measured[suite.name]
    text = description(
        TITLE, ["flight"], record.channels, {"inputs": ["ax"], "outputs": ["q"], "estimators": [_ESTIMATOR]}, trim_s=1.0
    )
    return Handout({"flight": record}, {"g_m_s2": _GRAVITY}, {"which_sensor_lies.toml": text})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the instrument and its error."""
    size, kind = case["size"], case["kind"]
    mistakes = [Mistake(-size, "of the wrong sign: positive means that the instrument reads too much")]
    if kind == "scale":
        mistakes += [
            Mistake(1.0 + size, "this is the scale factor itself; the answer is its difference from 1"),
            Mistake(100.0 * size, "this is in percent; the answer is a fraction of one"),
        ]
    else:
        mistakes += [Mistake(size / DEG_RAD, "this is in degrees; the answer is in rad or rad/s")]
    hint = "integrate the rates and compare: which difference grows with time, which with the value?"
    confused = {
        "q": "a wrong gyro makes the integrated pitch angle drift away; here it does not",
        "theta": "a wrong pitch angle would disagree with the integrated q; it does not",
    }
    others = tuple(
        Mistake(c, confused.get(c, f"with another {_WORDS[c]} the six still disagree"))
        for c in _WORDS
        if c != case["channel"]
    )
    why = (
        "a scale error is nothing where the value is nothing, and grows with it"
        if kind == "scale"
        else "a bias is the same at all values; this one does not grow with the value"
    )
    other = "bias" if kind == "scale" else "scale"
    return {
        "instrument": Answer(case["channel"], others, hint),
        "kind": Answer(kind, (Mistake(other, why),)),
        "size": Answer(size, tuple(mistakes), hint),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Let data compatibility find the surest error."""
    from testbench.inference.instruments import every_error

    every = every_error([load_record(folder / "records" / "flight.nc")], _GRAVITY)
    assert every is not None
    surest, (size, _) = max(every.found.items(), key=lambda item: abs(item[1][0]) / item[1][1])
    channel, kind = surest.rsplit("_", 1)
    return {"instrument": channel, "kind": kind, "size": size}


TITLE, LEVEL, MINUTES = "Data compatibility: which sensor is wrong?", 2, 75
QUESTIONS = (
    Choice("instrument", "Which instrument is wrong?", _WORDS),
    Choice("kind", "How is it wrong?", {"bias": "by a constant", "scale": "by a share of its value"}),
    Number(
        "size",
        "SI or 1",
        "By how much does it read too much (bias in SI units; scale error as a fraction; negative: too little)?",
        0.25,
    ),
)
