"""The algebra of pooling: exact data, a second way to compute it, scatter against errors, false alarms, priors."""

import json

import numpy as np
import pytest
from scipy.stats import binom

import testbench as tb
from testbench.core.errors import EstimationError, RecordError
from testbench.pooling.least_squares import Trend, fit
from testbench.pooling.pool import CRITERIA
from testbench.pooling.prior import prior_of_file

NAMES = ("Cm_alpha", "Cm_q", "Cm_de", "CZ_alpha")
TRUE = np.array([-0.7, -12.0, -0.85, -4.6])
RELATIVE = np.array([0.02, 0.05, 0.01, 0.01])
SPEEDS = (10.0, 10.3, 14.0, 14.2, 18.0, 18.3)


def covariance(rng: np.random.Generator) -> np.ndarray:
    """A covariance with errors of some per cent and correlations up to 0.7."""
    A = np.eye(4) + 0.4 * rng.standard_normal((4, 4))
    C = A @ A.T
    size = np.abs(TRUE) * RELATIVE * rng.uniform(0.5, 2.0, 4) / np.sqrt(np.diag(C))
    return C * np.outer(size, size)


def logs(rng, slopes=(0.0,) * 4, speeds=SPEEDS, scatter=0.0, exact=False):
    out = []
    for i, V in enumerate(speeds):
        P = covariance(rng)
        y = TRUE + np.array(slopes) * (V - np.mean(speeds))
        y = y * (1.0 + scatter * rng.standard_normal(4))
        y = y if exact else rng.multivariate_normal(y, P)
        out.append(tb.LogCoefficients(f"day{i}", NAMES, y, P, {"V": V, "qbar": 0.6 * V**2}))
    return out


def test_exact_logs_give_the_coefficients_and_slopes_exactly():
    slopes = (0.01, 0.0, -0.02, 0.0)
    found = tb.pool(logs(np.random.default_rng(1), slopes, exact=True), trend="V")
    assert found.trend.reference == pytest.approx(np.mean(SPEEDS), rel=1e-14)
    assert found.chi2 < 1e-12
    for i, name in enumerate(NAMES):
        c = found.coefficient(name)
        assert c.value == pytest.approx(TRUE[i], rel=1e-10)
        if slopes[i]:
            assert c.slope == pytest.approx(slopes[i], rel=1e-8)
        x = 17.0
        assert found.at(name, x)[0] == pytest.approx(TRUE[i] + slopes[i] * (x - np.mean(SPEEDS)), rel=1e-8)


def test_it_is_the_least_squares_of_all_whitened_logs_at_once():
    """A second way: one tall system, each log whitened by the Cholesky factor of its covariance."""
    given = logs(np.random.default_rng(2))
    trend = Trend("V", 14.0, ("Cm_q",))
    tall, right = [], []
    for log in given:
        H = np.column_stack([np.eye(4), np.eye(4)[:, 1] * (log.at["V"] - 14.0)])
        L = np.linalg.cholesky(log.covariance)
        tall.append(np.linalg.solve(L, H))
        right.append(np.linalg.solve(L, log.values))
    A, y = np.vstack(tall), np.concatenate(right)
    b, chi2 = np.linalg.lstsq(A, y, rcond=None)[:2]
    found = fit(given, trend)
    np.testing.assert_allclose(found.b, b, rtol=1e-9)
    assert found.chi2 == pytest.approx(chi2[0], rel=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(A.T @ A), rtol=1e-7)
    assert found.dof == len(y) - 5


def test_scatter_agrees_with_errors_and_false_alarms_are_those_admitted():
    """300 draws of six logs that agree: each check fails by chance in less than 1e-3 of all runs."""
    rng, n = np.random.default_rng(3), 300
    off, alarms, trends = [], 0, 0
    for _ in range(n):
        found = tb.pool(logs(rng))
        alarms += not found.agree
        trends += bool(found.trend.names)
        off.append([(c.value - t) / c.own_std for c, t in zip(found.coefficients, TRUE, strict=True)])
    spread = np.std(off, axis=0)
    assert np.all(np.abs(spread - 1.0) < 4.0 / np.sqrt(2.0 * n)), spread
    assert np.all(np.abs(np.mean(off, axis=0)) < 4.0 / np.sqrt(n))
    most = binom.isf(5e-4, n, CRITERIA.agree)
    assert alarms <= most
    assert trends <= binom.isf(5e-4, n, CRITERIA.trend)


