"""Decisions about fits: what is named, what is form, what gives way; no flights, the fits are written down."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

import testbench.questions.gap.search.fit as fit_module
from testbench.effects import EFFECTS
from testbench.effects.base import together
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import (
    decide,
    does_without,
    is_special_case,
    leads,
    more_than_form,
    score,
    worth_of_form,
)
from testbench.questions.gap.priors import PRIORS
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.gauss_newton import Descent
from testbench.questions.gap.search.name import _asked
from testbench.questions.gap.search.screening import Screened
from testbench.questions.gap.search.several import _Joint, several_at_once


@pytest.fixture(scope="module")
def slow():
    """A naming whose best fit, of a slow servo, leaves noise."""
    best = EffectFit(
        effect=EFFECTS["actuator_lag"],
        values={"lag_rad_s": 12.0},
        errors={"lag_rad_s": 0.1},
        chi2=4_450.0,
        gain=9_000.0,
        threshold=17.0,
        share=0.999,
        nuisances=dict.fromkeys(PRIORS, 1.0),
    )
    return SimpleNamespace(best=best)


def test_the_special_case_is_named_where_a_general_form_gains_no_more_than_form_would(slow):
    special = slow.best
    general = replace(
        special, effect=EFFECTS["second_order_actuator"], values={"omega_rad_s": 1.0, "zeta": 1.0}, gain=special.gain
    )
    assert is_special_case(special, general)
    assert is_special_case(special, replace(general, gain=special.gain * (1.0 + 0.5 * CRITERIA.form) + 5.0))
    assert not is_special_case(special, replace(general, gain=special.gain * (1.0 + 2.0 * CRITERIA.form) + 20.0))
    assert not is_special_case(general, special)


def test_what_several_pairs_have_in_common_is_named_where_it_explains_enough(slow):
    """Two partners that each explain what a servo leaves speak for neither of them; one that is alone does."""
    servo = replace(slow.best, share=0.97, gain=10_000.0, chi2=5_000.0)
    samples = 4_500
    pairs = []
    for partner, gain in (("alpha_scale", 10_500.0), ("mass_error", 10_497.0)):
        both = together(EFFECTS["actuator_lag"], EFFECTS[partner])
        ones = dict.fromkeys((p.name for p in both.parameters), 1.0)
        pairs.append(replace(servo, effect=both, values=ones, errors=ones, gain=gain))
    fits = tuple(replace(f, share=0.999, chi2=4_500.0) for f in pairs)
    outcome, names, sentence = decide((*fits, servo), 15_000.0, samples, samples)
    assert (outcome, names) == ("named", ("actuator_lag",)), sentence
    assert "either to its form or to one of several other effects" in sentence
    assert decide((fits[0], servo), 15_000.0, samples, samples)[1] == (fits[0].effect.name,)


def test_company_that_may_as_well_act_elsewhere_is_no_name(slow):
    """Where a servo explains half, a vane or the mass the rest, one effect that is not known may do it all."""
    samples = 4_500

    def pair(first, second, gain):
        both = together(EFFECTS[first], EFFECTS[second])
        sizes = dict.fromkeys((p.name for p in both.parameters), 0.7)
        return replace(slow.best, effect=both, values=sizes, errors=sizes, gain=gain, share=0.999, chi2=4_500.0)

    servo = replace(slow.best, share=0.5, gain=5_000.0, chi2=10_000.0)
    vane, mass = pair("actuator_lag", "alpha_scale", 10_500.0), pair("actuator_lag", "mass_error", 10_497.0)
    outcome, names, sentence = decide((vane, mass, servo), 15_000.0, samples, samples)
    assert (outcome, names) == ("unexplained", ()), sentence
    assert all(f.effect.title in sentence for f in (vane, mass))
    assert decide((vane, servo), 15_000.0, samples, samples)[1] == (vane.effect.name,)
    told_apart = replace(mass, gain=9_000.0)
    assert decide((vane, told_apart, servo), 15_000.0, samples, samples)[1] == (vane.effect.name,)
    late = pair("actuator_lag", "alpha_lag", 10_497.0)  # of the same vane
    names = vane.effect.name, late.effect.name
    assert decide((vane, late, servo), 15_000.0, samples, samples)[:2] == ("set", names)


def test_form_is_a_share_of_what_an_effect_does_where_coefficients_imitate_it(slow):
    """A yaw damper with a filter gained 1104 beside coefficients, and 6e5 beside its own: 169 more was form."""
    assert more_than_form(169.0, 1_104.0)
    assert not more_than_form(169.0, 1_104.0, work=6e5)
    assert more_than_form(0.36 * 1_104.0, 1_104.0, work=1e7)  # as much as a second effect would have to gain
    assert more_than_form(169.0, 1_104.0, work=1e5)  # coefficients do less than 99 % of it
    imitated = replace(slow.best, gain=1_000.0, work=2e5)
    other = EFFECTS["alpha_scale"]
    assert worth_of_form(imitated, other, 4_500, noise=5_000.0) == pytest.approx(0.35 * 1_000.0)
    assert worth_of_form(imitated, other, 4_500, noise=4_000.0) == pytest.approx(5e-4 * 2e5)
    assert worth_of_form(replace(imitated, work=9e4), other, 4_500, noise=5_000.0) == pytest.approx(0.02 * 1_000.0)
    assert worth_of_form(replace(imitated, within=1e-3), other, 4_500, noise=5_000.0) == 0.0


def test_company_in_its_place_is_worth_more_than_form_where_an_effect_leaves_far_more_than_its_form_may(slow):
    """A bank angle of two stages: its lag gained 128 214 and left 2965, a delay beside it 3742 of that.

    A twentieth of what the lag gained would be 6411: with 2965 left it was no name, and with a delay beside it neither.
    """
    samples, noise = 42_060, 42_962.0
    lag = replace(slow.best, gain=128_214.0, work=0.0, chi2=45_025.0)
    delay = EFFECTS["transport_delay"]  # in the place of the servo's lag
    assert worth_of_form(lag, delay, samples, noise) == pytest.approx(5e-4 * lag.gain)
    both = replace(
        lag, effect=together(EFFECTS["actuator_lag"], delay), gain=131_956.0, chi2=41_284.0, values={"a": 1, "b": 1}
    )
    assert not does_without(both, lag, samples, noise)
    whole = replace(lag, chi2=samples + 2_800.0)  # within ten standard deviations of the noise
    assert worth_of_form(whole, delay, samples, noise) == pytest.approx(0.05 * lag.gain)


def test_what_leaves_far_more_than_noise_is_nearest_and_no_name(slow):
    """Ten standard deviations of the noise's chi-square, and two thousandths of the gain: a relative leaves as much."""
    samples, limit = 4_500, 10.0 * np.sqrt(2.0 * 4_500)
    near = replace(slow.best, gain=0.5 * limit / 2e-3, share=0.99)
    for left, outcome in ((0.9 * limit, "named"), (1.1 * limit, "unexplained")):
        fit_left = replace(near, chi2=samples + left)
        assert decide((fit_left,), fit_left.chi2 + near.gain, samples, samples)[0] == outcome
    loud = replace(near, gain=2.0 * limit / 2e-3, chi2=samples + 1.9 * limit)  # no form is right to so little of it
    assert decide((loud,), loud.chi2 + loud.gain, samples, samples)[0] == "named"


