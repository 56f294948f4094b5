"""Pooling of one or two coefficients, each number worked out by hand: between, factor, prior, trend, causes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import testbench as tb
from testbench.aircraft.model import MassProperties
from testbench.evaluation.coefficients import Scaling
from testbench.page.figure import Area
from testbench.pooling import least_squares, scales
from testbench.pooling.least_squares import Trend, _chance_by_scatter, _conditions, best_trend, fit
from testbench.pooling.pool import CRITERIA, PooledCoefficient, added, disagreement
from testbench.questions.identify.pool import answer, page


def log(name, values, std, at=None, names=("Cm_alpha",)):
    values = np.atleast_1d(np.array(values, float))
    std = np.broadcast_to(std, values.shape)
    return tb.LogCoefficients(name, names[: len(values)], values, np.diag(std**2), at or {})


def line(values, std=0.1, speeds=None, names=("Cm_alpha",)):
    at = [{}] * len(values) if speeds is None else [{"V": v} for v in speeds]
    return [log(f"day {i}", v, std, a, names) for i, (v, a) in enumerate(zip(values, at, strict=True))]


def test_between_is_the_scatter_less_what_the_errors_explain():
    """Of logs of one error v: sum (y - mean)^2 / (v + B^2) = n - 1, so that B^2 is the sample variance less v."""
    y = [0.0, 1.0, 2.0, 5.0]
    found = tb.pool(line(y, 0.1), trend="none")
    between = math.sqrt(np.var(y, ddof=1) - 0.1**2)
    c = found.coefficient("Cm_alpha")
    assert (c.logs, c.value) == (4, pytest.approx(2.0))
    assert c.between == pytest.approx(between, rel=1e-9)
    assert c.own_std == pytest.approx(0.1 / 2.0)
    assert c.std == pytest.approx(math.hypot(between, 0.1) / 2.0)  # what is missing stands in the error
    assert (found.factor, found.dof, found.chi2) == (1.0, 3, pytest.approx(14.0 / 0.01))


def test_between_of_errors_that_differ_makes_the_weighted_squares_what_they_should_be():
    y, v = np.array([0.0, 3.0, 1.0]), np.array([0.2, 0.5, 0.1]) ** 2
    logs = [log(f"{i}", a, math.sqrt(b)) for i, (a, b) in enumerate(zip(y, v, strict=True))]
    B = disagreement(logs, fit(logs), "none", CRITERIA.agree, CRITERIA.trend).between["Cm_alpha"]
    w = 1.0 / (v + B**2)
    mean = w @ y / w.sum()
    assert w @ (y - mean) ** 2 == pytest.approx(2.0, rel=1e-9)
    assert [e.tolist() for e in added(logs[:1], {"Cm_alpha": B})] == [[[pytest.approx(B**2)]]]


def test_between_about_a_slope_counts_one_degree_of_freedom_less():
    y, V = np.array([0.0, 3.0, 3.0, 6.0]), np.array([10.0, 12.0, 14.0, 16.0])
    logs, trend = line(y, 0.1, V), Trend("V", 13.0, ("Cm_alpha",))
    left = y - np.polyval(np.polyfit(V, y, 1), V)
    B = disagreement(logs, fit(logs, trend), "V", CRITERIA.agree, CRITERIA.trend).between["Cm_alpha"]
    assert pytest.approx(math.sqrt(left @ left / 2.0 - 0.01), rel=1e-9) == B


def test_what_agrees_or_stands_alone_has_nothing_between():
    both = ("Cm_alpha", "Cm_q")
    logs = [log("a", [0.0, 1.0], 0.1, names=both), log("b", [5.0, 1.1], 0.1, names=both), log("c", 0.1, 0.1)]
    found = disagreement(logs, fit(logs), "none", CRITERIA.agree, CRITERIA.trend)
    assert list(found.between) == ["Cm_alpha"]
    assert found.outlying == "b"
    assert disagreement(logs[:1], fit(logs[:1]), "none", 0.01, 0.01).between == {}


def test_the_outlying_log_is_the_one_that_the_others_do_not_predict():
    """Of n logs the one left out is judged at 1 % over n: for three, off by 2.94 of the error of its difference."""
    for off, said in ((2.90, ""), (2.99, "day 2")):
        away = off * math.sqrt(0.01 + 0.01 / 2.0)
        logs = line([0.0, 0.0, away])
        assert disagreement(logs, fit(logs), "none", 0.01, 0.01).outlying == said


def test_correlated_errors_that_no_scatter_of_single_coefficients_explains_take_a_factor():
    """Each coefficient scatters as its error says, the difference of both, known to a tenth of it, does not."""
    P = np.array([[1.0, 0.995], [0.995, 1.0]])
    names = ("Cm_alpha", "Cm_q")
    logs = [tb.LogCoefficients(n, names, np.array(y), P, {}) for n, y in (("a", [0.5, -0.5]), ("b", [-0.5, 0.5]))]
    found = tb.pool(logs, trend="none")
    chi2 = 2.0 * 2.0 * 0.5**2 / 0.005
    assert (found.chi2, found.dof) == (pytest.approx(chi2), 2)
    assert found.factor == pytest.approx(math.sqrt(chi2 / 2.0))
    c = found.coefficient("Cm_q")
    assert (c.between, c.std) == (0.0, pytest.approx(found.factor * math.sqrt(0.5)))


def test_a_prior_of_one_coefficient_is_a_weighted_mean():
    prior = tb.Prior(("Cm_q", "Cm_alpha"), np.array([9.0, 1.0]), np.diag([4.0, 0.09]), "handbook")
    c = tb.pool(line([0.0, 0.1], 0.2), prior, trend="none").coefficient("Cm_alpha")
    w, p = 2.0 / 0.04, 1.0 / 0.09
    assert (c.prior, c.prior_std) == (1.0, pytest.approx(0.3))
    assert c.posterior == pytest.approx((0.05 * w + 1.0 * p) / (w + p))
    assert c.posterior_std == pytest.approx((w + p) ** -0.5)


def coefficient(value=1.0, std=0.4, prior=0.5, prior_std=0.3, shared=None):
    return PooledCoefficient(
        "Cm_q", 2, value, std, std, 0.0, None, None, prior, prior_std, 0.8, 0.15, None, None, shared or {}
    )


def test_what_is_told_of_one_coefficient():
    c = coefficient(shared={"mass": 0.18, "airspeed": 0.24})
    assert c.shared_std == pytest.approx(0.3)
    assert c.mostly == ""  # 0.24^2 is 36 % of 0.4^2
    assert coefficient(shared={"mass": 0.1, "airspeed": 0.29}).mostly == "airspeed"
    assert (c.added, c.bits) == (pytest.approx(0.75), pytest.approx(1.0))
    assert c.distance == pytest.approx(1.0)
    assert not coefficient(value=1.99).in_conflict  # 2.98 standard deviations of the difference
    assert coefficient(value=2.01).in_conflict
    assert coefficient(value=-1.01).in_conflict
    bare = coefficient(prior=None, prior_std=None)
    assert (bare.added, bare.bits, bare.distance, bare.in_conflict) == (None, None, None, False)


def test_conditions_are_apart_by_a_tenth_of_the_range_that_they_must_have():
    def count(*speeds):
        return _conditions(line([0.0] * len(speeds), speeds=speeds), "Cm_alpha", "V")

    assert count(10.0, 10.4) == 1  # less than a twentieth of the largest
    assert count(10.0, 11.0) == 2
    assert count(10.0, 12.0, 20.0) == 3
    assert count(10.0, 10.9, 20.0) == 2
    turned = [log(str(a), 0.0, 0.1, {"alpha": a}) for a in (-0.006, 0.003)]
    assert _conditions(turned, "Cm_alpha", "alpha") == 1  # a hundredth of a radian at least
    assert _conditions([*turned, log("c", 0.0, 0.1, {"alpha": 0.1})], "Cm_alpha", "alpha") == 2


def test_a_slope_is_kept_where_chance_makes_it_in_less_than_the_level():
    """Speeds at -4, 0, 4 about the mean, errors of 0.1: a slope b has a chi-square of b^2 32 / 0.01."""
    for chi2, kept in ((6.4, False), (6.9, True)):  # 6.63 in 1 %
        b = math.sqrt(chi2 * 0.01 / 32.0)
        found = best_trend(line([-4.0 * b, 0.0, 4.0 * b], 0.1, (12.0, 16.0, 20.0)), "V", 0.01)
        assert bool(found.trend.names) is kept
    assert (found.trend.variable, found.trend.reference) == ("V", 16.0)
    assert found.b == pytest.approx([0.0, b])


def test_of_two_variables_each_slope_more_must_save_two_in_chi_square(monkeypatch):
    at = [{"V": 10.0, "qbar": 60.0}, {"V": 20.0, "qbar": 240.0}]
    logs = [log(f"day {i}", y, 0.1, a) for i, (y, a) in enumerate(zip((0.0, 9.0), at, strict=True))]
    for two, taken in ((7.9, "qbar"), (8.1, "V")):
        tried = {"V": (10.0, ("a",)), "qbar": (two, ("a", "b"))}
        monkeypatch.setattr(
            least_squares, "_forward", lambda logs, flat, variable, level, tried=tried: SimpleNamespace(
                chi2=tried[variable][0], trend=Trend(variable, 0.0, tried[variable][1])
            ),
        )  # fmt: skip
        assert best_trend(logs, "auto", 0.01).trend.variable == taken


def test_errors_are_trusted_unless_the_scatter_about_all_slopes_has_a_chance_below_one_in_twenty():
    """Chi-square of the slope is 9, 0.3 % by chance; of the rest 5.63 (6 % for two) or 6.2 (4.5 %), F(1, 2) about 3."""
    x, rest = np.array([-3.0, -1.0, 1.0, 3.0]), np.array([1.0, -1.0, -1.0, 1.0])
    for chi2, kept in ((5.63, True), (6.2, False)):
        y = 0.1 * (math.sqrt(9.0 / 20.0) * x + math.sqrt(chi2 / 4.0) * rest)
        assert bool(best_trend(line(y, 0.1, 13.0 + x), "V", 0.01).trend.names) is kept


def test_the_f_test_against_the_scatter_of_the_coefficient_alone():
    """y = 0, 1, 0, 3 at -3, -1, 1, 3: slope 0.4, chi-square of the line 2.8 of 6; F(1, 2) = 3.2 / 1.4."""
    logs = line([0.0, 1.0, 0.0, 3.0], 1.0, (10.0, 12.0, 14.0, 16.0))
    F = 3.2 / 1.4
    assert _chance_by_scatter(logs, "Cm_alpha", "V", 13.0) == pytest.approx(1.0 - math.sqrt(F / (2.0 + F)))
    exact = line([0.0, 0.0, 0.0, 0.0], 1.0, (10.0, 12.0, 14.0, 16.0))
    assert _chance_by_scatter(exact, "Cm_alpha", "V", 13.0) == 0.0


@pytest.mark.parametrize(("size", "airspeed"), [(0.01, 0.01), (0.02, 0.01), (0.05, 0.05), (0.1, 0.05), (0.2, 0.1)])
def test_a_cause_is_told_with_the_least_size_that_explains_the_scatter(size, airspeed):
    """Errors of 2, -2, 1 and -1 sizes: chi-square is 10, and 40 at half the size; of airspeed half as much does."""
    errors = size * np.array([2.0, -2.0, 1.0, -1.0])
    logs = [log(f"day {i}", [5.0 * (1.0 + d)], 5e-3, names=("CZ_alpha",)) for i, d in enumerate(errors)]
    causes = disagreement(logs, fit(logs), "none", 0.01, 0.01).causes
    told = {c.what: c.size for c in causes}
    assert told == {"airspeed": airspeed, "mass": size, "mass and inertia alike": size}


def test_an_error_of_airspeed_moves_coefficients_by_angles_twice_as_far_as_those_by_rates():
    names, true = ("Cm_alpha", "Cm_q", "CZ_alpha"), np.array([-1.0, -10.0, -5.0])
    errors = np.array([0.04, -0.04, 0.02, -0.02])
    logs = [
        log(f"day {i}", true * (1.0 + np.array([-2.0, -1.0, -2.0]) * d), np.abs(true) * 1e-3, names=names)
        for i, d in enumerate(errors)
    ]
    cause = disagreement(logs, fit(logs), "none", 0.01, 0.01).causes[0]
    assert (cause.what, cause.size) == ("airspeed", 0.02)
    np.testing.assert_allclose(list(cause.deviations.values()), errors, atol=2e-3)
    heavy = [
        log(f"day {i}", true * (1.0 + np.array([0.0, 0.0, 1.0]) * d), np.abs(true) * 1e-3, names=names)
        for i, d in enumerate(errors)
    ]
    assert disagreement(heavy, fit(heavy), "none", 0.01, 0.01).causes[0].what == "mass"


def test_pooling_itself_admits_one_trend_by_chance_in_a_hundred():
    for chi2, kept in ((6.4, False), (6.9, True)):
        b = math.sqrt(chi2 * 0.01 / 32.0)
        found = tb.pool(line([-4.0 * b, 0.0, 4.0 * b], 0.1, (12.0, 16.0, 20.0)), trend="V")
        assert bool(found.trend.names) is kept


def test_pooling_itself_says_of_one_agreeing_set_in_a_hundred_that_it_does_not():
    for chi2, agree in ((6.4, True), (6.9, False)):
        assert tb.pool(line([0.0, math.sqrt(2.0 * chi2 * 0.01)], 0.1), trend="none").agree is agree


def test_the_answer_names_the_shared_error_and_a_third_condition():
    c = coefficient(shared={"mass": 0.1, "airspeed": 0.29})
    (said,) = answer._shared(SimpleNamespace(coefficients=(c,), scale_uncertainty={"airspeed": 0.02}))
    assert "of airspeed, 2 %, causes most of the variance of Cm_q (53 %)" in said.text.replace("\u00a0", " ")
    for logs, told in ((2, True), (3, False)):
        pooled = SimpleNamespace(trend=Trend(), logs=range(logs))
        assert ("fly a third condition" in answer._causes(pooled, ())) is told


def test_the_figure_draws_the_pooled_value_with_its_interval():
    pooled = tb.pool(line([0.0, 0.2], 0.1, (10.0, 20.0)), trend="none")
    (plate,) = page.pool_plates(SimpleNamespace(pooled=pooled))
    panel = next(p for p in plate.chart.panels if p.title == "Cm_alpha")
    (band,) = (d for d in panel.draws if isinstance(d, Area))
    y = np.asarray(band.outlines[0][1])
    std = 0.1 / math.sqrt(2.0)
    assert (y.min(), y.max()) == (pytest.approx(0.1 - 1.96 * std, abs=1e-3), pytest.approx(0.1 + 1.96 * std, abs=1e-3))


def test_what_an_error_of_a_quantity_makes_of_the_scaling():
    mass = MassProperties(2.0, 0.1, 0.2, 0.3, 0.01)
    given = Scaling(12.0, 80.0, None, mass)
    assert scales.scaled(given, "airspeed", math.log(2.0)) == Scaling(24.0, 320.0, None, mass)
    assert scales.scaled(given, "Iyy", math.log(1.5)).mass.Iyy == pytest.approx(0.3)
    assert scales.scaled(given, "mass", math.log(1.5)).mass.mass_kg == pytest.approx(3.0)
    powers = {n: [scales._power(n, q) for q in ("airspeed", "mass", "Ixx", "Iyy", "Izz")] for n in ("CZ_q", "Cm_alpha")}
    assert powers == {"CZ_q": [-1.0, 1.0, 0.0, 0.0, 0.0], "Cm_alpha": [-2.0, 0.0, 0.0, 1.0, 0.0]}
