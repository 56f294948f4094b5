"""Autopilot logs against their libraries' own readers, bit for bit; units, instances and damage."""

import os
from pathlib import Path

import numpy as np
import pytest
from writers import DATAFLASH, SERVO, dataflash_bin, dataflash_of, ulog, ulog_of

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.logs import chain
from testbench.logs.ardupilot import COLUMNS
from testbench.logs.dataflash import binary_messages, read_dataflash, text_messages
from testbench.logs.signals import increasing
from testbench.logs.ulog import read_ulog
from testbench.questions.importing.ask import import_log, read_log

SHARED = Path(__file__).resolve().parents[3] / "shared"
LOGS = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", SHARED / "flight_data")).parent / "logs"
T = np.arange(200) / 50.0
WAVE = 0.1 * np.sin(3.0 * T)


def put(tmp_path, name: str, data: bytes) -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


SCALED = (
    (130, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    (131, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw"),
    (132, "ARSP", "Qff", "TimeUS,Airspeed,DiffPress"),
    (133, "POS", "QLLe", "TimeUS,Lat,Lng,Alt"),
    (134, "XKF1", "QBcfde", "TimeUS,C,Roll,VD,PN,PE"),
)


def every_code() -> bytes:
    rng = np.random.default_rng(1)
    rows = []
    for i in range(300):
        us = 1_000_000 + 20_000 * i
        x = [float(v) for v in rng.standard_normal(6)]
        n = [int(v) for v in rng.integers(-30000, 30000, 4)]
        rows += [("IMU", (us, 0, *x)), ("ATT", (us, n[0], n[1], n[2] % 36000)), ("ARSP", (us, x[0], x[1]))]
        rows += [
            ("POS", (us, 1000 * n[0], 1000 * n[1], 999 * n[2])),
            ("XKF1", (us, i % 2, n[3], x[2], x[3], 77 * n[0])),
        ]
    return dataflash_of(SCALED, rows)


@pytest.mark.parametrize("content", [every_code, lambda: dataflash_bin(12.0)], ids=["every code", "a flight"])
def test_columns_are_those_of_pymavlink_bit_for_bit(tmp_path, content):
    DFReader = pytest.importorskip("pymavlink.DFReader")
    path = put(tmp_path, "f.bin", content())
    found = binary_messages(path.read_bytes())
    reader = DFReader.DFReader_binary(str(path), zero_time_base=True)
    theirs: dict[str, list] = {}
    while (message := reader.recv_match(type=[*COLUMNS], strict=True)) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    reader.close()
    assert theirs.keys() == found.columns.keys() & COLUMNS.keys()
    compared = 0
    for name, messages in theirs.items():
        for column, values in found.columns[name].items():
            expected = np.array([getattr(message, column) for message in messages], dtype=np.float64)
            assert np.array_equal(values.astype(np.float64), expected), (name, column)
            compared += values.size
    assert compared > 5000


SAMPLES = ("sample_log_small.ulg", "sample_logging_tagged_and_default_params.ulg", "sample_appended_multiple.ulg")


@pytest.mark.parametrize("name", ["written", *SAMPLES])
def test_topics_are_those_of_pyulog_bit_for_bit(tmp_path, name):
    ULog = pytest.importorskip("pyulog").ULog
    path = put(tmp_path, "f.ulg", ulog(12.0)) if name == "written" else LOGS / name
    if not path.is_file():
        pytest.skip("the log is not here")
    log, theirs = read_ulog(path), ULog(str(path))
    seen = set()
    for data in theirs.data_list:
        topic = log.topics.get(data.name + (f"#{data.multi_id}" if data.multi_id else ""))
        if topic is None:
            continue
        seen.add(topic.name)
        clocks = [data.data[key] for key in ("timestamp_sample", "timestamp") if key in data.data]
        clocks = [clock.astype(np.float64) * 1e-6 for clock in clocks]
        matching = [t for t in clocks if np.array_equal(t[increasing(t)], topic.t_s)]
        assert matching, topic.name
        keep = increasing(matching[0])
        for column, values in topic.columns.items():
            assert values.dtype == data.data[column].dtype
            assert np.array_equal(values, data.data[column][keep], equal_nan=True), (topic.name, column)
    assert seen == log.topics.keys()
    assert log.parameters == {k: float(v) for k, v in theirs.initial_parameters.items()}


DAMAGES = 40


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut, overwritten with noise or with one byte, or with bytes that are gone, at random places."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        at, size = int(rng.integers(0, len(data))), int(rng.integers(1, 600))
        kind = int(rng.integers(0, 5))
        if kind == 0:
            data[at : at + size] = rng.bytes(min(size, len(data) - at))
        elif kind == 1:
            data[at : at + size] = bytes(min(size, len(data) - at))
        elif kind == 2:
            data[at : at + size] = b"\xff" * min(size, len(data) - at)
        elif kind == 3:
            del data[at : at + size]
        else:
            data[at] = int(rng.integers(0, 256))
    return bytes(data[: int(rng.integers(len(data) // 2, len(data) + 1))])


@pytest.mark.parametrize(("name", "content"), [("f.bin", dataflash_bin), ("f.ulg", ulog)])
def test_runs_of_messages_are_what_a_walk_message_by_message_finds(tmp_path, monkeypatch, name, content):
    whole = content(3.0)
    rng = np.random.default_rng(5)
    compared = 0
    for _ in range(DAMAGES):
        path = put(tmp_path, name, damaged(whole, rng))
        answers = []
        for one_by_one in (False, True):
            with monkeypatch.context() as patch:
                if one_by_one:
                    patch.setattr(chain, "run_length", lambda starts, ends, first: 0)
                else:
                    patch.setattr(chain, "CHUNK", 3000)
                try:
                    answers.append(read_log(path)[0])
                except RecordError as error:
                    answers.append(str(error))
        runs, walk = answers
        if isinstance(runs, str):
            assert runs == walk
            continue
        assert runs.warnings == walk.warnings
        assert runs.parameters == walk.parameters
        assert runs.unread == walk.unread
        assert runs.topics.keys() == walk.topics.keys()
        for key, topic in runs.topics.items():
            assert np.array_equal(topic.t_s, walk.topics[key].t_s)
            for column, values in topic.columns.items():
                assert np.array_equal(values, walk.topics[key].columns[column], equal_nan=True)
            compared += topic.t_s.size
    assert compared > 1000 * DAMAGES // 4


@pytest.mark.parametrize("filler", [b"\x00", b"\xff", b"\xa3\x95", b"D"])
@pytest.mark.parametrize(("name", "content"), [("f.bin", dataflash_bin), ("f.ulg", ulog)])
def test_a_page_of_one_byte_costs_what_lay_in_it(tmp_path, name, content, filler):
    data = bytearray(content(10.0))
    middle = len(data) // 2
    data[middle : middle + 4096] = filler * (4096 // len(filler))
    found = import_log(put(tmp_path, name, bytes(data)))
    assert any("belong to no whole message and were left out; saved" in text for text in found.log.warnings)
    p = next(c for c in found.channels if c.name == "p")
    assert np.max(np.abs(p.values - 0.01 * (p.t_s - 12.5))) < 1e-6
    lost = 10.0 * 4096 / len(data)
    assert len(p.gaps) == 1
    assert np.diff(p.gaps[0]) < 1.3 * lost + 0.05


def test_a_layout_that_changes_while_the_log_runs_is_followed():
    first = dataflash_of(SCALED[1:2], [("ATT", (20_000 * i, 100, 200, 300)) for i in range(50)])
    wide = (131, "ATT", "Qffff", "TimeUS,Roll,Pitch,Yaw,More")
    same = (131, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    for later, expected in ((wide, 50), (same, 100)):
        values = (1.0, 2.0, 3.0, 4.0)[: len(later[2]) - 1]
        second = dataflash_of([later], [("ATT", (2_000_000 + 20_000 * i, *values)) for i in range(50)])
        found = binary_messages(first + second)
        assert found.counts["ATT"] == 100
        assert found.columns["ATT"]["Roll"].size == expected
        assert set(found.columns["ATT"]["Pitch"]) == {2.0}
        assert found.damage == ()


# Units ------------------------------------------------------------------------------------------------------------

UNITS = (
    (160, "UNIT", "QbZ", "TimeUS,Id,Label"),
    (161, "MULT", "Qbd", "TimeUS,Id,Mult"),
    (162, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
)


def stated(gyro: tuple[str, str], pitch: tuple[str, str], factor: float = 1.0) -> bytes:
    """A log whose rates and pitch angle have a unit and a multiplier (by letters of the log's own)."""
    formats = (DATAFLASH[0], (131, "ATT", "Qffc", "TimeUS,Pitch,Yaw,Roll"), *UNITS)
    labels = {
        "s": b"s",
        "E": b"rad/s",
        "k": b"deg/s",
        "d": b"deg",
        "r": b"rad",
        "o": b"m/s/s",
        "P": b"Pa",
        "#": b"instance",
    }
    rows = [("UNIT", (0, ord(i), label)) for i, label in labels.items()]
    sizes = {
        "-": 0.0,
        "0": 1.0,
        "B": float(np.float32(1e-2)),
        "C": float(np.float32(1e-3)),
        "F": float(np.float32(1e-6)),
    }
    rows += [("MULT", (0, ord(i), size)) for i, size in sizes.items()]
    rows.append(("FMTU", (0, 130, f"s#{3 * gyro[0]}ooo".encode(), f"F-{3 * gyro[1]}000".encode())))
    rows.append(("FMTU", (0, 131, f"s{pitch[0]}dd".encode(), f"F{pitch[1]}0B".encode())))
    for t, x in zip(T, WAVE, strict=True):
        us = round(1e6 * t)
        rows.append(("IMU", (us, 0, x * factor, 0.0, x * factor, 0.3, 0.0, -9.8)))
        rows.append(("ATT", (us, x * factor, 0.0, 150)))
    return dataflash_of(formats, rows)


def test_units_and_multipliers_of_the_log_are_used(tmp_path):
    def values(content: bytes) -> dict[str, np.ndarray]:
        return {c.name: c.values for c in import_log(put(tmp_path, "f.bin", content)).channels}

    usual = values(stated(("E", "0"), ("d", "0")))
    assert np.allclose(usual["p"], WAVE, atol=1e-8)
    assert np.allclose(usual["theta"], WAVE * DEG_RAD, atol=1e-9)
    assert np.allclose(usual["phi"], 1.5 * DEG_RAD)  # hundredths by its own code: the multiplier is not used again
    degrees = values(stated(("k", "0"), ("r", "0")))
    assert np.allclose(degrees["p"], WAVE * DEG_RAD, atol=1e-9)
    assert np.allclose(degrees["theta"], WAVE, atol=1e-8)
    thousandths = values(stated(("E", "C"), ("d", "B")))
    assert np.allclose(thousandths["p"], 1e-3 * WAVE, atol=1e-10)
    assert np.allclose(thousandths["theta"], 1e-2 * WAVE * DEG_RAD, atol=1e-10)


def test_a_unit_of_another_kind_is_not_read_and_said(tmp_path):
    found = import_log(put(tmp_path, "f.bin", stated(("P", "0"), ("d", "0"))))
    assert "p" not in found.record.channels
    assert any("IMU.GyrX is not read as p: the log states its unit as Pa" in text for text in found.log.notes)


# Which sensor, which filter, which message ------------------------------------------------------------------------

AIR = (165, "ARSP", "QBffBBB", "TimeUS,I,Airspeed,DiffPress,U,H,Pri")
CORE = (166, "XKF1", "QBfff", "TimeUS,C,VD,PN,PE")
PRIMARY = (167, "XKF4", "QBb", "TimeUS,C,PI")


def speeds(flags: dict[int, tuple[int, int, int]]) -> bytes:
    rows = []
    for t in T:
        rows += [("ARSP", (round(1e6 * t), i, 20.0 + i, 200.0 + i, *flag)) for i, flag in flags.items()]
    return dataflash_of([AIR], rows)


@pytest.mark.parametrize(
    ("flags", "speed", "why"),
    [
        ({0: (1, 1, 0), 1: (1, 1, 0)}, 20.0, ""),
        ({0: (1, 1, 1), 1: (1, 1, 1)}, 21.0, "the log calls airspeed 1 the first for 100 % of the time"),
        ({0: (0, 1, 0), 1: (1, 1, 0)}, 21.0, "ARSP was in use for 0 % of the time, by its own flag"),
        ({0: (1, 1, 1), 1: (0, 1, 1)}, 20.0, "ARSP#1 was in use for 0 % of the time, by its own flag"),
        ({0: (0, 1, 0)}, 20.0, "ARSP was in use for 0 % of the time, by its own flag"),
    ],
)
def test_the_airspeed_that_was_in_use_is_read(tmp_path, flags, speed, why):
    found = import_log(put(tmp_path, "f.bin", speeds(flags)))
    assert set(found.record["V"]) == {speed}
    assert set(found.record["qbar"]) == {speed + 180.0}
    told = [text for text in found.log.notes if "airspeed" in text or "ARSP" in text]
    assert (why in told) if why else not told


@pytest.mark.parametrize(("primary", "core"), [([0], 0), ([1], 1), ([0, 1, 1, 1], 1), ([2], 2)])
def test_the_filter_core_that_was_flown_by_is_read(tmp_path, primary, core):
    rows = []
    for k, t in enumerate(T):
        us = round(1e6 * t)
        rows += [("XKF1", (us, c, -1.0 - c, 0.5 * k + c, 10.0 + c)) for c in range(3)]
        rows += [("XKF4", (us, c, primary[k % len(primary)])) for c in range(3)]
    found = import_log(put(tmp_path, "f.bin", dataflash_of([CORE, PRIMARY], rows)))
    assert set(found.record["hdot"]) == {1.0 + core}
    assert found.record["east"][0] == 10.0 + core
    assert any(f"flew by core {core} of XKF" in text for text in found.log.notes) == (primary != [0])


def test_the_inertial_unit_of_the_core_is_preferred(tmp_path):
    unit = DATAFLASH[0]
    parameter = DATAFLASH[4]
    for mask, expected in ((None, 1.0), (0b101, 2.0)):
        rows = [("PARM", (0, b"EK3_IMU_MASK", float(mask)))] if mask else []
        for t, x in zip(T, WAVE, strict=True):
            us = round(1e6 * t)
            rows += [("IMU", (us, i, i + x, 0.0, 0.0, 0.1, 0.0, -9.8)) for i in range(3)]
            rows.append(("XKF4", (us, 0, 1)))
        found = import_log(put(tmp_path, "f.bin", dataflash_of([unit, parameter, PRIMARY], rows)))
        assert found.record["p"].mean() == pytest.approx(expected, abs=0.05)


def test_raw_inertial_data_are_read_where_they_are_denser(tmp_path):
    gyro = (168, "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ")
    rows = [("IMU", (round(1e6 * t), 0, 1.0, 1.0, 1.0, 0.0, 0.0, -9.8)) for t in T[::2]]
    rows += [("GYR", (round(1e6 * t), 0, round(1e6 * t), 2.0, 2.0, 2.0)) for t in T]
    found = import_log(put(tmp_path, "f.bin", dataflash_of([DATAFLASH[0], gyro], rows)))
    by_name = {c.name: c for c in found.channels}
    assert by_name["p"].source == "GYR.GyrX"
    assert by_name["az"].source == "IMU.AccZ"
    assert by_name["p"].rate_hz == pytest.approx(50.0)


def test_a_change_of_estimator_is_said(tmp_path):
    rates = ("vehicle_angular_velocity", "uint64_t timestamp;float[3] xyz;", T, np.column_stack([WAVE] * 3))
    selector = ("estimator_selector_status", "uint64_t timestamp;float primary_instance;", T, (T > 3.0)[:, None])
    found = import_log(put(tmp_path, "f.ulg", ulog_of([rates, selector])))
    assert any("instance 0 for 75.5 %, 1 for 24.5 % of the time" in text for text in found.log.notes)
    calm = (*selector[:3], 0.0 * T[:, None])
    found = import_log(put(tmp_path, "f.ulg", ulog_of([rates, calm])))
    assert not any("estimator" in text for text in found.log.notes)


# What would serve better ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "slow"), [(10.0, True), (25.0, True), (39.0, True), (42.0, False), (250.0, False)])
def test_a_slow_log_says_what_to_set(tmp_path, rate, slow):
    t = np.arange(200) / rate
    column = 0.1 * np.sin(t)[:, None]
    rates = ("vehicle_angular_velocity", "uint64_t timestamp;float[3] xyz;", t, np.tile(column, 3))
    found = import_log(put(tmp_path, "f.ulg", ulog_of([rates])))
    told = [text for text in found.log.notes if text.startswith("logged slowly")]
    assert len(told) == slow
    assert not slow or ("SDLOG_PROFILE" in told[0] and f"p {rate:.3g} Hz" in told[0])
    rows = [("IMU", (round(1e6 * at), 0, *[float(x)] * 6)) for at, x in zip(t, column[:, 0], strict=True)]
    log, _ = read_log(put(tmp_path, "f.bin", dataflash_of(DATAFLASH[:1], rows)))
    assert sum("LOG_BITMASK" in text for text in log.notes) == slow


def test_an_unknown_flag_and_a_log_without_a_flight_are_refused_in_one_line(tmp_path):
    data = bytearray(ulog(1.0))
    data[16 + 3 + 9] = 1
    with pytest.raises(RecordError, match="needs more than is known"):
        read_ulog(put(tmp_path, "f.ulg", bytes(data)))
    other = ("battery_status", "uint64_t timestamp;float voltage_v;", T, WAVE[:, None])
    with pytest.raises(RecordError, match="it holds battery_status"):
        read_ulog(put(tmp_path, "f.ulg", ulog_of([other])))
    power = dataflash_of(DATAFLASH[-1:], [("POWR", (0, 5.0))])
    with pytest.raises(RecordError, match=r"it holds .*POWR"):
        read_dataflash(put(tmp_path, "f.bin", power))


def test_settings_of_the_log_are_kept(tmp_path):
    log = read_dataflash(put(tmp_path, "f.bin", dataflash_bin(1.0)))
    assert log.parameters == {key: float(value) for key, value in SERVO.items()}
    assert log.facts == {"software": "ArduPlane V4.5.7"}
    assert read_ulog(put(tmp_path, "f.ulg", ulog_of([("airspeed", "uint64_t timestamp;float true_airspeed_m_s;", T,
                     20.0 + WAVE[:, None])], {"A": 3, "B": 0.5}))).parameters == {"A": 3.0, "B": 0.5}  # fmt: skip


@pytest.mark.parametrize(
    ("line", "whole"),
    [
        ("ATT, 1, 2.0, 3.0", 1),
        ("ATT, 1, 2.0", 0),
        ("ATT, 1, 2.0, x", 0),
        ("ATT, 1.5, 2.0, 3.0", 0),
        ("FMT, 130, 20, GPS, Q!, TimeUS,Lat", 0),
        ("FMT, 130, 20, GPS, Qff, TimeUS,Lat", 0),
        ("FMT, 130, 20, GPS, Qf, TimeUS,Lat", 1),
        ("FMT, 128, 89, FMT, BBnN!, Type,Length,Name,Format,Columns", 0),
        ("FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format", 1),
        ("NEW, 1", 0),
        ("", 0),
    ],
)
def test_lines_of_a_text_log_that_fit_no_format_are_counted(line, whole):
    head = ["FMT, 129, 19, ATT, Qff, TimeUS,Roll,Pitch", "ATT, 0, 1.0, 2.0"]
    found = text_messages("\n".join([*head, line, ""]).encode())
    bad = "" if whole or not line else "1 of 3 lines fit no format given and were left out"
    assert "; ".join(found.damage) == bad
    assert sum(found.counts.values()) == 2 + whole
    cut = text_messages("\n".join([*head, "ATT, 5, 1.0, 2.0"]).encode())
    assert cut.damage == ("the file ends in the middle of a line, which was left out; it was cut short",)
    assert cut.counts["ATT"] == 1
