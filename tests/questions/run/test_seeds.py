"""Repetitions of a run over seeds: what is repeated, the intervals, and the sentence that they give."""

from __future__ import annotations

import numpy as np
import pytest
from failing_estimators import write

import testbench as tb
from testbench.questions.run.seeds import Repeats
from testbench.questions.run.seeds_answer import seeds_findings

FAST = "short period, fast root"
SENSED = {"bare": ("V", "q"), "vane": ("V", "alpha", "q")}


def drawn(before: float, after: float, n: int = 40) -> Repeats:
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 1.0, n)
    errors = {
        ("bare", "long"): {FAST: before + noise, "prediction of V, q": 10.0 + 0.1 * rng.normal(size=n)},
        ("vane", "long"): {
            FAST: after + rng.normal(0.0, 1.0, n),
            "prediction of V, q": 10.0 + 0.1 * rng.normal(size=n),
        },
    }
    return Repeats(n, errors)


def test_the_lead_gives_the_largest_sure_gain_with_its_interval_in_few_words():
    lead, detail, meaning = seeds_findings(drawn(30.0, 10.0), SENSED)
    assert lead.startswith("40 seeds, long: alpha lowers the error of the fast root of the short period from ")
    assert len(lead.split()) <= 25
    mean = drawn(30.0, 10.0).mean(("bare", "long"), FAST)
    assert mean.low < 30.0 < mean.high  # the seed is fixed; 95 % of seeds hold this
    assert "changes the error of the prediction of V, q" in detail
    assert "5 % for all 2 questions together" in meaning


def test_what_is_no_more_than_chance_is_not_called_a_gain():
    lead = seeds_findings(drawn(20.0, 20.0), SENSED)[0]  # false alarm: 5 % over draws; the draw is fixed
    assert lead == "over 40 seeds no other suite reduces an error by more than chance"


def test_percent_of_a_truth_near_zero_do_not_lead():
    repeats, rng = drawn(30.0, 10.0), np.random.default_rng(4)
    for key, size in ((("bare", "long"), 4e6), (("vane", "long"), 900.0)):
        repeats.errors[key]["N_p"] = size * (1.0 + 0.1 * rng.normal(size=40))
    lead, detail, _ = seeds_findings(repeats, SENSED)
    assert "fast root of the short period" in lead
    assert "N_p: errors of more than 100 % of the true value, without alpha and with it" in detail
    assert "e+06" not in detail
    alone = Repeats(40, {key: {"N_p": series["N_p"]} for key, series in repeats.errors.items()})
    assert seeds_findings(alone, SENSED)[0] == (
        "over 40 seeds another suite lowers only errors above 100 % of the true value"
    )


def test_a_mode_that_no_seed_found_has_no_mean_and_is_counted():
    repeats = drawn(30.0, 10.0)
    lost = np.full(40, np.nan)
    errors = {k: {**v, FAST: lost} if k[0] == "vane" else v for k, v in repeats.errors.items()}
    repeats = Repeats(40, errors)
    assert repeats.mean(("vane", "long"), FAST) is None
    assert "is found in 40 of 40 seeds without and in 0 with it" in seeds_findings(repeats, SENSED)[1]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    equation = '{ method = "equation_error", structure = "longitudinal", short = true, V_m_s = 16.0 }'
    file = write(tmp_path_factory.mktemp("seeds"), equation)
    scenario = tb.load_scenario(file).changed(suites=("eolo_alpha",), seeds=4)
    return scenario, tb.run(scenario)


def test_the_first_seed_is_the_run_itself_and_every_other_has_noise_of_its_own(flown):
    scenario, result = flown
    alone = tb.run(scenario.changed(seeds=1))
    p = next(p for p in alone.cases[0].evaluation.parameters if p.name == "M_q")
    found = result.repeats.errors["eolo_alpha", "equation_error"]["M_q"]
    assert found[0] == 100.0 * abs(p.value - p.true) / abs(p.true)
    assert len(set(found.tolist())) == 4
    assert "over 4 seeds" in result.findings[0]


def test_a_structure_without_the_phugoid_is_not_blamed_for_missing_it(flown):
    _, result = flown
    assert [m.name for m in result.cases[0].evaluation.poles if m.name == "phugoid"] == []
    assert "speed_left_out" in {a.code for a in result.cases[0].model.advice}  # Z_alpha is 97 % off
