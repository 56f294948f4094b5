"""Effects that users bring: the example of the guide in an empty folder, and what is said of files that are wrong."""

from __future__ import annotations

import hashlib
import pickle
import re
from pathlib import Path

import pytest
from commands import command

from testbench.core.bring import BroughtCodeError
from testbench.core.errors import ScenarioError
from testbench.effects import library
from testbench.questions.gap.brought import choose, faults, load_effect
from testbench.questions.gap.effect_contract import LAWS, tried
from testbench.questions.gap.scenario import GapScenario
from testbench.sensors import load_suite

GUIDE = Path(__file__).resolve().parents[3] / "docs" / "guides" / "bring_an_effect.md"
FILE = re.compile(r"^```\w+\n# (\S+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with the files that the guide shows; the working directory."""
    for name, text in FILE.findall(GUIDE.read_text(encoding="utf-8")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def changed(folder: Path, old: str, new: str, file: str = "my_effect.py") -> None:
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new), encoding="utf-8")


def test_the_effect_of_the_guide_is_searched_from_an_empty_folder_and_whose_code_ran_is_said(folder):
    for words in (("check", "banner.toml"), ("gap", "banner.toml", "--workers", "2")):
        done = command(*words, cwd=folder)
        assert done.returncode == 0, done.stderr + done.stdout
    said = " ".join(done.stdout.split())
    code = hashlib.sha256((folder / "my_effect.py").read_bytes()).hexdigest()
    assert "the effect 'banner' is code of" in said
    assert code in said
    (file,) = (folder / "results" / "gap_banner").rglob("ranking.csv")
    ranking = file.read_text(encoding="utf-8")
    assert ranking.splitlines()[1].startswith("banner on a line,")
    named = [line.partition(",")[0] for line in ranking.splitlines()[1:]]
    effects = [n for n in named if n != "nothing" and not n.startswith("a ")]  # no coefficients, no terms
    assert len(effects) <= 3, "three effects were searched, and no other"


def test_the_effect_of_the_guide_keeps_every_law(folder):
    told = list(tried(folder / "my_effect.py", "EFFECT"))
    assert len(told) == len(LAWS)
    assert [(law, why) for law, kept, why in told if not kept] == []


def test_a_law_that_is_broken_is_told_with_its_reason(folder):
    changed(folder, "It hangs low, so that it also pitches the nose down.", "")
    changed(folder, "return aircraft.amended(", "return values['size'] and aircraft.amended(")
    told = {law: why for law, kept, why in tried(folder / "my_effect.py", "EFFECT") if not kept}
    assert "two sentences" in told["it says in words what it is"]
    flies = told["it flies at its usual size"]
    assert re.search(r"amend of 'banner' must work, got KeyError: 'size' \(my_effect\.py, line \d+\)", flies), flies


def test_effects_take_the_place_of_the_library_and_more_effects_stand_beside_it(folder):
    suite = load_suite("eolo_gap")
    whole = list(library(suite))
    assert list(choose(suite).effects) == whole
    assert list(choose(suite, None, ("my_effect.py:EFFECT",)).effects) == [*whole, "banner"]
    only = choose(suite, ("my_effect.py:EFFECT", "actuator_lag"), ("gust",))
    assert list(only.effects) == ["banner", "actuator_lag", "gust"]
    assert len(only.notes) == 1


def test_a_file_is_looked_for_beside_the_scenario_and_in_the_effects_of_the_project(folder, monkeypatch):
    project = folder / "project"
    (project / "effects").mkdir(parents=True)
    (folder / "my_effect.py").rename(project / "effects" / "my_effect.py")
    (folder / "banner.toml").rename(project / "banner.toml")
    scenario = GapScenario.load(project / "banner.toml")
    assert "banner" in choose(load_suite("eolo_gap"), scenario.effects, (), scenario.file).effects
    with pytest.raises(ScenarioError, match="must exist"):
        choose(load_suite("eolo_gap"), scenario.effects)
    monkeypatch.chdir(project)
    assert "banner" in choose(load_suite("eolo_gap"), scenario.effects).effects


def test_check_reads_a_file_without_running_it(folder):
    changed(folder, "BELOW = ", "raise RuntimeError('run')\nBELOW = ")
    assert GapScenario.load(folder / "banner.toml").effects is not None
    with pytest.raises(ScenarioError, match=r"must run without an error, got RuntimeError: run \(my_effect.py, line"):
        load_effect(folder / "my_effect.py", "EFFECT")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("my_effect.py:EFECT", "must define 'EFECT'; did you mean 'EFFECT'"),
        ("my_efect.py:EFFECT", "the file of 'my_efect.py:EFFECT' must exist"),
        ("my_effect.py:amend", "must be an Effect"),
        ("my_effect.py:BELOW", "must be an Effect"),
        ("actuator_leg", "must name an effect of the library or FILE.py:NAME, got 'actuator_leg'"),
    ],
)
def test_what_is_no_effect_is_a_fault_of_the_scenario(folder, name, words):
    changed(folder, '"my_effect.py:EFFECT"', f'"{name}"', "banner.toml")
    with pytest.raises(ScenarioError) as told:
        GapScenario.load(folder / "banner.toml")
    (fault,) = told.value.faults
    assert words in fault
    assert "banner.toml, effects: " in fault
    assert faults([name], load_suite("eolo_gap"), folder / "banner.toml") == [fault.partition("effects: ")[2]]


def test_a_name_that_the_library_has_is_refused(folder):
    changed(folder, 'name="banner"', 'name="drag_increment"')
    with pytest.raises(ScenarioError, match="must have its own name, got 'drag_increment'"):
        choose(load_suite("eolo_gap"), None, ("my_effect.py:EFFECT",))


def test_a_brought_effect_goes_to_processes_of_the_search_and_its_errors_name_their_line(folder):
    effect = load_effect(folder / "my_effect.py", "EFFECT")
    again = pickle.loads(pickle.dumps(effect))
    with pytest.raises(BroughtCodeError, match=r"amend of 'banner' must work, got KeyError: 'CD' \(my_effect.py, line"):
        again.amend(None, None, {})
