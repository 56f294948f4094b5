"""Errors of instruments found in simulated and in recorded flights."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.record import FlightRecord
from testbench.estimators.data_compatibility import DataCompatibility, correct, estimate
from testbench.flight.simulate import Manoeuvre, fly
from testbench.inputs.signal import InputSignal
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite

G_SIMULATED_M_S2 = 9.7803  # the simulator flies over the equator
NOISE = {
    "V": 0.1, "alpha": 0.2 * DEG_RAD, "beta": 0.2 * DEG_RAD, "p": 0.1 * DEG_RAD, "q": 0.1 * DEG_RAD,
    "r": 0.1 * DEG_RAD, "ax": 0.05, "ay": 0.05, "az": 0.05, "phi": 0.2 * DEG_RAD, "theta": 0.2 * DEG_RAD,
    "psi": 0.3 * DEG_RAD, "h": 0.3, "hdot": 0.1, "Vg": 0.1,
}  # fmt: skip
LONGITUDINAL = ("V", "alpha", "q", "theta", "ax", "az")
TRUE = {"alpha_scale": 1.1, "q_bias": 0.5 * DEG_RAD, "ax_bias": 0.3}


def fly_steps(aircraft, trimmed, steps: dict[str, list[tuple[float, float, float]]], duration_s: float, hz: float):
    t = np.arange(round(duration_s * trimmed.rate_hz)) / trimmed.rate_hz
    u = np.zeros((t.size, len(steps)))
    for column, parts in zip(u.T, steps.values(), strict=True):
        for start, end, size in parts:
            column[(t >= start) & (t < end)] += size * DEG_RAD
    return fly(aircraft, trimmed, Manoeuvre("steps", InputSignal(t, u, tuple(steps))), hz)


@pytest.fixture(scope="module")
def taurus_flight(taurus, taurus_trim):
    steps = {
        "de": [(0, 0.9, 2), (0.9, 1.5, -2), (1.5, 1.8, 2), (1.8, 2.1, -2), (14, 15, 2), (15, 16, -2)],
        "da": [(5, 6, 2), (6, 8, -2), (8, 9, 2), (18, 19.5, 2), (22, 23.5, -2)],
        "dr": [(10, 11, 3), (11, 12, -3)],
    }
    return fly_steps(taurus, taurus_trim, steps, 28.0, 120.0)


@pytest.fixture(scope="module")
def eolo_flight(eolo, eolo_trim):
    steps = {"de": [(0, 0.9, 2), (0.9, 1.5, -2), (1.5, 1.8, 2), (1.8, 2.1, -2), (5, 6, 2), (6, 7, -2), (10, 10.5, -2)]}
    return fly_steps(eolo, eolo_trim, steps, 13.0, 50.0)


def measure(truth, seed: int, errors: dict[str, float], channels=tuple(NOISE), hz: float | None = None) -> FlightRecord:
    keys = {"bias": "bias", "scale": "scale", "delay": "delay_s", "lag": "lag_s"}
    own: dict[str, dict[str, float]] = {}
    for name, value in errors.items():
        of, kind = name.split("_")
        own.setdefault(of, {})[keys[kind]] = value
    sensors = tuple(Sensor(n, noise_std=NOISE[n], **own.get(n, {})) for n in channels)
    return SensorSuite("test", "test", hz or 1.0 / truth.dt_s, sensors).measure(truth, seed)


def outside(results: list[DataCompatibility], true: dict[str, float]) -> int:
    """How many estimates lie beyond 3 standard errors from the truth; every error must be among those found."""
    count = 0
    for result in results:
        found = {e.name: e for e in result.errors}
        assert set(true) <= set(found), [e.words for e in result.errors]
        count += sum(abs(found[n].estimate - value) > 3.0 * found[n].standard_error for n, value in true.items())
    return count


def test_an_eolo_with_errors_has_them_named_over_10_seeds(eolo_flight):
    results = [
        estimate([measure(eolo_flight, seed, TRUE, LONGITUDINAL, 25.0)], gravity_m_s2=G_SIMULATED_M_S2)
        for seed in range(10)
    ]
    # 20 estimates: more than 1 beyond 3 standard errors by chance with probability 0.0014.
    assert outside(results, {n: TRUE[n] for n in ("q_bias", "ax_bias")}) <= 1
    # This flight moves alpha too little for 10 % of it to be significant; its estimate allows for it all the same.
    scales = [e for r in results for e in r.tested if e.name == "alpha_scale"]
    assert len(scales) >= 7
    assert sum(abs(e.estimate - TRUE["alpha_scale"]) > 3.0 * e.standard_error for e in scales) <= 1
    assert max(r.residual_after["theta"] / NOISE["theta"] for r in results) < 1.2


def test_an_eolo_without_errors_has_none_named_over_10_seeds(eolo_flight):
    results = [
        estimate([measure(eolo_flight, seed, {}, LONGITUDINAL, 25.0)], gravity_m_s2=G_SIMULATED_M_S2)
        for seed in range(100, 110)
    ]
    # false_alarm = 0.01 each: more than 1 of 10 by chance with probability 0.004
    assert sum(bool(r.errors) for r in results) <= 1


@pytest.mark.slow
def test_a_taurus_with_all_channels(taurus_flight):
    true = {**TRUE, "alpha_delay": 0.1, "V_bias": 1.0}
    start = time.process_time()
    result = estimate([measure(taurus_flight, 1, true, hz=24.0)], gravity_m_s2=G_SIMULATED_M_S2)
    assert time.process_time() - start < 15.0  # measured: 2 to 3 s
    # 3 estimates: one beyond 3 standard errors by chance with probability 0.008
    assert outside([result], {n: true[n] for n in ("q_bias", "ax_bias", "V_bias")}) == 0
    timing = {e.name: e for e in result.errors if e.name in ("alpha_delay", "alpha_lag")}
    assert len(timing) == 1
    assert next(iter(timing.values())).estimate == pytest.approx(0.1, abs=0.03)
    # A flight at nearly constant alpha does not always tell a scale from a bias or a rising wind: then it says so.
    assert any("angle-of-attack vane reads" in text for e in result.errors for text in (e.words, *e.alternatives))
    clean = estimate([measure(taurus_flight, 2, {}, hz=24.0)], gravity_m_s2=G_SIMULATED_M_S2)
    assert clean.errors == ()  # false alarm: 0.01


def test_a_corrected_record_has_no_error_left(taurus_flight):
    records = [measure(taurus_flight, seed, TRUE, hz=24.0) for seed in (3, 4)]
    result = estimate(records[:1], gravity_m_s2=G_SIMULATED_M_S2)
    again = estimate([correct(records[1], result)], gravity_m_s2=G_SIMULATED_M_S2)
    left = {e.name: e for e in again.errors}
    for name in ("q_bias", "ax_bias"):  # what is left is what the first record did not tell: far below what was there
        assert name not in left or abs(left[name].estimate) < 0.1 * TRUE[name]


def test_gravity_taken_wrong_shows_as_a_small_bias_and_is_said(taurus_flight):
    result = estimate([measure(taurus_flight, 1, {}, hz=24.0)], gravity_m_s2=9.82)
    [error] = [e for e in result.errors if e.name == "az_bias"]
    assert error.estimate == pytest.approx(9.82 - G_SIMULATED_M_S2, abs=4.0 * error.standard_error)
    assert any("may be gravity" in line for line in result.advice)


@pytest.mark.slow
def test_a_taurus_over_20_seeds(taurus_flight):
    true = {**TRUE, "V_bias": 1.0}
    clean = [estimate([measure(taurus_flight, seed, {}, hz=40.0)], gravity_m_s2=G_SIMULATED_M_S2) for seed in range(20)]
    assert sum(bool(r.errors) for r in clean) <= 2  # false_alarm = 0.01 each: beyond by chance 0.001
    spoilt = [
        estimate([measure(taurus_flight, seed, true, hz=40.0)], gravity_m_s2=G_SIMULATED_M_S2)
        for seed in range(1000, 1020)
    ]
    # 60 estimates: more than 2 beyond 3 standard errors by chance with probability 0.001
    assert outside(spoilt, {n: true[n] for n in ("q_bias", "ax_bias", "V_bias")}) <= 2
    for result in spoilt:  # the scale by its name (17 of 20, measured), or as an alternative to what is named
        words = [text for e in result.errors for text in (e.words, *e.alternatives)]
        assert any("angle-of-attack vane reads" in text and "% too much" in text for text in words)


def attas(name: str) -> FlightRecord:
    """A recorded flight; its accelerations are at the centre of gravity."""
    from scipy.io import loadmat

    folder = os.environ.get("TESTBENCH_FLIGHT_DATA") or Path(__file__).resolve().parents[3] / "shared" / "flight_data"
    file = Path(folder) / "attas" / f"fAttas{name}.mat"
    if not file.is_file():
        pytest.skip(f"recorded flights are missing: {file.name}; set TESTBENCH_FLIGHT_DATA to the folder with attas/")
    table = loadmat(file)[f"fAttas{name}"]
    columns = {
        "ax": (1, 1.0), "ay": (2, 1.0), "az": (3, 1.0), "p": (6, DEG_RAD), "q": (7, DEG_RAD), "r": (8, DEG_RAD),
        "phi": (9, DEG_RAD), "theta": (10, DEG_RAD), "psi": (11, DEG_RAD), "alpha": (12, DEG_RAD),
        "beta": (13, DEG_RAD), "V": (14, 1.0), "h": (15, FT_M),
    }  # fmt: skip
    data = np.column_stack([table[:, i] * factor for i, factor in columns.values()])
    return FlightRecord(table[:, 0], tuple(columns), data, "measured")


@pytest.mark.parametrize("name", ["Elv1", pytest.param("Elv2", marks=pytest.mark.slow)])
def test_recorded_flights_agree_about_their_gyros_and_vanes(name):
    result = estimate([attas(name)], gravity_m_s2=9.80)
    assert result.structure.motion == "full"
    # Measured: pitch-rate gyro 0.18 and 0.19 deg/s too much, vane of alpha 0.10 to 0.12 s late (or lagging).
    assert result.values["q_bias"] == pytest.approx(0.185 * DEG_RAD, abs=0.02 * DEG_RAD)
    late = result.values.get("alpha_delay", result.values.get("alpha_lag", 0.0))
    assert 0.07 < late < 0.15
    for channel in ("theta", "phi", "alpha"):
        assert result.residual_after[channel] < 0.3 * result.residual_before[channel]
