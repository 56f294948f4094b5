"""The report of the gap workflow: answer first, files, the amended aircraft, and the page of a plan."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from gap.gap_flights import among, believe, measure
from rich.console import Console

import testbench.questions.gap.plan as plan_module
import testbench.questions.gap.workflow as workflow
from testbench.effects import EFFECTS
from testbench.flight import load_aircraft
from testbench.inference.calibrate import Reliability, Trial
from testbench.questions.gap.ask import run_flights
from testbench.questions.gap.figures import gap_plates
from testbench.questions.gap.page import gap_page, gap_plan_page, gap_tables
from testbench.questions.gap.records import Flights
from testbench.questions.gap.result import TOLERANCE
from testbench.questions.gap.workflow import GapSearch
from testbench.questions.run.scenario import Scenario

FEW = {n: EFFECTS[n] for n in ("actuator_lag", "thrust_line", "alpha_scale")}


@pytest.fixture(scope="module")
def result():
    """Made once, by the whole workflow, in ten seconds: what the lag left was taken for noise, so it searches twice."""
    believed = believe()
    slow = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 8.0})
    elevator, throttle = measure(slow, 21)
    flights = Flights(
        believed, {"elevator": elevator, "throttle": throttle}, {"again": measure(slow, 31)[0]}, ("a note",)
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workflow, "name_effect", among(FEW))
        return run_flights("eolo", flights, how=GapSearch(check=False))


def test_the_answer_has_size_probability_place_and_shrink(result):
    finding = result.finding
    assert finding.naming.names == ("actuator_lag",)
    text = " | ".join(finding.sentences)
    for words in (
        "lag_rad_s =",
        "±",
        "probability 94",
        "nothing below 0.1 %",
        "over the flight region",
        "held-out again",
    ):
        assert words in text
    shrink = finding.shrink[0]
    assert shrink.visible
    assert shrink.removed > 0.9
    regions = {r.quantity: r for r in finding.regions}
    assert {"alpha", "V", "q", "de_cmd", "thr_cmd"} == set(regions)
    for region in regions.values():
        assert region.samples.sum() == sum(len(r) for r in result.records.values()) - len(shrink.record)
        assert np.nanmax(region.energy) > 1.0


def test_the_page_says_what_flew(result):
    tally = gap_page(result).flown
    assert (tally.batch, tally.jsbsim) == (6, 0)  # three records, the believed and the amended model


@pytest.mark.usefixtures("rendered")
def test_page_figures_tables_and_amended_aircraft(result, tmp_path):
    paths = gap_page(result).write(tmp_path)
    names = {str(p.relative_to(tmp_path)) for p in paths}
    for part in (
        "report.html",
        "figures/answer.png",
        "figures/residual_maps.png",
        "figures/residual_regions.png",
        "figures/lacking.png",
        "tables/ranking.csv",
        "amended/eolo/eolo.xml",
        "amended/eolo/aircraft.toml",
        "amended/model.diff",
    ):
        assert part in names
    page = paths[-1].read_text(encoding="utf-8")
    assert page.index("The amended model on a held-out flight") < page.index("The a-priori model and the records")
    assert "A note." in page
    assert page.count('id="figure-answer"') == 1
    assert page.index('id="answer"') < page.index('id="figure-answer"') < page.index('id="figure-residual_maps"')
    assert "http://" not in page.replace("http://www.w3.org", "")
    back = load_aircraft("eolo", "flexible", tmp_path / "amended" / "eolo")
    assert back.coefficient("Cm_q") == pytest.approx(
        load_aircraft("eolo").coefficient("Cm_q") * result.finding.naming.best.nuisances["Cm_q"]
    )
    console = Console(file=io.StringIO(), width=120)
    gap_page(result).show(console, tmp_path)
    assert "lag of the elevator servo" in console.file.getvalue()
    assert "Assumed: a note" in console.file.getvalue()


def test_models_are_told_apart_without_colour_and_the_legend_says_so(result):
    for plate in gap_plates(result):
        if plate.name not in ("answer", "held_out_1", "held_out_1_spectrum"):
            continue
        figure = plate.make(True)
        (shown,) = figure.legends
        legend = {h.get_label(): (h.get_color(), h.get_linestyle()) for h in shown.legend_handles}
        believed, amended = legend["a-priori model"], legend["amended model"]
        assert believed[1] != amended[1]
        curves = {(line.get_color(), line.get_linestyle()) for axes in figure.axes for line in axes.lines}
        assert {believed, amended} <= curves
        assert legend.get("noise floor", believed) in curves


@pytest.mark.usefixtures("rendered")
def test_the_page_of_a_plan(monkeypatch, tmp_path):
    monkeypatch.setattr(plan_module, "library", lambda suite, aircraft: FEW | {"q_bias": EFFECTS["q_bias"]})
    monkeypatch.setattr(plan_module, "family", lambda believed, planned, flown=(): [])
    plan = plan_module.plan_gap(Scenario.load("eolo_alpha"), draws=90)
    paths = gap_plan_page(plan).write(tmp_path)
    page = paths[-1].read_text(encoding="utf-8")
    for words in ("Rate at which each effect would be named", "Confusion of effects", "bias of the q sensor"):
        assert words in page
    assert {"power.png", "confusion.png", "power.csv", "again.csv", "unseen.csv"} <= {p.name for p in paths}
    console = Console(file=io.StringIO(), width=120)
    gap_plan_page(plan).show(console, tmp_path)
    assert "as planned" in console.file.getvalue()


def test_a_gap_that_nobody_would_feel_is_called_immaterial(result):
    finding = result.finding
    assert not finding.immaterial  # a servo at a sixth of its speed is felt
    shrink = finding.shrink[0]
    small = replace(shrink, before=shrink.after + 1e-4)
    light = replace(finding, shrink=(small,))
    assert light.immaterial
    assert any("real but immaterial" in s for s in light.sentences)
    assert not replace(finding, shrink=()).immaterial


def test_a_channel_without_a_tolerance_may_not_change_by_more_than_its_noise(result, monkeypatch):
    shrink, off = result.finding.shrink[0], np.zeros(5)
    off[result.finding.believed.outputs.index("V")] = 1.0  # m/s, of 3 kt that are allowed
    light = replace(result.finding, shrink=(replace(shrink, before=shrink.after + off),))
    assert light.immaterial
    monkeypatch.delitem(TOLERANCE, "V")
    assert not light.immaterial
    quiet = replace(light, shrink=(replace(shrink, before=shrink.after + 0.1 * off),))
    assert any("a channel for which no tolerance is given changes by less than its noise" in s for s in quiet.sentences)


def test_flights_again_stand_in_the_answer_and_in_a_table(result, tmp_path):
    trials = [Trial(t, {"actuator_lag": p, "nothing": 1.0 - p}) for t, p in (("actuator_lag", 0.96), ("nothing", 0.3))]
    again = Reliability((*trials, Trial("thrust_line", {"actuator_lag": 0.94, "nothing": 0.06})))
    page = gap_page(replace(result, finding=replace(result.finding, again=again))).write(tmp_path)[-1]
    said = "nswers stated with 90 to 99 % were right in 1 of 2 flights again"
    assert said in page.read_text(encoding="utf-8").replace("\u00a0", " ")
    rows = (tmp_path / "tables" / "again.csv").read_text(encoding="utf-8").splitlines()
    assert rows[-1].startswith("90 to 99,2,")


def test_the_ranking_has_all_explanations_and_probabilities_that_add_up(result):
    (ranking,) = [t for t in gap_tables(result) if t.name == "ranking"]
    whole, imitates = ([row[k] for row in ranking.rows] for k in (2, 3))
    assert sum(whole) + sum(imitates) == pytest.approx(100.0)
    assert [row[0] for row in ranking.rows].count("nothing") == 1
    assert whole == sorted(whole, reverse=True)


def test_every_diff_is_on_the_page(result, tmp_path):
    amended = result.finding.amended.with_effect(EFFECTS["alpha_scale"], {"scale": 1.1})
    both = replace(result, finding=replace(result.finding, amended=amended))
    page = gap_page(both).write(tmp_path)[-1].read_text(encoding="utf-8")
    for head in ("--- assumed suite", "--- a-priori model"):
        assert head in page
