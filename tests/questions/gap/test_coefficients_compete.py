"""A wrong coefficient is an explanation among the effects: named alone, or in a set with what does the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from axes import believe as believe_axes
from axes import commands
from gap_fits import weighed
from gap_flights import believe, measure

from testbench.effects import EFFECTS
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.name import Sought, name_effect
from testbench.questions.gap.workflow import GapSearch, find_gap


def test_a_coefficient_far_off_its_prior_is_named_with_its_size_and_the_aircraft_amended():
    """60 % off a prior of 10 %: the amended aircraft leaves the noise of flights held out."""
    believed = believe()
    truth = believed.with_nuisances({"Cm_alpha": 1.6})
    (one, two), (held, _) = measure(truth, 11), measure(truth, 31)
    few = {n: EFFECTS[n] for n in ("alpha_scale", "actuator_lag")}
    finding = find_gap(believed, {"a": one, "b": two}, {"c": held}, GapSearch(effects=few))
    assert finding.naming.names == ("Cm_alpha",), finding.naming.sentence
    best = finding.naming.best
    assert best.coefficients == ("Cm_alpha",)
    assert abs(best.nuisances["Cm_alpha"] - 1.6) < 4.0 * best.spread["Cm_alpha"]  # false alarm 6e-5
    assert "times the a-priori value" in finding.sentences[0]
    assert finding.shrink[0].removed > 0.95
    assert finding.amended.aircraft.coefficient("Cm_alpha") == pytest.approx(
        truth.aircraft.coefficient("Cm_alpha"), rel=4.0 * best.spread["Cm_alpha"]
    )


def test_two_coefficients_far_off_are_one_explanation():
    believed = believe()
    records = measure(believed.with_nuisances({"Cm_alpha": 1.6, "Cm_q": 2.2}), 11)
    naming = name_effect(believed, records, Sought({}))
    assert set(naming.names[0].split(" + ")) == {"Cm_alpha", "Cm_q"}, naming.sentence
    best = naming.best
    for name, true in (("Cm_alpha", 1.6), ("Cm_q", 2.2)):
        assert abs(best.nuisances[name] - true) < 4.0 * best.spread[name]


def test_within_its_prior_a_coefficient_is_no_gap():
    believed = believe()
    naming = weighed(believed, measure(believed.with_nuisances({"Cm_alpha": 1.1, "Cm_q": 0.9}), 11))
    assert naming.outcome == "no gap"
    assert naming.nuisances["Cm_alpha"] == pytest.approx(1.1, abs=0.05)


FEW = ("roll_damper", "yaw_damper", "interconnect", "bank_hold", "actuator_lag", "surface_scale")


def searched(truth) -> Naming:
    """Return what six effects and the coefficients say of three noisy records, aileron and rudder among them."""
    b, rng = believe_axes(), np.random.default_rng(3)
    flown = []
    for record in recorded(truth(b), commands()):
        data = record.data.copy()
        for i, n in enumerate(record.channels):
            if n in b.outputs:
                data[:, i] += b.noise_std[b.outputs.index(n)] * rng.standard_normal(len(data))
        flown.append(replace(record, data=data))
    return weighed(b, flown, *(EFFECTS[n] for n in FEW))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [("roll_damper", {"gain_s": 0.06}), ("actuator_lag", {"lag_rad_s": 12.0})])
def test_a_hidden_effect_is_named_and_no_coefficient_in_its_place(name, size):
    assert searched(lambda b: b.with_effect(EFFECTS[name], size)).names == (name,)


@pytest.mark.slow
def test_a_hidden_interconnect_is_not_blamed_on_the_yaw_due_to_aileron_alone():
    """At one airspeed the two are nearly the same: 0.3 of the aileron on the rudder is twice Cn_da."""
    assert "interconnect" in searched(lambda b: b.with_effect(EFFECTS["interconnect"], {"ratio": 0.3})).names


@pytest.mark.slow
def test_a_falsified_roll_damping_derivative_is_named_alone():
    assert searched(lambda b: b.with_nuisances({"Cl_p": 1.5})).names == ("Cl_p",)


@pytest.mark.slow
def test_a_falsified_elevator_effectiveness_is_a_set_with_the_linkage():
    assert set(searched(lambda b: b.with_nuisances({"Cm_de": 1.4})).names) == {"Cm_de", "surface_scale"}


@pytest.mark.slow
def test_clean_records_name_nothing():
    assert searched(lambda b: b).outcome == "no gap"
