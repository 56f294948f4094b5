"""`testbench design --aircraft` designs for an aircraft of the user's own, and hands its path on."""

import shutil
from pathlib import Path

import pytest
from commands import ends

import testbench.questions.design.ask as ask
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.run.scenario import Scenario


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """An aircraft of the user's own, in the folder aircraft/ of an otherwise empty working folder."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(AIRCRAFT_MODELS / "taurus", tmp_path / "aircraft" / "mine")
    return tmp_path / "aircraft" / "mine"


@pytest.mark.parametrize("given", ["mine", "aircraft/mine", "aircraft/mine/aircraft.toml"])
def test_a_design_scenario_takes_an_aircraft_that_is_not_packaged(mine, given):
    loaded = DesignScenario.load("design/taurus_short_period").with_aircraft(given)
    assert Path(loaded.aircraft) == mine
    assert loaded.name == "taurus_short_period"


def test_the_command_designs_for_it(mine, monkeypatch, capsys):
    asked = []

    def run_design(loaded, *rest):
        asked.append(loaded.aircraft)
        raise RecordError("seen")

    monkeypatch.setattr(ask, "run_design", run_design)
    status, said = ends(monkeypatch, capsys, "design", "taurus_short_period", "--aircraft", "mine")
    assert (status, said) == (2, ["error: seen"])
    assert asked == [str(mine)]


def test_what_it_cannot_fly_is_refused_before_anything_is_flown(mine, monkeypatch, capsys):
    status, said = ends(monkeypatch, capsys, "design", "taurus_short_period", "--aircraft", "mien")
    assert status == 2
    assert said[0].endswith("got 'mien'; did you mean 'mine'?")
    text = (mine / "aircraft.toml").read_text()
    (mine / "aircraft.toml").write_text(text.replace("[controls.de]", "[controls.df]"))
    with pytest.raises(ScenarioError):
        DesignScenario.load("design/taurus_short_period").with_aircraft("mine")


def test_a_run_takes_it_by_the_same_option(mine):
    assert Path(Scenario.load("taurus_doublet").with_aircraft("mine").aircraft) == mine
