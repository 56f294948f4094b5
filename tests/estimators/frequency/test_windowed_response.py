"""Windowed and composite frequency responses: a second implementation, errors against scatter, inputs."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, csd, lfilter, welch

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.frequency.response import estimate_frequency_response, random_error

DT = 0.05
NUM, DEN, _ = cont2discrete(([-4.0, -6.0], [1.0, 2.5, 6.25]), DT)
NUM = np.ravel(NUM)
OTHER = np.array([0.0, 0.006, 0.002])


def record(u, y, valid=None):
    names = ("de", "thr")[: u.shape[1]] + ("q", "alpha")[: y.shape[1]]
    return FlightRecord(np.arange(len(u)) * DT, names, np.hstack([u, y]), "measured", valid=valid)


def true(omega, num=NUM):
    z = np.exp(1j * omega * DT)
    return np.polyval(num, z) / np.polyval(DEN, z) * z ** (DEN.size - num.size)


def flown(rng, n, noise=0.0, m=1):
    u = lfilter([0.5], [1.0, -0.5], rng.standard_normal((n, m)), axis=0)
    y = lfilter(NUM, DEN, u[:, 0])
    if m == 2:
        y = y + lfilter(OTHER, DEN, u[:, 1])
    return record(u, (y + noise * rng.standard_normal(n))[:, None])


def test_one_window_agrees_with_scipy():
    rng = np.random.default_rng(1)
    r = flown(rng, 4000, 0.3)
    found = estimate_frequency_response([r], ("de",), ("q",), window_s=200 * DT)
    settings = {"fs": 1 / DT, "nperseg": 200, "noverlap": 100, "detrend": "constant", "window": "hann"}
    f, Suy = csd(r["de"], r["q"], **settings)
    Suu, Syy = welch(r["de"], **settings)[1], welch(r["q"], **settings)[1]
    assert np.allclose(found.omega_rad_s, 2 * np.pi * f[1:-1], rtol=1e-12)
    assert np.allclose(found.H[:, 0, 0], (Suy / Suu)[1:-1], rtol=1e-9)
    coherence = (np.abs(Suy) ** 2 / (Suu * Syy))[1:-1]
    assert np.allclose(found.coherence[:, 0], coherence, rtol=1e-9)
    assert np.allclose(found.partial_coherence[:, 0, 0], coherence, rtol=1e-9)


def test_zoom_gives_the_same_numbers_at_any_frequency():
    rng = np.random.default_rng(2)
    r = flown(rng, 3000, 0.1)
    whole = estimate_frequency_response([r], ("de",), ("q",), window_s=10.0)
    zoom = estimate_frequency_response([r], ("de",), ("q",), window_s=10.0, omega_rad_s=np.linspace(1.0, 3.0, 41))
    common = estimate_frequency_response([r], ("de",), ("q",), window_s=10.0, omega_rad_s=whole.omega_rad_s[[3, 7]])
    assert np.allclose(common.H, whole.H[[3, 7]], rtol=1e-10)
    assert np.all(np.abs(zoom.H[:, 0, 0] / true(zoom.omega_rad_s) - 1.0) < 0.15)


def test_conditioning_tells_correlated_inputs_apart():
    rng = np.random.default_rng(3)
    n = 20000
    u = lfilter([0.5], [1.0, -0.5], rng.standard_normal((n, 2)), axis=0)
    u[:, 1] = 0.8 * u[:, 0] + 0.6 * u[:, 1]
    y = lfilter(NUM, DEN, u[:, 0]) + lfilter(OTHER, DEN, u[:, 1])
    y2 = lfilter(OTHER, DEN, u[:, 1])
    r = record(u, np.column_stack([y, y2]))
    found = estimate_frequency_response([r], ("de", "thr"), ("q", "alpha"), window_s=20.0).between(0.5, 8.0)
    omega = found.omega_rad_s
    # leakage of Hann windows of 20 s in 50 averages: measured at most 3.5 %, 9 % and 4.5 %
    assert np.abs(found.H[:, 0, 0] / true(omega) - 1.0).max() < 0.06
    assert np.abs(found.H[:, 0, 1] / true(omega, OTHER) - 1.0).max() < 0.15
    assert np.abs(found.H[:, 1, 0]).max() < 0.08 * np.abs(found.H[:, 0, 0]).min()
    assert np.median(found.coherence) > 0.99
    alone = estimate_frequency_response([r], ("de",), ("q",), window_s=20.0).between(0.5, 8.0)
    assert np.abs(alone.H[:, 0, 0] / true(omega) - 1.0).max() > 0.2  # the second input biases it
    assert np.median(found.diagnostics["input_coherence"]) == pytest.approx(0.64, abs=0.05)


def test_random_error_is_the_scatter():
    rng = np.random.default_rng(4)
    seeds, omega = 150, np.array([1.0, 2.5, 4.0])
    found, stated, coherence = [], [], []
    for _ in range(seeds):
        response = estimate_frequency_response([flown(rng, 1500, 0.6, m=2)], ("de", "thr"), ("q",), window_s=5.0,
                                               omega_rad_s=omega)  # fmt: skip
        found.append(response.H[:, 0, 0])
        stated.append(response.random_error[:, 0, 0])
        coherence.append(response.coherence[:, 0])
    found = np.array(found)
    mean = found.mean(axis=0)
    gain = np.std(np.abs(found), axis=0, ddof=1) / np.abs(mean)
    phase = np.std(np.angle(found / mean), axis=0, ddof=1)
    # A standard deviation from 150 seeds is known to 5.8 %; leakage scatters too, which the error does not know of
    # (measured: up to 10 %). 0.3 is then more than 3 sigma, for 6 figures: false alarm below 1 %.
    for scatter in (gain, phase):
        assert np.all(np.abs(scatter / np.mean(stated, axis=0) - 1.0) < 0.3)


def test_random_error_formula():
    assert random_error(np.array([0.5]), np.array([50.0]))[0] == pytest.approx(0.1)  # sqrt(0.5) / (sqrt(0.5) 10)
    assert random_error(np.array([1.0]), np.array([50.0]))[0] == 0.0
    assert np.isfinite(random_error(np.zeros(1), np.ones(1)))[0]


def test_composite_windows_serve_low_and_high_frequencies():
    rng = np.random.default_rng(5)
    n, t = 6000, np.arange(6000) * DT
    u = np.sin(0.1 * t + 0.5 * 8.0 / t[-1] * t**2)[:, None]  # sweep from 0.1 to 8 rad/s
    y = lfilter(NUM, DEN, u[:, 0]) + 0.02 * rng.standard_normal(n)
    r = record(u, y[:, None])
    omega = np.geomspace(0.3, 7.0, 60)
    several = estimate_frequency_response(
        [r], ("de",), ("q",), window_s=(60.0, 30.0, 10.0), omega_rad_s=omega, overlap=0.8
    )
    single = [
        estimate_frequency_response([r], ("de",), ("q",), window_s=w, omega_rad_s=omega, overlap=0.8)
        for w in (60.0, 30.0, 10.0)
    ]
    assert several.method == "composite"
    errors = [np.abs(s.H[:, 0, 0] / true(omega) - 1.0) for s in (several, *single)]
    rms = [np.sqrt(np.mean(e**2)) for e in errors]
    assert rms[0] < np.median(rms[1:])
    assert rms[0] < 0.05
    assert np.all(several.coherence <= 1.0)
    low, high = several.resolution_rad_s[:10].mean(), several.resolution_rad_s[-10:].mean()
    assert low < 1.5 * 2 * np.pi / 10.0
    assert high <= 1.5 * 2 * np.pi / 10.0 + 1e-9
    assert several.diagnostics["averages"].keys() == {"60", "30", "10"}


def test_records_of_different_lengths_and_gaps():
    rng = np.random.default_rng(6)
    parts = [flown(rng, n) for n in (1500, 900)]
    valid = np.ones((1500, 2), bool)
    valid[700:706, 1] = False  # a short dropout is bridged
    valid[1200:1300, 1] = False  # a long one costs its segments
    data = parts[0].data.copy()
    data[~valid] = 0.0
    gappy = record(data[:, :1], data[:, 1:], valid)
    found = estimate_frequency_response([gappy, parts[1]], ("de",), ("q",), window_s=10.0).between(0.7, 5.0)
    whole = estimate_frequency_response(parts, ("de",), ("q",), window_s=10.0).between(0.7, 5.0)
    assert found.averages[0] < whole.averages[0]
    assert np.abs(found.H / whole.H - 1.0).max() < 0.2
    slow = np.ones((1500, 2), bool)
    slow[1::2, 1] = False
    with pytest.raises(EstimationError, match="decimate to the rate of the slowest sensor"):
        estimate_frequency_response([record(data[:, :1], data[:, 1:], slow)], ("de",), ("q",), window_s=10.0)


def test_what_is_doubtful_is_said():
    rng = np.random.default_rng(7)
    noisy = estimate_frequency_response([flown(rng, 2000, 30.0)], ("de",), ("q",), window_s=10.0)
    assert noisy.status != "good"
    assert any("coherence lies below 0.6" in s for s in noisy.advice)
    few = estimate_frequency_response([flown(rng, 500)], ("de",), ("q",), window_s=10.0)
    assert any("independent averages" in s for s in few.advice)
    u = rng.standard_normal((3000, 1))
    near = np.hstack([u, u + 0.1 * rng.standard_normal(u.shape)])
    alike = estimate_frequency_response(
        [record(near, lfilter(NUM, DEN, u, axis=0))], ("de", "thr"), ("q",), window_s=5.0
    )
    assert any("inputs de, thr are correlated" in s for s in alike.advice)
    with pytest.raises(EstimationError, match="must move independently"):
        estimate_frequency_response([record(np.hstack([u, 2 * u]), u)], ("de", "thr"), ("q",), window_s=5.0)
    with pytest.raises(EstimationError, match="more than 1 independent segments"):
        estimate_frequency_response([flown(rng, 200)], ("de",), ("q",), window_s=10.0)
    with pytest.raises(EstimationError, match="frequencies must increase"):
        estimate_frequency_response([flown(rng, 900)], ("de",), ("q",), window_s=5.0, omega_rad_s=np.array([1.0, 90.0]))
    with pytest.raises(EstimationError, match="overlap < 1"):
        estimate_frequency_response([flown(rng, 900)], ("de",), ("q",), window_s=5.0, overlap=1.0)


def test_units_do_not_matter_and_export():
    rng = np.random.default_rng(8)
    r = flown(rng, 3000, 0.3, m=2)
    found = estimate_frequency_response([r], ("de", "thr"), ("q",), window_s=10.0)
    scaled = r.with_columns({"q": 1e6 * r["q"], "thr": 1e-4 * r["thr"]})
    other = estimate_frequency_response([scaled], ("de", "thr"), ("q",), window_s=10.0)
    assert np.allclose(other.H, found.H * np.array([1e6, 1e10]), rtol=1e-9)
    assert np.allclose(other.random_error, found.random_error, rtol=1e-8)
    frd = found.to_control()
    assert frd.input_labels == ["de", "thr"]
    assert np.allclose(frd.frdata[0, 1], found.H[:, 0, 1])
    assert found.to_dict()["H"]["real"][3] == found.H[3].real.tolist()
    with pytest.raises(EstimationError, match="a band must hold frequencies"):
        found.between(1000.0, 2000.0)
