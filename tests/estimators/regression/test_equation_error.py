"""Equation error: exact data, printed results of the Twin Otter and ATTAS, errors against scatter, refusals, advice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded import flight_data
from regression_systems import DT, TERMS, TRUTH, motion, noise, record, signals, twin_otter

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ChannelError, EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.regression import (
    equation_error,
    frequency_equation_error,
    linear_model,
    regression_data,
    smooth_record,
)

X = motion()
QDOT = X @ TRUTH[:3] + TRUTH[3]
BAND = (0.08, 1.5)
SEEDS = 300


def short_version(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second implementation, by the double sum itself: estimates, plain and corrected covariance."""
    theta = np.linalg.lstsq(X, y, rcond=None)[0]
    v = y - X @ theta
    n = len(y)
    R = np.array([v[: n - lag] @ v[lag:] for lag in range(n)]) / n
    gamma = R[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]
    D = np.linalg.inv(X.T @ X)
    return theta, v @ v / (n - X.shape[1]) * D, D @ X.T @ gamma @ X @ D


def test_exact_data_are_recovered():
    found = equation_error(signals(X, QDOT), "qdot", TERMS)
    assert np.max(np.abs(found.params - TRUTH)) < 1e-10
    assert found.terms == (*TERMS, "1")
    assert found.r2 == pytest.approx(1.0, abs=1e-12)
    assert (found.status, found.advice) == ("good", ())
    without = equation_error(signals(X, QDOT - TRUTH[3]), "qdot", TERMS, bias=False)
    assert np.max(np.abs(without.params - TRUTH[:3])) < 1e-10
    transformed = frequency_equation_error(signals(X, QDOT), "qdot", TERMS, band_hz=BAND)
    assert np.max(np.abs(transformed.params - TRUTH[:3])) < 1e-10


def test_a_second_implementation_agrees():
    y = QDOT + noise(1, len(X), 0.9, 0.02)
    theta, plain, corrected = short_version(np.column_stack([X, np.ones(len(X))]), y)
    found = equation_error(signals(X, y), "qdot", TERMS, finite_record=False)
    assert np.allclose(found.params, theta, rtol=1e-10)
    assert np.allclose(found.std_plain, np.sqrt(np.diag(plain)), rtol=1e-10)
    assert np.allclose(found.covariance, corrected, rtol=1e-8, atol=1e-8 * np.max(np.abs(corrected)))
    assert np.allclose(found.std_corrected**2, np.diag(found.covariance))


@pytest.mark.parametrize(("target", "key"), [("CZ", "Z"), ("Cm", "m")])
def test_the_twin_otter_is_as_printed(target, key):
    flight, mass, _, printed = twin_otter()
    data = regression_data(flight, mass)
    terms = ["alpha", "q_hat", "de"]
    p, s = printed[f"p{key}"][:3], printed[f"serr{key}"][:3]
    # Its mass falls by 1e-4 in the record; taken as constant that moves the estimates by 6e-4 at most.
    plain_formula = equation_error(data, target, terms, finite_record=False)
    assert np.allclose(plain_formula.params[:3], p, rtol=2e-3)
    assert np.allclose(plain_formula.std_corrected[:3], s, rtol=0.01)  # measured: 0.7 %
    found = equation_error(data, target, terms)
    assert np.array_equal(found.params, plain_formula.params)
    assert np.allclose(found.std_corrected[:3], s, rtol=0.15)  # measured: 5 to 13 % above
    assert np.all(s / found.std_plain[:3] > 1.55)  # "1.6 to 3 times too small"
    assert np.all(s / found.std_plain[:3] < 3.1)
    assert found.status == "good"
    assert np.sqrt(np.mean((found.predict(flight) - data[target]) ** 2)) == pytest.approx(found.residual_rms, rel=1e-9)


