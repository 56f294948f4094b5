"""An input that is drawn in the app: the numbers are those of the design's own rooms, and so is the file."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS
from testbench.questions.app.ask import Workbench
from testbench.questions.app.drawn import design_text, design_told, input_told, list_designs, plan_words
from testbench.questions.design.ask import run_design
from testbench.questions.design.scenario import DesignScenario

STEPS = {"signal": "multistep", "control": "de", "amplitude_deg": 1.0, "step_s": 1.0, "pattern": [1.5, -2.0, 0.75]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with one design, whose errors are those of information alone, over five drawn aircraft."""
    text = (SCENARIOS / "design" / "taurus_short_period.toml").read_text(encoding="utf-8")
    head = "# mine, [so to say]\nrealise = 0\ndraws = 5\nseed = 3\n"
    (tmp_path / "mine.toml").write_text(head + text, encoding="utf-8")
    return tmp_path


def test_errors_and_limits_while_drawing_are_those_of_the_design(folder):
    given = {"of": "mine.toml", "input": [STEPS], "draws": 5}
    said = input_told(folder, given)
    name, text = design_text(folder, given)
    (folder / name).write_text(text, encoding="utf-8")
    result = run_design(DesignScenario.load(folder / name))
    best, t = result.best, result.problem.targets
    assert best.share("believed") == 1.0  # it is at its amplitude, so that both are of one input
    shown = np.array([w / x["wanted"] for w, x in zip(t.wanted, said["errors"], strict=True)])
    np.testing.assert_allclose([x["error"] for x in said["errors"]] * shown, best.design.errors, rtol=1e-9)
    over = best.over.told
    np.testing.assert_allclose(np.array(said["drawn"]["median"]) * shown, over.over(np.median) * t.wanted, rtol=1e-9)
    assert said["drawn"]["reached"] == over.reached
    worst, share = said["limits"][0]["name"], said["limits"][0]["used"]
    assert share == pytest.approx(result.problem.prediction.largest_factor(best.design.u)[0] ** -1.0)
    assert worst in said["answer"]
    assert said["reached"] is bool(best.design.cost <= 1.0)


def test_requests_that_come_at_once_are_flown_one_after_the_other(folder, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    bench = Workbench(folder)
    asks = [("design", {"of": "mine.toml"}), ("input", {"of": "mine.toml", "input": [STEPS]})] * 3
    with ThreadPoolExecutor(len(asks)) as several:
        got = several.map(lambda a: bench.take(f"{bench.home}show/{a[0]}", iter([json.dumps(a[1]).encode()])), asks)
        assert [answer.status for answer in got] == [200] * len(asks)


def test_the_signal_that_is_shown_is_the_one_that_is_flown(folder):
    points = input_told(folder, {"of": "mine.toml", "input": [STEPS | {"start_s": 0.5}]})["signal"]["de"]
    levels = [(0.0, 0.0), (0.5, 1.0), (2.0, -1.0), (4.0, 1.0), (4.75, 0.0)]
    for begin, level in levels:
        assert [v for t, v in points if t == pytest.approx(begin)][-1] == pytest.approx(level), begin


def test_a_file_keeps_its_comments_and_never_takes_the_place_of_another(folder):
    given = {"of": "mine.toml", "input": [STEPS], "duration_s": 25.0}
    name, text = design_text(folder, given)
    assert name == "mine_input.toml"
    assert text.startswith("# mine, [so to say]")
    (folder / name).write_text(text, encoding="utf-8")
    read = DesignScenario.load(folder / name)
    assert (read.input[0].pattern, read.duration_s, read.limits.alpha_deg) == ((1.5, -2.0, 0.75), 25.0, (-8.0, 12.0))
    assert design_text(folder, given)[0] == name  # the same again
    changed, more = design_text(folder, {"of": name, "input": [STEPS | {"amplitude_deg": 0.5}]})
    assert changed == "mine_input_2.toml"
    assert more.count("[[input]]") == 1
    searched, without = design_text(folder, {"of": name, "input": []})
    assert (searched, "[[input]]" in without) == ("mine_2.toml", False)  # mine.toml lasts 30 s


def test_a_new_design_of_an_aircraft_begins_within_its_limits_and_can_be_asked(folder):
    shutil.copytree(AIRCRAFT_MODELS / "taurus", folder / "aircraft" / "mine")
    every = {"aircraft": "taurus"}, {"aircraft": "mine"}, {"aircraft": "eolo", "control": "dr", "V_m_s": 17.0}
    for given in every:
        met = design_told(folder, given)
        said = input_told(folder, {**given, "input": met["input"]})
        assert said["limits"][0]["used"] <= 1.0
        name, text = design_text(folder, {**given, "input": met["input"]})
        assert str(folder) not in text
        (folder / name).write_text(text, encoding="utf-8")
        asked = DesignScenario.load(folder / name)
        assert asked.condition.V_m_s == met["V_m_s"]
        assert [x["name"] for x in said["errors"]] == [*asked.targets.parameters]
    assert [d["of"] for d in list_designs(folder)["designs"] if d["own"]] == [
        "eolo_dr_input.toml", "mine.toml", "mine_de_input.toml", "taurus_de_input.toml",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("given", "law"),
    [
        ({"of": "../mine.toml"}, r"a \.toml file in the folder of the app must be named"),
        ({"of": "nothing"}, "a design must be a file of the folder or a packaged one"),
        ({"aircraft": "nothing"}, "an aircraft must be a packaged name"),
        ({"of": "mine.toml", "input": [STEPS | {"amplitude_deg": "much"}]}, r"input\[0\].*amplitude_deg"),
        ({"of": "mine.toml", "input": [STEPS | {"pattern": [90.0]}]}, "input"),
        ({"of": "mine.toml", "input": {}}, "the input must be a list"),
        ({"of": "mine.toml", "input": [STEPS], "draws": 10**9}, "drawn must be 1 to 200"),
    ],
)
def test_what_cannot_be_drawn_is_said(folder, given, law):
    with pytest.raises((RecordError, ScenarioError), match=law):
        input_told(folder, {"input": [STEPS], **given})


def test_a_plan_that_was_made_is_planned_again_as_it_is(folder):
    given = {"design": "results/design_mine"}
    assert plan_words(folder, given)[:3] == ["plan", "--from", "results/design_mine"]
    made = folder / "results" / "plan_mine" / "mine.toml"
    made.parent.mkdir(parents=True)
    made.write_text("", encoding="utf-8")
    assert plan_words(folder, given)[:2] == ["plan", "results/plan_mine/mine.toml"]
