"""What a project file says, what a new one asks for, and the command that comes next at each stage of a campaign."""

from dataclasses import replace
from pathlib import Path

import pytest

from testbench.core.errors import ScenarioError
from testbench.core.project import Found, Project, project_here
from testbench.flight import load_aircraft
from testbench.questions.project import new
from testbench.questions.project.standing import following, standing

PROJECT = """
title = "{title}"
aircraft = "aircraft/mine"
suite = "eolo_alpha"
speeds_m_s = [13.0, 11.0]
h_m = 100.0
"""


def found(command: str, result: str = "results/x", says: str = "") -> Found:
    return Found(at="2026-01-01 10:00:00", command=command, result=result, says=says)


@pytest.fixture
def project(tmp_path, monkeypatch) -> Project:
    """A project with two designs, entered."""
    monkeypatch.chdir(tmp_path)
    Path("project.toml").write_text(PROJECT.format(title="M"), encoding="utf-8")
    for name in ("lateral", "longitudinal"):
        Path(f"{name}.toml").write_text('controls = ["de"]\n', encoding="utf-8")
    here = project_here()
    assert here is not None
    return here


def test_a_command_is_told_by_its_words_and_options():
    for command, question in (
        ("plan --from results/design_a", "plan"),
        ("plan rehearse plan.toml", "plan rehearse"),
        ("plan", "plan"),
        ("design plan", "design"),
        ("identify a.toml --amend mine", "identify --amend"),
        ("identify a.toml", "identify"),
        ("run --amend", "run"),
    ):
        assert found(command).question == question
    assert found("identify a.toml b.toml --amend mine").after("--amend") == "mine"
    assert found("identify a.toml --amend").after("--amend") == ""
    assert found("identify a.toml").after("--amend") == ""


def test_a_project_without_a_title_is_refused(project):
    assert project.title == "M"
    Path("project.toml").write_text(PROJECT.format(title=""), encoding="utf-8")
    with pytest.raises(ScenarioError, match="title"):
        project_here()


def test_every_stage_names_the_command_that_comes_next(project):
    history: list[Found] = []

    def comes_next() -> str:
        return following(project.model_copy(update={"history": tuple(history)}))

    for name in ("longitudinal", "lateral"):
        assert comes_next() == f"testbench design {name}.toml"
        Path(f"results/design_{name}").mkdir(parents=True)
    assert comes_next() == "testbench plan --from results/design_longitudinal --from results/design_lateral"
    history.append(found("plan --from results/design_longitudinal", "results/plan_longitudinal"))
    plan = "results/plan_longitudinal/longitudinal.toml"
    assert comes_next().startswith("fly the cards of results/plan_longitudinal/cards.pdf")
    assert comes_next().endswith(f"or testbench plan rehearse {plan}")
    Path("logs").mkdir()
    Path("logs/flight.bin").touch()
    assert comes_next() == f"testbench plan close {plan} logs/*"
    Path("logs/flight.bin").unlink()
    history.append(found(f"plan rehearse {plan}", "logs"))
    assert comes_next() == f"testbench plan close {plan} logs/*"
    history.append(found(f"plan close {plan} logs/*", "results/close"))
    assert comes_next() == "testbench identify results/close/identify/*.toml --amend mine_flown"
    history.append(found("identify a.toml", "results/a"))  # amends nothing
    assert comes_next() == "testbench identify results/close/identify/*.toml --amend mine_flown"
    history.append(found("identify a.toml --amend better", "results/a"))
    assert comes_next() == "testbench gap better results/close/records/*.nc --sensors eolo_alpha"
    history.append(found("gap better a.nc", "results/gap"))
    assert (
        comes_next() == "the loop is closed; the next flight: testbench design longitudinal.toml --after results/close"
    )
    history.append(found("plan close again.toml logs/*", "results/second"))
    assert comes_next().endswith("--after results/second")  # the last counts


def test_a_stage_is_one_line_with_what_was_found_last(project):
    fits = (88 - len(" (results/x)")) * "a"
    for says, shown in ((fits, f"{fits} (results/x)"), (f"{fits}b", f"{fits}b (result...")):
        history = (found("gap a", says="old"), found("gap a", says=says))
        head, *stages, _ = standing(project.model_copy(update={"history": history}))
        assert head == "M: aircraft/mine with eolo_alpha at 13, 11 m/s"
        assert stages[-1].split(maxsplit=1) == ["gap", shown]
        assert [line.split()[0] for line in stages if "not yet" in line] == ["planned", "flown", "closed", "amended"]


def test_a_new_project_wants_what_its_sensors_and_controls_can_tell(tmp_path, monkeypatch):
    suite = tmp_path / "gyro.toml"
    gyros = "".join(
        f'[[sensor]]\nchannel = "{name}"\nunit = "deg/s"\nnoise_std = 0.1\npart = "any"\nsource = "made up"\n'
        for name in "pqr"
    )
    suite.write_text(f'title = "Gyros alone"\nrate_hz = 150.0\n{gyros}', encoding="utf-8")
    taurus = load_aircraft("taurus")
    without = {c: s for c, s in taurus.controls.items() if c != "dr"}
    monkeypatch.setattr(new, "load_aircraft", lambda _: replace(taurus, controls=without))
    monkeypatch.chdir(tmp_path)
    files = new.new_project("mine", "taurus", str(suite))
    assert [f.name for f in files] == ["project.toml", "longitudinal.toml", "lateral.toml"]
    monkeypatch.chdir("mine")
    made = project_here()
    assert made is not None
    assert set(made.accuracies) == {"M_alpha", "M_q", "M_de", "L_beta", "L_p", "L_da", "N_beta", "N_r"}  # no Z, no dr
    assert made.speeds_m_s == (taurus.design_V_m_s,)
    assert made.suite == "../gyro.toml"
    rate_hz = made.simulation["rate_hz"]
    assert rate_hz % 150.0 == 0.0  # every sample of the sensors is one of the simulator
    assert taurus.rate_hz <= rate_hz < taurus.rate_hz + 150.0