def test_the_twin_otter_in_the_frequency_domain_agrees():
    flight, mass, _, printed = twin_otter()
    found = frequency_equation_error(regression_data(flight, mass), "Cm", ["alpha", "q_hat", "de"], band_hz=(0.1, 1.5))
    apart = found.params - printed["pm"][:3]
    # Both errors together; 3.5 deviations of three estimates: a false alarm once in 700 if they were independent.
    assert np.all(np.abs(apart) < 3.5 * np.hypot(found.std_corrected, printed["serrm"][:3]))
    assert np.all(np.abs(apart / printed["pm"][:3]) < 0.1)


def attas() -> list[FlightRecord]:
    from scipy.io import loadmat

    folder = flight_data() / "attas"
    out = []
    for name in ("fAttasElv1", "fAttasElv2"):
        if not (folder / f"{name}.mat").is_file():
            pytest.skip(f"the ATTAS record is missing: no {name}.mat in the folder of flight records")
        f = loadmat(folder / f"{name}.mat")[name]
        out.append(FlightRecord(f[:, 0] - f[0, 0], ("alpha", "q", "de"), f[:, [12, 7, 21]] * DEG_RAD, "measured"))
    return out


def test_attas_short_period_from_two_records():
    model = linear_model([regression_data(r) for r in attas()], states=("alpha", "q"), inputs=("de",))
    pole = model.poles()[-1]
    # Printed, by output error: Ma -4.9265, Mq -2.0057, Mde -7.2081; 2.53 rad/s, 0.493. Noise in the terms draws
    # equation error towards zero.
    assert abs(pole) == pytest.approx(2.53, rel=0.03)  # measured 2.499
    assert -pole.real / abs(pole) == pytest.approx(0.493, abs=0.02)  # measured 0.481
    assert model.A[1] == pytest.approx([-4.9265, -2.0057], rel=0.06)
    assert model.B[1, 0] == pytest.approx(-7.2081, rel=0.06)
    assert model.A[0] == pytest.approx([-0.4834, 1.1042], rel=0.06)
    assert model.A_std.shape == (2, 2)
    assert model.B_std[1, 0] > 0.0


@pytest.mark.parametrize("pole", [pytest.param(0.0, marks=pytest.mark.slow), 0.9], ids=["white", "coloured"])
def test_errors_agree_with_the_scatter(pole):
    terms, plain, corrected, printed, band, band_std = [], [], [], [], [], []
    for seed in range(SEEDS):
        data = signals(X, QDOT + noise(seed, len(X), pole, 0.02))
        found = equation_error(data, "qdot", TERMS)
        terms.append(found.params)
        plain.append(found.std_plain)
        corrected.append(found.std_corrected)
        if seed < 100:
            printed.append(equation_error(data, "qdot", TERMS, finite_record=False).std_corrected)
        spectrum = frequency_equation_error(data, "qdot", TERMS, band_hz=BAND, step_hz=0.04)
        band.append(spectrum.params)
        band_std.append(spectrum.std_corrected)
    scatter = np.std(terms, axis=0, ddof=1)

    def rms(x: list[np.ndarray]) -> np.ndarray:
        return np.sqrt(np.mean(np.square(x), axis=0))

    # The deviation of a deviation from 300 is 4.1 %: 0.85 to 1.17 is four of them, false alarm 6e-5 per estimate.
    ratio = scatter / rms(corrected)
    assert np.all((ratio > 0.85) & (ratio < 1.17))  # measured 0.92 to 1.03
    if pole:
        assert np.all(scatter > 3.0 * rms(plain))  # measured 3.5 to 4.4
    else:
        assert np.all(np.abs(scatter / rms(plain) - 1.0) < 0.17)
    # As printed: low for the terms by a tenth, for the constant by half (error of these means 1 %).
    low = rms(printed)[:4] / rms(corrected)
    assert np.all((low[:3] > 0.8) & (low[:3] < 0.98))
    assert low[3] < 0.7
    # In the frequency domain noise need be level within the band, which white noise is; AR(0.9) falls by half in it.
    ratio = np.std(band, axis=0, ddof=1) / rms(band_std)
    assert np.all((ratio > 0.85) & (ratio < (1.3 if pole else 1.17)))  # measured 0.95 to 1.12
    covered = np.mean(np.abs(np.array(terms) - TRUTH) < 1.96 * np.array(corrected), axis=0)
    # 95 % intervals of normal errors; their width is itself estimated. 300 draws have a deviation of 1.3 %.
    assert np.all(covered[:3] > 0.90)
    truth_in_plain = np.mean(np.abs(np.array(terms) - TRUTH) < 1.96 * np.array(plain), axis=0)
    assert np.all(truth_in_plain < 0.6) if pole else np.all(truth_in_plain > 0.9)