def test_what_explains_too_little_is_named_only_if_it_leaves_noise(slow):
    """Noise exceeds the limit once in a thousand records; at once in fifty, three right names in 36 were lost."""
    samples = 4_500
    for probability, outcome in (
        (2e-2, "named"),
        (2.0 * CRITERIA.false_alarm, "named"),
        (0.5 * CRITERIA.false_alarm, "unexplained"),
    ):
        left = replace(slow.best, gain=500.0, share=0.6, chi2=float(chi2.isf(probability, samples)))
        assert decide((left,), left.chi2 + left.gain, samples, samples)[0] == outcome


def test_a_rival_given_up_before_it_gained_is_tried_from_where_coefficients_rest(slow):
    """From the believed values, far from rest, a late attitude was given up beside a lag of it, and the lag named.

    In an F-16 a slow rudder servo had flown, was given up above where coefficients rest, and a delay was named.
    """
    best = replace(slow.best, gain=2_000.0, chi2=4_500.0, settled=True)
    rival = replace(best, effect=EFFECTS["transport_delay"], gain=0.0, chi2=7_000.0, flown=False, settled=False)
    one = SimpleNamespace(effect=rival.effect, promise=1_500.0)
    fits = {f.effect.name: f for f in (best, rival)}
    assert _asked(one, 0, fits, 4_600.0).best_gain == 2_000.0
    flown = replace(rival, flown=True)
    assert _asked(one, 0, {**fits, "transport_delay": flown}, 4_600.0).best_gain == 2_000.0
    for judged in (replace(flown, gain=500.0, chi2=6_000.0), replace(flown, settled=True)):
        assert _asked(one, 0, {**fits, "transport_delay": judged}, 4_600.0) == ""
    assert _asked(SimpleNamespace(effect=rival.effect, promise=100.0), 0, fits, 4_600.0) == ""


