"""New gap cases: complete for the records of a user, with sensors made from them and a record that judges."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from commands import command, ends
from gap_flights import ELEVATOR, THROTTLE, believe, measure

from testbench.core.constants import DEG_RAD
from testbench.core.errors import DiskError
from testbench.core.scenario.inputs import Doublet
from testbench.flight import load_aircraft
from testbench.questions.brought import laws_of
from testbench.questions.files import check_file
from testbench.questions.gap import ask, new
from testbench.questions.gap.new import most_different, shared_with, suite_of_records
from testbench.questions.gap.records import Said, flights_of
from testbench.questions.gap.scenario import GapScenario
from testbench.questions.importing.ask import import_log, write_import
from testbench.sensors import load_suite

ALIKE = ELEVATOR.model_copy(update={"amplitude_deg": 1.8})
FAST = Doublet(signal="doublet", control="de", amplitude_deg=2.0, period_s=0.5)


@pytest.fixture(scope="module")
def flown():
    """Two elevator inputs that are alike, one of another shape, and one of the throttle; noise alone, no effect."""
    flown = measure(believe(), 5, inputs=(ELEVATOR, ALIKE, FAST, THROTTLE), duration_s=8.0)
    return dict(zip(("one", "two", "fast", "throttle"), flown, strict=True))


@pytest.fixture
def folder(flown, tmp_path, monkeypatch):
    """A working folder with the flights as tables, without a word of who measured them, and as imported records."""
    monkeypatch.chdir(tmp_path)
    for name, record in flown.items():
        record.save_csv(tmp_path / f"{name}.csv")
        write_import(import_log(tmp_path / f"{name}.csv"), tmp_path / name)
    return tmp_path


def said(monkeypatch, capsys, *words):
    """Return the one line that refuses a command."""
    status, lines = ends(monkeypatch, capsys, *words)
    assert status == 2, lines
    assert len(lines) == 1, lines
    return lines[0]


def test_a_new_case_is_complete_and_its_sensors_are_those_of_the_records(folder, monkeypatch, capsys):
    words = ("gap", "new", "cases/mine.toml", "--aircraft", "eolo", "--wings", "rigid")
    status, _ = ends(monkeypatch, capsys, *words, "one", "two", "fast", "throttle")
    assert status == 0
    assert 'wings = "rigid"' in (folder / "cases" / "mine.toml").read_text(encoding="utf-8")
    case = folder / "cases" / "mine.toml"
    assert check_file(case) == "gap scenario"
    loaded = GapScenario.load(case)
    assert [m.name for m in loaded.measured if m.use == "held_out"] == ["fast 01_de"]
    assert all((case.parent / m.file).is_file() for m in loaded.measured)
    # 800 samples of 0.2 m/s and more: five standard errors, and the pitot's bias of 0.3 m/s is taken out
    assert loaded.condition.V_m_s == pytest.approx(16.0, abs=0.05)
    made, true = load_suite(loaded.suite), load_suite("eolo_gap")
    assert made.channels == true.channels
    for name in made.outputs:  # third differences of 4 times 800 samples tell a standard deviation to 3 %
        assert made.noise_std[name] == pytest.approx(true.noise_std[name], rel=0.1), name
    laws = laws_of(folder / "cases" / "mine_sensors.toml")
    assert laws is not None
    assert all(law.holds for law in laws[1])
    again = said(monkeypatch, capsys, *words, "one", "two")
    assert "must be a new file" in again


def test_a_case_whose_records_do_not_divide_the_aircraft_s_rate_flies_at_a_multiple_of_theirs(
    folder, monkeypatch, capsys
):
    for name in ("one", "two"):  # at 80 Hz, of an aircraft that is simulated at 500 Hz
        write_import(import_log(folder / f"{name}.csv", rate_hz=80.0), folder / f"{name}_slow")
    words = ("gap", "new", "mine.toml", "--aircraft", "eolo", "--wings", "rigid", "one_slow", "two_slow")
    assert ends(monkeypatch, capsys, *words)[0] == 0
    asked = []
    monkeypatch.setattr(ask, "find_gap", lambda believed, *_, **__: asked.append(believed) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        ask.run_gap(folder / "mine.toml")
    assert asked[0].rate_hz == pytest.approx(560.0)


def test_every_key_in_a_comment_is_one(folder, monkeypatch, capsys):
    assert ends(monkeypatch, capsys, "gap", "new", "mine.toml", "--aircraft", "eolo", "one", "two")[0] == 0
    text = (folder / "mine.toml").read_text(encoding="utf-8")
    live = re.sub(r"(?m)^# (effects = |\[simulation\]|rate_hz = |gamma_deg = )", r"\1", text)
    for key in ("condition", "load_kg", "load_aft_m"):  # of a record: put into the last one
        (line,) = re.findall(rf"(?m)^#     ({key} = [^#;\n]*)", text)
        live += line + "\n"
    assert live.count("\neffects = ") == live.count("\n[simulation]") == 1
    (folder / "mine.toml").write_text(live, encoding="utf-8")
    loaded = GapScenario.load(folder / "mine.toml")
    assert loaded.effects is not None
    assert loaded.measured[-1].load_kg == 0.5


def test_what_no_case_can_be_made_of_is_said_in_one_sentence(folder, flown, monkeypatch, capsys):
    new = ("gap", "new", "mine.toml", "--aircraft", "eolo")
    one = said(monkeypatch, capsys, *new, "one")
    assert "must have a second record to judge on" in one
    assert "testbench import LOG -o FOLDER" in one
    assert "testbench import one.csv -o FOLDER" in said(monkeypatch, capsys, *new, "one.csv", "two")
    flown["one"].select([n for n in flown["one"].channels if not n.endswith("_cmd")]).save("silent.nc")
    assert "must hold what drives the model, a command such as de_cmd" in said(
        monkeypatch, capsys, *new, "silent.nc", "two"
    )
    shutil.copy(folder / "one" / "whole.nc", "odd.nc")
    with h5py.File("odd.nc", "r+") as file:
        file.attrs["channels"] = file.attrs["channels"].replace("theta", "thetu")
        file.move("theta", "thetu")
    assert "'thetu'; did you mean 'theta'?" in said(monkeypatch, capsys, *new, "odd.nc", "two")
    unnamed = {**flown["one"].provenance, "suite": ""}
    replace(flown["one"].decimate(2), provenance=unnamed).save("slow.nc")
    assert "must have one rate, got 50 Hz in 'slow'" in said(monkeypatch, capsys, *new, "slow.nc", "two", "fast")
    assert not list(folder.glob("mine*"))


def test_a_judge_that_shares_flight_with_the_others_says_so(flown):
    def part(cut_s, log="x"):
        return replace(flown["one"], provenance={"sha256": log, "cut_from_record_s": cut_s})

    records = {"a": part([0.0, 7.0]), "b": part([5.0, 10.0]), "c": part([12.0, 20.0]), "d": part([0.0, 20.0], "y")}
    assert "shares 2 s of its log with 'a', where" in shared_with("b", records)
    assert not shared_with("c", records)
    assert not shared_with("one", {"one": flown["one"], "two": flown["two"]})


def test_a_record_that_shares_flight_with_another_does_not_judge(flown):
    """The most different one was chosen, and said to judge nothing new in the same file."""
    flights = flights_of(load_aircraft("eolo", "rigid"), flown, {}, Said("eolo_gap"))
    chosen = most_different(flights).name

    def of_log(name, start_s):
        told = {**flown[name].provenance, "sha256": "x", "cut_from_record_s": [start_s, start_s + 8.0]}
        return replace(flown[name], provenance=told)

    other = next(n for n in ("one", "two", "fast") if n != chosen)
    shared = replace(flights, naming={**flights.naming, chosen: of_log(chosen, 0.0), other: of_log(other, 5.0)})
    judge = most_different(shared).name
    assert judge not in (chosen, other)
    assert judge != "throttle"


def test_a_sensor_that_is_cleaner_than_usual_keeps_its_noise(flown):
    """Noise of 0.019 m/s2, less than a tenth of the usual 0.2, was called filtered: it is white."""
    rng = np.random.default_rng(8)
    t = flown["one"].t_s
    own = {n: flown[n].with_columns({"az": -9.8 + np.sin(t) + 0.019 * rng.normal(size=t.size)}) for n in ("one", "two")}
    suite, _ = suite_of_records("made", "other", own)
    assert suite.noise_std["az"] == pytest.approx(0.019, rel=0.1)


@pytest.mark.parametrize("channel", ["alpha", "theta"])
def test_degrees_read_as_radians_are_asked_about(flown, monkeypatch, capsys, tmp_path, channel):
    """Flow angles 57 times as large were refused as an elevator of the other sign; what is asked about comes first."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        record = flown[name].with_columns({channel: flown[name][channel] / DEG_RAD})
        replace(record, provenance={"file": f"{name}.log"}).save(f"{name}.nc")
    done = command("gap", "new", "mine.toml", "--aircraft", "eolo", "one.nc", "two.nc")
    assert done.returncode == 0
    assert f"in record 'one' (and in two), {channel}:" in done.stdout + done.stderr
    assert "is it in deg" in done.stdout + done.stderr
    assert "other way" not in done.stderr


