"""A design over the aircraft that the believed one may be: its own uncertainty drawn, and the choice for the worst."""

import csv
import tomllib
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from believed_taurus import believed_taurus

from testbench.aircraft.believed import drawn, with_priors
from testbench.core.errors import ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.design.amplitude import DRAWS
from testbench.design.ensemble import Flier, draw, told
from testbench.design.refine import Steps, Switching, exchange
from testbench.design.search import worst_of
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.information.fisher import cost
from testbench.questions.design.answer import design_sentences
from testbench.questions.design.ask import run_design
from testbench.questions.design.page import design_page, draws_table, ranking_table
from testbench.questions.design.pose import setting_of
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.plan.response import relative_spread

STATED = {"CL_alpha": 0.05, "Cm_alpha": 0.15, "Cm_q": 0.25, "Cm_de": 0.10}
FILE = SCENARIOS / "design" / "taurus_short_period.toml"


def scenario(aircraft: object = "taurus", **changes: object) -> DesignScenario:
    content = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return DesignScenario.of({**content, "aircraft": str(aircraft), "duration_s": 10.0, "realise": 0, **changes}, None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return believed_taurus(tmp_path_factory.mktemp("design_draws"), STATED)


@pytest.fixture(scope="module")
def judged(folder):
    return run_design(scenario(folder, draws=8))


@pytest.fixture(scope="module")
def robust(folder):
    return run_design(scenario(folder, draws=8, robust=True))


def test_the_believed_aircraft_is_judged_as_without_draws(judged):
    plain = run_design(scenario())
    assert plain.draws is None
    assert plain.best.over is None
    assert [r.design.cost for r in plain.ranking] == [r.design.cost for r in judged.ranking]
    np.testing.assert_array_equal(plain.best.design.errors, judged.best.design.errors)
    assert "draws" not in {t.name for t in design_page(plain).tables}
    said = [s for s in design_sentences(plain) if "drawn" in s]
    assert [s.split(":")[0] for s in said] == [
        "Errors and limits are those of the a-priori model of taurus, which states no [uncertainty]"
    ]


def test_flights_with_all_draws_and_of_all_designs_are_flown_together(folder):
    together, alone = (run_design(scenario(folder, draws=16), simulator=s) for s in ("auto", "jsbsim"))
    tally = together.tally
    assert tally.batch >= 16  # the draws at rest, and with the best design
    assert alone.tally.reasons == {"it is wanted": tally.batch + tally.jsbsim}
    assert design_page(together).flown is tally
    for mine, other in zip(design_page(together).tables, design_page(alone).tables, strict=True):
        shown = [[[c.text(v) for c, v in zip(t.columns, r, strict=True)] for r in t.rows] for t in (mine, other)]
        assert shown[0] == shown[1]


def test_the_exchange_for_all_draws_comes_near_the_best_of_all_signs(judged):
    """By trial of all signs and rests of seven steps, each judged by information in every draw at common limits."""
    problem, draws = judged.problem, judged.draws
    one = replace(draws, judged=draws.judged[:3])
    step, start, count = round(0.4 * problem.rate_hz), round(2.0 * problem.rate_hz), 7
    forms = [Switching.of(d.problem, Steps(step, start, count)) for d in one.judged]

    def worst(signs):
        u = np.zeros((problem.experiment.samples * problem.experiment.stride, 1))
        u[start : start + step * count, 0] = np.repeat(signs, step)
        of = [d.problem for d in one.judged]
        # the exchange looks at limits when the sensors do
        moved = [p.prediction.response(u)[:: p.experiment.stride] for p in of]
        factor = min(p.prediction.factor_of(y)[0] for p, y in zip(of, moved, strict=True))
        return max(cost(p.experiment.information(u), p.targets.gradient, p.criterion) for p in of) / factor

    best = min(worst(np.array([1.0, *rest])) for rest in product((1.0, -1.0, 0.0), repeat=count - 1))
    starts = np.random.default_rng(0).choice([1.0, -1.0, 0.0], (30, count))
    found = [exchange(forms, s) for s in starts if np.any(s)]
    for signs, value in found:
        assert worst(signs) == pytest.approx(value, rel=1e-6)
    assert best * (1.0 - 1e-6) <= min(value for _, value in found) < 1.02 * best


@pytest.mark.slow
def test_inputs_for_all_draws_do_as_well_in_the_worst_as_any_other(robust):
    family = "switching for all draws"
    made, others = ([r for r in robust.ranking if (r.design.family == family) is same] for same in (True, False))
    assert len(made) == 2
    best, other = (min(worst_of(robust.draws.judged, r.design.u) for r in of) for of in (made, others))
    assert best <= other * (1.0 + 1e-9)


def test_an_aircraft_that_is_known_well_has_the_errors_of_the_believed_one_in_every_draw(judged):
    known = replace(judged.aircraft, uncertainty=dict.fromkeys(STATED, 1e-7))
    best = judged.best.design
    setting = setting_of(judged.scenario, judged.believed, judged.ensemble.range_.suite)
    draws = draw(setting, known, 8, judged.scenario.seed, best, Flier())
    ratios = told(best, draws.judged, judged.problem.targets.names).ratios
    assert ratios.shape == (8, len(judged.problem.targets.names))
    believed = best.errors / judged.problem.targets.wanted
    np.testing.assert_allclose(ratios, np.tile(believed, (8, 1)), rtol=1e-3)


@pytest.mark.slow
def test_derivatives_scatter_as_the_band_of_a_plan_takes_them(folder):
    """60 draws: the standard deviation of one scatters by 1 / sqrt(120) = 9 %; three of it, and 5 % for alphadot."""
    aircraft = replace(load_aircraft(folder), uncertainty={"Cm_alpha": 0.10, "Cm_de": 0.05})
    condition = FlightCondition(12.0, 100.0)

    def derivatives(one) -> tuple[float, float]:
        linear = linearise(one, trim(one, condition))
        q = linear.states.index("q")
        return linear.A[q, linear.states.index("w")], linear.B[q, linear.inputs.index("de")]

    found = np.array([derivatives(drawn(aircraft, 1, i)) for i in range(60)]) / derivatives(aircraft)
    expected = relative_spread(("M_alpha", "M_de"), aircraft, 0.15)
    assert expected.tolist() == [0.10, 0.05]
    np.testing.assert_allclose(found.std(axis=0), expected, rtol=0.32)


def test_the_answer_tells_believed_median_and_worst_and_the_limits(judged):
    over, sentences = judged.best.over, design_sentences(judged)
    assert len(over.told.costs) + len(judged.draws.lost) == 8
    assert len(over.flights) == len(over.told.costs)
    (said,) = [s for s in sentences if s.startswith("Over ")]
    assert "in the median and" in said
    assert f"every wanted accuracy is reached in {over.told.reached} of" in said
    assert any(s.startswith("These errors contain no prior") for s in sentences)
    broken = sum(bool(f.breach) for f in over.flights)
    assert broken > 0  # the amplitude of the believed aircraft leaves nothing for those that answer more
    assert any(f"breaks a limit in {broken} of" in s and "robust = true" in s for s in sentences)


def test_tables_agree_with_the_result(judged, tmp_path):
    page = design_page(judged)
    page.write(tmp_path)
    rows = list(csv.DictReader((tmp_path / "tables" / "draws.csv").open(encoding="utf-8")))
    t, over = judged.problem.targets, judged.best.over
    assert [row["target"] for row in rows] == list(t.names)
    k = t.names.index("M_alpha")
    worst = 100.0 * over.told.ratios[:, k].max() * t.wanted[k] / abs(t.values[k])
    assert float(rows[k]["worst"]) == pytest.approx(worst)
    assert float(rows[k]["median"]) < float(rows[k]["worst"])
    ranking = ranking_table(judged)
    column = [c.key for c in ranking.columns].index("worst of draws")
    assert ranking.rows[0][column] == pytest.approx(over.told.costs.max())
    assert dict(page.asked)["uncertainty"].startswith("8 aircraft drawn with the stated uncertainty of mine")


def test_a_robust_design_keeps_the_limits_in_every_draw_and_has_the_smallest_worst_error(robust, judged):
    for ranked in robust.ranking:
        assert not ranked.over.broken
        assert ranked.share(DRAWS) <= 1.0
    worst = [r.over.told.costs.max() for r in robust.ranking]
    assert worst == sorted(worst)
    assert robust.best.share(DRAWS) < 1.0
    assert max(f.tightest.share for f in robust.best.over.flights) > 0.9  # no smaller than it must be
    assert "in each of" in design_sentences(robust)[0]
    assert "in the worst of them" in design_sentences(robust)[0]
    assert any("the binding limit of the worst of them is that on the" in s for s in design_sentences(robust))
    assert robust.shortest is None
    more = {"switching for all draws"}  # the paper's pilot flies no multisine
    assert {r.design.family for r in robust.ranking} - more == {r.design.family for r in judged.ranking}


def test_the_same_seed_draws_the_same_aircraft(judged, folder):
    again = run_design(scenario(folder, draws=8))
    np.testing.assert_array_equal(again.best.over.told.ratios, judged.best.over.told.ratios)
    other = run_design(scenario(folder, draws=8), seed=5)
    assert other.best.over.told.costs.max() != judged.best.over.told.costs.max()


def test_drawn_aircraft_that_cannot_be_flown_are_counted_with_the_reason(tmp_path):
    wild = believed_taurus(tmp_path, {"Cm_alpha": 2.0})
    result = run_design(scenario(wild, draws=8))
    assert 0 < len(result.draws.lost) < 8
    said = f"{len(result.draws.lost)} of 8 drawn aircraft cannot be judged; the first: {result.draws.lost[0].reason}"
    assert said in design_sentences(result)
    (table,) = [t for t in (draws_table(result),) if t.rows]
    assert f"over {8 - len(result.draws.lost)} aircraft" in table.caption


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robust": True, "draws": 0}, r"draws >= 1 must hold, got 0"),
        ({"draws": -1}, r"draws: must be 0 to 100000, got -1"),
    ],
)
def test_what_cannot_be_drawn_is_refused(changes, words):
    with pytest.raises(ScenarioError, match=words):
        scenario(**changes)


def test_an_aircraft_that_states_nothing_is_drawn_by_handbooks():
    """What an aircraft states counts alone."""
    silent = load_aircraft("taurus")
    assert scenario(draws=5).draws == 5
    assert with_priors(silent).uncertainty["Cm_alpha"] > 0.1
    stated = replace(silent, uncertainty={"Cm_alpha": 0.02})
    assert with_priors(stated) is stated


def test_a_robust_design_is_at_least_as_good_in_the_worst_draw_as_the_nominal_one(robust):
    """Both keep the limits in all draws; designs for the aircraft in which the best does worst are flown, too."""
    assert robust.nominal is not None
    nominal = robust.ranking[robust.nominal]
    assert nominal.over.told.costs.max() >= robust.best.over.told.costs.max()
    assert any("the a-priori model alone" in s for s in design_sentences(robust))
