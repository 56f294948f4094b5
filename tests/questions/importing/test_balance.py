"""The balance of an import: what is announced is what is written, and what was left out is named with its reason."""

from pathlib import Path

import numpy as np
import pytest
from commands import command
from recorded import flight_data, shared
from test_importing import T, short_period, sidpac, table
from writers import DATAFLASH, dataflash_bin, dataflash_of, elevator, ulog

import testbench as tb
from testbench.core.errors import RecordError
from testbench.core.record import load_record
from testbench.logs.signals import instances_of
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import Imported, import_log, read_log, write_import
from testbench.questions.importing.page import channel_rows, import_answer, noise_rows


def found_in(path: Path) -> list[tuple[str, str]]:
    """Every (channel, source) that the log holds and a rule knows, counted from the log itself."""
    log, rules = read_log(path)
    out = []
    for rule in rules:
        for name in instances_of(rule.topic, log.topics):
            if set(rule.fields) <= set(log.topics[name].columns):
                path = rule.fields[0].rpartition(".")[0] + "."  # of a vector, said once
                shared = path if all(field.startswith(path) for field in rule.fields) else ""
                fields = shared + "/".join(field.removeprefix(shared) for field in rule.fields)
                out.append((rule.channel, fields if name in ("", fields) else f"{name}.{fields}"))
    return sorted(out)


def assert_announced_is_written(path: Path, folder: Path) -> Imported:
    """Hold terminal, balance, records, provenance and descriptions of one import against each other."""
    found = import_log(path)
    paths = write_import(found, folder)
    whole = load_record(folder / "whole.nc")
    kept = found.balance.kept
    assert tuple(s.channel for s in kept) == whole.channels == tuple(c.name for c in found.channels)
    assert f"holds {len(whole.channels)} channel" in " ".join(text for _, text in import_answer(found))
    assert [row[0] for row in channel_rows(found)] == list(whole.channels)
    for i, signal in enumerate(kept):
        assert signal.valid == pytest.approx(whole.valid[:, i].mean())
        assert signal.record_rate_hz == pytest.approx(1.0 / whole.dt_s)
    assert list(whole.provenance["channels"]) == sorted(whole.channels)
    assert len(whole.provenance["left_out"]) == len(found.balance.left_out)
    known = [(s.channel, s.source) for s in found.balance.signals if s.channel]
    assert sorted(known) == sorted([*found_in(path), *((s.channel, s.source) for s in found.balance.left_out
                                                       if s.source in found.log.reasons)])  # fmt: skip
    assert all(s.reason for s in found.balance.signals if not s.kept)
    for part in paths:
        if part.suffix == ".nc":
            assert load_record(part).channels == whole.channels
        else:
            described = {c.name for c in RecordDescription.load(part).channel}
            text = part.read_text(encoding="utf-8")
            absent = [name for name in whole.channels if name not in described]
            assert described <= set(whole.channels)
            assert not absent or f"holds no sample: {', '.join(absent)}" in text
            assert all(s.source in text for s in found.balance.signals if s.channel)
    return found


WRITERS = {"flight.ulg": lambda: ulog(12.0), "flight.bin": lambda: dataflash_bin(12.0)}
CASES = [
    path
    for folder in ("cases", "logs")
    for path in shared(folder)
    if path.suffix in (".ulg", ".bin", ".csv", ".txt", ".mat", ".nc") and "hostile" not in path.parts
]


@pytest.mark.parametrize("name", [*WRITERS, "flight.csv", "flight.mat"])
def test_what_is_announced_is_what_is_written(tmp_path, name):
    path = tmp_path / name
    if name in WRITERS:
        pytest.importorskip("pyulog" if name.endswith("ulg") else "pymavlink", reason="needs the extra logs")
        path.write_bytes(WRITERS[name]())
    else:
        (table if name.endswith("csv") else sidpac)(path)
    assert_announced_is_written(path, tmp_path / "out")