def test_chi_square_has_its_false_alarm_rate():
    """Without a choice of slopes the rate is exact: 400 draws at 5 %, with 5e-4 on both sides."""
    rng, n = np.random.default_rng(4), 400
    P = [covariance(rng) for _ in SPEEDS[:3]]
    alarms = 0
    for _ in range(n):
        given = [tb.LogCoefficients("a", NAMES, rng.multivariate_normal(TRUE, C), C, {}) for C in P]
        alarms += tb.pool(given, trend="none").chance < 0.05
    assert binom.ppf(5e-4, n, 0.05) <= alarms <= binom.isf(5e-4, n, 0.05)


def test_a_trend_that_is_there_is_found_and_the_others_stay_constant():
    rng = np.random.default_rng(5)
    found = [tb.pool(logs(rng, (0.015, 0.0, 0.0, 0.0))) for _ in range(20)]
    assert sum(f.trend.names == ("Cm_alpha",) for f in found) >= 18  # slope of 9 errors; another by chance in 1 %
    c = found[0].coefficient("Cm_alpha")
    per = (
        c.slope if found[0].trend.variable == "V" else c.slope * 2.0 * 0.6 * found[0].trend.reference ** 0.5 / 0.6**0.5
    )
    assert per == pytest.approx(0.015, abs=0.006)


def test_errors_that_are_too_small_are_no_trend_but_a_disagreement():
    """Scatter of 5 % in every coefficient, errors of 1 to 5 %: 20 sets; chi-square alone would find slopes in most."""
    rng = np.random.default_rng(6)
    found = [tb.pool(logs(rng, scatter=0.05)) for _ in range(20)]
    assert sum(bool(f.trend.names) for f in found) <= 2
    assert all(not f.agree for f in found)
    off = np.array([[(c.value - t) / c.std for c, t in zip(f.coefficients, TRUE, strict=True)] for f in found])
    assert 0.7 < np.std(off) < 1.4  # 80 values, correlated within a set
    assert all(c.std >= c.own_std for f in found for c in f.coefficients)


@pytest.mark.parametrize(("slope", "asked"), [(0.0, "none"), (0.01, "auto")])
def test_the_log_that_lies_apart_is_named_and_kept(slope, asked):
    """Of logs with a trend, too: the others show it without the one that hides it."""
    rng = np.random.default_rng(7)
    given = logs(rng, (slope, 0.0, 0.0, 0.0))
    bad = given[2]
    given[2] = tb.LogCoefficients(bad.log, bad.names, bad.values * 1.15, bad.covariance, bad.at)
    found = tb.pool(given, trend=asked)
    assert not found.agree
    assert found.disagreement.outlying == "day2"
    assert len(found.logs) == 6


def test_a_wrong_airspeed_is_among_the_causes_with_its_sign():
    rng = np.random.default_rng(8)
    given, names = [], (*NAMES[:1], "Cm_q", *NAMES[2:])
    for i, d in enumerate((0.0, 0.04, 0.0, -0.04, 0.0)):  # recorded airspeed too large by d
        P = covariance(rng) * 0.1
        share = np.array([-2.0, -1.0, -2.0, -2.0])
        y = rng.multivariate_normal(TRUE * (1.0 + share * d), P)
        given.append(tb.LogCoefficients(f"day{i}", names, y, P, {"V": 12.0 + i}))
    found = tb.pool(given, trend="none")
    causes = {c.what: c for c in found.disagreement.causes}
    assert "airspeed" in causes
    assert "pitch inertia" not in causes  # forces are off, too
    assert causes["airspeed"].deviations["day1"] == pytest.approx(0.04, abs=0.015)
    assert causes["airspeed"].deviations["day3"] == pytest.approx(-0.04, abs=0.015)


def test_a_log_without_a_coefficient_says_nothing_of_it():
    rng = np.random.default_rng(9)
    a, b = logs(rng, speeds=(10.0, 14.0))
    part = tb.LogCoefficients("b", NAMES[:2], b.values[:2], b.covariance[:2, :2], b.at)
    found = tb.pool([a, part], trend="none")
    assert [c.logs for c in found.coefficients] == [2, 2, 1, 1]
    alone = tb.LogCoefficients("c", ("Cl_p",), np.array([-0.4]), np.array([[1e-4]]), {"V": 12.0})
    both = tb.pool([a, alone])
    assert both.dof == 0
    assert both.agree
    assert both.coefficient("Cl_p").std == pytest.approx(0.01)


