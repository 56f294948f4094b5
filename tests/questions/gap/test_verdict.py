"""The verdict of two levels: every effect has a part and a check, and what is said of calls is what the rows say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from studies.blind.__main__ import RESULTS, SEED, _sealed
from studies.blind.parts import UNSEEN, called, called_text

from testbench.effects import library
from testbench.effects.base import together
from testbench.flight import load_aircraft
from testbench.questions.gap import called as module
from testbench.questions.gap.called import CALLED
from testbench.questions.gap.part_figure import _REGIONS, _region, part_plate
from testbench.questions.gap.parts import part_names, parts_of
from testbench.questions.gap.verdict import Verdict, call_of
from testbench.sensors import load_suite

EFFECTS = {
    **library(load_suite("eolo_gap"), load_aircraft("taurus")),
    **library(load_suite("eolo_gap_lateral"), load_aircraft("eolo", "rigid")),
}


def test_what_is_said_of_calls_is_what_the_blind_test_found():
    cases, _ = _sealed(RESULTS, SEED)
    lines = (RESULTS / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    found = called(cases, {row["case"]: row for row in map(json.loads, lines)})
    assert found == CALLED
    assert called_text(found) == Path(module.__file__).read_text(encoding="utf-8")
    assert all(effect <= part <= cases for part, effect, cases in found.values())


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_every_effect_of_the_library_has_a_part_with_a_check_and_a_place_in_the_sketch(effect):
    (part,) = parts_of([effect])
    assert part_names(effect) == (part.name,)
    assert part.name in _REGIONS or part.name == "air" or part.name.endswith("sensor")
    assert not part.ground_check.startswith(("look at it, and measure", "compare the sensor"))
    assert any(_region(part.name)) or part.name == "air"


def test_unseen_kinds_act_in_parts_that_effects_have():
    known = {name for effect in EFFECTS.values() for name in part_names(effect)}
    assert set(UNSEEN.values()) <= known


def test_two_effects_of_one_part_call_it_once_and_a_set_says_or():
    lag, limit, scale = EFFECTS["actuator_lag"], EFFECTS["rate_limit"], EFFECTS["alpha_scale"]
    assert [p.name for p in parts_of([together(lag, limit)])] == ["elevator path"]
    assert call_of([together(lag, scale).name]) == "two effects"
    both = Verdict("set", parts_of([lag, scale]))
    assert both.sentences[0].startswith("where to look: elevator path or alpha sensor; ")
    assert len(both.sentences) == 3
    assert "elevator path or alpha sensor" in part_plate(both).caption


def test_where_nothing_is_named_no_part_is_called():
    verdict = Verdict("unexplained", (), "the lift")
    part, _, cases = CALLED["unexplained"]
    assert f"in only {part} of {cases} cases" in verdict.sentences[0]
    assert part_plate(verdict) is None