def test_what_strains_nothing_takes_the_place_of_what_leads_it_by_chance(slow):
    """Mass alone, beside a coefficient 3.7 deviations off, came before a payload that needs none."""
    strained = replace(slow.best, gain=1_000.0, chi2=4_500.0, within=0.1 * CRITERIA.strained, share=0.99)
    for trails, outcome in ((CRITERIA.told_apart - 1.0, "named"), (CRITERIA.told_apart + 1.0, "unexplained")):
        another = replace(slow.best.effect, name="another")
        other = replace(strained, effect=another, gain=1_000.0 - trails, within=1.0)
        assert decide((strained, other), 5_500.0, 4_500, 4_500)[0] == outcome


def test_an_effect_that_would_have_to_be_larger_than_possible_is_no_name(slow):
    """Of 19 names given where the true effect was not in the library, three lay at such an end; of 130 right ones none.

    A delay of the airspeed stood for a lag of 0.85 s, a vane's share in the airspeed for a bent scale.
    """
    delay = replace(slow.best, effect=EFFECTS["V_delay"], errors={"delay_s": 0.01}, share=0.99, chi2=4_450.0)
    for delay_s, outcome in ((0.5, "unexplained"), (0.49, "named"), (0.0, "named")):
        late = replace(delay, values={"delay_s": delay_s})
        assert decide((late,), 13_450.0, 4_500, 4_500)[0] == outcome
    far = replace(delay, values={"delay_s": 0.5})
    assert "delay_s lies at the end of its range" in decide((far,), 13_450.0, 4_500, 4_500)[2]
    possible = replace(slow.best, gain=far.gain - CRITERIA.told_apart + 1.0, values={"lag_rad_s": 12.0})
    outcome, names, _ = decide((far, possible), 13_450.0, 4_500, 4_500)
    assert (outcome, names) == ("named", ("actuator_lag",))  # it trails by chance only, and is possible


def test_the_end_of_a_form_is_a_form(slow):
    """A slipstream on the elevator alone, none on the damping, is one; a share of 1 or 0 refutes nothing."""
    names = {p.name: 0.5 for p in EFFECTS["elevator_slipstream"].parameters}
    for damping_share in (0.0, 1.0):
        values = {**names, "damping_share": damping_share}
        washed = replace(slow.best, effect=EFFECTS["elevator_slipstream"], values=values, errors=names)
        assert washed.beyond == ()
        assert decide((washed,), 13_450.0, 4_500, 4_500)[0] == "named"


def test_the_least_gain_that_is_named(slow):
    for gain, outcome in ((CRITERIA.least - 1.0, "no gap"), (CRITERIA.least + 1.0, "named")):
        small = replace(slow.best, gain=gain, threshold=20.0, chi2=4_500.0, share=float("nan"))
        assert decide((small,), 4_500.0 + gain, 4_500, 4_500)[0] == outcome


def test_a_second_effect_is_dropped_where_the_first_one_alone_does_as_well_but_for_its_form(slow):
    """The first one leaves noise; what its form is not right to may be 2 % of what it gains, 5 % in one place."""
    single = replace(slow.best, gain=10_000.0, chi2=4_550.0)

    def joint(partner: str, gain: float):
        return replace(single, effect=together(EFFECTS["actuator_lag"], EFFECTS[partner]), gain=gain)

    assert does_without(joint("alpha_scale", 10_190.0), single, 4_500, 4_600.0)
    assert not does_without(joint("alpha_scale", 10_210.0), single, 4_500, 4_600.0)
    assert does_without(joint("transport_delay", 10_490.0), single, 4_500, 4_600.0)
    assert not does_without(joint("transport_delay", 10_510.0), single, 4_500, 4_600.0)
    assert not does_without(joint("alpha_scale", 10_190.0), replace(single, chi2=4_700.0), 4_500, 4_600.0)
    assert not does_without(
        joint("alpha_scale", 10_190.0), replace(single, within=0.1 * CRITERIA.strained), 4_500, 4_600.0
    )
    assert not does_without(
        joint("alpha_scale", 10_190.0), replace(single, effect=EFFECTS["mass_error"]), 4_500, 4_600.0
    )