def test_a_full_disk_is_not_taken_for_what_is_asked_about(flown, monkeypatch, tmp_path):
    """Of values that are asked about, what fails is told as theirs; a disk without room is its own cause."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        frozen = np.full(len(flown[name]), 16.0)
        replace(flown[name].with_columns({"V": frozen}), provenance={"file": f"{name}.log"}).save(f"{name}.nc")

    def full(*_, **__):
        raise DiskError("the disk must have room")

    monkeypatch.setattr(new, "load_aircraft", full)
    with pytest.raises(DiskError):
        new.new_case(tmp_path / "mine.toml", "eolo", [Path("one.nc"), Path("two.nc")])


def test_noise_that_a_filter_took_is_a_guess_and_says_so(flown, monkeypatch, capsys, tmp_path):
    """An attitude filter leaves nothing in third differences; its error is no smaller for that."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        t = flown[name].t_s
        smooth = {"theta": 0.05 + 0.02 * np.sin(t)}
        replace(flown[name].with_columns(smooth), provenance={"file": f"{name}.log"}).save(f"{name}.nc")
    new = ("gap", "new", "mine.toml", "--aircraft", "eolo")
    assert ends(monkeypatch, capsys, *new, "one.nc", "two.nc")[0] == 0
    suite = load_suite(tmp_path / "mine_sensors.toml")
    theta, q = (next(s for s in suite.sensors if s.channel == n) for n in ("theta", "q"))
    assert theta.source.startswith("YOURS: the noise is assumed")
    assert suite.noise_std["theta"] == pytest.approx(load_suite("eolo_gap").noise_std["theta"], rel=0.01)
    assert q.source.startswith("noise from third differences")
