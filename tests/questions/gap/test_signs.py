"""Controls that a log, or the believed model, counts the other way are refused before anything is fitted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from open_flights import FLOWN, believe, measured, truths

from testbench.aircraft import Amendment, ScaleCoefficient
from testbench.core.errors import RecordError
from testbench.effects.servo import COEFFICIENTS
from testbench.questions.gap.evidence.check import check_signs, turned
from testbench.questions.gap.windows import as_they_start
from testbench.questions.gap.workflow import find_gap

# One of our own models and one that is adapted; the others belong to the slow suite.
EACH = [n if n in ("taurus", "c172p") else pytest.param(n, marks=pytest.mark.slow) for n in FLOWN]
WORDS = {"de": "elevator", "da": "aileron", "dr": "rudder"}


@cache
def flown(name: str):
    return measured(name, truths(name, believe(name).aircraft), 1)


def turned_over(name: str, control: str):
    return {n: r.with_columns({f"{control}_cmd": -r[f"{control}_cmd"]}) for n, r in flown(name).items()}


@pytest.mark.parametrize("name", EACH)
def test_moments_of_controls_are_as_believed_to_within_their_errors(name):
    """The error of each sample is that of its noise: five standard errors are exceeded once in two million."""
    for found in turned(believe(name), list(flown(name).values())):
        assert abs(found.factor - 1.0) < max(5.0 * found.error, 0.15), found
    check_signs(believe(name), flown(name))


@pytest.mark.parametrize("name", EACH)
@pytest.mark.parametrize("control", WORDS)
def test_a_control_that_a_log_counts_the_other_way_is_refused(name, control):
    with pytest.raises(RecordError, match=rf"the {WORDS[control]} of the records must turn the aircraft .* scale = -1"):
        check_signs(believe(name), turned_over(name, control))


def test_so_is_a_model_that_does():
    believed = believe("taurus")
    wrong = believed.aircraft.amended(Amendment("wrong", "wrong", (ScaleCoefficient("Cm_de", -1.0),)))
    with pytest.raises(RecordError, match="in the model, turn Cm_de"):
        find_gap(replace(believed, aircraft=wrong), flown("taurus"), {})


@pytest.mark.parametrize("scale", [0.8, 3.0])
@pytest.mark.parametrize("own", [moment for moment, _ in COEFFICIENTS.values()])
def test_a_control_that_works_too_little_or_too_much_is_no_wrong_sign(own, scale):
    believed = believe("taurus")
    other = believed.aircraft.amended(Amendment("other", "other", (ScaleCoefficient(own, scale),)))
    found = turned(replace(believed, aircraft=other), list(flown("taurus").values()))
    factor = {COEFFICIENTS[t.control][0]: t.factor for t in found}[own]
    assert factor == pytest.approx(1.0 / scale, rel=0.2)
    assert not any(t.reversed for t in found)


def test_hands_that_are_never_still_are_no_hindrance():
    """Without quiet flight the deviations are those from the mean of each record."""
    restless = {n: r.between(2.6, 12.0) for n, r in turned_over("taurus", "de").items()}
    with pytest.raises(RecordError, match="the elevator of the records"):
        check_signs(believe("taurus"), as_they_start(restless))
