"""What planned manoeuvres could show: against signatures computed one by one, and against what is known of pairs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_flights import believe, measure

import testbench.questions.gap.plan as plan_module
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.effects import EFFECTS
from testbench.questions.gap.plan import NEEDED, Grams, as_record, candidates, family, plan_gap, separate, sum_of
from testbench.questions.gap.search.hypothesis import Hypothesis, changes
from testbench.questions.run.scenario import Scenario

FEW = ("actuator_lag", "transport_delay", "thrust_line", "alpha_scale", "q_bias")
ELEVATOR = Manoeuvre(
    name="elevator",
    use="identification",
    duration_s=8.0,
    input=(StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4),),
)
THROTTLE = Manoeuvre(
    name="throttle",
    use="identification",
    duration_s=8.0,
    input=(Doublet(signal="doublet", control="thr", amplitude_percent=10.0, period_s=4.0),),
)


@pytest.fixture(scope="module")
def believed():
    return believe()


@pytest.fixture(scope="module")
def effects():
    return tuple(EFFECTS[n] for n in FEW)


@pytest.fixture(scope="module")
def grams(believed, effects):
    return [Grams.of(believed, as_record(believed, m), effects) for m in (ELEVATOR, THROTTLE)]


def test_noncentrality_is_the_gain_that_the_effect_would_have(believed, effects, grams):
    """An independent way: the sum of squares that is left of the signature after re-tuning, as a fit computes it."""
    base = Hypothesis.at(believed, believed, (as_record(believed, ELEVATOR),), np.ones(5))
    found = grams[0].isolability(effects)
    for i, name in enumerate(FEW[:2]):
        d = changes(base, [(EFFECTS[name], np.array([p.starts[0] for p in EFFECTS[name].parameters]))])[0]
        left, _ = base.tuned(d)
        assert found.noncentrality[i] == pytest.approx(left @ left, rel=1e-6)


def test_what_is_alike_in_one_manoeuvre_is_told_apart_by_another(effects, grams):
    alone, both = grams[0].isolability(effects), sum_of(grams).isolability(effects)
    thrust = FEW.index("thrust_line")
    assert both.noncentrality[thrust] > 10.0 * max(alone.noncentrality[thrust], 1.0)
    assert np.all(both.left[: len(FEW) - 1].min(axis=0) >= -1e-6)
    assert both.share[0, 0] == pytest.approx(1.0, abs=1e-6)
    assert alone.share[0, FEW.index("transport_delay")] > 0.8  # a lag and a delay of the servo look alike
    assert alone.share[0, FEW.index("alpha_scale")] < 0.3


def test_a_bias_cannot_be_seen_where_channels_are_compared_about_their_means(effects, grams):
    found = sum_of(grams).isolability(effects)
    assert [e.name for e in found.unseen][-1] == "q_bias"
    assert "q_bias" not in [e.name for e in found.nameable]
    assert np.isnan(found.share[FEW.index("q_bias")]).all()


def test_the_family_is_as_large_as_what_is_planned(believed):
    loud = ELEVATOR.model_copy(update={"input": (ELEVATOR.input[0].model_copy(update={"amplitude_deg": 4.0}),)})
    amplitudes = [s.amplitude_deg for m, _ in family(believed, [loud]) for s in m.input if s.control == "de"]
    assert max(amplitudes) == pytest.approx(4.0)
    pull = next(m for m, _ in family(believed, [loud]) if m.name == "slow pull")
    assert pull.input[0].amplitude_deg == pytest.approx(-2.4)  # held for four seconds, it is 0.6 of the largest
    names = [m.name for m, _ in family(believed, [])]
    assert len(set(names)) == len(names)


def test_a_set_gets_the_manoeuvre_that_separates_it(believed):
    """A thrust line and a mass hardly show in a short elevator input; throttle tells them apart."""
    records = [r.between(0.0, 5.0) for r in measure(believed, 5, duration_s=6.0)[:1]]
    fits = [
        SimpleNamespace(effect=EFFECTS[n], values={EFFECTS[n].parameters[0].name: x})
        for n, x in (("thrust_line", 0.05), ("mass_error", 1.1))
    ]
    words = separate(believed, records, fits)
    assert "fly next" in words
    assert "throttle" in words


def test_a_plan_names_what_to_add(monkeypatch):
    monkeypatch.setattr(plan_module, "library", lambda suite, aircraft: {n: EFFECTS[n] for n in FEW})
    said: list[str] = []
    found = plan_gap(Scenario.load("eolo_alpha"), said.append)
    assert found.manoeuvres == ("3-2-1-1", "doublet")
    assert {e.name for e in found.planned.unseen} >= {"q_bias"}
    best, planned = found.additions[0], found.planned
    assert len(best.with_it.nameable) >= len(planned.nameable)
    assert best.words in found.sentences[-1] or "no manoeuvre" in found.sentences[-1]
    # A manoeuvre that is added hides nothing that was seen before.
    assert all(np.all(a.with_it.noncentrality >= planned.noncentrality - 1e-6) for a in found.additions)
    assert any("throttle" in s for s in said)
    assert found.planned.noncentrality.max() > NEEDED


def test_a_slow_sensor_shows_as_little_as_its_samples_do(believed):
    """A lag of the vane shows in its own samples alone: a tenth of them, a tenth of the noncentrality."""
    sensors = tuple(replace(s, rate_hz=10.0) if s.channel == "alpha" else s for s in believed.suite.sensors)
    slow = replace(believed, suite=replace(believed.suite, sensors=sensors))
    only = (EFFECTS["alpha_lag"],)
    found = [Grams.of(b, as_record(b, ELEVATOR), only).isolability(only).noncentrality[0] for b in (believed, slow)]
    assert found[1] == pytest.approx(0.1 * found[0], rel=0.15)


def test_what_one_airspeed_cannot_separate_gets_another(believed):
    """A pitch damper and the wake of the wing are moments that follow q alike, but not as the airspeed changes."""
    records = measure(believed, 5, duration_s=6.0)[:1]
    fits = [
        SimpleNamespace(effect=EFFECTS[n], values={EFFECTS[n].parameters[0].name: x})
        for n, x in (("pitch_damper", 0.02), ("alpha_dot", -5.0))
    ]
    words = separate(believed, records, fits)
    assert ", at 20 m/s; it raises the noncentrality between the two most alike from 4.7 to 250 " in words


def test_airspeeds_that_were_flown_or_lie_beyond_the_limits_are_not_asked_for(believed):
    speeds = {there.condition.V_m_s for there, _, _ in candidates(believed, [ELEVATOR])}
    assert speeds == {16.0, 20.0, 13.6}
    names = [spec.name for _, spec, _ in candidates(believed, [ELEVATOR])]
    assert len(set(names)) == len(names)
    aircraft = replace(believed.aircraft, limits={**believed.aircraft.limits, "V": (13.0, 30.0)})
    limited = replace(believed, aircraft=aircraft)
    assert {there.condition.V_m_s for there, _, _ in candidates(limited, [ELEVATOR])} == {16.0, 20.0}
