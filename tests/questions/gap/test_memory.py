"""Effects that remember: the linear model holds their states, and turbulence whitened with it leaves noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import CONDITION, believe, measure
from scipy.linalg import expm
from scipy.stats import chi2

from testbench.core.constants import DEG_RAD
from testbench.effects import EFFECTS
from testbench.flight import Manoeuvre, fly
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.gust_filter import GustModel

WITH_MEMORY = {
    "wake_lag": ({"time_s": 0.3, "Cm_wake": -0.5}, "de"),
    "washed_pitch_damper": ({"gain_s": 0.15, "washout_rad_s": 2.0}, "de"),
    "filtered_pitch_damper": ({"gain_s": 0.2, "lag_s": 0.08}, "de"),
    "pitch_damper": ({"gain_s": 0.15}, "de"),
    "filtered_yaw_damper": ({"gain_s": 0.3, "washout_rad_s": 1.0, "lag_s": 0.1}, "dr"),
    "filtered_roll_damper": ({"gain_s": 0.1, "lag_s": 0.1}, "da"),
    "late_interconnect": ({"ratio": 0.4, "lag_s": 0.1}, "da"),
    "yaw_damper": ({"gain_s": 0.3, "washout_rad_s": 1.0}, "dr"),
}


def amended(name):
    return believe().with_effect(EFFECTS[name], WITH_MEMORY[name][0])


@pytest.mark.parametrize("name", WITH_MEMORY)
def test_a_small_flight_is_the_one_of_the_linear_model(name):
    model, control = amended(name), WITH_MEMORY[name][1]
    u = np.zeros((int(6.0 * model.rate_hz), 1))
    u[: len(u) // 10], u[len(u) // 10 : len(u) // 5] = 0.1 * DEG_RAD, -0.1 * DEG_RAD
    signal = InputSignal(np.arange(len(u)) / model.rate_hz, u, (control,))
    flown = fly(model.aircraft, model.trimmed, Manoeuvre("small", signal, 0.0), model.rate_hz)
    linear = model.linear
    n, k = len(linear.states), linear.inputs.index(f"{control}_cmd")
    step = expm(np.block([[linear.A, linear.B[:, [k]]], [np.zeros((1, n + 1))]]) / model.rate_hz)
    x = np.zeros((len(flown), n))
    for i in range(1, len(x)):
        x[i] = step[:n, :n] @ x[i - 1] + step[:n, n] * u[i - 1, 0]
    for channel in ("q", "alpha", "az") if control == "de" else ("r", "beta"):
        deviation = flown[channel] - flown[channel][0]
        error = x @ linear.C[linear.outputs.index(channel)] - deviation
        assert np.sqrt(np.mean(error**2)) < 0.03 * np.std(deviation), channel


@pytest.mark.parametrize("name", WITH_MEMORY)
def test_along_a_flight_at_trim_the_model_is_the_one_about_trim(name):
    model = amended(name)
    record = measure(model, 7, duration_s=4.0)[0]
    about = GustModel.at_trim(model, 300.0, record.dt_s)
    along = GustModel.along(model, 300.0, record, model.suite)
    for matrix in ("F", "Q", "H"):
        there = getattr(about, matrix)[0]
        assert getattr(along, matrix)[0] == pytest.approx(there, rel=1e-4, abs=1e-6 * np.abs(there).max()), matrix


@pytest.mark.slow
@pytest.mark.parametrize(("name", "hidden"), [("wake_lag", True), ("filtered_pitch_damper", False)])
def test_in_turbulence_the_true_model_leaves_noise(name, hidden):
    """Chi-square of white residuals leaves its 1e-4 bounds, 2 % wider for a linear model, once in 5 000 tries at most.

    It does so without the state of a wake that is ``hidden``; this damper's is too quick to show at this rms.
    """
    model = amended(name)
    records = measure(model, 11, 0.25)
    known = AirFound(True, 0.25, CONDITION.h_m, 0.0, 0.0, 0.0)
    forgetful = tuple(replace(a, memories=()) for a in model.aircraft.amendments)
    stateless = replace(model, aircraft=replace(model.aircraft, amendments=forgetful))
    with_state, without = (
        np.concatenate([in_air(model, known, along).residuals(r).ravel() for r in records])
        for along in (model, stateless)
    )
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], with_state.size)
    assert 0.98 * low < np.sum(with_state**2) < 1.02 * high
    assert (np.sum(without**2) > 1.02 * high) == hidden
