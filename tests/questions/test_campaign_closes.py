"""The loop of the commands closes: from a new project to an aircraft that a flight amended, in small."""

import csv
import sys
from pathlib import Path

import pytest
from commands import command

import testbench as tb
from testbench.core.errors import RecordError
from testbench.core.project import project_here, remember
from testbench.questions.project.new import new_project
from testbench.questions.project.standing import following, standing

DESIGN = """
[identification]
inputs = ["de"]
[[identification.estimators]]
method = "output_error"
starts = 1
structure = "drawn"
outputs = ["alpha", "q"]
output_biases = ["alpha", "q"]
[identification.structures.drawn]
means = "short_period"
states = ["alpha", "q"]
[identification.structures.drawn.equations]
alpha_dot = "Z_alpha*alpha + q"
q_dot = "M_alpha*alpha + M_q*q + M_de*de"
[identification.structures.drawn.parameters]
Z_alpha = -8.0
M_alpha = -60.0
M_q = -12.0
M_de = -90.0
"""
PLAN = """
title = "In small"
flown_by = "autopilot"
uncertainty_percent = 15.0
turbulence_rms_m_s = 0.02
autopilot = { system = "own", period_ms = 20 }
timing = { turn_s = 45.0, overhead_s = 120.0 }
energy = { kind = "battery", capacity_Wh = 24.4, efficiency_percent = 45.0, source = "estimated" }
[[manoeuvre]]
name = "doublet"
duration_s = 4.0
repeats = 1
design = "drawn/design.toml"
input = [{ signal = "doublet", control = "de", amplitude_deg = 1.0, period_s = 0.8, start_s = 0.2 }]
[[manoeuvre]]
name = "judge"
duration_s = 4.0
repeats = 1
use = "validation"
design = "drawn/design.toml"
input = [{ signal = "doublet", control = "de", amplitude_deg = -1.0, period_s = 1.4, start_s = 0.2 }]
"""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """A project of Taurus at 13 m/s, entered."""
    monkeypatch.chdir(tmp_path)
    done = command("new", "mine", "--aircraft", "taurus", "--sensors", "eolo_alpha", "--speed", "13")
    assert done.returncode == 0, done.stderr
    monkeypatch.chdir(tmp_path / "mine")
    return Path()


def test_a_campaign_closes_and_says_where_it_stands(campaign):
    assert "lateral" in Path("project.toml").read_text("utf-8")  # named, and what it would take
    assert not Path("lateral.toml").exists()
    assert tb.load("longitudinal.toml").condition.V_m_s == 13.0  # which the file itself leaves out
    done = command()
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == "Next: testbench design longitudinal.toml"
    Path("drawn").mkdir()
    Path("drawn/design.toml").write_text(DESIGN, encoding="utf-8")
    Path("plan.toml").write_text(PLAN, encoding="utf-8")
    for words in (
        "plan rehearse plan.toml --drawn 4 --seed 1",
        "plan close plan.toml logs/plan_flight_1.csv",
        "identify results/close_plan/identify/01_doublet_13mps_100m.toml --amend flown --again 0",
    ):
        done = command(*words.split())
        assert done.returncode == 0, f"{words}: {done.stderr}"
    assert "on the record that it did not use" in " ".join(done.stdout.split())
    project = project_here()
    assert [f.question for f in project.history] == ["plan rehearse", "plan close", "identify --amend"]
    assert len(standing(project)) <= 10
    Path("results/design_longitudinal").mkdir()
    assert following(project) == "testbench plan --from results/design_longitudinal"
    with Path("results/01_doublet_13mps_100m/tables/amended_misses.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["records"] == "not used"]
    assert {row["output"]: float(row["after"]) < float(row["before"]) for row in rows}["q"]


def test_what_is_no_project_is_left_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("project.toml").write_text('name = "of another program"\n', encoding="utf-8")
    assert project_here() is None
    assert "Fly an identification experiment" in command().stdout
    with pytest.raises(RecordError, match="which is there"):
        new_project(tmp_path, "taurus", "eolo_alpha")
    assert Path("project.toml").read_text("utf-8") == 'name = "of another program"\n'


def test_long_answers_and_commands_of_many_files_are_kept_and_read_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert command("new", "mine", "--aircraft", "taurus", "--sensors", "eolo_alpha").returncode == 0
    monkeypatch.chdir(tmp_path / "mine")
    monkeypatch.setattr(sys, "argv", ["testbench", "gap", *(f"records/run_{i}.nc" for i in range(30))])
    remember(
        "results/gap_taurus", "one of these, which these data do not separate: " + 10 * "a servo that is slower; or "
    )
    done = command()
    assert (done.returncode, done.stderr) == (0, "")
    assert "one of these" in done.stdout.lower()
