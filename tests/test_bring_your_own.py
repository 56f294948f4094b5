"""A project folder of somebody else: an aircraft and a sensor suite that are not packaged, named as if they were."""

import shutil
from pathlib import Path

import pytest
from commands import command

from testbench.cli import check
from testbench.core.errors import ScenarioError, TestbenchError
from testbench.core.paths import AIRCRAFT_MODELS, SUITES
from testbench.flight import load_aircraft
from testbench.questions.campaign.load import load_campaign
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite

SCENARIO = """\
title = "A doublet on my aircraft, through my logger"
aircraft = "AIRCRAFT"
suites = ["SUITE"]
seed = 1

[condition]
V_m_s = 12.0
h_m = 100.0

[[manoeuvre]]
name = "doublet"
use = "split"
duration_s = 10.0
input = [{ signal = "doublet", control = "de", amplitude_deg = 3.0, period_s = 1.0 }]

[identification]
inputs = ["de_cmd"]
outputs = ["q", "theta"]
estimators = [{ method = "dsr_e", past_horizon = 4, future_horizon = 4 }]
"""


def written(folder, aircraft="mine", suite="logger"):
    """Write a scenario into a folder and return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "doublet.toml"
    file.write_text(SCENARIO.replace("AIRCRAFT", aircraft).replace("SUITE", suite), encoding="utf-8")
    return file


@pytest.fixture
def project(tmp_path):
    """A project folder with aircraft/mine and suites/logger.toml, and a scenario that names both."""
    mine = tmp_path / "aircraft" / "mine"
    shutil.copytree(AIRCRAFT_MODELS / "taurus", mine)
    text = (mine / "aircraft.toml").read_text(encoding="utf-8")
    title = next(line for line in text.splitlines() if line.startswith("title"))
    (mine / "aircraft.toml").write_text(text.replace(title, 'title = "Mine: not packaged"'), encoding="utf-8")
    (tmp_path / "suites").mkdir()
    shutil.copy(SUITES / "taurus_8hz.toml", tmp_path / "suites" / "logger.toml")
    written(tmp_path)
    return tmp_path


def test_check_run_and_aircraft_take_names_of_the_project_folder(project):
    done = command("check", "doublet.toml", "aircraft/mine", "mine", "suites/logger.toml", cwd=project)
    assert done.returncode == 0, done.stderr
    assert "doublet.toml: a valid scenario" in done.stdout
    assert "aircraft/mine: a valid aircraft" in done.stdout
    assert "\nmine: a valid aircraft" in done.stdout
    assert "suites/logger.toml: a valid sensor suite" in done.stdout
    done = command("run", "doublet.toml", cwd=project)
    assert done.returncode == 0, done.stderr
    assert "Mine: not packaged" in (project / "results" / "doublet" / "report.html").read_text(encoding="utf-8")
    done = command("aircraft", "mine", cwd=project)
    assert done.returncode == 0, done.stderr
    assert (project / "results" / "aircraft_mine" / "report.html").is_file()
    done = command("export", "aircraft", "mine", "--to", "jsbsim", "-o", "plain", cwd=project)
    assert done.returncode == 0, done.stderr
    assert (project / "plain" / "mine" / "mine.xml").is_file()
    assert "Written: plain/mine/mine.xml\n" in done.stdout


def test_the_studio_shows_ones_own_aircraft_through_ones_own_suites(project):
    done = command("studio", "mine", "--write", "studio.html", cwd=project)
    assert done.returncode == 0, done.stderr
    assert "Mine: not packaged" in (project / "studio.html").read_text(encoding="utf-8")


def test_names_are_looked_for_beside_the_scenario_from_wherever_it_is_asked(project, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    scenario = Scenario.load(project / "doublet.toml")
    assert load_aircraft(scenario.aircraft).title == "Mine: not packaged"
    assert load_suite(scenario.suites[0]).name == "logger"


@pytest.mark.parametrize("aircraft", ["../aircraft/mine", "../aircraft/mine/aircraft.toml"])
def test_paths_are_taken_from_the_folder_of_the_scenario(project, aircraft):
    file = written(project / "scenarios", aircraft, "../suites/logger.toml")
    scenario = Scenario.load(file)
    assert load_aircraft(scenario.aircraft).name == "mine"
    assert load_suite(scenario.suites[0]).name == "logger"


MANY = 'title = "Many"\nbase = "doublet.toml"\nruns = 2\ntruth = false\n'


def test_a_campaign_sends_its_workers_what_the_project_holds(project):
    (project / "many.toml").write_text(MANY, "utf-8")
    campaign = load_campaign(project / "many.toml")
    assert campaign.content["aircraft"] == str(project / "aircraft" / "mine")
    assert campaign.content["suites"] == [str(project / "suites" / "logger.toml")]


@pytest.mark.slow  # a worker is started; that of a packaged aircraft: test_cli.py
def test_a_worker_flies_what_the_project_holds(project):
    (project / "many.toml").write_text(MANY, "utf-8")
    done = command("campaign", "run", "many.toml", "--workers", 1, cwd=project)
    assert done.returncode == 0, done.stderr
    assert (project / "results" / "campaign_many" / "tables" / "runs.csv").is_file()


def test_a_misspelt_name_is_told_the_nearest_of_the_users_own(project):
    file = written(project, aircraft="mime")
    with pytest.raises(ScenarioError, match=r"aircraft: an aircraft must be .* got 'mime'; did you mean 'mine'\?"):
        Scenario.load(file)


def test_a_name_that_is_packaged_and_ones_own_is_refused(project):
    shutil.copytree(project / "aircraft" / "mine", project / "aircraft" / "taurus")
    file = written(project, aircraft="taurus")
    with pytest.raises(ScenarioError, match=r"'taurus', which is both: write the path '.*aircraft.taurus'"):
        Scenario.load(file)
    assert (
        load_aircraft(Scenario.load(written(project, str(project / "aircraft" / "taurus"))).aircraft).name == "taurus"
    )


def test_a_folder_without_an_aircraft_is_refused(project):
    (project / "empty").mkdir()
    with pytest.raises(
        ScenarioError, match=r"a folder with aircraft.toml, .* got 'empty': .* is there, but holds neither"
    ):
        Scenario.load(written(project, aircraft="empty"))


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("sys.exit(0)", "m.py must run without an error, got SystemExit: 0 (m.py, line 2)"),
        ("os._exit(0)", "m.py must run without an error, got SystemExit: os._exit(0) (m.py, line 2)"),
        ("os.abort()", "m.py:estimate must end with a result, but its process was ended by SIGABRT"),
        ("while True: pass", "m.py:estimate must end within 1 s, got no end by then"),
    ],
)
def test_check_says_what_ended_in_place_of_the_laws(tmp_path, monkeypatch, lines, said):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("testbench.questions.brought.LIMIT_S", 1.0)
    Path("m.py").write_text(f"import os, sys\n{lines}\ndef estimate(records, inputs, outputs): pass\n")
    with pytest.raises(TestbenchError) as error:
        check([Path("m.py:estimate")])
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert error.value.exit_status in (2, 3)
