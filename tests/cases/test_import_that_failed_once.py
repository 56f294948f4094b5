"""Logs whose import once went wrong, as small copies made by the writers, and the inputs themselves where they are."""

import struct
from pathlib import Path

import numpy as np
import pytest
from recorded import shared
from writers import dataflash_bin, pitch_rate, ulog

from testbench.core.record import load_record
from testbench.questions.importing.ask import import_log, write_import

pytest.importorskip("pyulog", reason="needs the extra logs: pip install flight-testbench[logs]")
pytest.importorskip("pymavlink", reason="needs the extra logs: pip install flight-testbench[logs]")

IMU, HEAD = 130, b"\xa3\x95"
LENGTHS = {128: 89, 130: 36, 131: 17, 132: 19, 133: 19, 134: 31, 135: 75, 136: 15}


def failed_once(name: str) -> Path:
    """A file of the inputs that failed, by folder and name; skips where they are absent."""
    found = [path for path in shared("cases") if f"{path.parent.name}/{path.name}" == name]
    if not found:
        pytest.skip(f"no {name} beside the flight records")
    return found[0]


def with_first_unit_dead(whole: bytes) -> bytes:
    """Exchange the two inertial units of a log; the first, which stood still, reads zero."""
    data, at, seen = bytearray(whole), 0, 0
    while at < len(data):
        assert data[at : at + 2] == HEAD
        kind = data[at + 2]
        if kind == IMU:
            number = data[at + 11]
            data[at + 11] = 1 - number
            if number == 1:
                data[at + 12 : at + 36] = struct.pack("<6f", *[0.0] * 6)
            seen += 1
        at += LENGTHS[kind]
    assert seen > 100
    return bytes(data)


def thinned(whole: bytes, topics: tuple[int, ...]) -> bytes:
    """Leave out every third sample of some topics of a ULog, as a logger that thins a fast topic does."""
    out, at, counts = [whole[:16]], 16, dict.fromkeys(topics, 0)
    while at < len(whole):
        size, kind = struct.unpack_from("<Hc", whole, at)
        message = whole[at : at + 3 + size]
        topic = struct.unpack_from("<H", message, 3)[0] if kind == b"D" else -1
        if topic in counts:
            counts[topic] += 1
        if topic not in counts or counts[topic] % 3:
            out.append(message)
        at += 3 + size
    return b"".join(out)


def test_a_dead_first_inertial_unit_is_not_read(tmp_path):
    path = tmp_path / "imu.bin"
    path.write_bytes(with_first_unit_dead(dataflash_bin(10.0)))
    found = import_log(path)
    sources = {c.name: c.source for c in found.channels}
    assert {sources[name] for name in ("p", "q", "r")} == {"IMU#1.GyrX", "IMU#1.GyrY", "IMU#1.GyrZ"}
    assert np.max(np.abs(found.record["q"] - pitch_rate(found.record.t_s))) < 1e-4
    assert found.balance.sensors == ("imu: IMU#1 is read, the best of IMU, IMU#1 (IMU: zero throughout)",)
    asked = import_log(path, sensors={"imu": 0})
    assert "q" not in asked.record.channels  # as asked: what is not there is not announced
    assert {s.channel for s in asked.balance.lost} >= {"p", "q", "r", "az"}


def test_the_dead_unit_of_the_log_that_failed():
    found = import_log(failed_once("bin_first_imu_dead/imu.bin"))
    assert {c.name: c.source for c in found.channels}["q"] == "IMU#1.GyrY"
    assert {"p", "q", "ax", "az"} <= set(found.record.channels)
    assert np.degrees(found.record["q"]).max() == pytest.approx(10.0, abs=0.2)
    assert "GH is 0, not 1" in found.balance.sensors[0]


def test_a_thinned_topic_keeps_its_channels_and_its_manoeuvre(tmp_path):
    path = tmp_path / "two.ulg"
    path.write_bytes(thinned(ulog(12.0), (0, 4)))
    found = import_log(path)
    whole = load_record(write_import(found, tmp_path / "out")[0])
    for name in ("q", "de_cmd"):
        assert whole.valid[:, whole.channels.index(name)].mean() > 0.99, name
    assert np.max(np.abs(whole["q"] - pitch_rate(whole.t_s))[5:-5]) < 1e-4
    (manoeuvre,) = found.search.manoeuvres
    assert (manoeuvre.start_s, manoeuvre.end_s) == pytest.approx((5.0, 7.0), abs=0.1)


def test_the_two_step_clock_of_the_log_that_failed(tmp_path):
    found = import_log(failed_once("ulog_two_step_clock/two_step.ulg"))
    whole = load_record(write_import(found, tmp_path)[0])
    for name in ("q", "de_cmd"):
        assert whole.valid[:, whole.channels.index(name)].mean() > 0.99, name
    (manoeuvre,) = found.search.manoeuvres
    assert manoeuvre.cut_s is not None
    assert (manoeuvre.start_s, manoeuvre.end_s) == pytest.approx((5.0, 7.0), abs=0.1)
    assert found.asked == ()


def test_microseconds_and_a_second_rate_of_the_files_that_failed():
    found = import_log(failed_once("csv_timestamp_in_us/us.csv"))
    assert found.rate_hz == 50.0
    assert found.record.duration_s == pytest.approx(16.0, abs=0.03)
    assert sum(m.cut_s is not None for m in found.search.manoeuvres) == 1
    assert "taken as us, which makes 50 Hz" in found.log.assumed[0]
    found = import_log(failed_once("mat_second_rate/rates.mat"))
    assert found.record.channels == ("de", "q", "alpha")
    assert [s.rate_hz for s in found.balance.kept] == pytest.approx([50.0, 50.0, 10.0])
    assert sum(m.cut_s is not None for m in found.search.manoeuvres) == 1


def test_a_damaged_page_of_a_log_is_questioned(tmp_path):
    """A page of zeros in a log of a sensor with noise: the messages are whole, their numbers are not."""
    data = bytearray(dataflash_bin(10.0))
    rng = np.random.default_rng(4)
    at = 0
    while at < len(data):
        kind = data[at + 2]
        if kind == IMU and data[at + 11] == 0:
            t = struct.unpack_from("<Q", data, at + 3)[0] * 1e-6 - 12.5
            az = 0.0 if 4.0 < t < 4.4 else -9.81 + 0.1 * rng.normal()
            data[at + 32 : at + 36] = struct.pack("<f", az)
        at += LENGTHS[kind]
    path = tmp_path / "page.bin"
    path.write_bytes(bytes(data))
    asked = [text for text in import_log(path).asked if text.startswith("az")]
    assert len(asked) == 1
    assert "0 m/s2 from 16.5" in asked[0]
    assert "without any change; is this stretch damaged" in asked[0]
