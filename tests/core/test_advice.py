"""Advice: a sentence with its severity and the code of its cause, which copies, pickles and prefixes keep."""

import copy
import json
import pickle

import pytest

from testbench.core.advice import Advice, as_json, doubt, from_json, note, ranked, status_of, wrong

LATE = doubt("delay", "q answers late")


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda a: pickle.loads(pickle.dumps(a))])
def test_a_copy_keeps_severity_and_code(again):
    other = again(LATE)
    assert (other, other.severity, other.code) == (LATE, "doubt", "delay")
    assert type(other) is Advice


def test_advice_is_its_sentence_and_a_prefix_keeps_its_rank():
    assert LATE == "q answers late"
    assert "late" in LATE
    said = wrong("on_bound", "M_q ended on a bound").about("second flight")
    assert (said, said.severity, said.code) == ("second flight: M_q ended on a bound", "wrong", "on_bound")


def test_the_worst_stands_first_and_equals_keep_their_order():
    given = (note("first", "1"), LATE, "plain", wrong("second", "2"), doubt("third", "3"))
    assert [str(a) for a in ranked(given)] == ["2", "q answers late", "plain", "3", "1"]
    plain = ranked(given)[2]
    assert (plain.severity, plain.code) == ("doubt", "own")


@pytest.mark.parametrize(
    ("advice", "status"),
    [((), "good"), ((note("a", "x"),), "good"), (("x",), "doubt"), ((note("a", "x"), wrong("b", "y"), LATE), "wrong")],
)
def test_the_status_is_the_worst_severity(advice, status):
    assert status_of(advice) == status


def test_what_is_written_is_read_again_and_older_files_are_doubts():
    given = (note("a", "x"), wrong("b", "y"))
    again = from_json(json.loads(json.dumps(as_json(given))))
    assert [(a, a.severity, a.code) for a in again] == [("y", "wrong", "b"), ("x", "note", "a")]
    (old,) = from_json(["as files of old hold it"])
    assert (old.severity, old.code) == ("doubt", "own")


def test_a_severity_or_code_that_is_none_is_refused():
    with pytest.raises(ValueError, match="must be one of wrong, doubt, note, got 'warning'"):
        Advice("x", "warning", "a")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="lower case with underscores, got 'On bound'"):
        doubt("On bound", "x")
