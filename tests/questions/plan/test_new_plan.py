"""New plan files: complete for any aircraft, with designs taken over without retyping, in a box of air."""

import math
import os
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import command
from test_bounds import scenario_of

from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS, SUITES
from testbench.core.record import FlightRecord
from testbench.flight import load_aircraft
from testbench.inputs import build
from testbench.questions.design.ask import run_design
from testbench.questions.design.page import design_page
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.card_text import before_lines
from testbench.questions.plan.check import check
from testbench.questions.plan.new import limits_of_designs, plan_text, take
from testbench.questions.plan.repeats import box_faults, leg_of
from testbench.questions.plan.scenario import Airspace, PlanScenario, Tow


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """The folder that `testbench design` makes of the packaged design for Taurus."""
    folder = tmp_path_factory.mktemp("designed") / "design_taurus_short_period"
    page = design_page(
        run_design(DesignScenario.load(SCENARIOS / "design" / "taurus_short_period.toml").changed(realise=0), None)
    )
    page.write(folder)
    return folder


def loaded(text, tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(text, encoding="utf-8")
    return PlanScenario.load(file)


@pytest.mark.parametrize("name", ["taurus", "eolo", "b1", "jsbsim:c172p", "jsbsim:f16"])
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4", "own", "pilot"])
def test_a_new_plan_is_complete_for_any_aircraft(name, autopilot, tmp_path):
    aircraft = load_aircraft(name)
    text = plan_text(aircraft, name, autopilot)
    scenario = loaded(text, tmp_path)
    assert not check(scenario)
    blind = not name.startswith("jsbsim:")  # their packaged suites see nothing of roll and yaw
    moved = ("de",) if blind else ("de", "da", "dr")
    assert {m.controls[0] for m in scenario.manoeuvre} == {c for c in moved if c in aircraft.controls}
    assert ("# Nothing of the lateral motion: that needs beta or p or r among the sensors." in text) is blind
    assert scenario.flown_by == ("pilot" if autopilot == "pilot" else "autopilot")
    assert scenario.autopilot.system == ("ardupilot" if autopilot == "pilot" else autopilot)
    assert not scenario.limits.model_dump(exclude_none=True, exclude_defaults=True)  # all come from the aircraft
    low, high = aircraft.limits["V"]
    assert all(low < V < high for V in scenario.speeds_m_s)
    assert scenario.airspace.wind_m_s <= min(aircraft.design_V_m_s / 3.0, 8.0)


@pytest.mark.parametrize("name", ["taurus", "jsbsim:c172p"])
def test_a_new_plan_flies_as_it_is(name, tmp_path):
    scenario = loaded(plan_text(load_aircraft(name), name, "ardupilot"), tmp_path)
    plan = make_plan(scenario.model_copy(update={"speeds_m_s": scenario.speeds_m_s[:1]}))
    assert len(plan.cards) == (1 if name == "taurus" else 3)
    assert all(card.status != "refused" for card in plan.cards)
    for card in plan.cards:
        lines = before_lines(card, plan)
        assert [line.split(":")[0] for line in lines[:2]] == ["weather", "box"]
        assert all("GO if" in line for line in lines)


def test_a_design_is_taken_over_as_it_was_designed(designed, tmp_path):
    (taken,) = take([designed])
    assert taken.file.name.startswith("1_")
    text = plan_text(load_aircraft("taurus"), "taurus", "pilot", None, [taken])
    scenario = loaded(text, tmp_path)
    manoeuvre, judge = scenario.manoeuvre
    assert not {manoeuvre.name[-1], judge.name[-1]} & set("12")  # numbers are for several designs
    assert (judge.use, judge.design) == ("validation", manoeuvre.design)  # a flight that nothing is identified from
    one = build(manoeuvre.input, manoeuvre.duration_s, 200.0)
    two = build(taken.manoeuvre.input, taken.manoeuvre.duration_s, 200.0)
    assert one.channels == two.channels
    assert (one.u == two.u).all()
    asked = DesignScenario.load(SCENARIOS / "design" / "taurus_short_period.toml")
    for key in ("load_factor", "alpha_deg", "speed_change_m_s", "pitch_change_deg", "deflection_deg"):
        assert getattr(scenario.limits, key) == getattr(asked.limits, key)
    assert scenario.suite == "taurus_8hz"
    assert (scenario.speeds_m_s, scenario.heights_m) == ((12.0,), (100.0,))
    assert manoeuvre.design == Path(os.path.relpath(taken.file)).as_posix()
    assert all(f"#     {line}" in text for line in taken.promised)
    assert len(taken.promised) == 5
    plan = make_plan(scenario)
    card, _ = plan.cards
    assert card.status == "fly"  # inside the limits that it was designed for
    assert not any("for still air" in text for _, text in plan_answer(plan))  # filter error: a light aircraft
    text = taken.file.read_text("utf-8").replace('method = "filter_error"', 'method = "output_error"')
    calm = tmp_path / "calm.toml"
    calm.write_text(re.sub(r"(?m)^process_noise.*$", "", text), "utf-8")
    spec = card.spec.model_copy(update={"design": calm.as_posix()})
    still = replace(plan, cards=(replace(card, spec=spec),))
    assert any("card 1 is for still air" in text for _, text in plan_answer(still))
    none = still.scenario.changed(turbulence_rms_m_s=0.0)
    assert not any("for still air" in text for _, text in plan_answer(replace(still, scenario=none)))


def test_the_command_takes_a_design_over_and_keeps_what_was_edited(designed, tmp_path):
    done = command("plan", "--from", designed, "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "plan_taurus_short_period"
    file = folder / "taurus_short_period.toml"
    assert 'flown_by = "pilot"' in file.read_text(encoding="utf-8")  # as it was designed
    assert len(list((folder / "cards").glob("*.pdf"))) == 2
    again = command("plan", "--from", designed, "-o", tmp_path)
    assert again.returncode == 2
    assert "edit it and run testbench plan" in again.stderr
    third = next((designed / "designs").glob("3_*.toml"))
    made = command(
        "plan", "new", "--from", third, "--from", designed, "--autopilot", "px4", "-o", tmp_path / "two.toml"
    )
    assert made.returncode == 0, made.stderr
    both = PlanScenario.load(tmp_path / "two.toml")
    assert [m.use for m in both.manoeuvre] == ["identification", "validation"] * 2
    assert len({m.name for m in both.manoeuvre}) == 4
    assert both.autopilot.system == "px4"


def test_designs_that_no_plan_can_hold_are_refused_by_name(designed, tmp_path):
    with pytest.raises(RecordError, match="must hold designs/1_"):
        take([tmp_path])
    with pytest.raises(RecordError, match="a design must be a file or a folder"):
        take([tmp_path / "nothing"])
    other = tmp_path / "other"
    shutil.copytree(designed, other)
    file = next((other / "designs").glob("1_*.toml"))
    suite = shutil.copy(SUITES / "taurus_8hz.toml", tmp_path / "mine.toml")
    file.write_text(file.read_text("utf-8").replace('["taurus_8hz"]', f'["{suite.as_posix()}"]'), "utf-8")
    with pytest.raises(ScenarioError, match=r"must have the same suites, got .*mine\.toml, taurus_8hz"):
        take([designed, other])
    (other / "design.toml").unlink()
    (taken,) = take([other])
    assert limits_of_designs([taken]) == {}
    assert "are not known: no design.toml" in plan_text(load_aircraft("taurus"), "taurus", "own", None, [taken])


def test_the_narrowest_limit_of_several_designs_holds(designed, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(designed, other)
    file = other / "design.toml"
    text = (
        file.read_text("utf-8").replace("[0.2, 2.0]", "[-1.0, 1.5]").replace("speed_change_m_s = 4.0", "bank_deg = 20")
    )
    file.write_text(text.replace("{ de = 10.0 }", "{ de = 12.0 }"), "utf-8")
    found = limits_of_designs(take([designed, other]))
    assert found["load_factor"] == (0.2, 1.5)
    assert found["speed_change_m_s"] == 4.0
    assert found["bank_deg"] == 20.0
    assert found["deflection_deg"] == {"de": 10.0}


def test_new_files_do_not_write_over_old_ones_and_say_what_is_missing(tmp_path):
    file = tmp_path / "mine.toml"
    assert command("plan", "new", "taurus", "-o", file).returncode == 0
    for arguments, words in (
        (("new", "taurus", "-o", file), "must be a new file"),
        (("new",), "give an aircraft, or --from with a design"),
        (("new", "torus", "-o", tmp_path / "x.toml"), "got 'torus'; did you mean 'taurus'?"),
        (("new", "taurus", "--suite", "taurus_9hz", "-o", tmp_path / "x.toml"), "taurus_8hz"),
        ((file, "--from", tmp_path), "give either a plan file or --from"),
    ):
        done = command("plan", *arguments)
        assert done.returncode == 2, arguments
        assert words in done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "x.toml").exists()


BOX = {"length_m": 1000.0, "width_m": 300.0, "lowest_m": 0.0, "highest_m": 300.0, "wind_m_s": 5.0}


def test_a_run_goes_as_far_as_the_wind_carries_it(tmp_path):
    plan = make_plan(scenario_of(2.0, airspace=BOX))
    (card,) = plan.cards
    leg = leg_of(card, plan.scenario.airspace)
    assert leg.run_m == pytest.approx(19.0 * 7.0)
    assert leg.radius_m == pytest.approx(14.0**2 / (9.80665 * math.tan(math.radians(30.0))))
    assert leg.turn_s == pytest.approx(math.pi * leg.radius_m / 14.0)
    assert leg.runs == math.floor((1000.0 - 2.0 * (leg.radius_m + 2.5 * leg.turn_s)) / leg.run_m) == 6
    assert leg.turns == 0
    room = BOX["length_m"] - 6 * leg.run_m - 2.0 * (leg.radius_m + 2.5 * leg.turn_s)  # beyond what six runs take
    for spare_m, runs in ((1.0, 6), (-1.0, 5)):
        shorter = plan.scenario.airspace.model_copy(update={"length_m": BOX["length_m"] - room + spare_m})
        assert leg_of(card, shorter).runs == runs
    wind, box, battery = before_lines(card, plan)
    assert wind == "weather: GO if the mean wind is at most 5 m/s"
    assert box.startswith("box: GO if 133 m lie ahead per run; no turn between")
    timing = plan.scenario.timing
    need_J = card.point.power_W * (card.length_s + timing.turn_s + 0.5 * timing.overhead_s)
    assert battery.startswith(f"battery: GO if {need_J / 3600.0:.3g} Wh ")
    towed = plan.scenario.model_copy(update={"energy": Tow(kind="tow", release_m=300.0, lowest_m=60.0)})
    assert before_lines(card, replace(plan, scenario=towed))[2].startswith("height: GO if the run ends above 60")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length_m": 200.0}, r"length_m >= \d+ must hold for one run of 3-2-1-1 at 14 m/s, 100 m \(133 m over ground"),
        ({"width_m": 60.0}, "width_m >= 70 must hold for a turn at 14 m/s and 30 deg of bank, got 60"),
        ({"highest_m": 120.0}, "highest_m >= 150 must hold for the heights"),
        ({"lowest_m": 60.0}, "lowest_m <= 50"),
    ],
)
def test_what_does_not_fit_into_the_box_is_a_fault_with_the_number_that_would(change, words):
    with pytest.raises(ScenarioError, match=words) as error:
        make_plan(scenario_of(2.0, airspace={**BOX, **change}))
    assert len(error.value.faults) == 1


def test_a_box_has_laws():
    for change, words in (({"highest_m": -1.0}, "highest_m > lowest_m"), ({"gust_m_s": 3.0}, "gust_m_s >= wind_m_s")):
        with pytest.raises(ValueError, match=words):
            Airspace(**{**BOX, **change})
    assert not box_faults(scenario_of(2.0), ())


def test_a_rehearsal_with_fewer_flights_leaves_no_log_of_the_longer_one(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from testbench.cli import app

    record, flights = FlightRecord(np.arange(5.0), ("q",), np.zeros((5, 1)), "measured"), 2
    monkeypatch.setattr("testbench.questions.plan.ask.make_plan", lambda *given, **more: None)
    monkeypatch.setattr(
        "testbench.questions.plan.rehearse.rehearse", lambda *given: dict.fromkeys(range(1, flights + 1), record)
    )
    (tmp_path / "mine_flight_1.csv").write_text("mine")
    for plan, flights in (("taurus_63", 2), ("eolo_envelope", 1), ("taurus_63", 1)):  # noqa: B007 - read above
        done = CliRunner().invoke(app, ["plan", "rehearse", plan, "-o", str(tmp_path)])
        assert done.exit_code == 0, done.output
    logs = sorted(p.name for p in tmp_path.glob("*.csv"))
    assert logs == ["eolo_envelope_flight_1.csv", "mine_flight_1.csv", "taurus_63_flight_1.csv"]


def test_a_plan_names_what_is_ones_own_so_that_the_project_can_be_moved(designed, tmp_path, monkeypatch):
    """Neither the aircraft of the project, nor its sensors, nor the design is named by a path from the root."""
    project = tmp_path / "project"
    shutil.copytree(AIRCRAFT_MODELS / "taurus", project / "aircraft" / "mine")
    shutil.copytree(designed, project / "results" / "design_x")
    (project / "suites").mkdir()
    shutil.copy(SUITES / "taurus_8hz.toml", project / "suites" / "own.toml")
    (file,) = (project / "results" / "design_x" / "designs").glob("1_*.toml")
    text = file.read_text("utf-8")
    named = re.sub(r"(?m)^aircraft = .*$", f'aircraft = "{project / "aircraft" / "mine"}"', text)
    named = re.sub(r"(?m)^suites = .*$", f'suites = ["{project / "suites" / "own.toml"}"]', named)
    file.write_text(named, encoding="utf-8")
    monkeypatch.chdir(project)
    taken = take([project / "results" / "design_x"])
    text = plan_text(load_aircraft(str(project / "aircraft" / "mine")), taken[0].scenario.aircraft, "own", None, taken)
    assert str(tmp_path) not in text
    read = tomllib.loads(text)
    assert (read["aircraft"], read["suite"]) == ("mine", "own")
    assert read["manoeuvre"][0]["design"] == file.relative_to(project).as_posix()
    (project / "plan.toml").write_text(text, encoding="utf-8")
    project.rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path / "moved")
    assert PlanScenario.load(tmp_path / "moved" / "plan.toml").aircraft == str(tmp_path / "moved" / "aircraft" / "mine")
