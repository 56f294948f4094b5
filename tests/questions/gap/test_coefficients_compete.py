"""A wrong coefficient is a hypothesis among the effects: it leads, it is led, or both are the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from axes import believe as believe_axes
from axes import commands
from gap_flights import ELEVATOR, believe, measure

from testbench.questions.gap.coefficients import compete, far_off, fit_alone, gain_of, rivals
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.effects import EFFECTS
from testbench.questions.gap.effects.contract import recorded
from testbench.questions.gap.parameters import wrong_parameters
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.name import name_effect


@pytest.fixture(scope="module")
def tuned():
    """Return the believed EOLO re-tuned to a record of one whose Cm_alpha is 35 % off."""
    believed = believe()
    (record,) = measure(believed.with_nuisances({"Cm_alpha": 1.35}), 11, inputs=(ELEVATOR,))
    return retune(Hypothesis.at(believed, believed, (record,)))


def effect_that_gains(tuned, gain: float, **changes) -> EffectFit:
    """Return a pitch damper that is said to gain so much."""
    effect = EFFECTS["pitch_damper"]
    sizes = {p.name: p.starts[0] for p in effect.parameters}
    near = dict.fromkeys(tuned.priors, 1.0)
    errors = dict.fromkeys(sizes, 0.01)
    found = EffectFit(effect, sizes, errors, tuned.chi2 - gain, gain, 14.0, float("nan"), near)
    return replace(found, **changes)


def naming_of(tuned, *fits: EffectFit, names: tuple[str, ...] = ()) -> Naming:
    return Naming(
        outcome="named" if names else "no gap",
        names=names,
        ranking=fits,
        chi2_believed=0.0,
        chi2_tuned=tuned.chi2,
        nuisances=tuned.by_name,
        samples=tuned.samples,
        sentence="",
        measured=tuned.measured(),
    )


def test_what_a_coefficient_gains_by_formula_is_what_it_gains_flown(tuned):
    naming, alone = naming_of(tuned), fit_alone("Cm_alpha", tuned)
    assert far_off(naming) == ("Cm_alpha",)
    assert alone.gain == pytest.approx(gain_of("Cm_alpha", naming), rel=0.1)
    assert alone.gain == pytest.approx(0.35**2 / 0.1**2, rel=0.2)
    assert alone.values["factor"] == pytest.approx(1.35, abs=4.0 * alone.errors["factor"])
    assert alone.nuisances["Cm_alpha"] == 1.0, "it is told by its own parameter, not twice"


@pytest.mark.parametrize(("more", "names"), [(10.0, 2), (-10.0, 2), (16.0, 1), (-16.0, 0)])
def test_coefficient_and_effect_are_a_set_unless_one_leads_by_what_tells_effects_apart(tuned, more, names):
    best = effect_that_gains(tuned, fit_alone("Cm_alpha", tuned).gain + more)
    out = compete(naming_of(tuned, best, names=("pitch_damper",)), tuned, 2.0 * tuned.samples)
    assert len(out.names) == names
    if names == 2:
        assert out.outcome == "set"
        assert set(out.names) == {"pitch_damper", "wrong Cm_alpha"}
        assert out.names[0] == ("pitch_damper" if more > 0.0 else "wrong Cm_alpha")
        assert out.best is not None
        assert "another airspeed" in out.sentence or more > 0.0
    elif names == 0:
        assert out.outcome == "no gap"
        assert "a wrong Cm_alpha alone explains more" in out.sentence
        (accused,) = wrong_parameters(out, tuned.believed)
        assert (accused.name, accused.rivals) == ("Cm_alpha", ())
    else:
        assert out.outcome == "named"


def test_an_accused_coefficient_is_told_with_the_effect_that_does_the_same_and_not_with_one_that_does_less(tuned):
    gain = gain_of("Cm_alpha", naming_of(tuned))
    alike, less = effect_that_gains(tuned, gain - 5.0), effect_that_gains(tuned, gain - 15.0)
    assert rivals("Cm_alpha", naming_of(tuned, alike)) == (alike,)
    assert rivals("Cm_alpha", naming_of(tuned, less)) == ()
    for impossible in ({"within": 1e-4}, {"flown": False}, {"settled": False}):
        assert rivals("Cm_alpha", naming_of(tuned, replace(alike, **impossible))) == ()
    (accused,) = wrong_parameters(naming_of(tuned, alike), tuned.believed)
    assert accused.sentence.startswith("one of these, which these data cannot tell apart: the believed Cm_alpha is")
    assert EFFECTS["pitch_damper"].title in accused.sentence
    assert "What separates them: flights at another airspeed" in accused.sentence


FEW = ("roll_damper", "yaw_damper", "interconnect", "bank_hold", "actuator_lag", "surface_scale")


def searched(truth) -> tuple[Naming, tuple]:
    """Return what six effects and the coefficients say of three noisy records, aileron and rudder among them."""
    b, rng = believe_axes(), np.random.default_rng(3)
    flown = []
    for record in recorded(truth(b), commands()):
        data = record.data.copy()
        for i, n in enumerate(record.channels):
            if n in b.outputs:
                data[:, i] += b.noise_std[b.outputs.index(n)] * rng.standard_normal(len(data))
        flown.append(replace(record, data=data))
    naming = name_effect(b, tuple(flown), effects={n: EFFECTS[n] for n in FEW}, pairs=False)
    return naming, wrong_parameters(naming, b)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [("roll_damper", {"gain_s": 0.06}), ("actuator_lag", {"lag_rad_s": 12.0})])
def test_a_hidden_effect_is_named_and_no_coefficient_accused_in_its_place(name, size):
    naming, accused = searched(lambda b: b.with_effect(EFFECTS[name], size))
    assert (naming.names, accused) == ((name,), ())


@pytest.mark.slow
def test_a_hidden_interconnect_is_not_blamed_on_the_yaw_due_to_aileron_alone():
    """At one airspeed the two are nearly the same: 0.3 of the aileron on the rudder is twice Cn_da."""
    naming, (accused,) = searched(lambda b: b.with_effect(EFFECTS["interconnect"], {"ratio": 0.3}))
    assert naming.names == ()
    assert accused.name == "Cn_da"
    assert any(r.startswith(EFFECTS["interconnect"].title) for r in accused.rivals)


@pytest.mark.slow
def test_a_falsified_roll_damping_derivative_is_accused_alone():
    naming, (accused,) = searched(lambda b: b.with_nuisances({"Cl_p": 1.5}))
    assert naming.names == ()
    assert (accused.name, accused.rivals) == ("Cl_p", ())


@pytest.mark.slow
def test_a_falsified_elevator_effectiveness_is_a_set_with_the_linkage():
    naming, (accused,) = searched(lambda b: b.with_nuisances({"Cm_de": 1.4}))
    assert naming.names == ()
    assert accused.name == "Cm_de"
    assert any("elevator" in rival for rival in accused.rivals)


@pytest.mark.slow
def test_clean_records_name_nothing_and_accuse_nothing():
    naming, accused = searched(lambda b: b)
    assert (naming.outcome, naming.names, accused) == ("no gap", (), ())
