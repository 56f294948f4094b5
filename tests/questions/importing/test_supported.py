"""A record that cannot support a recipe gets none, and the reason is one line: too slow, no control, few samples.

What import advises works if it is followed: another rate gives a recipe, or is not advised.
"""

import re

import numpy as np
import pytest
from commands import command, ends
from scipy.io import savemat
from writers import elevator, short_period

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, load_record
from testbench.estimators import estimate
from testbench.estimators.prepare import prepare
from testbench.questions.identify.ask import identify
from testbench.questions.identify.logs import _in_folder
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, write_import
from testbench.questions.importing.page import import_answer
from testbench.questions.importing.recipe import why_not

T = np.arange(0.0, 35.0, 0.02)


def log(folder, V=18.0, control=None, rows=slice(None)):
    """A table of a flight; V is a number, noise about it if it is small, or None for no column."""
    rng = np.random.default_rng(3)
    q, theta, az = short_period(T)
    columns = {"time [s]": T, "q [rad/s]": q, "theta [rad]": theta, "az [m/s2]": az}
    columns["elevator [rad]"] = 8.0 * DEG_RAD * elevator(T) if control is None else np.full(T.size, control)
    if V is not None:
        columns["V [m/s]"] = V + 0.3 * rng.standard_normal(T.size)
    path = folder / "log.csv"
    table = np.column_stack(list(columns.values()))[rows]
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.6f")
    return path


NONE = {
    "backwards": ({"V": -2.7}, "airspeed is -2.7 m/s"),
    "never airborne": ({"V": 0.0}, "on the ground"),
    "hover": ({"V": 1.5}, "in a hover"),
    "constant control": ({"control": 0.05}, "no control moves (de by 0 deg)"),
    "20 samples": ({"rows": slice(240, 260)}, "20 samples"),
}


@pytest.mark.parametrize("name", NONE)
def test_what_no_recipe_fits_has_none_and_says_why_in_one_line(tmp_path, name):
    how, why = NONE[name]
    found = import_log(log(tmp_path, **how))
    said = [text for _, text in import_answer(found) if why in text]
    assert said
    assert all("\n" not in text and text.startswith("no recipe for ") for text in said)
    paths = write_import(found, tmp_path / "out")
    assert not [p for p in paths if p.suffix == ".toml"]
    with pytest.raises(Exception, match="must hold a flight that can be identified") as refused:
        _in_folder(tmp_path / "out")
    assert why in str(refused.value)


def test_a_model_without_a_structure_has_a_recipe_where_its_estimator_has_samples_enough_and_not_below(tmp_path):
    """At 9 Hz the horizons of DSR_e are 5 samples: 35 stretches are needed, which 7 s hold and 6.5 s do not."""
    short = import_log(log(tmp_path, V=None, rows=slice(0, 325)), rate_hz=9.0)
    assert [text for text in short.unusable if "without a structure takes 35 stretches" in text] == [*short.unusable]
    first = prepare(short.record.split(0.7)[0], bias="mean", trim_s=0.0)
    with pytest.raises(EstimationError, match="gives 35 rows, got 32 columns"):
        estimate("dsr_e", [first], ["de"], ["q", "theta", "az"], past_horizon=5, future_horizon=5, order=3)
    enough = import_log(log(tmp_path, V=None, rows=slice(0, 350)), rate_hz=9.0)
    assert enough.unusable == ()
    (description,) = (p for p in write_import(enough, tmp_path / "out") if p.suffix == ".toml")
    assert identify(RecordDescription.load(description)).cases[0].model.method == "dsr_e"


def test_a_log_without_a_control_says_so_to_identify_too(tmp_path):
    found = import_log(log(tmp_path, control=0.0))
    write_import(found, tmp_path / "out")
    with pytest.raises(Exception, match=r"no control was found \(de: zero throughout\)"):
        _in_folder(tmp_path / "out")


def test_a_control_logged_more_slowly_than_the_record_is_no_input():
    t = np.arange(400) / 50.0
    valid = np.ones((400, 2), bool)
    valid[:, 1] = np.arange(400) % 5 == 0
    data = np.column_stack([np.sin(t), 0.1 * np.sin(t)])
    record = FlightRecord(t, ("q", "de_cmd"), data, "measured", valid)
    assert "at most 1 sample in a row at 50 Hz" in why_not(record, ("de_cmd",))
    valid[100:200, 1] = True
    assert why_not(FlightRecord(t, ("q", "de_cmd"), data, "measured", valid), ("de_cmd",)) == ""


def test_a_flight_fast_enough_has_its_recipe_and_without_airspeed_a_model_without_derivatives(tmp_path):
    for V, method in ((18.0, "output_error"), (None, "dsr_e")):
        found = import_log(log(tmp_path, V=V))
        assert found.unusable == ()
        (description,) = (p for p in write_import(found, tmp_path / method) if p.suffix == ".toml")
        assert f'method = "{method}"' in description.read_text(encoding="utf-8")