def test_uneven_residuals_in_the_band_are_said():
    data = signals(X, QDOT + noise(0, len(X), 0.99, 0.02))
    found = frequency_equation_error(data, "qdot", TERMS, band_hz=(0.08, 5.0))
    assert any("stronger in the lower half" in sentence for sentence in found.advice)


def test_several_records_are_one_sum():
    y = QDOT + noise(3, len(X), 0.9, 0.02)
    whole = signals(X, y)
    parts = [regression_data(record(X, y).between(0.0, 5.0)), regression_data(record(X, y).between(5.0, 99.0))]
    apart = equation_error(parts, "qdot", TERMS)
    together = equation_error(whole, "qdot", TERMS)
    assert np.allclose(apart.params, together.params, rtol=1e-10)
    assert np.allclose(apart.std_plain, together.std_plain, rtol=1e-10)
    assert np.allclose(apart.std_corrected, together.std_corrected, rtol=0.3)  # lags end at the joint
    assert apart.samples == together.samples == len(X)
    double = frequency_equation_error([whole, whole], "qdot", TERMS, band_hz=BAND)
    single = frequency_equation_error(whole, "qdot", TERMS, band_hz=BAND)
    assert np.allclose(double.params, single.params, rtol=1e-10)
    lines = single.samples
    assert np.allclose(double.std_corrected, single.std_corrected * np.sqrt((lines - 3) / (2 * lines - 3)), rtol=1e-9)


def test_samples_that_were_not_taken_do_not_count():
    valid = np.ones((len(X), 4), bool)
    valid[100:140, 1] = False
    valid[300:310, 3] = False
    y = QDOT + noise(4, len(X), 0.5, 0.02)
    spoilt, spoilt_y = X.copy(), y.copy()
    spoilt[100:140, 1] = 7.0
    spoilt_y[300:310] = -50.0
    used = valid.all(axis=1)
    found = equation_error(signals(spoilt, spoilt_y, valid), "qdot", TERMS)
    theta, plain, _ = short_version(np.column_stack([X, np.ones(len(X))])[used], y[used])
    assert np.allclose(found.params, theta, rtol=1e-10)
    assert np.allclose(found.std_plain, np.sqrt(np.diag(plain)), rtol=1e-10)
    assert found.samples == used.sum()
    spectrum = frequency_equation_error(signals(spoilt, spoilt_y, valid), "qdot", TERMS, band_hz=BAND)
    assert any("8 % of the samples were not taken" in sentence for sentence in spectrum.advice)


def test_order_and_units_change_nothing():
    y = QDOT + noise(5, len(X), 0.9, 0.02)
    found = equation_error(signals(X, y), "qdot", TERMS)
    flight = record(X, y)
    shuffled = equation_error(
        regression_data(flight.select(("qdot", "de", "q", "alpha"))), "qdot", ["de", "alpha", "q"]
    )
    for term in (*TERMS, "1"):
        assert shuffled[term] == pytest.approx(found[term], rel=1e-10)
        assert shuffled.std(term) == pytest.approx(found.std(term), rel=1e-10)
    scale = np.array([1e6, 1e-6, 57.3])
    scaled = equation_error(signals(X * scale, y), "qdot", TERMS)
    assert np.allclose(scaled.params[:3] * scale, found.params[:3], rtol=1e-9)
    assert np.allclose(scaled.std_corrected[:3] * scale, found.std_corrected[:3], rtol=1e-9)
    assert np.allclose(scaled.vif, found.vif, rtol=1e-9)
    again = equation_error(signals(X, y), "qdot", TERMS)
    assert again.covariance.tobytes() == found.covariance.tobytes()