def test_a_prior_is_one_more_information_matrix():
    rng = np.random.default_rng(10)
    given = logs(rng)
    C = covariance(rng) * 4.0
    prior = tb.Prior(NAMES, TRUE * 1.01, C, "handbook")
    found = tb.pool(given, prior, "none")
    as_log = fit([*given, tb.LogCoefficients("prior", NAMES, TRUE * 1.01, C, {})])
    np.testing.assert_allclose([c.posterior for c in found.coefficients], as_log.b, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, as_log.covariance, rtol=1e-7)
    for i, c in enumerate(found.coefficients):
        assert c.value == pytest.approx(fit(given).b[i])
        assert c.added == pytest.approx(1.0 - found.covariance[i, i] / C[i, i])
        assert c.bits == pytest.approx(0.5 * np.log2(C[i, i] / found.covariance[i, i]))


def test_an_earlier_pooling_is_a_prior_at_the_condition_of_the_later_logs(tmp_path):
    rng = np.random.default_rng(14)
    first = tb.pool(logs(rng, (0.015, 0.0, -0.4, 0.0)), trend="V")
    assert set(first.trend.names) == {"Cm_alpha", "Cm_de"}
    (tmp_path / "pooled.json").write_text(json.dumps(first.written()))
    later = prior_of_file(tmp_path / "pooled.json", {"V": 20.0})
    for name, value, variance in zip(later.names, later.values, np.diag(later.covariance), strict=True):
        assert (value, variance**0.5) == pytest.approx(first.at(name, 20.0), rel=1e-9)
    there = prior_of_file(tmp_path / "pooled.json")
    assert there.values == pytest.approx([c.posterior for c in first.coefficients])
    (tmp_path / "pooled.json").write_text('{"coefficients": {}}')
    with pytest.raises(RecordError, match=r"must be the pooled\.json"):
        prior_of_file(tmp_path / "pooled.json")


def test_prior_and_data_that_contradict_each_other_are_named():
    given = logs(np.random.default_rng(11))
    prior = tb.Prior(("Cm_q", "Cl_p"), np.array([-20.0, -0.4]), np.diag([1.0, 0.01]), "handbook")
    found = tb.pool(given, prior)
    assert [c.name for c in found.in_conflict] == ["Cm_q"]
    assert found.coefficient("Cm_q").distance > 3.0
    assert found.coefficient("Cm_alpha").added is None


def test_data_and_prior_that_agree_contradict_each_other_in_3_of_1000():
    """300 draws of a prior with its own deviation: at most 5 conflicts but for 3e-4 of all runs (chance 0.27 %)."""
    rng, conflicts = np.random.default_rng(12), 0
    P, W = covariance(rng), covariance(rng)
    for _ in range(300):
        log = tb.LogCoefficients("a", NAMES, rng.multivariate_normal(TRUE, P), P, {})
        prior = tb.Prior(NAMES[:1], rng.normal(TRUE[:1], np.sqrt(W[0, 0])), W[:1, :1], "handbook")
        conflicts += bool(tb.pool([log], prior).in_conflict)
    assert conflicts <= 5


@pytest.mark.parametrize(
    ("values", "covariance_", "words"),
    [
        ([1.0, np.nan], np.eye(2), "finite"),
        ([1.0, 2.0], np.zeros((2, 2)), "errors > 0"),
        ([1.0, 2.0], np.ones((2, 2)), "stand for one another"),
        ([1.0], np.eye(2), "one value"),
    ],
)
def test_a_log_that_cannot_be_pooled_is_refused_by_name(values, covariance_, words):
    with pytest.raises(EstimationError, match=words) as raised:
        tb.LogCoefficients("day7", ("Cm_alpha", "Cm_q"), np.array(values), covariance_, {})
    assert "day7" in str(raised.value)


def test_refusals_say_what_is_missing():
    a, b = logs(np.random.default_rng(13), speeds=(10.0, 14.0))
    with pytest.raises(EstimationError, match=r"alpha .*not known of day0, day1"):
        tb.pool([a, b], trend="alpha")
    with pytest.raises(EstimationError, match="got none"):
        tb.pool([])
    with pytest.raises(EstimationError, match="positive definite"):
        tb.Prior(("Cm_q", "Cm_alpha"), np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]]), "me")
