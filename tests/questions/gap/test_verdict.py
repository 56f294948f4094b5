"""Where to look: every effect has a part and a check, and the verdict says how probable its parts are."""

from __future__ import annotations

import numpy as np
import pytest
from studies.blind.parts import UNSEEN

from testbench.effects import library
from testbench.effects.base import together
from testbench.flight import load_aircraft
from testbench.inference.calibrate import SURE
from testbench.questions.gap.explain import (
    P_COEFFICIENT,
    P_EFFECT,
    P_IN_PART,
    P_NOTHING,
    P_OPEN,
    P_PAIR,
    Weights,
    percent,
    within_noise,
    wrong_coefficient,
)
from testbench.questions.gap.figures import _NOSE, _REGIONS, part_plate
from testbench.questions.gap.parts import part_names, parts_of
from testbench.questions.gap.result import Verdict
from testbench.sensors import load_suite

EFFECTS = {
    **library(load_suite("eolo_gap"), load_aircraft("taurus")),
    **library(load_suite("eolo_gap_lateral"), load_aircraft("eolo", "rigid")),
}


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_every_effect_of_the_library_has_a_part_with_a_check_and_a_place_in_the_sketch(effect):
    (part,) = parts_of([effect])
    assert part_names(effect) == (part.name,)
    assert part.name in _REGIONS or part.name == "air" or part.name.endswith("sensor")
    assert not part.ground_check.startswith(("inspect it, and measure", "compare the sensor"))
    assert any(_REGIONS.get(part.name, _NOSE)) or part.name == "air"


def test_unseen_kinds_act_in_parts_that_effects_have():
    known = {name for effect in EFFECTS.values() for name in part_names(effect)}
    assert set(UNSEEN.values()) <= known


def test_two_effects_of_one_part_call_it_once_and_a_set_says_or():
    lag, limit, scale = EFFECTS["actuator_lag"], EFFECTS["rate_limit"], EFFECTS["alpha_scale"]
    assert [p.name for p in parts_of([together(lag, limit)])] == ["elevator path"]
    both = Verdict(parts_of([lag, scale]), 0.973, any=True)
    assert both.sentences[0] == "where to look: elevator path or alpha sensor; probability of that place: 97.3 %"
    assert len(both.sentences) == 3
    assert "elevator path or alpha sensor. Probability: 97.3 %" in part_plate(both).caption


def test_where_nothing_is_named_no_part_is_called():
    verdict = Verdict((), 0.41, nearest="the lift")
    assert "the right part with 41 %" in verdict.sentences[0]
    assert part_plate(verdict) is None


def weighed(**evidence):
    """Return explanations of these (whole, in part) evidences."""
    return Weights(evidence, {n: EFFECTS[n] for n in evidence if n != "nothing"}, 50, 5)


def test_probabilities_are_prior_times_evidence_and_add_up():
    found = weighed(
        nothing=(-10.0, -14.0), actuator_lag=(-2.0, -6.0), rate_limit=(-4.0, -5.0), alpha_scale=(-30, -20.0)
    )
    named = sum(found[n] for n in found.effects)
    assert found.nothing + named + found.unknown == pytest.approx(1.0, abs=1e-12)
    assert found["actuator_lag"] / found["rate_limit"] == pytest.approx(7.389, rel=1e-3)  # both are one of 50
    assert found.credible() == ("actuator_lag", "unknown", "rate_limit")
    inside = sum(found[n] + P_IN_PART * found.imitates(n) for n in ("actuator_lag", "rate_limit"))
    assert found.part(["elevator path"]) == pytest.approx(inside, rel=1e-12)
    assert found.part(["alpha sensor"]) < 1e-6


def test_what_gains_little_may_be_an_imitation_that_noise_hides():
    """The mean of exp(-d^2 gain) over ln d from ln 0.003 to ln 1/3, by the trapezoidal rule."""
    d = np.exp(np.linspace(np.log(0.003), np.log(1.0 / 3.0), 20001))
    for gain in (1.0, 40.0, 1e3, 1e5, 1e7):
        hidden_by_noise = np.exp(-(d**2) * gain)
        mean = np.trapezoid(hidden_by_noise, np.log(d)) / np.log(d[-1] / d[0])
        assert within_noise(gain) == pytest.approx(mean, rel=1e-6, abs=1e-30)
    assert within_noise(-3.0) == 1.0
    little, much = (weighed(nothing=(-gain, -gain), actuator_lag=(0.0, -5.0)) for gain in (40.0, 40_000.0))
    assert little.needed < 0.01
    assert little.unknown > 4.0 * much.unknown > 0.0
    assert little["actuator_lag"] < SURE < much["actuator_lag"]


def test_an_effect_that_needs_an_unknown_motion_imitates_what_the_library_lacks():
    found = weighed(nothing=(-900.0, -400.0), actuator_lag=(-300.0, -20.0))
    assert found["actuator_lag"] < 1e-100
    assert found.unknown == pytest.approx(1.0)
    assert found.credible() == ("unknown",)
    assert found.decide() == ("partial", ("actuator_lag",))


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        ({"nothing": (0.0, -5.0), "actuator_lag": (2.0, -5.0)}, ("no gap", ())),  # one of fifty gains as much by chance
        ({"nothing": (-900.0, -50.0), "actuator_lag": (0.0, -5.0)}, ("named", ("actuator_lag",))),
        ({"nothing": (-30.0, -30.0), "actuator_lag": (0.0, -5.0)}, ("set", ("actuator_lag",))),  # or what is like it
        (
            {"nothing": (-90.0, -50.0), "actuator_lag": (0.0, -5.0), "rate_limit": (-1.0, -5.0)},
            ("set", ("actuator_lag", "rate_limit")),
        ),
        ({"nothing": (-90.0, 0.0), "actuator_lag": (-80.0, 0.0)}, ("unexplained", ())),
        ({"nothing": (-90.0, -40.0), "actuator_lag": (-80.0, 0.0)}, ("partial", ("actuator_lag",))),
    ],
)
def test_what_is_said_is_what_is_most_probable(evidence, said):
    assert weighed(**evidence).decide() == said


def test_the_prior_is_shared_by_all_of_a_kind():
    one, other = EFFECTS["actuator_lag"], EFFECTS["alpha_scale"]
    both, wrong = together(one, other), wrong_coefficient("Cm_de")
    logs = dict.fromkeys(("nothing", one.name, both.name, wrong.name, "term"), (0.0, -np.inf))
    effects = {one.name: one, both.name: both, wrong.name: wrong, "term": other}
    plain = Weights(logs, effects, 50, 5, 200, ("term",))
    ratio = {n: plain[n] / plain.nothing * P_NOTHING for n in effects}
    assert ratio == pytest.approx(
        {one.name: P_EFFECT / 50, both.name: P_PAIR / 1225, wrong.name: P_COEFFICIENT / 5, "term": P_OPEN / 200}
    )
    of_lag = sum(plain[n] + P_IN_PART * plain.imitates(n) for n in (one.name, both.name))
    assert plain.holds([one.name]) == pytest.approx(of_lag)
    assert plain.holds([]) == 0.0


def test_no_probability_is_said_to_be_certain():
    assert [percent(p) for p in (1.0, 0.9456, 0.00434, 1e-9)] == ["above 99.9 %", "94.6 %", "0.434 %", "below 0.1 %"]