def test_dependent_terms_are_refused_by_name():
    tied = X.copy()
    tied[:, 2] = 3.0 * tied[:, 0] - 0.5 * tied[:, 1] + 0.01
    for fit in (
        lambda d: equation_error(d, "qdot", [*TERMS, "alpha^2"]),
        lambda d: frequency_equation_error(d, "qdot", [*TERMS, "alpha^2"], band_hz=BAND),
    ):
        with pytest.raises(EstimationError, match="alpha, q, de depend on each other") as error:
            fit(signals(tied, QDOT))
        assert "alpha^2" not in str(error.value)
    still = X.copy()
    still[:, 2] = 0.1
    with pytest.raises(EstimationError, match="'de' never moves"):
        equation_error(signals(still, QDOT), "qdot", TERMS)


def test_a_prior_decides_what_the_data_cannot():
    tied = X.copy()
    tied[:, 2] = 2.0 * tied[:, 0]
    y = tied @ TRUTH[:3] + TRUTH[3] + noise(6, len(X), 0.0, 0.02)
    found = equation_error(signals(tied, y), "qdot", TERMS, prior={"de": (-9.0, 0.1)})
    assert found["de"] == pytest.approx(-9.0, abs=1e-6)
    assert found.std("de") == pytest.approx(0.1, rel=1e-3)
    assert found["alpha"] == pytest.approx(-8.0, abs=5.0 * found.std("alpha"))
    assert found.std("alpha") > 0.19  # twice the prior's, through the tie
    assert any("nearly a combination" in sentence for sentence in found.advice)


def test_a_prior_weighs_as_an_independent_measurement():
    y = QDOT + noise(7, len(X), 0.0, 0.02)
    free = equation_error(signals(X, y), "qdot", TERMS)
    i, std = 1, free.std("q")
    held = equation_error(signals(X, y), "qdot", TERMS, prior={"q": (free["q"] + std, std)})
    # White noise: the mean of two measurements of equal error, up to how far the two estimates of that error agree.
    assert held["q"] == pytest.approx(free["q"] + 0.5 * std, abs=0.06 * std)
    assert held.std_corrected[i] == pytest.approx(std / np.sqrt(2.0), rel=0.1)
    far = equation_error(signals(X, y), "qdot", TERMS, prior={"q": (free["q"] + 20 * std, std)})
    assert any("data and prior differ" in sentence for sentence in far.advice)
    loose = equation_error(signals(X, y), "qdot", TERMS, prior={"q": (0.0, 1e6)})
    assert np.allclose(loose.params, free.params, rtol=1e-8)


def test_noise_in_a_term_is_said_and_smoothing_helps():
    errors, smoothed, said = [], [], 0
    for seed in range(20):
        noisy = X.copy()
        noisy[:, 0] += noise(seed, len(X), 0.0, 0.35 * X[:, 0].std())
        flight = record(noisy, QDOT)
        found = equation_error(regression_data(flight), "qdot", TERMS)
        said += any(sentence.startswith("alpha: noise in the signal") for sentence in found.advice)
        errors.append(found["alpha"] - TRUTH[0])
        calm = equation_error(regression_data(smooth_record(flight, ("alpha",))), "qdot", TERMS)
        smoothed.append(calm["alpha"] - TRUTH[0])
    assert said == 20
    bias = np.mean(errors)
    # noise / variance = 0.12, times a variance inflation of 1.2, of 8 per rad: towards zero by about 1
    assert 0.5 < bias < 1.8
    assert abs(np.mean(smoothed)) < 0.2 * bias


