"""Limits that a plan leaves out come from the aircraft, and every card says from where and who watches them."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.aircraft.model import ASSUMED
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.evaluation.derivatives import lift_per_rad
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.bounds import GIVEN, bounds_at, stall_speed_m_s
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import PlanLimits, PlanScenario


def point_of(aircraft, V, h):
    trimmed = trim(aircraft, FlightCondition(V, h))
    return Point(1, V, h, trimmed, linearise(aircraft, trimmed), 10.0, None, (), None)


@pytest.fixture(scope="module")
def at_14(taurus):
    return point_of(taurus, 14.0, 100.0)


def test_the_stall_speed_is_that_at_which_trim_takes_the_highest_alpha(taurus, at_14):
    stall = stall_speed_m_s(taurus, at_14)
    assert stall == pytest.approx(stall_speed_m_s(taurus, point_of(taurus, 12.0, 100.0)), rel=0.01)
    slow = trim(taurus, FlightCondition(11.0, 100.0))  # slower, its elevator runs out
    room = ((11.0 / stall) ** 2 - 1.0) / lift_per_rad(linearise(taurus, slow), 11.0)
    assert (slow.alpha + room) / DEG_RAD == pytest.approx(taurus.limits["alpha"][1] / DEG_RAD, abs=0.2)


def test_what_a_plan_leaves_out_comes_from_the_aircraft(taurus, at_14):
    found = bounds_at(PlanLimits(), taurus, at_14, 0.0)
    limits = found.limits
    assert limits.load_factor == (0.0, 2.0)
    np.testing.assert_allclose(limits.alpha_deg, np.array(taurus.limits["alpha"]) / DEG_RAD)
    assert limits.beta_deg == pytest.approx(25.0)
    assert 30.0 <= limits.bank_deg <= 45.0
    assert 30.0 <= limits.pitch_change_deg <= 45.0
    assert limits.V_min_m_s == pytest.approx(1.2 * stall_speed_m_s(taurus, at_14))
    assert limits.V_max_m_s == pytest.approx(taurus.limits["V"][1])
    assert limits.height_change_m == pytest.approx(50.0)
    assert bounds_at(PlanLimits(), taurus, at_14, 60.0).limits.height_change_m == pytest.approx(20.0)
    assert set(found.sources) == {"az", "alpha", "beta", "phi", "theta", "V", "h"}
    assert found.sources["alpha"] == "limits of taurus"
    elastic = bounds_at(PlanLimits(), taurus, at_14, 0.0, onset_m_s=20.0)
    assert "highest: onset of the instability" in elastic.sources["V"]
    assert bounds_at(PlanLimits(V_max_m_s=19.0), taurus, at_14, 0.0, onset_m_s=20.0).sources["V"].endswith("plan says")
    assert "states none" in found.sources["az"]
    assert "(stall)" in found.sources["V"]


def test_what_a_plan_gives_stays(taurus, at_14):
    given = PlanLimits(
        load_factor=(-1.0, 3.0), alpha_deg=(-5.0, 9.0), beta_deg=3.0, speed_change_m_s=9.0, height_change_m=7.0,
        pitch_change_deg=60.0, bank_deg=70.0, V_max_m_s=20.0,
    )  # fmt: skip
    found = bounds_at(given, taurus, at_14, 0.0)
    assert found.limits == given
    assert set(found.sources.values()) == {GIVEN}


def test_an_aircraft_that_states_little_has_no_silent_limits(taurus, at_14):
    bare = replace(taurus, limits={})
    found = bounds_at(PlanLimits(), bare, at_14, 0.0)
    assert (found.limits.bank_deg, found.limits.pitch_change_deg) == (30.0, 30.0)
    assert found.limits.alpha_deg is None
    assert found.limits.V_min_m_s == pytest.approx(0.9 * 14.0)
    assert found.limits.V_max_m_s == pytest.approx(1.3 * 14.0)
    assert "stall unknown" in found.sources["V"]
    narrow = replace(taurus, limits={"phi": (-0.3, 0.3), "az": (-4.0 * G0_M_S2, G0_M_S2)})
    found = bounds_at(PlanLimits(), narrow, at_14, 0.0)
    assert found.limits.bank_deg == pytest.approx(0.9 * 0.3 / DEG_RAD, abs=0.1)
    assert found.limits.load_factor == (-1.0, 4.0)


def test_low_must_lie_below_high():
    with pytest.raises(ValueError, match="V_min_m_s < V_max_m_s must hold, got 20 and 15"):
        PlanLimits(V_min_m_s=20.0, V_max_m_s=15.0)


CONTENT = {
    "title": "bare",
    "aircraft": "taurus",
    "flown_by": "autopilot",
    "speeds_m_s": [14.0],
    "heights_m": [100.0],
    "suite": "taurus_8hz",
    "limits": {},
    "timing": {"turn_s": 30.0, "overhead_s": 60.0},
    "energy": {"kind": "battery", "capacity_Wh": 20.0, "efficiency_percent": 50.0, "source": "made up"},
}


def scenario_of(amplitude_deg, **changes):
    signal = {"signal": "3211", "control": "de", "amplitude_deg": amplitude_deg, "step_s": 0.3, "start_s": 0.5}
    manoeuvre = {"name": "3-2-1-1", "duration_s": 5.0, "repeats": 1, "input": [signal]}
    return PlanScenario.model_validate({**CONTENT, "manoeuvre": [manoeuvre], **changes})


def test_every_card_has_every_limit_with_its_source_and_is_judged_by_it():
    (card,) = make_plan(scenario_of(2.0)).cards
    assert {limit.channel for limit in card.limits} == {"V", "h", "phi", "theta", "az", "alpha", "beta", "de"}
    assert all(limit.source and math.isfinite(limit.high) for limit in card.limits)
    (hard,) = make_plan(scenario_of(6.0, speeds_m_s=[18.0])).cards  # what nobody wrote into the plan
    assert hard.status == "refused"
    assert [text.partition(" passes")[0] for text in hard.met] == ["the load factor"] * 2


def test_alpha_by_the_lift_curve_is_alpha_of_the_flight():
    (card,) = make_plan(scenario_of(3.0)).cards
    record, trimmed = card.expected, card.point.trimmed
    load, slow = -record["az"] / G0_M_S2, card.point.V_m_s / record["V"]
    rise = lift_per_rad(card.point.model, card.point.V_m_s)
    reckoned = trimmed.alpha + (load * slow**2 + trimmed.state["az"] / G0_M_S2) / rise
    assert np.ptp(record["alpha"]) > 3.5 * DEG_RAD
    np.testing.assert_allclose(reckoned, record["alpha"], atol=1.0 * DEG_RAD)


def stub_point(h=300.0, **state):
    """A point at 20 m/s with Z_w = -3 1/s, trimmed at alpha = 0.05 rad."""
    A = np.diag([-0.1, -3.0, -2.0])
    model = SimpleNamespace(states=("u", "w", "q"), A=A)
    return SimpleNamespace(V_m_s=20.0, h_m=h, trimmed=SimpleNamespace(alpha=0.05, state=state), model=model)


STATED = {"alpha": (-0.1, 0.25), "beta": (-0.2, 0.3), "phi": (-1.3, 1.4), "theta": (-2.0, 2.1), "V": (10.0, 30.0)}
LIFT = 3.0 * 20.0 / G0_M_S2
STALL = 20.0 / math.sqrt(1.0 + LIFT * 0.2)


def stub_aircraft(limits=STATED, sources=None, level=None):
    said = sources or {}
    return SimpleNamespace(
        name="it", limits=limits, limit_sources=said, limit_source=lambda c: said.get(c, "limits of it"),
        level_V_m_s=level, design_h_m=0.0,
    )  # fmt: skip


def bounds(limits=STATED, given=None, point=None, field=60.0, onset=None):
    return bounds_at(given or PlanLimits(), stub_aircraft(limits), point or stub_point(theta=0.1), field, onset)


def test_the_bounds_by_hand():
    assert lift_per_rad(stub_point().model, 20.0) == pytest.approx(LIFT, rel=1e-14)
    found = bounds()
    limits = found.limits
    assert limits.alpha_deg == pytest.approx((-0.1 / DEG_RAD, 0.25 / DEG_RAD))
    assert limits.beta_deg == pytest.approx(0.2 / DEG_RAD)
    assert limits.bank_deg == round(0.5 * 1.3 / DEG_RAD, 1)  # the nearer side
    assert limits.pitch_change_deg == 45.0  # half of 109 deg
    assert limits.V_min_m_s == pytest.approx(1.2 * STALL)
    assert limits.V_max_m_s == 30.0
    assert found.sources["phi"] == "of the 74 deg that it allows"
    assert found.sources["V"] == f"lowest: 1.2 x {STALL:.3g} m/s (stall); highest: limits of it"


def test_an_angle_counts_from_trim_and_a_narrow_one_keeps_a_tenth():
    found = bounds({**STATED, "phi": (-0.4, 0.5), "theta": (-0.8, 1.4)}, point=stub_point(theta=0.6, phi=0.1))
    assert found.limits.bank_deg == round(0.9 * 0.4 / DEG_RAD, 1)
    assert found.sources["phi"] == "0.9 of the 23 deg that it allows"
    assert found.limits.pitch_change_deg == 30.0  # half of 0.8 rad above is less than the least
    assert found.sources["theta"] == "of the 46 deg that it allows"


@pytest.mark.parametrize(
    ("field", "height", "words"),
    [(60.0, 100.0, "5 s of flight"), (200.0, 50.0, "half the height above the field"),
     (100.0, 100.0, "half the height above the field"), (400.0, 0.5, "half the height above the field")],
)  # fmt: skip
def test_the_height_is_half_of_that_above_the_field_but_five_seconds_at_most(field, height, words):
    found = bounds(field=field)
    assert (found.limits.height_change_m, found.sources["h"]) == (height, words)


def test_no_alpha_is_left_when_trim_lies_that_far_beyond_the_highest():
    beyond = stub_point(theta=0.1)
    beyond.trimmed.alpha = 0.25 + 1.001 / LIFT  # the ratio of the squares is below zero
    assert stall_speed_m_s(stub_aircraft(), beyond) is None
    beyond.trimmed.alpha = 0.25 + 0.96 / LIFT
    assert stall_speed_m_s(stub_aircraft(), beyond) == pytest.approx(20.0 / 0.2)


def test_the_higher_of_the_lowest_speeds_holds_and_an_onset_below_the_fastest_is_said():
    slow = bounds({**STATED, "V": (18.0, 30.0)})
    assert (slow.limits.V_min_m_s, slow.sources["V"][:20]) == (18.0, "lowest: limits of it")
    for onset, said in ((30.0, False), (29.9, True)):
        assert ("onset" in bounds(onset=onset).sources["V"]) is said
    change = PlanLimits(speed_change_m_s=4.0)
    for onset, said in ((24.0, GIVEN), (23.9, f"{GIVEN}; highest: onset of the instability")):
        assert bounds(given=change, onset=onset).sources["V"] == said


def test_what_the_testbench_assumed_is_no_limit_of_the_aircraft():
    """Neither a stall speed nor a word on a card; the slowest level flight that trims holds, at the density there."""
    said = dict.fromkeys(STATED, ASSUMED)
    point = stub_point(theta=0.1, h=2000.0)
    found = bounds_at(PlanLimits(), stub_aircraft(sources=said, level=(14.0, 28.0)), point, 60.0)
    assert not any("limits of it" in words or "it allows" in words for words in found.sources.values())
    assert found.sources["alpha"] == found.sources["beta"] == ASSUMED
    assert found.limits.V_min_m_s == pytest.approx(14.0 * math.sqrt(1.225 / 1.00649), rel=1e-4)
    assert "slowest level flight" in found.sources["V"]
