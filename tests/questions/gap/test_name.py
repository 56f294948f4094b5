"""Naming: one effect, several at once, none, and none of those that are known; few candidates, so that it is quick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.blind.flights import fly_truth
from studies.blind.run import believe
from studies.blind.truth import Truth
from studies.blind.truths import TRUTHS

from testbench.effects import EFFECTS
from testbench.questions.gap.name import Sought, name_effect, size_of

FEW = ("actuator_lag", "second_order_actuator", "transport_delay", "alpha_scale", "pitch_damper")


def named(plan: Truth, names: tuple[str, ...] = FEW, seed: int = 11, flown: str = "short", aircraft: str = "taurus"):
    records = list(fly_truth(aircraft, plan, flown, seed).values())
    return name_effect(believe(aircraft), records, Sought({n: EFFECTS[n] for n in names}))


SLOW = TRUTHS["slow servo"]({"lag_rad_s": 12.0}, "taurus")


def hidden(kinds: dict[str, dict[str, float]], aircraft: str = "taurus", **factors: float) -> Truth:
    plan = Truth(factors=factors)
    for kind, sizes in kinds.items():
        plan = plan.with_(TRUTHS[kind](sizes, aircraft))
    return plan


@pytest.fixture(scope="module")
def slow():
    return named(SLOW)


def test_a_slow_servo_is_named_with_its_size_and_not_its_more_general_form(slow):
    assert (slow.outcome, slow.names) == ("named", ("actuator_lag",)), slow.sentence
    best = slow.best
    assert abs(best.values["lag_rad_s"] - 12.0) < 4.0 * best.errors["lag_rad_s"]  # false alarm 6e-5
    assert "lag_rad_s = 1" in best.size
    assert best.kappa <= 1e-3


def test_every_effect_is_either_ranked_or_has_a_reason(slow):
    ranked = {f.effect.name for f in slow.ranking if not (f.effect.parts or f.coefficients)}
    assert ranked | set(slow.rejected) == set(FEW)
    assert slow.chi2_believed >= slow.chi2_tuned > slow.best.chi2
    assert sum(f.probability for f in slow.ranking) + slow.weighed.nothing + slow.weighed.unknown == pytest.approx(1.0)


def test_nothing_hidden_is_no_gap():
    naming = named(Truth(factors={"Cm_q": 1.1, "CL_alpha": 0.97}))
    assert (naming.outcome, naming.names, naming.best) == ("no gap", (), None), naming.sentence


@pytest.mark.parametrize("stated", [*(pytest.param(x, marks=pytest.mark.slow) for x in (0.75, 1.0)), 1.3])
def test_the_name_and_its_size_do_not_depend_on_how_large_the_noise_is_said_to_be(stated):
    believed = believe("taurus")
    sensors = tuple(replace(s, noise_std=stated * s.noise_std) for s in believed.suite.sensors)
    told = replace(believed, suite=replace(believed.suite, sensors=sensors))
    few = {n: EFFECTS[n] for n in ("actuator_lag", "alpha_scale")}
    for plan, names in ((SLOW, ("actuator_lag",)), (Truth(), ())):
        naming = name_effect(told, list(fly_truth("taurus", plan, "short", 11).values()), Sought(few, source="stated"))
        assert naming.names == names, naming.sentence
        for scale, error in naming.weighed.table.noise.values():
            assert abs(scale * stated - 1.0) < 5.0 * error  # ten channels and cases: false alarm 2e-5


@pytest.mark.parametrize(
    "others", [("alpha_scale",), pytest.param(("alpha_scale", "pitch_damper"), marks=pytest.mark.slow)]
)
def test_without_the_true_effect_no_other_one_is_named(others):
    """None is hopeless without it, and another is sought beside the nearest: four seconds."""
    naming = named(SLOW, others)
    assert naming.outcome in ("unexplained", "partial"), naming.sentence
    assert naming.weighed.unknown > 0.9


@pytest.mark.parametrize("others", [(), pytest.param(("transport_delay",), marks=pytest.mark.slow)])
def test_two_effects_at_once_are_one_name_with_both_sizes(others):
    """Fits of one, of both and of each again where both rest: five seconds."""
    plan = hidden({"slow servo": {"lag_rad_s": 12.0}, "vane gain": {"gain": 1.7}})
    naming = named(plan, ("actuator_lag", "alpha_scale", *others))
    assert set(naming.names[0].split(" + ")) == {"actuator_lag", "alpha_scale"}, naming.sentence
    values = naming.best.values
    assert values["actuator_lag.lag_rad_s"] == pytest.approx(12.0, rel=0.1)
    assert values["alpha_scale.scale"] == pytest.approx(1.7, rel=0.05)


@pytest.mark.slow
def test_three_effects_at_once_are_found_one_beside_the_other():
    plan = hidden({"late link": {"delay_s": 0.06}, "ballast": {"ratio": 0.3}, "vane gain": {"gain": 1.5}})
    naming = named(plan, ("transport_delay", "alpha_scale", "mass_error"), flown="rich")
    true = {"transport_delay.delay_s": 0.06, "mass_error.factor": 1.3, "alpha_scale.scale": 1.5}
    assert naming.best.values.keys() == true.keys()
    for name, value in true.items():  # 2 % holds the error of half a frame in a delay besides four standard errors
        assert naming.best.values[name] == pytest.approx(value, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kinds", "factors", "known", "right", "sizes"),
    [
        (
            {"slew limit": {"limit_rad_s": 0.16}},
            {},
            ("rate_limit", "asymmetric_rate_limit", "stall"),
            {"rate_limit"},
            {"limit_rad_s": 0.16},
        ),
        (
            {"effectiveness with speed": {"k": -0.4}},
            {"CL_alpha": 1.073, "CD": 1.127, "Cm_alpha": 0.992, "Cm_q": 1.266, "Cm_de": 0.906},
            ("elevator_mode", "speed_effectiveness"),
            {"speed_effectiveness"},
            {"k": -0.4},
        ),
        (
            {"effectiveness with speed": {"k": -1.018}},
            {"CL_alpha": 1.028, "CD": 0.885, "Cm_alpha": 0.868, "Cm_q": 1.3, "Cm_de": 1.145},
            ("elevator_mode", "thrust_scale", "speed_effectiveness"),
            {"speed_effectiveness"},
            {"k": -1.018},
        ),
        ({"motor of two stages": {"lag_s": 0.68}}, {}, ("thrust_lag", "thrust_scale"), {"thrust_lag"}, {}),
        (
            {"rate feedback": {"gain_s": 0.02}},
            {"CL_alpha": 1.02, "CD": 1.03, "Cm_alpha": 1.02, "Cm_q": 0.91, "Cm_de": 1.15},
            ("pitch_damper", "speed_effectiveness", "transport_delay"),
            {"pitch_damper"},
            {"gain_s": 0.02},
        ),
        ({"linkage ratio": {"gain": 0.52}}, {}, ("surface_scale", "theta_delay"), {"surface_scale"}, {}),
        (
            {"slow servo": {"lag_rad_s": 12.6}, "vane gain": {"gain": 0.846}},
            {"CL_alpha": 0.931, "CD": 0.95, "Cm_alpha": 0.977, "Cm_q": 1.189, "Cm_de": 0.981},
            ("actuator_lag", "alpha_scale", "clock_offset"),
            {"actuator_lag", "alpha_scale"},
            {"actuator_lag.lag_rad_s": 12.6},
        ),
    ],
    ids=[
        "a special case",
        "nearly a mode",
        "far away, of the other sign",
        "of another form",
        "small, its work done by coefficients",
        "no trim with a smaller coefficient",
        "a second one that hardly shows",
    ],
)
def test_what_is_hidden_is_named_among_what_resembles_it(kinds, factors, known, right, sizes):
    naming = named(hidden(kinds, **factors), known, flown="rich")
    found = [set(name.split(" + ")) for name in naming.names]
    # a motor of two stages has a form of its own, beside which thrust of another scale gains
    assert right in found or (not sizes and right < found[0]), naming.sentence
    for name, true in sizes.items():
        assert abs(naming.best.values[name] - true) < 4.0 * naming.best.errors[name], naming.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kinds", "off", "known"),
    [
        (
            {"separation": {"alpha_rad": 0.114, "sharpness": 18.45}, "slow servo": {"lag_rad_s": 18.0}},
            {"CL_alpha": 1.006, "CD": 1.072, "Cm_alpha": 0.982, "Cm_q": 0.947, "Cm_de": 0.973},
            ("actuator_lag", "nonlinear_lift", "stall"),
        ),
        (
            {"linkage ratio": {"gain": 1.37}, "late attitude": {"delay_s": 0.06}},
            {"CL_alpha": 0.945, "CD": 0.985, "Cm_alpha": 1.059, "Cm_q": 0.849, "Cm_de": 1.11},
            ("rate_limit", "surface_scale", "theta_delay"),
        ),
        ({"late link": {"delay_s": 0.05}, "roughness": {"CD0": 0.03}}, {}, ("transport_delay", "drag_increment")),
    ],
    ids=["a stall that first flies too early", "a linkage whose work a coefficient does", "drag beside a late link"],
)
def test_two_effects_of_which_one_cannot_be_seen_at_first_are_found(kinds, off, known):
    naming = named(hidden(kinds, "eolo", **off), known, flown="rich", aircraft="eolo")
    right = {
        "separation": "stall",
        "slow servo": "actuator_lag",
        "linkage ratio": "surface_scale",
        "late attitude": "theta_delay",
        "late link": "transport_delay",
        "roughness": "drag_increment",
    }
    assert any(set(name.split(" + ")) == {right[k] for k in kinds} for name in naming.names), naming.sentence


def test_a_lag_has_a_prior_of_its_order_and_a_size_one_about_nothing():
    (lag,), (scale,) = EFFECTS["actuator_lag"].parameters, EFFECTS["alpha_scale"].parameters
    prior = size_of("lag", lag, 12.0)
    assert np.exp(prior.value) == pytest.approx(np.sqrt(30.0 * 8.0))
    assert (np.exp(prior.low), np.exp(prior.high)) == pytest.approx((lag.low, lag.high))
    of_size = size_of("scale", scale, 1.2)
    assert (of_size.value, of_size.low) == (1.0, scale.low)


def test_whitening_that_halves_residuals_quarters_chi_square(slow):
    records = list(fly_truth("taurus", SLOW, "short", 11).values())
    half = replace(believe("taurus"), whiten=lambda record, r: 0.5 * r)
    naming = name_effect(half, records, Sought({}))
    assert naming.chi2_believed == pytest.approx(slow.chi2_believed / 4.0, rel=1e-9)
    assert np.isfinite(naming.chi2_tuned)
