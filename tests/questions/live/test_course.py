"""The card that is named next tells what is still wanted, and what is not needed any more is left out."""

from functools import cache

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.questions.live.answer import called
from testbench.questions.live.ask import Session, fly_along
from testbench.questions.live.belief import Believed
from testbench.questions.live.course import Course
from testbench.questions.live.stream import Sample, Source
from testbench.questions.live.track import Plane
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.rehearse import fly_run
from testbench.questions.plan.result import Run
from testbench.questions.plan.scenario import PlanScenario

PLAN = {
    "title": "Two speeds", "aircraft": "jsbsim:c172p", "seed": 1, "flown_by": "pilot", "speeds_m_s": [40.0, 45.0],
    "heights_m": [1000.0], "suite": "eolo_alpha_beta", "uncertainty_percent": 15.0, "scale": True,
    "limits": {"speed_change_m_s": 8.0}, "timing": {"turn_s": 60.0, "overhead_s": 120.0},
    "energy": {"kind": "battery", "capacity_Wh": 50000.0, "efficiency_percent": 45.0, "source": "estimated"},
    "manoeuvre": [{"name": "elevator", "duration_s": 8.0, "settle_s": 2.0, "repeats": 3,
                   "accuracy_percent": {"M_alpha": 5.0, "M_q": 10.0, "M_de": 5.0},
                   "input": [{"signal": "3211", "control": "de", "amplitude_deg": 3.0, "step_s": 0.5,
                              "start_s": 1.0}]}],
}  # fmt: skip


@cache
def plan():
    return make_plan(PlanScenario.model_validate(PLAN))


def plane():
    believed = Believed.of(plan().aircraft, 40.0, 1000.0)
    return Plane("longitudinal", {"de": "de"}, {}, believed, {"": 0.1}, 0.02, False, True, lambda name: 0.003)


def course():
    out = Course(plan(), 0.1)
    out.learn(plane())
    while not out.expect():
        pass
    return out


def test_before_any_run_the_slow_speed_comes_first_and_nothing_can_be_left_out():
    out = course()
    ahead = out.outlook({})
    assert ahead.card == 1
    assert ahead.spare == ()
    assert {g.name for g in ahead.gains} == {"M_alpha", "M_q", "M_de"}
    assert all(g.after < g.now for g in ahead.gains)
    assert 0.0 < ahead.left_s <= ahead.printed_s == pytest.approx(6 * 70.0)
    assert set(ahead.order) == {1, 2}
    assert "M_q unknown -> " in ahead.words


def test_information_that_is_known_makes_the_rest_shorter_and_leaves_cards_out():
    out = course()
    known = out._known["longitudinal"]
    known.information[: len(known.names), : len(known.names)] += 1e6 * np.eye(len(known.names))
    errors = known.errors(known.information)
    at = plan().points[1].trimmed.alpha - known.alpha
    unlike = 0.5 * at / 0.1 / 0.05  # of a derivative at the other speed, by the prior of its change, over 5 %
    one = next(e for (n, name), e in zip(known.of, errors, strict=True) if n == 2 and name == "M_de")
    here = known.at[2][0][known.names.index("M_de")]  # what is believed there, over that at the first speed
    assert one == pytest.approx(np.hypot(unlike, unlike * at / 0.1) / abs(here), rel=0.02)
    ahead = out.outlook({1: 1})
    assert set(ahead.order) <= {2}
    assert 1 in ahead.spare
    assert ahead.printed_s == pytest.approx(5 * 70.0)


def test_a_plan_ends_when_what_it_wants_is_known_and_that_is_right():
    session = Session("flight", plan().aircraft, plan())
    flown = []

    def arriving():
        zero, card = 0.0, plan().cards[0]
        while card is not None and len(flown) < 6:
            flown.append(card.number)
            record: FlightRecord = fly_run(plan(), Run(1, card, 1, 1, 0.0, 0.0), None, len(flown))
            for t, row in zip(record.t_s.tolist(), record.data.tolist(), strict=True):
                yield Sample(zero + t, dict(zip(record.channels, row, strict=True)), zero + t)
            zero += float(record.t_s[-1]) + 10.0
            card = session.next_card

    samples, how = [], {"aircraft": plan().aircraft, "plan": plan(), "draws": 0}
    for _ in fly_along(Source("flight", arriving(), careful="awaited"), **how, session=session, keep=samples.append):
        pass
    again = [u.line() for u in fly_along(Source("again", iter(samples)), **how)]
    assert again == [u.line() for u in session.updates]
    careful = [called(c) for c in session.calls if c.kind == "careful"]
    assert len(careful) >= len(flown) - 1
    assert careful[0].startswith("card 1, careful: M_")
    assert "; live said " in careful[0]
    assert flown[0] == 1
    assert 2 in flown
    assert len(flown) < 6
    assert session.outlook is not None
    assert session.outlook.card == 0
    said = [called(c) for c in session.calls if c.kind == "next"]
    assert any("next card 2: " in text for text in said)
    assert said[-1] == "nothing is left to fly: cards 1 and 2 can be left out"
    for point in plan().points:
        truth = {d.name: d.held for d in dimensional_derivatives(point.model, point.trimmed)}
        claimed = session.course.claimed(point)
        assert set(claimed) == {"M_alpha", "M_q", "M_de"}
        for name, (value, aim) in claimed.items():
            assert abs(value - truth[name]) < 1.96 * aim, (point.label, name)


def test_a_condition_that_is_left_keeps_what_was_known():
    out, other = course(), plane()
    known = out._known["longitudinal"]
    known.information[:] += 1e8 * np.eye(len(known.information))
    out.learn(other)
    while not out.expect():
        pass
    assert out.outlook({}).order == ()
    assert out.outlook({}).spare == (1, 2)


def test_cards_are_told_apart_by_what_is_wanted_of_them():
    judge = {**PLAN["manoeuvre"][0], "name": "judge", "use": "validation", "repeats": 1, "accuracy_percent": {}}
    both = make_plan(PlanScenario.model_validate({**PLAN, "speeds_m_s": [40.0],
                                                  "manoeuvre": [*PLAN["manoeuvre"], judge]}))  # fmt: skip
    out = Course(both, 0.1)
    out.learn(plane())
    while not out.expect():
        pass
    ahead = out.outlook({})
    assert ahead.order[-1] == 2  # what only judges is flown as printed
    assert ahead.order.count(2) == 1


def test_repeats_that_are_given_stay_beside_the_wanted_accuracy():
    card = plan().cards[0]
    assert card.repeats == 3
    assert card.reached[0].reached == pytest.approx(card.reached[0].one / 3.0**0.5)
