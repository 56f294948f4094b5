"""Numbers as people read them: a value has no more decimals than its error lends it.

A user's prose in a message.

Percentages of values near zero are not printed to their last digit.

Intervals of a share that was counted.
"""

import math

import numpy as np
import pytest
from scipy.stats import binom

from testbench.core.errors import excerpt
from testbench.core.proportion import proportion_interval
from testbench.core.relative import percent_in_words, share_in_words
from testbench.core.words import array_found, with_error
from testbench.evaluation import Scores, _prediction_verdict
from testbench.inference.causes import Found, in_words


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [
        (12.0534, 0.0632, "12.053 ± 0.063"),
        (5.0612, 0.4812, "5.06 ± 0.48"),
        (0.09963, 0.1, "0.10 ± 0.10"),
        (81234.4, 123.4, "81234 ± 123"),
        (1.23456e-7, 2.3e-9, "1.235e-07 ± 2.3e-09"),
        (-0.5, 0.0, "-0.5 ± 0"),
        (3.0, float("nan"), "3 ± nan"),
    ],
)
def test_value_and_error_have_the_same_decimals(value, error, said):
    assert with_error(value, error) == said


def test_an_array_that_is_refused_says_whether_its_shape_or_its_numbers_are_wrong() -> None:
    """A model of NaN "must be of shape (4, 4), got shape (4, 4)"."""
    assert array_found(np.ones((4, 2))) == "shape (4, 2)"
    assert array_found(np.array([1.0, np.nan, np.inf])) == "shape (3,), with NaN"
    assert array_found(np.array([1.0, -np.inf])) == "shape (2,), with infinite values"


def test_prose_is_quoted_as_one_line_of_200_letters_without_controls():
    said = excerpt("ask\n\x1b[31m Mr. Smith " + 500 * "x")
    assert "\n" not in said
    assert "\x1b" not in said
    assert len(said) <= 202


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (0.0, "0 %"),
        (0.123, "12 %"),
        (1.9, "190 %"),
        (12.3, "12 times its size"),
        (6649978275.29, "more than 100 times its size"),
        (math.inf, "more than 100 times its size"),
    ],
)
def test_a_share_beyond_twice_the_value_is_said_in_times(share, said):
    assert share_in_words(share) == said


@pytest.mark.parametrize(
    ("percent", "said"),
    [(17.34, "17.3 %"), (1000.0, "1000 %"), (176807130.0, "over 1000 %"), (math.inf, "over 1000 %")],
)
def test_an_error_of_prediction_ends_at_a_thousand_percent(percent, said):
    assert percent_in_words(percent) == said


def drift(relative, moved="", errors=math.nan):
    class Model:
        method = "dsr_e"
        advice = ()
        outputs = ("alpha", "q")

    return in_words(Model(), Found("drift", "", 0.0, 0.0, errors, moved, relative))


def test_a_pole_near_the_origin_moves_by_rad_s_and_not_by_percent():
    far = "a pole of 1e-09 rad/s by some 6.6 rad/s"
    assert f"it shifts {far}; set offset" in drift(6.6e9, far)
    assert "it shifts a pole by some 40 %; set" in drift(0.4, far)
    assert "it shifts" not in drift(math.inf, far)


def test_a_shift_beyond_the_value_of_a_parameter_has_no_percent():
    assert "it shifts Z_q by some 9 of its standard errors (12 %)" in drift(0.12, "Z_q", 9.0)
    assert "it shifts Z_q by some 9 of its standard errors (more than its value)" in drift(3e7, "Z_q", 9.0)


def test_the_verdict_of_a_prediction_prints_no_astronomical_percent():
    values = np.array([82.0, 1.77e8])
    scores = Scores(values, 100.0 - values, ((None, None),))
    said = _prediction_verdict("validation", ["q", "theta"], scores)
    assert said.startswith("validation: MRSE over 1000 % (q 82 %, theta over 1000 %): theta no better than")


def test_wilsons_interval_solves_its_equation():
    """Its ends solve (share - p)^2 = z^2 p (1 - p) / n (Brown, Cai, DasGupta, Stat. Sci. 16(2), 2001, equation 4)."""
    for p in proportion_interval(8, 10):
        assert (0.8 - p) ** 2 == pytest.approx(1.959964**2 * p * (1 - p) / 10, rel=1e-6)
    low, high = proportion_interval(10, 10)
    assert high == pytest.approx(1.0)
    assert low > 0.7


def test_the_exact_interval_is_the_wider_one_and_nothing_counted_says_nothing():
    low, high = proportion_interval(3, 20)
    exact_low, exact_high = proportion_interval(3, 20, method="exact")
    assert exact_low < low < 0.15 < high < exact_high
    assert proportion_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("k", [1, 3, 12])
def test_the_exact_interval_leaves_half_of_the_error_on_each_side(k):
    low, high = proportion_interval(k, 20, method="exact")
    assert binom.sf(k - 1, 20, low) == pytest.approx(0.025)
    assert binom.cdf(k, 20, high) == pytest.approx(0.025)
