"""The guides as they stand: their commands run one after the other in an empty folder, their code is run and right."""

import csv
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import threading
import types
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import flown_logs
import numpy as np
import pytest
from any_aircraft import Visitor, geometry_of_the_guide
from changed_flights import NOISE, UNITS, changed_aircraft, flown, steps
from commands import Done, command
from drawn_sets import SMALL, StandIn

import testbench as tb
from testbench.core.paths import AIRCRAFT_MODELS, stock_root

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
MOST_S = 300.0
"""Of machine time, from the drawing to derivatives."""


def text_of(guide: str) -> str:
    return (GUIDES / f"{guide}.md").read_text("utf-8")


def blocks_of(guide: str, language: str) -> list[str]:
    """Return the blocks of a guide in one language."""
    return re.findall(rf"```{language}\n(.*?)```", text_of(guide), re.DOTALL)


def run_code(code: str, names: dict[str, Any] | None = None) -> dict[str, Any]:
    """Run a block of Python; return its names."""
    names = {} if names is None else names
    exec(compile(code, "a guide", "exec"), names)
    return names


def said_by(line: str, run: Callable[..., Any] = command) -> str:
    """Run a command of a guide, which must end well; return what it said."""
    words = [str(f) for w in shlex.split(line)[1:] for f in (sorted(Path().glob(w)) if "*" in w else [w])]
    done = run(*words)
    assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout


def plane_of_taurus() -> None:
    """Write Taurus as a user's own aircraft, plane."""
    shutil.copytree(AIRCRAFT_MODELS / "taurus", "aircraft/plane")
    Path("aircraft/plane/taurus.xml").rename("aircraft/plane/plane.xml")
    toml = Path("aircraft/plane/aircraft.toml")
    toml.write_text(toml.read_text().replace("taurus.xml", "plane.xml"))


@pytest.mark.slow
def test_the_guide_s_way_from_a_log_to_an_amended_aircraft_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plane_of_taurus()
    truth = changed_aircraft("taurus", {"Cm_q": 0.6, "Cm_alpha": 1.25})
    first, second = steps(5.0, 0.24, 0.5), steps(25.0, 0.24, 0.5)
    record = flown(truth, 15.0, 100.0, {"de": lambda t: first(t) + second(t)}, 40.0)
    rng, names = np.random.default_rng(2), ("V", "h", "alpha", "q", "theta", "de")
    columns = [np.degrees(record[c]) if UNITS[c].startswith("deg") else record[c] for c in names]
    columns = [y + NOISE.get(c, 0.0) * rng.standard_normal(len(y)) for c, y in zip(names, columns, strict=True)]
    head = ",".join(["time [s]", *(f"{c} [{UNITS[c]}]" for c in names)])
    np.savetxt("flight.csv", np.column_stack([record.t_s, *columns]), "%.9g", ",", header=head, comments="")
    chapter = text_of("from_log_to_derivatives").split("## Back into the aircraft")[1]
    lines = re.search(r"```sh\n(.*?)```", chapter, re.DOTALL)[1].splitlines()
    assert len(lines) == 3
    said = [said_by(line) for line in lines]
    assert "'plane_flown': M_q" in said[0] or "'plane_flown': M_alpha" in said[0]
    assert "laws kept" in said[1]
    old, new = (tb.load_aircraft(name).coefficient("Cm_q") for name in ("plane", "plane_flown"))
    assert new / old == pytest.approx(0.6, abs=0.05)


@pytest.mark.slow
def test_five_commands_lead_from_an_autopilot_s_log_to_derivatives_an_aircraft_and_a_gap(tmp_path, monkeypatch):
    """The log is pyulog's: what it read of a flight is written again by it."""
    pyulog = pytest.importorskip("pyulog")
    monkeypatch.chdir(tmp_path)
    plane_of_taurus()
    truth = changed_aircraft("taurus", {"Cm_q": 0.6, "Cm_alpha": 1.25})
    monkeypatch.setattr(flown_logs, "aircraft", lambda: truth)
    flown_logs.trimmed.cache_clear()
    Path("made.ulg").write_bytes(flown_logs.px4_log(1))
    flown_logs.trimmed.cache_clear()
    pyulog.ULog("made.ulg").write_ulog("flight.ulg")
    lines = blocks_of("autopilot_logs", "sh")[0].splitlines()
    assert len(lines) == 5
    said = [said_by(line) for line in lines]
    assert "8 manoeuvres found" in said[0]
    assert "full command is 25 deg (assumed, the log does not state it)" in " ".join(said[0].split())
    assert "'plane_flown'" in said[2]
    for name, factor in (("Cm_q", 0.6), ("Cm_alpha", 1.25)):
        old, new = (tb.load_aircraft(a).coefficient(name) for a in ("plane", "plane_flown"))
        assert new / old == pytest.approx(factor, abs=0.08), name
    assert "plane_flown" in said[4]


