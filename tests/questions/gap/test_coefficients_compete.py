"""A wrong coefficient is a hypothesis among the effects: accused alone, or told with what does the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from axes import believe as believe_axes
from axes import commands
from gap_flights import ELEVATOR, believe, measure

from testbench.effects import EFFECTS
from testbench.questions.gap.coefficients import gain_of, rivals
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.linkage import linkage_instead
from testbench.questions.gap.parameters import off_parameters, wrong_parameters
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


def test_what_a_coefficient_gains_by_formula_is_what_it_gains_with_its_prior_dropped(tuned):
    free = retune(replace(tuned, priors={**tuned.priors, "Cm_alpha": 10.0}, slopes=tuned.tangents))
    gain = gain_of("Cm_alpha", naming_of(tuned))
    assert tuned.chi2 - free.chi2 == pytest.approx(gain, rel=0.1)
    assert gain == pytest.approx(0.35**2 / 0.1**2, rel=0.2)


def test_an_accused_coefficient_is_told_with_the_effect_that_does_the_same_and_not_with_one_that_does_less(tuned):
    gain = gain_of("Cm_alpha", naming_of(tuned))
    alike, less = effect_that_gains(tuned, gain - 5.0), effect_that_gains(tuned, gain - 15.0)
    assert rivals("Cm_alpha", naming_of(tuned, alike)) == (alike,)
    assert rivals("Cm_alpha", naming_of(tuned, less)) == ()
    beside = dict(tuned.by_name)  # the coefficient stays where it is: the effect does something else
    assert rivals("Cm_alpha", naming_of(tuned, replace(alike, nuisances=beside))) == ()
    for impossible in ({"within": 1e-4}, {"flown": False}, {"settled": False}):
        assert rivals("Cm_alpha", naming_of(tuned, replace(alike, **impossible))) == ()
    (accused,) = wrong_parameters(naming_of(tuned, alike), tuned.believed)
    assert accused.sentence.startswith("one of these, which these data cannot tell apart: the believed Cm_alpha is")
    assert EFFECTS["pitch_damper"].title in accused.sentence
    assert "What separates them: flights at another airspeed" in accused.sentence


def test_an_effect_that_held_out_flights_refute_is_not_told_beside_a_coefficient(tuned):
    alike = effect_that_gains(tuned, gain_of("Cm_alpha", naming_of(tuned)) - 5.0)
    (kept,) = measure(tuned.believed.with_nuisances({"Cm_alpha": 1.35}), 12, inputs=(ELEVATOR,))
    (accused,) = wrong_parameters(naming_of(tuned, alike), tuned.believed, [kept])
    assert (accused.name, accused.rivals) == ("Cm_alpha", ())


def test_no_coefficient_is_accused_where_re_tuning_explains_little_or_an_effect_most_of_the_rest(tuned):
    """Named or not: a slew limit of which 0.1 % was left unexplained stood beside three accused coefficients."""
    gain = gain_of("Cm_alpha", naming_of(tuned))
    for share, accused in ((0.6, ["Cm_alpha"]), (0.7, []), (float("nan"), ["Cm_alpha"])):
        naming = naming_of(tuned, effect_that_gains(tuned, gain + 200.0, share=share))
        assert [p.name for p in wrong_parameters(naming, tuned.believed)] == accused
        assert [p.name for p in off_parameters(naming)] == accused
    naming = naming_of(tuned)
    for believed, left, accused in ((5.0, 3.2, ["Cm_alpha"]), (5.0, 3.9, []), (1.01, 1.005, ["Cm_alpha"])):
        poor = replace(naming, chi2_believed=believed * naming.samples, chi2_tuned=left * naming.samples)
        assert [p.name for p in wrong_parameters(poor, tuned.believed)] == accused
    hardly = effect_that_gains(tuned, gain, share=0.7, threshold=gain + 1.0)  # no more than noise would
    assert [p.name for p in wrong_parameters(naming_of(tuned, hardly), tuned.believed)] == ["Cm_alpha"]


def test_a_wrong_effectiveness_is_told_with_the_linkage_that_does_the_same_though_no_search_found_it(tuned):
    truth = tuned.believed.with_nuisances({"Cm_de": 1.4})
    records, (held,) = measure(truth, 21), measure(truth, 31, inputs=(ELEVATOR,))
    point = retune(Hypothesis.at(tuned.believed, tuned.believed, tuple(records)))
    (accused,) = wrong_parameters(naming_of(point), point.believed, [held], records, EFFECTS)
    assert accused.name == "Cm_de"
    assert wrong_parameters(naming_of(point), point.believed, [held], records)[0].rivals == ()  # nothing is sought
    (linkage,) = accused.rivals
    assert (linkage.effect.name, linkage.values) == ("surface_scale", {"scale": accused.factor})
    assert linkage.nuisances["Cm_de"] == pytest.approx(1.0, abs=0.05)
    assert linkage.errors["scale"] == pytest.approx(0.1 * accused.factor, rel=0.05)  # the coefficient's own prior
    asked = naming_of(point), point.believed, records, [held]
    # the re-tuned aircraft left nothing of what was held out
    assert linkage_instead("Cm_de", *asked, 0.0, EFFECTS) is None
    assert linkage_instead("Cm_alpha", *asked, np.inf, EFFECTS) is None  # no linkage does what this coefficient does


@pytest.mark.parametrize(("left", "count", "said"), [(1.5, 2, 2), (1.5, 3, 0), (1.01, 3, 3)])
def test_three_coefficients_wrong_at_once_are_no_answer_while_more_than_noise_is_left(tuned, left, count, said):
    names = ("Cm_alpha", "Cm_q", "Cm_de", "CL_alpha")
    measured = {n: (0.4 if i < count else 1.0, 0.01) for i, n in enumerate(names)}
    samples = tuned.samples
    naming = replace(naming_of(tuned), chi2_believed=50.0 * samples, chi2_tuned=left * samples, measured=measured)
    assert len(off_parameters(naming)) == said


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
    assert "interconnect" in [f.effect.name for f in accused.rivals]


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
    assert any("elevator" in f.effect.title for f in accused.rivals)


@pytest.mark.slow
def test_clean_records_name_nothing_and_accuse_nothing():
    naming, accused = searched(lambda b: b)
    assert (naming.outcome, naming.names, accused) == ("no gap", (), ())
