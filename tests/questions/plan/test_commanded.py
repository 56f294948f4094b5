"""The simulated input of a script is the one that the script sends: sampled at its period and held."""

from __future__ import annotations

import numpy as np
import pytest
from test_bounds import scenario_of

from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import Multisine, Sweep
from testbench.inputs import build
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.card_text import card_text
from testbench.questions.plan.commanded import commanded
from testbench.questions.plan.injection.lua import rows_of
from testbench.questions.plan.scenario import PlanScenario

SINES = {
    "signal": "multisine",
    "control": "de",
    "amplitude_deg": 2.0,
    "f_min_hz": 0.5,
    "f_max_hz": 3.0,
    "period_s": 4.0,
}


def planned(entry, **changes):
    scenario = scenario_of(2.0)
    content = scenario.model_dump(exclude_unset=True, mode="json")
    content["manoeuvre"] = [{"name": "m", "duration_s": 6.0, "repeats": 1, "input": [entry]}]
    return PlanScenario.model_validate({**content, **changes})


@pytest.mark.parametrize("period_ms", [20, 32, 25])
def test_every_value_holds_until_the_next_one_is_sent(period_ms):
    entry = (Multisine.model_validate(SINES),)
    fast = commanded(entry, 6.0, 1000.0, period_ms)
    sent = build(entry, 6.0, 1e3 / period_ms)
    assert len(fast.u) == 6000
    for k in (0, 1, 7, 100, len(sent.u) - 1):
        first = int(np.ceil(k * period_ms - 1e-6))
        np.testing.assert_array_equal(fast.u[first : first + period_ms - 1, 0], sent.u[k, 0])
    drawn = commanded(entry, 6.0, 1000.0)
    np.testing.assert_array_equal(drawn.u, build(entry, 6.0, 1000.0).u)
    assert np.abs(drawn.u - fast.u).max() > 0.05 * np.abs(drawn.u).max()
    with pytest.raises(ScenarioError, match="f_max_hz"):
        commanded(entry, 6.0, 1000.0, 50)


def test_a_card_flies_what_its_script_sends():
    (card,) = make_plan(planned(SINES)).cards
    times_ms, rows = rows_of(card, 20)
    sampled = np.repeat(rows[:, 0], np.diff([*times_ms, 6000]) // 20)
    flown = np.degrees(card.signal.u[:, 0])
    t_ms = 1e3 * card.signal.t_s
    np.testing.assert_allclose(flown, sampled[np.floor(t_ms / 20.0 + 1e-6).astype(int)], atol=1e-5)
    (by_hand,) = make_plan(scenario_of(2.0, flown_by="pilot")).cards
    assert by_hand.spec.input == scenario_of(2.0).manoeuvre[0].input


def test_the_card_of_a_sweep_says_the_settings_of_the_autopilot_s_own(tmp_path):
    sweep = {
        "signal": "sweep",
        "control": "da",
        "amplitude_deg": 2.5,
        "f_start_hz": 0.3,
        "f_end_hz": 2.0,
        "sweep_s": 5.0,
    }
    assert Sweep.model_validate(sweep)
    plan = make_plan(planned(sweep))
    (note,) = [n for n in card_text(plan.cards[0], plan).notes if "SID_AXIS" in n]
    part = 2.5 / np.degrees(plan.aircraft.controls["da"].full)
    assert f"SID_AXIS 22, SID_MAGNITUDE {part:.3g}, SID_F_START_HZ 0.3, SID_F_STOP_HZ 2, SID_T_REC 5" in note
    other = make_plan(planned(sweep, autopilot={"system": "px4"}))
    assert not [n for n in card_text(other.cards[0], other).notes if "SID_AXIS" in n]