def test_nearly_dependent_and_undecided_terms_are_said():
    y = QDOT + noise(8, len(X), 0.0, 0.02)
    near = X.copy()
    near[:, 2] = X[:, 0] * 1.5 + 0.05 * X[:, 2]
    found = equation_error(signals(near, y), "qdot", TERMS)
    assert any("variance inflation" in sentence and sentence.startswith("de") for sentence in found.advice)
    assert found.vif[2] > 10.0
    weak = equation_error(signals(X, noise(9, len(X), 0.0, 0.5)), "qdot", TERMS)
    assert weak.status != "good"
    assert any("within two standard errors" in sentence for sentence in weak.advice)
    assert any("explain" in sentence for sentence in weak.advice)
    assert np.all(np.isfinite(weak.t_statistics))


def test_the_result_predicts_and_becomes_json():
    import json

    found = equation_error(signals(X, QDOT), "qdot", TERMS)
    other = motion(300, size=-0.02)
    assert np.allclose(found.predict(record(other, np.zeros(300))), other @ TRUTH[:3] + TRUTH[3], atol=1e-10)
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["params"]["q"] == pytest.approx(-2.0)
    assert content["recipe"]["mass"] is None
    with pytest.raises(ValueError, match="read-only"):
        found.params[0] = 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda d: equation_error([], "qdot", TERMS), "at least one record"),
        (lambda d: equation_error(d, "qdot", []), "at least one term"),
        (lambda d: equation_error(d, "qdot", ["alpha*q", "q*alpha"]), "the same product"),
        (lambda d: equation_error(d, "qdot", ["alpha+q"]), "product of powers"),
        (lambda d: equation_error(d, "qdot", ["alpha", "qdot*de"]), "must not explain itself"),
        (lambda d: equation_error(d, "qdot", TERMS, prior={"p": (0.0, 1.0)}), "must be on a term"),
        (lambda d: equation_error(d, "qdot", TERMS, prior={"q": (0.0, 0.0)}), "standard deviation > 0"),
        (lambda d: frequency_equation_error(d, "qdot", TERMS, band_hz=(0.0, 1.0)), "0 < low < high"),
        (lambda d: frequency_equation_error(d, "qdot", TERMS, band_hz=(0.1, 30.0)), "Nyquist frequency = 25 Hz"),
        (lambda d: frequency_equation_error(d, "qdot", TERMS, band_hz=(0.1, 0.2)), "too few"),
        (lambda d: frequency_equation_error(d, "qdot", TERMS, band_hz=(0.09, 0.1)), "no multiple"),
        (lambda d: linear_model(d, states=("theta",), inputs=("de",)), "states must be some of"),
        (lambda d: equation_error(d, "qdot", TERMS)["beta"], "must be one of alpha"),
    ],
)
def test_what_cannot_be_regressed_is_refused(call, message):
    with pytest.raises(EstimationError, match=message):
        call(signals(X, QDOT))


def test_records_that_cannot_be_used_are_refused():
    with pytest.raises(EstimationError, match="measured records only"):
        regression_data(replace(record(X, QDOT), kind="truth"))
    with pytest.raises(EstimationError, match="twice as many samples"):
        equation_error(signals(X[:7], QDOT[:7]), "qdot", TERMS)
    slow = FlightRecord(np.arange(600) * 2 * DT, (*TERMS, "qdot"), np.column_stack([X, QDOT]), "measured")
    with pytest.raises(EstimationError, match="share one sample time"):
        equation_error([signals(X, QDOT), regression_data(slow)], "qdot", TERMS)
    with pytest.raises(ChannelError, match="'Cm' needs mass properties"):
        equation_error(signals(X, QDOT), "Cm", TERMS)
