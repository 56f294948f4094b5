"""Responses at the lines of multisines: exact on periodic data, noise and distortion apart, the F-16."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.frequency.multisine import estimate_interleaved_responses, estimate_multisine_response
from testbench.logs.layout import ENVIRONMENT
from testbench.logs.tables import read_table

DT, N = 0.05, 400
PERIOD = N * DT
NUM, DEN, _ = cont2discrete(([-4.0, -6.0], [1.0, 2.5, 6.25]), DT)
NUM = np.ravel(NUM)
OTHER = np.array([0.0, 0.006, 0.002])
ODD = np.arange(1, 60, 2)


def true(omega, num=NUM):
    z = np.exp(1j * omega * DT)
    return np.polyval(num, z) / np.polyval(DEN, z) * z ** (DEN.size - num.size)


def multisine(rng, lines, periods):
    t = np.arange(N)
    one = np.sum(np.cos(2 * np.pi * np.outer(t, lines) / N + rng.uniform(0, 2 * np.pi, lines.size)), axis=1)
    return np.tile(one / np.sqrt(lines.size), periods)


def record(u, *y, valid=None):
    u = np.atleast_2d(u.T).T
    names = ("de", "thr")[: u.shape[1]] + ("q", "alpha")[: len(y)]
    return FlightRecord(np.arange(len(u)) * DT, names, np.column_stack([u, *y]), "measured", valid=valid)


def test_periodic_data_give_the_exact_response():
    rng = np.random.default_rng(1)
    u = multisine(rng, ODD, 6)
    r = record(u, lfilter(NUM, DEN, u))
    found = estimate_multisine_response([r], ("de",), ("q",), period_s=PERIOD, drop_periods=3)
    assert np.allclose(found.omega_rad_s, 2 * np.pi * ODD / PERIOD, rtol=1e-12)
    # the transient has decayed by e^(-1.25 x 60 s)
    assert np.abs(found.H[:, 0, 0] / true(found.omega_rad_s) - 1.0).max() < 1e-9
    assert np.all(found.coherence > 1.0 - 1e-12)
    early = estimate_multisine_response([r], ("de",), ("q",), period_s=PERIOD, drop_periods=0)
    assert any("transient has not decayed; raise drop_periods" in s for s in early.advice)
    assert np.abs(early.H[:, 0, 0] / true(found.omega_rad_s) - 1.0).max() > 1e-4


def test_noise_variance_is_the_scatter():
    rng = np.random.default_rng(2)
    seeds, periods = 200, 5
    u = multisine(rng, ODD, periods)
    y = lfilter(NUM, DEN, np.tile(u, 2))[u.size :]  # settled
    found, stated = [], []
    for _ in range(seeds):
        r = record(u + 0.05 * rng.standard_normal(u.size), y + 0.3 * rng.standard_normal(u.size))
        response = estimate_multisine_response(
            [r], ("de",), ("q",), period_s=PERIOD, drop_periods=0, lines_hz=ODD / PERIOD
        )
        found.append(response.H[:, 0, 0])
        stated.append(response.noise_variance[:, 0, 0])
    scatter = np.var(found, axis=0, ddof=1)
    # Ratio of chi-squares of 398 and 1600 degrees of freedom: sigma 8 %. 0.35 is 4.4 sigma, 30 lines: false alarm 4e-4.
    assert np.all(np.abs(scatter / np.mean(stated, axis=0) - 1.0) < 0.35)


def test_distortion_at_lines_that_are_not_excited():
    rng = np.random.default_rng(3)
    lines = np.setdiff1d(ODD, ODD[3::5])  # some odd lines left out, all even ones
    u = multisine(rng, lines, 6)

    def flown(square, cube):
        v = u + square * u**2 + cube * u**3
        return record(u, lfilter(NUM, DEN, v) + 1e-4 * rng.standard_normal(u.size))

    power = {}
    for name, terms in {"linear": (0, 0), "even": (0.1, 0), "odd": (0, 0.1)}.items():
        found = estimate_multisine_response([flown(*terms)], ("de",), ("q",), period_s=PERIOD, drop_periods=3)
        assert found.diagnostics["distortion_source"] == "detection lines"
        d = found.diagnostics
        power[name] = [np.mean(np.abs(d[f"{kind}_distortion"]["q"][1])) for kind in ("even", "odd")]
        assert any("nonlinear distortion" in s for s in found.advice) == (name == "odd")
    assert power["even"][0] > 1e4 * power["linear"][0]
    assert power["even"][1] < 10 * power["linear"][1]
    assert power["odd"][1] > 1e4 * power["linear"][1]
    assert power["odd"][0] < 10 * power["linear"][0]


def test_distortion_from_realisations_with_other_phases():
    rng = np.random.default_rng(4)
    full = np.arange(1, 60)
    inputs = [multisine(rng, full, 4) for _ in range(12)]
    records = [record(u, lfilter(NUM, DEN, u + 0.05 * u**3) + 1e-3 * rng.standard_normal(u.size)) for u in inputs]
    found = estimate_multisine_response(records, ("de",), ("q",), period_s=PERIOD, drop_periods=2)
    assert found.diagnostics["distortion_source"] == "realisations"
    best = true(found.omega_rad_s) * (
        1.0 + 0.05 * 3.0 * 0.5
    )  # Gaussian input of variance 1/2: best linear gain 1 + 3 c s^2
    miss = np.abs(found.H[:, 0, 0] - best) ** 2
    # mean of 59 ratios: the stated variance itself is known to 1/sqrt(11); 0.3 to 2 is far beyond 3 sigma
    assert 0.3 < np.mean(miss) / np.mean(found.distortion_variance + found.noise_variance) < 2.0
    assert np.mean(found.distortion_variance) > 100.0 * np.mean(found.noise_variance)
    again = estimate_multisine_response([records[0]] * 3, ("de",), ("q",), period_s=PERIOD, drop_periods=2)
    assert again.diagnostics["distortion_source"] == "not separable"  # repeats are no realisations
    assert again.distortion_variance is None


def test_several_inputs_from_several_records_or_from_lines_of_their_own():
    rng = np.random.default_rng(5)
    first, second = multisine(rng, ODD, 6), multisine(rng, ODD, 6)
    records = []
    for sign in (1.0, -1.0):
        u = np.column_stack([first, sign * second])
        records.append(record(u, lfilter(NUM, DEN, u[:, 0]) + lfilter(OTHER, DEN, u[:, 1])))
    settings = {"period_s": PERIOD, "drop_periods": 3}
    found = estimate_multisine_response(records, ("de", "thr"), ("q",), **settings)
    for j, num in enumerate((NUM, OTHER)):
        assert np.abs(found.H[:, 0, j] / true(found.omega_rad_s, num) - 1.0).max() < 1e-9
    with pytest.raises(EstimationError, match="2 inputs at the same lines need 2 or more records"):
        estimate_multisine_response(records[:1], ("de", "thr"), ("q",), **settings)
    with pytest.raises(EstimationError, match="lines that one input alone excites, got none for 'de'"):
        estimate_interleaved_responses(records, ("de", "thr"), ("q",), **settings)
    u = np.column_stack([multisine(rng, ODD[::2], 6), multisine(rng, ODD[1::2], 6)])
    one = record(u, lfilter(NUM, DEN, u[:, 0]) + lfilter(OTHER, DEN, u[:, 1]))
    both = estimate_interleaved_responses([one], ("de", "thr"), ("q",), **settings)
    for name, num, lines in (("de", NUM, ODD[::2]), ("thr", OTHER, ODD[1::2])):
        assert np.allclose(both[name].omega_rad_s, 2 * np.pi * lines / PERIOD)
        assert np.abs(both[name].H[:, 0, 0] / true(both[name].omega_rad_s, num) - 1.0).max() < 1e-9


def test_gaps_and_refusals():
    rng = np.random.default_rng(6)
    u = multisine(rng, ODD, 6)
    y = lfilter(NUM, DEN, u)
    valid = np.ones((u.size, 2), bool)
    valid[4 * N + 7, 1] = False
    gap = record(u, np.where(valid[:, 1], y, 50.0), valid=valid)
    found = estimate_multisine_response([gap], ("de",), ("q",), period_s=PERIOD, drop_periods=3)
    assert found.diagnostics["periods"] == [2]
    assert np.abs(found.H[:, 0, 0] / true(found.omega_rad_s) - 1.0).max() < 1e-9
    r = record(u, y)
    with pytest.raises(EstimationError, match=r"whole number .* got 400\.5 samples"):
        estimate_multisine_response([r], ("de",), ("q",), period_s=400.5 * DT)
    with pytest.raises(EstimationError, match=r"at least 2 whole periods .* got 1"):
        estimate_multisine_response([r], ("de",), ("q",), period_s=PERIOD, drop_periods=5)
    with pytest.raises(EstimationError, match="lines_hz must be multiples"):
        estimate_multisine_response([r], ("de",), ("q",), period_s=PERIOD, lines_hz=[0.07])


def f16():
    folder = Path(os.environ.get(ENVIRONMENT) or Path(__file__).resolve().parents[4] / "shared" / "flight_data")
    path = folder / "f16_gvt" / "F16Data_FullMSine_Level1.csv"
    if not path.is_file():
        pytest.skip(f"the F-16 ground vibration test is missing: '{path}'; set {ENVIRONMENT} to its folder's parent")
    table = read_table(path, "csv")
    columns = [table.numbers(f"{name}") for name in ("Force", "Acceleration1", "Acceleration2", "Acceleration3")]
    # The channel table knows no shaker: its force stands under "thrust" (N), the accelerations under ax, ay, az.
    data = np.column_stack(columns)
    return FlightRecord(np.arange(len(data)) / 400.0, ("thrust", "ax", "ay", "az"), data, "measured")


def test_f16_peaks_of_the_ground_vibration_test():
    response = estimate_multisine_response([f16()], ("thrust",), ("ax", "ay", "az"), period_s=8192 / 400.0)
    band = response.between(2 * np.pi * 2.5, 2 * np.pi * 10.5)
    f = band.omega_rad_s / (2 * np.pi)
    gain = np.abs(band.H[:, :, 0])
    for printed in (3.5, 5.22, 6.64, 7.32, 9.23):
        found = []
        for i in range(3):
            near = np.abs(f - printed) <= 0.03 * printed
            k = np.flatnonzero(near)[np.argmax(gain[near, i])]
            if gain[k, i] >= max(gain[k - 1, i], gain[k + 1, i]):  # a peak, not the flank of another
                a, b, c = np.log(gain[k - 1 : k + 2, i])
                found.append(f[k] + 0.5 * (a - c) / (a - 2 * b + c) * (f[1] - f[0]))
        assert min(abs(peak / printed - 1.0) for peak in found) < 0.01
    assert np.median(band.coherence) > 0.99
    assert np.median(band.random_error) < 0.02
