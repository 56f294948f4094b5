"""Recorded surfaces and the motion are explained together: their likelihoods multiply."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from gap.hidden_truths import late_command, rate_feedback, roughness
from gap.test_control_path import ELEVATOR, NOISE_RAD, believe, measure

from testbench.effects import EFFECTS
from testbench.effects.base import together
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.control_path import JudgedPath, PathTerm, judge_paths
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.name import name_effect
from testbench.questions.gap.part_figure import part_plate
from testbench.questions.gap.verdict import verdict_of
from testbench.questions.gap.workflow import Sought, find_gap

LAGS = ("transport_delay", "second_order_actuator", "wake_lag")
DAMPERS = ("pitch_damper", "alpha_dot")


@cache
def searched(hidden: str) -> tuple[Believed, tuple, Naming, tuple[JudgedPath, ...]]:
    """Return belief, records, what the motion alone names, and the judged path."""
    truth, names = {"late": (late_command(0.02), LAGS), "fed back": (rate_feedback(0.04), DAMPERS)}[hidden]
    b = believe(NOISE_RAD)
    records = tuple(measure(b, truth, ELEVATOR).values())
    naming = name_effect(b, records, effects={n: EFFECTS[n] for n in names}, pairs=False)
    return b, records, naming, judge_paths(b, records)


def beside(hidden: str, paths=None) -> Naming:
    """Return what motion and surfaces name together."""
    b, records, naming, judged = searched(hidden)
    known = {f.effect.name: f.effect for f in naming.ranking if not f.coefficients}
    return Sought(known, paths=judged if paths is None else paths, pairs=False).name(b, records, lambda s: None)


def path_of(gain: float, **falls: float) -> JudgedPath:
    term = PathTerm("fed q", (0.1,), (0.01,), ("s",))
    return JudgedPath("de", "differs", (term,), gain=gain, samples=400, falls={"fed q": gain, **falls})


def test_what_the_surface_tells_multiplies_the_probability():
    _, _, naming, (path,) = searched("late")
    both = beside("late")
    for name, told in (("transport_delay", path.gain), ("wake_lag", 0.0)):
        assert both.weighed.told[name] == pytest.approx(0.5 * told)
    assert both.weighed["wake_lag"] < naming.weighed["wake_lag"]


def test_the_surface_tells_apart_what_the_motion_cannot():
    """A command 0.02 s late moves the aircraft as a servo of second order would, but not the surface."""
    assert {"transport_delay", "second_order_actuator"} <= set(searched("late")[2].names)
    both = beside("late")
    assert (both.outcome, both.names) == ("named", ("transport_delay",))


def test_a_feedback_too_small_for_the_motion_is_named_by_the_surface():
    assert searched("fed back")[2].weighed["pitch_damper"] < 0.9
    both = beside("fed back")
    assert (both.outcome, both.names) == ("named", ("pitch_damper",))
    assert abs(both.best.values["gain_s"] - 0.04) < 3.0 * both.best.errors["gain_s"]


def test_a_path_as_believed_changes_nothing():
    _, _, naming, _ = searched("late")
    for paths in ((), (JudgedPath("de", "as believed"),)):
        both = beside("late", paths)
        assert {f.effect.name: f.probability for f in both.ranking} == pytest.approx(
            {f.effect.name: f.probability for f in naming.ranking}, rel=1e-6
        )


def test_parts_of_a_joint_effect_are_told_together():
    lag = PathTerm("lag", (12.0,), (0.1,), ("rad/s",))
    path = replace(path_of(900.0, lag=500.0, delay=450.0), terms=(*path_of(900.0).terms, lag))
    assert path.told(together(EFFECTS["pitch_damper"], EFFECTS["actuator_lag"])) == 900.0
    assert path.told(EFFECTS["transport_delay"]) == 450.0
    assert path.told(together(EFFECTS["transport_delay"], EFFECTS["drag_increment"])) == 450.0
    assert path.told(EFFECTS["drag_increment"]) == 0.0


def test_where_nothing_is_named_and_a_surface_differs_that_is_where_to_look():
    _, _, naming, paths = searched("late")
    verdict = verdict_of(replace(naming, outcome="unexplained", names=()), paths)
    assert [p.name for p in verdict.parts] == ["elevator path"]
    assert verdict.sentences[0] == (
        "where to look first: elevator path, as the recorded surface shows; whether that is all is not known"
    )
    assert part_plate(verdict).caption.endswith(
        "The recorded surface shows that its path differs from what is believed."
    )


@pytest.mark.slow
def test_the_whole_library_names_a_small_feedback_by_its_surface_and_drag_beside_a_right_path():
    b = believe(NOISE_RAD)
    fed = find_gap(b, measure(b, rate_feedback(0.04), ELEVATOR), {})
    assert (fed.naming.outcome, fed.naming.names) == ("named", ("pitch_damper",))
    rough = find_gap(b, measure(b, roughness(0.06), ELEVATOR), {})
    assert rough.naming.best is None or "drag_increment" in rough.naming.names