@pytest.mark.slow
def test_five_flights_become_functions_and_an_aircraft(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first, second = blocks_of("global_model", "python")
    names = run_code(first)
    said = [said_by(line) for line in blocks_of("global_model", "sh")[0].splitlines()]
    assert "6 coefficients of T38" in said[0]
    assert "eld-out log3: errors of CL" in said[0]
    assert "laws kept" in said[1]
    alpha = [tb.trim(tb.load_aircraft(n), tb.FlightCondition(120.0, 3000.0)).alpha for n in ("jsbsim:T38", "t38_flown")]
    assert alpha[1] == pytest.approx(alpha[0], abs=0.01)
    run_code(second, names)
    out = capsys.readouterr().out
    CL, error, alpha = (float(x) for x in re.search(r"CL ([\d.]+) \+- ([\d.]+) .* at ([\d.]+) rad", out).groups())
    de = names["state"]["de"][0]
    assert pytest.approx(2.864 * alpha + 0.172 * de, abs=0.02) == CL  # the tables of JSBSim's T-38 below 14 deg
    assert 0.0 < error < 0.02
    assert "inside: False, CL nan" in out


@pytest.mark.slow
def test_the_loop_closes_without_editing_a_file(tmp_path, monkeypatch):
    """The aircraft that flies is drawn; what is amended follows the flight that it does not know better than before."""
    monkeypatch.chdir(tmp_path)
    Path("trainer.toml").write_text(geometry_of_the_guide(), encoding="utf-8")
    (block,) = blocks_of("one_campaign", "sh")
    lines = block.splitlines()
    assert len([line for line in lines if line.startswith("testbench ")]) <= 10
    for line in lines:
        if line.startswith("cd "):
            os.chdir(line.split()[1])
        else:
            said_by(line)
    misses = {}
    for path in Path("results").glob("*/tables/amended_misses.csv"):
        with path.open(encoding="utf-8") as file:
            misses |= {r["output"]: (float(r["before"]), float(r["after"])) for r in csv.DictReader(file)
                       if r["records"] == "not used"}  # fmt: skip
    assert misses["q"][1] < 0.8 * misses["q"][0]
    assert misses["p"][1] < misses["p"][0]
    standing = command().stdout
    assert "the loop is closed" in standing
    assert len(standing.splitlines()) <= 10


def test_the_example_names_the_late_elevator_and_sizes_delay_and_noise(capsys):
    """Some hundred flights."""
    (code,) = blocks_of("ask_your_own_question", "python")
    found = run_code(code)["found"]
    assert found.best.name == "elevator late"
    assert found.best.probability > 0.95
    assert found.best.posterior.p_whole > 0.5
    delay, error = found.best.posterior["delay_s"]
    assert delay == pytest.approx(0.06, abs=4.0 * error)
    assert error < 0.01
    for value, deviation in found.noise.values():
        assert value == pytest.approx(1.3, abs=4.0 * deviation)
    assert "elevator late" in capsys.readouterr().out


@pytest.mark.slow
def test_three_days_disagree_until_the_mass_of_the_third_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    python, toml = (blocks_of("pool_several_logs", language) for language in ("python", "toml"))
    lines = text_of("pool_several_logs").splitlines()
    first, second = (line for line in lines if line.startswith("testbench identify "))
    run_code(python[0])
    said = " ".join(said_by(f"{first} -v").split())
    assert "day3_longitudinal differs from the others" in said
    assert "errors of airspeed" in said
    assert "or mass and inertia alike" in said
    heavy = Path("results/day3/day3_longitudinal.toml")
    heavy.write_text(heavy.read_text("utf-8") + toml[0], encoding="utf-8")
    said = said_by(second)
    assert "The logs agree within their errors" in said
    assert "What the data added to the prior of taurus" in said
    Path("tunnel.toml").write_text(toml[1], encoding="utf-8")
    line = "testbench identify day1.csv --aircraft taurus --prior tunnel.toml --out one"
    assert "wind tunnel, March" in said_by(line)


def lines_of(chapter: str, end: str) -> list[str]:
    """Return the commands between two headings."""
    text = text_of("plan_a_flight").split(chapter)[1].split(end)[0]
    return [line for line in text.splitlines() if line.startswith("testbench ")]


def in_a_process_of_its_own(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command so that its machine time is that of a child of this process."""
    code = "from testbench.cli import main; main()"
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)


def fly_the_whole_way(more: str = "", run: Callable[..., Any] = command) -> list[str]:
    """Run the commands of the whole way in the working directory, the design with more lines; return what each said."""
    chapter = text_of("plan_a_flight").split("## The whole way in six commands")[1]
    Path("trainer.toml").write_text(geometry_of_the_guide(), encoding="utf-8")
    asked = chapter.split("```toml\n")[1].split("```")[0]
    Path("short_period.toml").write_text(asked.replace("\n[condition]", f"{more}\n[condition]"), encoding="utf-8")
    lines = lines_of("## The whole way in six commands", "\n## 1.")
    assert len(lines) == 6
    said = [said_by(line, run) for line in lines]
    assert list(Path("results/plan_short_period/cards").glob("*.pdf"))
    return said


def targets_found() -> dict[str, dict[str, str]]:
    """Return the rows of the table of targets by name."""
    with Path("results/close_short_period/tables/targets.csv").open(encoding="utf-8") as file:
        return {row["target"]: row for row in csv.DictReader(file)}


def identified_errors() -> dict[str, float]:
    """Return the errors of the targets that `testbench identify` gives for what `plan close` wrote."""
    (path,) = Path("results").glob("*/tables/derivatives.csv")
    with path.open(encoding="utf-8") as file:
        return {row["derivative"]: float(row["std"]) for row in csv.DictReader(file) if row["derivative"][0] == "M"}


@pytest.mark.slow
def test_the_whole_way_from_geometry_to_derivatives_in_small(tmp_path, monkeypatch):
    """The commands of the guide, with a design that no flight realises."""
    monkeypatch.chdir(tmp_path)
    said = fly_the_whole_way("draws = 0\nrealise = 0\n")
    assert "2 runs of 2 found in 1 log, 2 as their cards say" in said[4]
    rows = targets_found()
    assert set(rows) == {"M_alpha", "M_q", "M_de"}
    assert identified_errors() == {name: pytest.approx(float(row["error"])) for name, row in rows.items()}
    for row in rows.values():
        assert float(row["flown"]) == pytest.approx(float(row["here"]), rel=0.4)
        assert row["realised"] == ""
        assert row["verdict"] in ("reached", "not reached", "not identifiable")
    assert "Not realised in simulation: cards 1, 2" in Path("results/close_short_period/report.html").read_text("utf-8")
    assert "of 3 targets known as well as wanted, from 2 good of 2 planned runs" in " ".join(said[4].split())
    assert "M_alpha" in said[5]
    assert "MRSE on the validation records" in said[5], "the run that the design is judged by is kept back"
    (line,) = lines_of("### Design the next flight", "\n## What")[:1]
    said_by(line)
    with Path("results/design_short_period_after_1/tables/known.csv").open(encoding="utf-8") as file:
        known = {row["target"]: row for row in csv.DictReader(file)}
    assert set(known) == set(rows)
    for name, row in known.items():
        error = float(rows[name]["error"])
        assert float(row["value"]) == pytest.approx(float(rows[name]["flown"]), abs=2.0 * error)
        assert float(row["after"]) < min(float(row["now"]), float(row["alone"]))


@pytest.mark.slow
def test_the_whole_way_as_the_guide_has_it_keeps_its_promise_in_five_minutes(tmp_path, monkeypatch):
    """Machine time is that of all processes of the commands together."""
    monkeypatch.chdir(tmp_path)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    fly_the_whole_way(run=in_a_process_of_its_own)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert 1.0 < took_s < MOST_S
    rows = targets_found()
    assert identified_errors() == {name: pytest.approx(float(row["error"])) for name, row in rows.items()}
    assert [row["verdict"] for row in rows.values()].count("reached") >= 2
    for row in rows.values():
        assert float(row["flown error"]) < 1.2 * max(float(row["wanted"]), float(row["realised"]))
        assert float(row["realised"]) > float(row["promised"])
        assert abs(float(row["differs"])) < 4.0


def test_the_guide_s_way_to_scripts_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = lines_of("## 4. Turn it into flights", "### Limits")
    assert len(lines) == 3
    for line in lines:
        said_by(line)
    assert len(list(Path("results/plan_my_plan/injection").glob("*.lua"))) == 2


def run_commands(guide: str, folder: Path) -> dict[str, Done]:
    """Run every command of a guide in a folder, in their order; return each with how it ended."""
    lines = [line for block in blocks_of(guide, "sh") for line in block.splitlines()]
    assert all(line.startswith("testbench ") for line in lines)
    return {line.split("#")[0].strip(): command(*shlex.split(line, comments=True)[1:], cwd=folder) for line in lines}


@pytest.mark.slow
def test_the_guide_on_teaching_hands_out_and_marks(tmp_path: Path) -> None:
    (tmp_path / "names.txt").write_text("Ada\nBen\n", encoding="utf-8")
    done = run_commands("teach", tmp_path)
    assert len(done) == 5
    check = done.pop("testbench exercise check doublet_length_ada")
    assert check.returncode == 1  # nothing is answered yet
    assert "0 of" in check.stdout
    for line, ended in done.items():
        assert ended.returncode == 0, f"{line}: {ended.stderr}"
    sheet = tmp_path / "doublet_length_ada"
    for name in ("README.html", "README.md", "answers.toml", "notebook.ipynb"):
        assert (sheet / name).is_file(), name
    assert (tmp_path / "class" / "key.txt").is_file()
    (marks,) = tmp_path.rglob("marks.csv")
    with marks.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["student"] for row in rows} == {"Ada", "Ben"}


@pytest.mark.slow
def test_the_guide_on_any_aircraft_shows_adopts_and_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    models, stock = tmp_path / "models", stock_root() / "aircraft" / "J3Cub"
    shutil.copytree(stock, models / "plane")
    (models / "plane" / "J3Cub.xml").rename(models / "plane" / "plane.xml")
    shutil.copytree(models / "plane", models, dirs_exist_ok=True)
    Visitor("../models/plane", 30.0, 1000.0, 0.3, 1.0).write(tmp_path)["run"].rename(tmp_path / "my_scenario.toml")
    scenario = (tmp_path / "my_scenario.toml").read_text(encoding="utf-8").replace("../models", "models")
    (tmp_path / "my_scenario.toml").write_text(scenario, encoding="utf-8")
    done = run_commands("any_aircraft", tmp_path)
    assert len(done) == 4
    for line, ended in done.items():
        assert ended.returncode == 0, f"{line}: {ended.stderr}"
    adopted = tmp_path / "aircraft" / "plane" / "aircraft.toml"
    assert (tmp_path / "aircraft" / "plane" / "plane.xml").is_file()
    monkeypatch.chdir(tmp_path)
    (python,) = blocks_of("any_aircraft", "python")
    assert run_code(python)["trimmed"].condition.V_m_s == 43.0
    (stabiliser,) = blocks_of("any_aircraft", "toml")
    adopted.write_text(adopted.read_text(encoding="utf-8") + "\n" + stabiliser, encoding="utf-8")
    checked = command("check", "aircraft/plane", cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr


@pytest.mark.slow
def test_its_commands_run_and_its_own_file_is_right(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = text_of("synthetic_data").splitlines()
    first, second, third = (line for line in lines if line.startswith("testbench dataset "))
    assert "200 flights of 50 draws" in said_by(first)
    assert "every file agrees" in said_by(second)
    run_code("\n".join(blocks_of("synthetic_data", "python")))
    assert {line.split()[0] for line in said_by(third).splitlines() if "M_alpha" in line} == {
        "clean", "sensed", "turbulent", "flexible",
    }  # fmt: skip
    (own,) = blocks_of("synthetic_data", "toml")
    Path("mine.toml").write_text(own, encoding="utf-8")
    assert "a valid data set" in command("check", "mine.toml").stdout
    said_by("testbench dataset mine.toml --out mine --runs 12 --workers 1")


def test_its_lines_for_pytorch(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    tb.draw_dataset("small.toml", "my_set", workers=1)
    (lines,) = blocks_of("synthetic_data", r"\{code-block\} python")
    assert len(lines.strip().splitlines()) == 3
    try:
        import torch.utils.data  # noqa: F401
    except ImportError:
        for name in ("torch", "torch.utils", "torch.utils.data"):
            monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
        sys.modules["torch.utils.data"].DataLoader = StandIn
    readings, truth = next(iter(run_code(lines)["loader"]))
    assert tuple(readings.shape[1:]) == (251, 7)
    assert np.isfinite(np.asarray(truth)).any()


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is found")
def test_the_exported_aircraft_flies_as_the_guide_flies_it(tmp_path, monkeypatch):
    pytest.importorskip("fmpy", reason="fmpy is not installed")
    monkeypatch.chdir(tmp_path)
    exports, builds = (block.splitlines() for block in blocks_of("export_the_aircraft", "sh"))
    for line in exports:
        said_by(line)
    (code,) = blocks_of("export_the_aircraft", "c")
    Path("main.c").write_text(code)
    said = [subprocess.run(shlex.split(line), check=True, capture_output=True, text=True).stdout for line in builds]
    theta = float(said[1].split(":")[1].split()[0])
    by_unit = run_code(blocks_of("export_the_aircraft", "python")[0])["flight"]
    assert by_unit["theta"][by_unit["time"] == 2.0] == pytest.approx(theta, abs=2e-6)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("jax") is None, reason="jax is not installed")
def test_the_guide_finds_a_coefficient_through_jax():
    """In a process of its own, as JAX runs threads and other tests fork."""
    _, many, one = blocks_of("export_the_aircraft", "python")
    code = f"{many}\n{one}\nprint(*flights.shape, float(damping[0]))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *shape, damping = ran.stdout.split()[-3:]
    assert shape == ["64", "480"]
    assert float(damping) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_the_guide_s_flight_is_followed_and_plays_again(tmp_path, monkeypatch):
    from studies.reliability.small import made

    monkeypatch.chdir(tmp_path)
    made("g0.csv", tmp_path).rename("flight.csv")
    first, *_ = blocks_of("live", "sh")[0].splitlines()
    assert "link: " in said_by(first.partition("#")[0])
    again = re.search(r"`(testbench live results/live_flight [^`]*)`", text_of("live"))
    assert again is not None
    said_by(again[1])
    one, other = (Path("results") / name / "updates.jsonl" for name in ("live_flight", "live_flight_again"))
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_the_guide_s_aircraft_is_flown_by_a_stand_in(tmp_path, monkeypatch):
    """The first command of the guide, its two files those of a user; ArduPilot is a stand-in."""
    from questions.sitl.stand_ins import ArduPilot, free_port

    from testbench.core.paths import SUITES

    monkeypatch.chdir(tmp_path)
    shutil.copy(SUITES / "taurus_8hz.toml", "my_autopilot.toml")
    Path("mine.parm").write_text("SERVO1_FUNCTION 4\nSERVO2_FUNCTION 19\nSERVO3_FUNCTION 70\nSERVO4_FUNCTION 21\n")
    first, second = blocks_of("sitl", "sh")[0].splitlines()
    assert "--model JSON:127.0.0.1" in second
    port = free_port()

    def fly() -> None:
        autopilot = ArduPilot(port)
        for k in range(480):
            assert autopilot.step([1500, 1837 if k < 240 else 1840, 1327, 1500])["imu"]

    flight = threading.Thread(target=fly)
    flight.start()
    said = said_by(f"{first.partition('#')[0]} --port {port} --idle 3 --release 0")
    flight.join()
    assert "480 steps" in said
    again = re.search(r"`testbench live (results/sitl_taurus/records/flight_1_)SUITE.nc", text_of("sitl"))
    assert again is not None
    assert Path(f"{again[1]}my_autopilot.nc").is_file()
