"""The report of a design: tables, page, files ready to fly, and the answer in words."""

import csv
import io
import json
from dataclasses import replace
from html import escape

import numpy as np
import pytest
from rich.console import Console

from testbench.core.paths import SCENARIOS
from testbench.questions.design.answer import design_sentences, family_label, limit_rows
from testbench.questions.design.ask import run_design
from testbench.questions.design.page import compared, design_page, design_plates, design_tables
from testbench.questions.design.ready import scenario_toml
from testbench.questions.design.scenario import DesignScenario

pytestmark = pytest.mark.drawn


@pytest.fixture(scope="module")
def designed():
    scenario = DesignScenario.load(SCENARIOS / "design" / "taurus_short_period.toml")
    return run_design(scenario.model_copy(update={"duration_s": 16.0, "realise": 0}))


@pytest.fixture(scope="module")
def folder(designed, tmp_path_factory):
    out = tmp_path_factory.mktemp("design")
    design_page(designed).write(out)
    return out


def test_the_first_sentence_is_the_answer(designed):
    sentences = design_sentences(designed)
    assert sentences[0].startswith("Fly the designed switching on the elevator (")
    assert "it reaches every wanted accuracy" in sentences[0]
    assert any(s.startswith("The shortest record that reaches the wanted accuracy lasts ") for s in sentences)
    assert any("3-2-1-1 has" in s for s in sentences)
    assert any(s.startswith("Flown in the nonlinear simulator it uses") for s in sentences)
    assert not any(s.endswith(".") for s in sentences)


def test_the_page_is_complete_and_fetches_nothing(folder, designed):
    page = (folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    first = page.index("The answer")
    assert first < page.index("figure-flight") < page.index("Designs, ranked") < page.index("figure-spectra")
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    for sentence in design_sentences(designed):
        assert escape(sentence)[:40] in page.replace("&#39;", "&#x27;")
    for name in ("flight", "spectra", "errors"):
        assert (folder / "figures" / f"{name}.png").stat().st_size > 5000
    assert not list(folder.rglob("*.part"))


def test_tables_agree_with_the_result(folder, designed):
    rows = list(csv.reader((folder / "tables" / "ranking.csv").open(encoding="utf-8")))
    assert [r[0] for r in rows[1:]][: len(designed.ranking)] == [str(k + 1) for k in range(len(designed.ranking))]
    best = rows[1]
    assert best[1] == family_label(designed.best.design.family)
    head = rows[0]
    at = next(i for i, h in enumerate(head) if h.startswith("error of M_q"))
    k = designed.problem.targets.names.index("M_q")
    expected = 100.0 * designed.best.design.errors[k] / abs(designed.problem.targets.values[k])
    assert float(best[at]) == pytest.approx(expected)
    content = json.loads((folder / "tables" / "energy.json").read_text(encoding="utf-8"))
    assert len(content["rows"]) == len(designed.ranking)
    assert {t.name for t in design_tables(designed)} == {"ranking", "energy", "screening", "obstacles"}


def test_signals_are_what_was_flown(folder, designed):
    files = sorted(p.name for p in (folder / "designs").glob("*.toml"))
    assert files[0] == "1_designed_switching.toml"
    assert any(f.startswith("shortest") for f in files)
    rows = list(csv.reader((folder / "signals" / "1_designed_switching.csv").open(encoding="utf-8")))
    data = np.array([[float(x) for x in r] for r in rows if r and r[0].replace(".", "").replace("-", "").isdigit()])
    assert len(data) == len(designed.best.design.u)
    assert np.abs(data[:, 1]).max() == pytest.approx(designed.best.design.peak[0], rel=1e-6) or np.abs(
        data[:, 1]
    ).max() == pytest.approx(np.degrees(designed.best.design.peak[0]), rel=1e-6)
    assert (folder / "signals" / "1_designed_switching.mat").stat().st_size > 500


def test_every_ranked_design_is_a_valid_scenario(designed, tmp_path):
    from testbench.questions.run.scenario import Scenario

    for ranked in designed.ranking:
        file = tmp_path / "one.toml"
        file.write_text(scenario_toml(designed, ranked.design), encoding="utf-8")
        loaded = Scenario.load(file)
        assert loaded.manoeuvre[0].use == "identification"
        assert {m.use for m in loaded.manoeuvre} == {"identification", "validation"}


def test_figures_draw_wide_and_narrow_and_always_the_same(designed):
    assert len(compared(designed)) <= 5
    families = {r.design.family for r in compared(designed)}
    assert {"doublet", "3211"} <= families
    for plate in design_plates(designed):
        assert plate.draw(png=False).svg == plate.draw(png=False).svg
        assert plate.draw(wide=False, png=False).svg != plate.draw(png=False).svg


def test_limits_in_words(designed):
    text = "; ".join(limit_rows(designed))
    assert "load factor 0.2 to 2" in text
    assert "V 8 to 16 m/s" in text
    assert "δe −10 to 10 deg" in text


def test_terminal(designed):
    out = io.StringIO()
    design_page(designed).show(Console(file=out, width=160, no_color=True), "somewhere")
    text = out.getvalue()
    for part in ("designed switching", "3-2-1-1", "Report: somewhere/report.html", "testbench run somewhere/designs"):
        assert part in text


def test_the_error_of_the_best_stands_at_the_end_of_its_bar(designed):
    """However far all of them miss what is wanted: here it is a twentieth of what the scenario asks for."""
    targets = designed.problem.targets
    wanted = 0.05 * targets.wanted
    problem = replace(designed.problem, targets=replace(targets, wanted=wanted))
    strict = replace(designed, believed=replace(designed.believed, problem=problem))
    ranking = compared(strict)
    plate = next(p for p in design_plates(strict) if p.name == "errors")
    (axes,) = plate.make(True).axes[:1]
    ends = [text.xy[0] for text in axes.texts if hasattr(text, "xy")]
    np.testing.assert_allclose(ends, ranking[0].design.errors / wanted)
