"""Percentages of values near zero are not printed to their last digit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from testbench.core.relative import percent_in_words, share_in_words
from testbench.estimators.causes.found import Found, in_words
from testbench.evaluation import Scores, _prediction_verdict


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

    return in_words(Model(), Found("drift", "", 0.0, 0.0, errors, moved, relative, 0.0, 1))


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
