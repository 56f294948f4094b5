"""Frequency, damping and derivatives of the short period of a small aeroplane, flown in JSBSim."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient
from testbench.core.constants import DEG_RAD
from testbench.core.record import load_record
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import FlightCondition, TrimmedFlight, linearise, load_aircraft, trim
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.inputs.signal import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.exercise.answers import description
from testbench.questions.exercise.exercise import Answer, Case, Handout, Mistake, Number
from testbench.questions.exercise.motion import doublet
from testbench.sensors import Sensor, SensorSuite

_RATE, _TRIM_S = 200.0, 1.0
_ESTIMATOR = {"method": "equation_error", "structure": "short_period"}
_SUITE = SensorSuite(
    "exercise",
    "air data boom, gyro and elevator of the exercise",
    50.0,
    (Sensor("alpha", noise_std=0.1 * DEG_RAD), Sensor("q", noise_std=0.3 * DEG_RAD), Sensor("de", noise_std=0.0)),
)


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw how the student's aircraft differs from the packaged one."""
    factors = {"Cm_alpha": (0.7, 1.3), "Cm_q": (0.3, 0.6), "Cm_de": (0.9, 1.2)}
    return {name: float(rng.uniform(*limits)) for name, limits in factors.items()} | {
        "V_m_s": float(rng.integers(13, 17))
    }


def _trimmed(case: Case) -> tuple[Aircraft, TrimmedFlight]:
    changes = tuple(ScaleCoefficient(name, case[name]) for name in ("Cm_alpha", "Cm_q", "Cm_de"))
    aircraft = load_aircraft("taurus").amended(Amendment("exercise", "a student's own aircraft", changes))
    return aircraft, trim(aircraft, FlightCondition(case["V_m_s"], 100.0), _RATE)


def hand_out(case: Case) -> Handout:
    """Fly a doublet, and another one to judge by."""
    aircraft, trimmed = _trimmed(case)
    n = round(6.0 * _RATE)
    records = {}
    for k, (name, step_s, size_deg) in enumerate((("doublet", 0.25, 3.0), ("held_out", 0.4, -2.0))):
        u = doublet(n, 1.0 / _RATE, 0.0, step_s, size_deg * DEG_RAD)
        signal = InputSignal(np.arange(n) / _RATE, u[:, None], ("de",))
        job = Job(aircraft, trimmed, Manoeuvre(name, signal, _TRIM_S), _SUITE.rate_hz)
        flight = fly_and_measure(job, [_SUITE], case.seed + k)
        records[name] = flight.measured[_SUITE.name]
    channels = ["de", "alpha", "q"]
    asked = {"inputs": ["de"], "outputs": channels[1:], "estimators": [_ESTIMATOR]}
    text = description(TITLE, ["doublet"], channels, asked, _TRIM_S, held_out=["held_out"])
    given = {"V_m_s": case["V_m_s"], "trim_s": _TRIM_S}
    return Handout(records, given, {"short_period.toml": text})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return the short period of the linearised aircraft at constant speed."""
    aircraft, trimmed = _trimmed(case)
    d = {x.name: x.held for x in dimensional_derivatives(linearise(aircraft, trimmed), trimmed)}
    V = case["V_m_s"]
    A = np.array([[d["Z_alpha"] / V, 1.0 + d["Z_q"] / V], [d["M_alpha"], d["M_q"]]])
    wn, damping = float(np.sqrt(np.linalg.det(A))), float(-np.trace(A))
    zeta = damping / (2.0 * wn)
    wd = wn * np.sqrt(max(1.0 - zeta**2, 0.0))
    return {
        "omega_n_rad_s": Answer(
            wn,
            (Mistake(wd, "this is the damped frequency wd, the imaginary part of the pole; wn is its magnitude"),),
            "wn is the magnitude of the pole",
        ),
        "zeta": Answer(
            zeta,
            (
                Mistake(0.5 * damping, "this is zeta wn, minus the real part of the pole, in 1/s; divide it by wn"),
                Mistake(0.5 * damping / max(wd, 1e-9), "zeta wn was divided by the damped frequency; divide by wn"),
            ),
            "zeta is minus the real part of the pole over its magnitude",
        ),
        "M_alpha_1_s2": Answer(
            d["M_alpha"],
            (
                Mistake(
                    -(wn**2), "this is -wn^2; M_alpha = (Z_alpha M_q - wn^2) / (1 + Z_q), damping has its share of wn"
                ),
            ),
            "use alpha, q and de together; equation error is enough here",
        ),
        "M_de_1_s2": Answer(d["M_de"], (), "it is the pitch acceleration right after the elevator has moved"),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Estimate the short-period structure by output error."""
    from testbench.estimators.parametric import output_error
    from testbench.estimators.parametric.structures.longitudinal import short_period
    from testbench.estimators.prepare import prepare

    record = prepare(load_record(folder / "records" / "doublet.nc"), bias="trim", trim_s=_TRIM_S)
    model = output_error.estimate([record], short_period())
    pole = next(iter(model.poles().values()))[0]
    return {
        "omega_n_rad_s": float(abs(pole)),
        "zeta": float(-pole.real / abs(pole)),
        "M_alpha_1_s2": model.values["M_alpha"],
        "M_de_1_s2": model.values["M_de"],
    }


TITLE, LEVEL, MINUTES = "Short period from a doublet: frequency, damping and two derivatives", 1, 60
QUESTIONS = (
    Number("omega_n_rad_s", "rad/s", "Natural frequency of the short period", 0.07),
    Number("zeta", "1", "Its damping ratio", 0.10),
    Number("M_alpha_1_s2", "1/s2", "Pitch stiffness: pitch acceleration per angle of attack, M_alpha", 0.12),
    Number("M_de_1_s2", "1/s2", "Elevator effectiveness: pitch acceleration per elevator, M_de", 0.10),
)