def test_what_to_do_next_is_said_and_that_there_are_frequency_responses_where_no_structure_fits(tmp_path):
    for V, following in ((18.0, ["identify"]), (None, ["identify", "response"])):
        folder = tmp_path / str(V)
        done = command("import", log(tmp_path, V=V), "-o", folder)
        assert done.returncode == 0, done.stderr
        (description,) = folder.glob("*.toml")
        told = done.stdout[done.stdout.index("Next: ") + 6 :].splitlines()
        assert told.pop().endswith(f"testbench gap new case.toml --aircraft MODEL {folder}")
        assert [line.split(":")[0].split() for line in told] == [["testbench", w, str(description)] for w in following]
        for words in following[1:]:
            shown = command(words, description, "--window", "2", "-o", tmp_path / "out")
            assert shown.returncode == 0, shown.stderr


def test_the_command_ends_with_the_reason_and_no_traceback(tmp_path):
    done = command("identify", log(tmp_path, V=0.0), "-o", tmp_path / "out")
    assert done.returncode in (2, 3)
    assert "on the ground" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_command_without_a_unit_is_named_with_what_to_do(tmp_path):
    t = 0.02 * np.arange(300)
    table = np.column_stack([t, np.sign(np.sin(t)) * 0.3, 0.1 * np.sin(t)])
    heads = ["Time", "elevator cmd", "velocities/q-rad_sec"]
    np.savetxt(tmp_path / "log.csv", table, "%.6g", ",", header=",".join(heads), comments="")
    (said,) = import_log(tmp_path / "log.csv").unusable
    assert "'elevator cmd' is named after one, but the name does not state an angle" in said


RATE = 50.0


def flight(path, control_hz, seconds=16.0, split=None):
    """Write a MAT file of a short period at 50 Hz whose elevator was logged more slowly, with times of its own."""
    n = round(seconds * RATE)
    t, u, x, y = np.arange(n) / RATE, np.zeros(n), np.zeros(2), np.zeros((n, 2))
    at, sign = 5.0, 1.0
    for k in (3, 2, 1, 1):
        u[(t >= at - 1e-9) & (t < at + 0.4 * k - 1e-9)] = 0.05 * sign
        at, sign = at + 0.4 * k, -sign
    A, B = np.array([[-1.2, 0.97], [-8.0, -2.0]]), np.array([-0.1, -9.0])
    for i in range(n):
        y[i] = x
        for _ in range(5):
            x = x + (A @ x + B * u[i]) / RATE / 5.0
    y += np.array([2e-4, 5e-4]) * np.random.default_rng(1).standard_normal(y.shape)
    k = round(RATE / control_hz)
    savemat(path, {"t": t, "alpha": y[:, 0], "q": y[:, 1], "de": u[::k], "t_de": t[::k]})
    return path


@pytest.mark.parametrize("control_hz", [25.0, 10.0, 5.0])
def test_the_rate_that_is_advised_gives_a_recipe(tmp_path, monkeypatch, capsys, control_hz):
    monkeypatch.chdir(tmp_path)
    flight(tmp_path / "slow.mat", control_hz)
    status, said = ends(monkeypatch, capsys, "identify", "slow.mat")
    assert status == 2
    advised = re.search(r"testbench (import) LOG (--rate) (\S+) (-o) FOLDER", " ".join(said))
    assert advised is not None, said
    words = [w.replace("LOG", "slow.mat").replace("FOLDER", "mine") for w in advised[0].split()[1:]]
    assert ends(monkeypatch, capsys, *words)[0] == 0
    assert [p.name for p in (tmp_path / "mine").glob("*.toml")] == ["slow_longitudinal.toml"]
    assert load_record(tmp_path / "mine" / "01_de.nc").valid.all()


def test_a_rate_that_would_not_help_is_not_advised(tmp_path):
    found = import_log(flight(tmp_path / "slow.mat", 2.0))
    (said,) = found.unusable
    assert "--rate 2 takes all of it, but does not help: it holds 21 samples, and a model needs 50 at least" in said
    other = import_log(tmp_path / "slow.mat", 2.0)
    assert not any(p.suffix == ".toml" for p in write_import(other, tmp_path / "mine"))


def test_a_channel_of_short_stretches_is_kept_by_the_rate_that_is_named(tmp_path):
    t = np.arange(4000) / 400.0
    fast = t[(np.arange(t.size) % 40) < 12]  # bursts of 30 ms every 0.1 s
    slow = np.arange(500) / RATE
    de = 0.05 * np.sign(np.sin(slow))
    content = {"t": slow, "de": de, "alpha": 0.1 * de, "q": np.sin(3.0 * fast), "t_q": fast}
    savemat(tmp_path / "bursts.mat", content)
    found = import_log(tmp_path / "bursts.mat", RATE)
    (left,) = [s for s in found.balance.left_out if s.channel == "q"]
    advised = re.search(r"--rate (\S+) keeps it", left.reason)
    assert advised is not None, left.reason
    assert "q" in import_log(tmp_path / "bursts.mat", float(advised[1])).record