@pytest.mark.parametrize("path", CASES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_what_is_announced_is_what_is_written_for_inputs_that_failed_once(tmp_path, path):
    pytest.importorskip("pyulog", reason="needs the extra logs: pip install flight-testbench[logs]")
    pytest.importorskip("pymavlink", reason="needs the extra logs: pip install flight-testbench[logs]")
    try:
        read_log(path)
    except RecordError:
        with pytest.raises(RecordError, match=path.name):  # refused, not half delivered
            import_log(path)
        return
    assert_announced_is_written(path, tmp_path / "out")


def test_real_records_are_announced_as_they_are_written(tmp_path):
    folder = flight_data()
    for name in ("twin_otter/totter_lon_020213f1_018.mat", "hfb320/hfb320_1_10_withHeader.asc"):
        assert_announced_is_written(folder / name, tmp_path / Path(name).stem)


def scattered(path: Path, hole: float = 0.3) -> Path:
    """A table at 200 Hz of which stretches of 0.1 s are left, too short to be filtered for 50 Hz, beside a good one."""
    t = np.arange(0.0, 20.0, 0.005)
    q, theta, _ = short_period(t)
    holes = (t % (0.1 + hole)) > 0.1
    rows = [
        f"{a:.3f},{'' if lost else format(b, '.9g')},{c:.9g}" for a, b, c, lost in zip(t, q, theta, holes, strict=True)
    ]
    path.write_text("\n".join(["t [s],q [rad/s],theta [rad]", *rows]) + "\n", encoding="utf-8")
    return path


def test_a_channel_that_resampling_drops_is_announced_as_lost(tmp_path):
    found = import_log(scattered(tmp_path / "f.csv"), rate_hz=50.0)
    assert found.record.channels == ("theta",)
    (lost,) = found.balance.lost
    assert (lost.channel, lost.kept, lost.source) == ("q", False, "q")
    assert "no stretch between its gaps is long enough to be filtered for 50 Hz" in lost.reason
    lines = [text for kind, text in import_answer(found) if kind == "doubt"]
    assert any(text.startswith("lost: q from q: ") for text in lines)
    assert import_log(scattered(tmp_path / "f.csv"), rate_hz=200.0).record.channels == ("q", "theta")  # as it advises


def test_a_channel_of_which_most_is_lost_says_so(tmp_path):
    t = np.arange(0.0, 20.0, 0.005)
    q, theta, _ = short_period(t)
    kept = (t < 4.0) | ((t % 0.4) < 0.1)
    rows = [f"{a:.3f},{b if ok else np.nan:.9g},{c:.9g}" for a, b, c, ok in zip(t, q, theta, kept, strict=True)]
    path = tmp_path / "f.csv"
    path.write_text("\n".join(["t [s],q [rad/s],theta [rad]", *rows]) + "\n", encoding="utf-8")
    found = import_log(path, rate_hz=50.0)
    (lost,) = found.balance.lost
    assert lost.channel == "q"
    assert lost.kept
    assert "% of its samples are in the record" in lost.reason


@pytest.mark.parametrize(("copy", "said"), [(True, "which has the same values"), (False, "which has other values")])
def test_a_second_column_of_a_name_or_of_a_channel_does_not_vanish(tmp_path, copy, said):
    path = tmp_path / "f.csv"
    q, theta, _ = short_period(T)
    other = q if copy else 2.0 * q
    np.savetxt(path, np.c_[T, q, theta, other, other], delimiter=",", header="t,q,theta,q,pitch_rate", comments="")
    found = assert_announced_is_written(path, tmp_path / "out")
    left = {s.source: s.reason for s in found.balance.left_out}
    assert list(left) == ["q (column 4)", "pitch_rate"]
    assert all(reason == f"q is taken from q, {said}" for reason in left.values())


def mat(path: Path, **more: np.ndarray) -> Path:
    from scipy.io import savemat

    q = short_period(T)[0]
    savemat(path, {"t": T, "q": q, "de": 0.01 * np.sin(T), **more})
    return path


@pytest.mark.parametrize("clock", ["t_alpha", "alpha_time", "Time_alpha"])
def test_a_second_rate_of_a_mat_file_is_read_with_its_own_clock(tmp_path, clock):
    slow = T[::5] + 0.004
    found = assert_announced_is_written(
        mat(tmp_path / "m.mat", alpha=0.1 * np.sin(slow), **{clock: slow}), tmp_path / "out"
    )
    record = found.record
    taken = record.valid[:, record.channels.index("alpha")]
    assert taken.mean() == pytest.approx(0.2, abs=0.01)
    error = np.abs(record["alpha"] - 0.1 * np.sin(record.t_s))[taken]
    assert error[1:].max() < 1e-6  # at the record's times, 4 ms from its own; the first holds the first sample
    assert found.balance.lost == ()


def test_a_second_rate_without_times_is_listed_with_what_to_do(tmp_path):
    slow = T[::5]
    found = assert_announced_is_written(mat(tmp_path / "m.mat", alpha=np.sin(slow), foo=slow), tmp_path / "out")
    (lost,) = found.balance.lost
    assert (lost.channel, lost.source, lost.samples) == ("alpha", "alpha", slow.size)
    assert "its own times must be called t_alpha, got none" in lost.reason
    assert [s.source for s in found.balance.unknown] == ["foo"]
    wrong = import_log(mat(tmp_path / "m.mat", alpha=np.sin(slow), t_alpha=slow[:-1]))
    assert "349 samples" in wrong.balance.lost[0].reason


def test_times_in_microseconds_that_state_no_unit_are_taken_as_such_and_said(tmp_path):
    q, theta, _ = short_period(T)
    path = tmp_path / "us.csv"
    np.savetxt(
        path, np.c_[np.round(1e6 * (T + 300.0)), q, theta], delimiter=",", header="timestamp,q,theta", comments=""
    )
    found = import_log(path)
    assert found.rate_hz == 50.0
    assert found.record.duration_s == pytest.approx(T[-1])
    assert [text.partition(", which")[0] for text in found.log.assumed] == [
        "the file states no unit for column 'timestamp', whose whole numbers are 20000 apart: taken as us"
    ]
    text = path.read_text(encoding="utf-8").replace("timestamp", "timestamp [s]")
    path.write_text(text, encoding="utf-8")  # the file insists on seconds
    assert "are the times in us" in import_log(path).asked[0]
    with pytest.raises(RecordError, match=r"plausible \(strict\)"):
        import_log(path, strict=True)


def test_the_command_prints_the_balance_questions_and_refuses_when_strict(tmp_path):
    path = table(tmp_path / "f.csv", names="time [s],Q [deg/s],theta [deg],elevator,AZ [g],Q")
    text = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([text[0], *(f"{row},1.5" for row in text[1:])]) + "\n", encoding="utf-8")
    done = command("import", path)
    out = done.stdout
    assert done.returncode == 0
    assert "1 signal that could be a channel is left out" in out
    assert "Q (column 6)" in out
    said = " ".join(out.split())
    assert "de is taken in deg, which no heading states: -229 deg in 275 of 1750 samples" in said
    path.write_text(path.read_text(encoding="utf-8").replace("elevator", "elevator [rad]"), encoding="utf-8")
    done = command("import", path, "--strict", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "must be plausible (strict)" in done.stderr
    assert not (tmp_path / "out").exists()
    done = command("import", path, "--imu", 1)
    assert done.returncode == 2
    assert "instance of imu" in done.stderr


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_inertial_units_that_disagree_are_questioned_and_refused_when_strict(tmp_path, sign):
    times = np.arange(0.0, 35.0, 0.01)
    rng = np.random.default_rng(0)
    messages = []
    for t, up, q, az in zip(times, elevator(times), *(short_period(times)[i] for i in (0, 2)), strict=True):
        us = round((20.0 + t) * 1e6)
        noise = 0.003 * rng.normal(size=4)
        messages += [("IMU", (us, 0, 0.0, q + noise[0], 0.0, 0.0, 0.0, az + noise[1]))]
        messages += [("IMU", (us, 1, 0.0, sign * q + noise[2], 0.0, 0.0, 0.0, az + noise[3]))]
        messages += [("RCOU", (us, 1500, round(1500 - 400 * float(up)), 1300, 1500))]
    path = tmp_path / "two.bin"
    path.write_bytes(dataflash_of(DATAFLASH, messages))
    found = import_log(path)
    said = "imu: IMU and IMU#1 differ in GyrY by 2 times their motion; IMU is used: is it the right one?"
    assert found.asked == (() if sign > 0.0 else (said,))
    if sign < 0.0:
        with pytest.raises(RecordError, match="IMU and IMU#1 differ"):
            import_log(path, strict=True)


def test_identify_asks_the_same_questions_as_import(tmp_path):
    paths = write_import(import_log(table(tmp_path / "f.csv")), tmp_path)
    description = next(p for p in paths if p.suffix == ".toml")
    assert tb.identify(tb.load_description(description)).questions == ()
    record = load_record(tmp_path / "01_de.nc")
    column = record.channels.index("theta")
    for name in ("01_de", "02_de"):
        record = load_record(tmp_path / f"{name}.nc")
        data = record.data.copy()
        data[:, column] *= 180.0 / np.pi
        type(record)(record.t_s, record.channels, data, "measured", record.valid).save(tmp_path / f"{name}.nc")
    result = tb.identify(tb.load_description(description))
    (said,) = result.questions
    assert said.startswith("in record '01_de' (and in 02_de), theta: ")
    assert result.findings[0] == said
    with pytest.raises(RecordError, match=r"plausible \(strict\)"):
        tb.identify(tb.load_description(description), strict=True)
    for question in ("identify", "compatibility"):
        done = command(question, description, "--strict")
        assert done.returncode == 2
        assert "theta: " in done.stderr


def test_one_outage_of_all_channels_is_said_once_and_loses_none(tmp_path):
    """Every channel had a line of its own for one gap: 14 of a copter's log."""
    t = np.r_[np.arange(0.0, 20.0, 0.02), np.arange(300.0, 320.0, 0.02)]
    rates = 0.1 * np.sin(np.outer(t, (1.0, 1.3, 0.7, 0.4, 0.2)))
    head = "t [s],p [rad/s],q [rad/s],r [rad/s],phi [rad],theta [rad]"
    np.savetxt(tmp_path / "f.csv", np.c_[t, rates], "%.6g", ",", header=head, comments="")
    found = import_log(tmp_path / "f.csv", rate_hz=50.0)
    assert found.balance.lost == ()
    said = [text for kind, text in import_answer(found) if kind == "doubt"]
    assert said == ["damage or loss: nothing was logged from 19.98 to 300.0 s, of no channel"]
    assert [s.kind for s in found.stretches] == ["flight", "not logged", "flight"]


def test_what_one_cause_takes_of_several_channels_is_one_line(tmp_path):
    t = np.arange(0.0, 20.0, 0.005)
    holes = (t % 0.4) > 0.1
    columns = [np.where(holes, np.nan, 0.1 * np.sin(k * t)) for k in (1, 2, 3)]
    head = "t [s],p [rad/s],q [rad/s],r [rad/s],theta [rad]"
    np.savetxt(tmp_path / "f.csv", np.c_[t, np.array(columns).T, np.sin(t)], "%.6g", ",", header=head, comments="")
    found = import_log(tmp_path / "f.csv", rate_hz=50.0)
    (line,) = (text for _, text in import_answer(found) if text.startswith("lost: "))
    assert line.startswith("lost: p from p: no stretch between its gaps")
    assert line.endswith("; likewise q, r")


def test_times_that_run_backwards_are_said_to(tmp_path):
    t = np.r_[np.arange(0.0, 10.0, 0.02), np.arange(4.0, 24.0, 0.02)]
    rows = np.c_[t, np.sin(t)]
    np.savetxt(tmp_path / "f.csv", rows, "%.6g", ",", header="t [s],q [rad/s]", comments="")
    (said,) = import_log(tmp_path / "f.csv").log.warnings
    assert said.startswith("500 of 1500 samples left out, because the clock runs backwards, once, by 5.98 s")


def test_a_crash_at_the_end_is_no_question_of_a_unit_that_the_heading_states(tmp_path):
    t = np.arange(81) / 10.0
    q = np.where(t < 7.75, 5.0 * np.sin(t), 1000.0)
    alpha = np.where(t < 7.55, 3.0 + np.sin(t), 170.0 + t)
    rows = np.c_[t, q, alpha, 36.0 + t / 10.0, 500.0 + t, 0.1 * t]
    head = "Time,Q (deg/s),Alpha (deg),V_{Total} (ft/s),Terrain Elevation (ft),fcs/elevator-control"
    np.savetxt(tmp_path / "f.csv", rows, "%.6g", ",", header=head, comments="")
    found = import_log(tmp_path / "f.csv")
    assert [text.partition(": ")[2] for text in found.asked] == [
        "1e+03 deg/s in 3 of 81 samples from t = 7.8 s on; are these samples damaged, or not flight (a crash)?",
        "178 deg in 5 of 81 samples from t = 7.6 s on; are these samples damaged, or not flight (a crash)?",
    ]
    assert found.stretches[-1].kind == "crash"
    (said,) = found.unusable
    assert "'fcs/elevator-control' is named after one" in said
    assert "Terrain" not in said


def test_samples_that_repeat_a_slower_signal_are_said_with_its_rate(tmp_path):
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 30.0, 0.02)
    slow = np.repeat(rng.standard_normal(t.size // 5), 5)
    head = "t [s],V [m/s],q [rad/s]"
    rows = np.c_[t, 20.0 + slow, 0.01 * rng.standard_normal(t.size)]
    np.savetxt(tmp_path / "f.csv", rows, "%.6f", ",", header=head, comments="")
    found = import_log(tmp_path / "f.csv")
    assert found.repeated == ("V 10 of 50 Hz",)
    (row,) = (row for row in noise_rows(found) if row[0] == "q")
    assert row[2:4] == ("none seen", "50.0 Hz")
    assert float(row[1].split()[0]) == pytest.approx(np.degrees(0.01), rel=0.1)