def test_a_second_effect_beside_one_that_leaves_noise_takes_as_much_as_a_name(slow):
    """No simulation, and no model of turbulence, is right to a few parts in a thousand of chi-square."""
    single = replace(slow.best, gain=500.0, chi2=4_550.0)
    both = together(EFFECTS["actuator_lag"], EFFECTS["alpha_scale"])
    values = dict.fromkeys((p.name for p in both.parameters), 1.0)
    price = np.log(4_500)  # of one parameter more

    def joint(more: float):
        return replace(single, effect=both, values=values, gain=500.0 + more)

    assert does_without(joint(price + CRITERIA.weak - 1.0), single, 4_500, 4_600.0)
    assert not does_without(joint(price + CRITERIA.weak + 1.0), single, 4_500, 4_600.0)
    assert leads(
        joint(price + CRITERIA.told_apart + 1.0), replace(single, chi2=4_700.0), 4_500, 4_600.0
    )  # it leaves more than noise
    assert not leads(joint(price + CRITERIA.told_apart + 1.0), single, 4_500, 4_600.0)


def test_company_that_one_effect_needed_on_its_way_is_left_out_again(slow, monkeypatch):
    """A shifted centre of gravity came to rest beside two others only, and had no need of them once it was there."""
    samples, noise = 4_500, 4_500.0
    lead = replace(slow.best, gain=10_000.0, chi2=6_000.0, share=0.9)
    gains = {"actuator_lag": 11_990.0, "alpha_scale": 200.0, "mass_error": 300.0}

    def fit_of(*names: str):
        effect = together(*(EFFECTS[n] for n in names)) if len(names) > 1 else EFFECTS[names[0]]
        gain = max(gains[n] for n in names) + 2.0 * len(names)
        values = dict.fromkeys((p.name for p in effect.parameters), 1.0)
        return replace(lead, effect=effect, values=values, errors=values, gain=gain, chi2=16_000.0 - gain)

    def without(self, joint, part, hopeless):
        return fit_of(*(p.name for p in joint.effect.parts if p is not part))

    monkeypatch.setattr(_Joint, "beside", lambda self, *args: [fit_of(*gains)])
    monkeypatch.setattr(_Joint, "swapped", lambda self, *args: [])
    monkeypatch.setattr(_Joint, "simpler", lambda self, *args: [])
    monkeypatch.setattr(_Joint, "without", without)
    base = SimpleNamespace(believed=SimpleNamespace(whiten=None))
    found = several_at_once(base, 16_000.0, (), (lead,), samples, 3, print)
    best = max(found, key=lambda f: score(f, samples))
    assert best.effect.name == "actuator_lag"
    assert best.chi2 < noise


def test_a_general_form_is_told_from_special_cases_of_all_its_parts():
    def of(*names: str):
        return together(*(EFFECTS[n] for n in names)) if len(names) > 1 else EFFECTS[names[0]]

    assert of("second_order_actuator").generalises(of("actuator_lag"))
    assert not of("actuator_lag").generalises(of("second_order_actuator"))
    assert not of("actuator_lag").generalises(of("actuator_lag"))
    assert of("thrust_line", "second_order_actuator").generalises(of("actuator_lag", "thrust_line"))
    assert of("thrust_line", "actuator_lag").generalises(of("thrust_line"))
    assert not of("thrust_line", "actuator_lag").generalises(of("thrust_line", "transport_delay"))


def test_a_descent_that_is_given_up_begins_anew_at_the_usual_size(monkeypatch):
    """The best multiple of what a lost fin does lay at the end of its range, and the descent from there went astray."""
    base = SimpleNamespace(exact=np.zeros(4_500), samples=4_500)
    far, usual, begun = np.array([0.88]), np.array([0.2]), []

    def descend(signature, start, *more):
        begun.append(float(start[0]))
        settled = start is usual
        left = 4_450.0 if settled else 90_000.0
        return Descent(np.array([0.44]), dict.fromkeys(PRIORS, 1.0), np.ones((4_500, 1)), left, True, 1.0, settled)

    monkeypatch.setattr(fit_module, "descend", descend)
    screened = Screened(EFFECTS["lost_fin"], SimpleNamespace(base=base), (far,), 1e5, "")
    assert not fit_module.fit(screened, 10_000.0, 0.0, 1).settled
    found = fit_module.fit(replace(screened, instead=usual), 10_000.0, 0.0, 1)
    assert (found.settled, found.chi2) == (True, 4_450.0)
    assert begun == [0.88, 0.88, 0.2]
    fit_module.fit(replace(screened, starts=(usual,), instead=usual), 10_000.0, 0.0, 1)
    assert begun[3:] == [0.2]  # what came to rest is not tried again
