"""PX4 and ArduPilot logs written byte by byte: what is read back, in the units and signs of the channel table.

Messages of Paparazzi with the definitions beside them: channels in their units and signs, and clear refusals.
"""

import numpy as np
import pytest
from short_flight import DE, Q, T
from writers import START_S, attitude, dataflash_bin, dataflash_log, elevator, pitch_rate, ulog

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.logs.signals import find_channels
from testbench.questions.importing.ask import cut, import_log, read_log

# What the formats keep: 32-bit floats, and hundredths of a degree for the attitude of ArduPilot.
KINDS = {"flight.ulg": ("PX4 ULog", 2e-6), "flight.bin": ("ArduPilot DataFlash (binary)", 0.0051 * DEG_RAD),
         "flight.log": ("ArduPilot DataFlash (text)", 0.0051 * DEG_RAD)}  # fmt: skip


def content(name: str, duration_s: float = 35.0) -> bytes:
    if name.endswith("ulg"):
        return ulog(duration_s)
    return dataflash_bin(duration_s) if name.endswith("bin") else dataflash_log(duration_s).encode()


@pytest.fixture(scope="module")
def whole() -> dict[str, bytes]:
    return {name: content(name) for name in KINDS}


@pytest.fixture(scope="module")
def short() -> dict[str, bytes]:
    return {name: content(name, 10.0) for name in KINDS}


def put(tmp_path, name: str, data: bytes):
    path = tmp_path / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", KINDS)
def test_a_flight_is_read_back(tmp_path, whole, name):
    kind, angle_tolerance = KINDS[name]
    found = import_log(put(tmp_path, name, whole[name]))
    assert found.log.kind == kind
    assert found.log.warnings == ()
    record, t = found.record, found.record.t_s
    assert record.kind == "measured"
    assert found.rate_hz == 50.0
    phi, theta, psi = attitude(t)
    for channel, truth, tolerance in (
        ("phi", phi, angle_tolerance),
        ("theta", theta, angle_tolerance),
        ("psi", psi, angle_tolerance),  # through 180 deg without a jump
        ("q", pitch_rate(t), 1e-4),  # the low pass has a ripple of 0.1 %
        ("p", 0.01 * t, 1e-4),
        ("r", -0.02 * t, 1e-4),
        ("az", np.full(t.size, -G0_M_S2), 1e-4),
        ("V", 18.0 + 0.1 * t, 1e-5),
    ):
        taken = record.valid[:, record.channels.index(channel)]
        assert np.max(np.abs(record[channel] - truth)[taken]) < tolerance, channel
    assert record.provenance["clock_zero_s"] == pytest.approx(START_S, abs=1e-6)  # when read, not when published
    speed = record.valid[:, record.channels.index("V")]
    assert np.array_equal(np.flatnonzero(speed)[:3], [0, 5, 10])  # 10 Hz at 50 Hz: marked where it was sampled


@pytest.mark.parametrize("name", KINDS)
def test_the_elevator_command_has_our_sign_and_throw(tmp_path, whole, name):
    found = import_log(put(tmp_path, name, whole[name]), throw_rad={"de": 20.0 * DEG_RAD})
    t = found.record.t_s
    expected = -20.0 * DEG_RAD * elevator(t)  # nose up is elevator up, which is negative
    error = np.abs(found.record["de_cmd"] - expected)
    edges = np.abs(t[:, None] - np.array([5, 6, 7, 20, 21.5, 22.5, 23, 23.5])).min(axis=1) < 0.25
    assert error[~edges].max() < 0.01 * 4.0 * DEG_RAD  # 1 % of the amplitude away from the steps: the filter's ripple
    mapped = next(c for c in found.channels if c.name == "de_cmd")
    assert "full command is 20 deg (as given)" in mapped.assumed
    unknown = next(c for c in import_log(found.log.file).channels if c.name == "de_cmd")
    assert "full command is 25 deg (assumed" in unknown.assumed


@pytest.mark.parametrize("name", KINDS)
def test_both_manoeuvres_are_found(tmp_path, whole, name):
    found = import_log(put(tmp_path, name, whole[name]))
    spans = [(m.start_s, m.end_s, m.controls) for m in found.search.manoeuvres]
    assert [s[2] for s in spans] == [("de_cmd",), ("de_cmd",)]
    assert np.allclose([s[:2] for s in spans], [(5.0, 7.0), (20.0, 23.5)], atol=0.1)
    parts = cut(found)
    assert list(parts) == ["01_de", "02_de"]
    for m, record in parts.values():
        assert record.t_s[0] == 0.0
        assert m.start_s - m.cut_s[0] == pytest.approx(2.0, abs=0.021)  # a sample


@pytest.mark.parametrize("name", KINDS)
def test_what_a_file_cut_short_still_holds(tmp_path, short, name):
    data = short[name]
    found = import_log(put(tmp_path, name, data[: int(0.7 * len(data)) + 5]))
    assert any("cut short" in text and "saved: " in text for text in found.log.warnings)
    assert 5.0 < found.record.duration_s < 9.0
    assert found.record["p"][100] == pytest.approx(0.01 * found.record.t_s[100], abs=1e-4)


@pytest.mark.parametrize("name", KINDS)
def test_damage_in_the_middle_costs_what_was_hit(tmp_path, short, name):
    data = bytearray(short[name])
    middle = len(data) // 2
    data[middle : middle + 400] = bytes(i * 37 % 251 for i in range(400))
    found = import_log(put(tmp_path, name, bytes(data)))
    assert found.log.warnings
    assert found.record.duration_s == pytest.approx(9.98, abs=0.05)
    taken = found.record.valid[:, found.record.channels.index("p")]
    assert 0.8 < taken.mean() <= 1.0
    assert np.max(np.abs(found.record["p"] - 0.01 * found.record.t_s)[taken]) < 1e-4


@pytest.mark.parametrize("name", KINDS)
def test_random_damage_gives_an_error_or_what_could_be_saved(tmp_path, short, name):
    rng = np.random.default_rng(7)
    ends = {"saved": 0, "refused": 0}
    for i in range(12):
        data = bytearray(short[name][: len(short[name]) // 4])
        start = 0 if i < 4 else len(data) // 3
        for place in rng.integers(start, start + len(data) // 3, 30):
            data[place] = rng.integers(0, 256)
        try:
            log, rules = read_log(put(tmp_path, name, bytes(data)))
        except RecordError as error:
            ends["refused"] += name in str(error)
        else:
            assert log.warnings
            assert all(np.isfinite(c.values).all() for c in find_channels(log, rules).channels)
            ends["saved"] += 1
    assert sum(ends.values()) == 12  # a refusal names the file
    assert ends["saved"] >= 6  # with the definitions whole, something can always be saved


@pytest.mark.parametrize("name", KINDS)
def test_nothing_to_save_is_said_in_one_line(tmp_path, short, name):
    for size in (3, 300):
        path = put(tmp_path, name, short[name][:size] if name != "flight.ulg" or size > 3 else b"ULo")
        with pytest.raises(RecordError, match=r"flight\.") as error:
            import_log(path)
        assert "\n" not in str(error.value)
    with pytest.raises(RecordError, match="is empty"):
        import_log(put(tmp_path, name, b""))
    with pytest.raises(RecordError, match="a file that exists"):
        import_log(tmp_path / ("no_" + name))


def test_lost_samples_are_marked_and_never_bridged(tmp_path):
    found = import_log(put(tmp_path, "f.ulg", ulog(20.0, gap=(12.0, 13.0))))
    record = found.record
    lost = (record.t_s > 12.0) & (record.t_s < 12.99)
    for i, name in enumerate(record.channels):
        assert not record.valid[lost, i].any(), name
    assert np.ptp(record["psi"][lost]) == 0.0  # held, not interpolated
    assert [c.gaps for c in found.channels if c.name == "theta"] == [[pytest.approx((START_S + 11.99, START_S + 13.0))]]


def test_a_reboot_of_the_clock_and_one_wrong_time(tmp_path, short):
    data = bytearray(short["flight.bin"])
    at = data.find(b"\xa3\x95\x82", len(data) // 2) + 3  # the time of an IMU message
    data[at + 6] = 0x55  # years ahead
    found = import_log(put(tmp_path, "f.bin", bytes(data)))
    assert found.record.duration_s < 10.0
    assert any("left out, because their times run backwards" in text for text in found.log.warnings)


def test_servo_settings_of_the_log_are_used_and_absent_ones_are_said(tmp_path, short):
    found = import_log(put(tmp_path, "f.bin", short["flight.bin"]))
    by_name = {c.name: c for c in found.channels}
    assert by_name["de_cmd"].said == "elevator: servo 2, 1100 to 1900 us, centre 1500 us, reversed, times -1"
    assert "no setting states this" not in by_name["de_cmd"].assumed
    assert "no setting states this" in by_name["da_cmd"].assumed
    assert found.record["thr_cmd"][10] == pytest.approx(0.3, abs=1e-6)
    assert found.log.unread == {"POWR": 100}
    assert found.record["p"].max() < 0.2  # the second inertial unit, which reads 9, is not mixed in


def test_a_log_written_by_pyulog_is_the_same_log(tmp_path, short):
    ULog = pytest.importorskip("pyulog").ULog
    first = put(tmp_path, "flight.ulg", short["flight.ulg"])
    second = tmp_path / "again.ulg"
    ULog(str(first)).write_ulog(str(second))
    a, b = import_log(first), import_log(second)
    assert b.log.warnings == ()
    assert a.record.channels == b.record.channels
    np.testing.assert_array_equal(a.record.data, b.record.data)


DEFINITIONS = """<?xml version="1.0"?>
<configuration time_of_day="1714564800.0" data_file="f.data">
 <conf><aircraft name="Glider" ac_id="7"/></conf>
 <airframe><commands><axis name="THROTTLE"/><axis name="ROLL"/><axis name="PITCH"/></commands></airframe>
 <protocol><msg_class name="datalink"><message name="ATTITUDE"><field name="x" type="float"/></message></msg_class>
 <msg_class name="telemetry">
  <message name="ATTITUDE" id="6"><field name="phi" type="float" unit="rad"/><field name="psi" type="float" unit="rad"/>
   <field name="theta" type="float" unit="rad"/></message>
  <message name="IMU_GYRO_SCALED" id="131"><field name="gp" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
   <field name="gq" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
   <field name="gr" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/></message>
  <message name="COMMANDS" id="102"><field name="values" type="int16[]"/></message>
  <message name="ALIVE" id="2"><field name="md5sum" type="uint8[]"/></message>
 </msg_class></protocol>
</configuration>
"""


def lines():
    out = []
    for i, t in enumerate(T):
        out.append(f"{t:.4f} 7 IMU_GYRO_SCALED 0 {round(Q[i] / 0.0139882)} 0")
        out.append(f"{t:.4f} 7 COMMANDS 4800,960,{round(-9600 * DE[i] / 25.0)}")
        if i % 2 == 0:
            out.append(f"{t:.4f} 7 ATTITUDE 0.01 1.5 {0.1 + 0.02 * np.cos(t):.6f}")
        if i % 50 == 0:
            out += [f"{t:.4f} 7 ALIVE 12,34,56", f"{t:.4f} 9 ATTITUDE 3.0 3.0 3.0"]
    return out


def write(folder, rows=None, definitions=DEFINITIONS):
    (folder / "f.data").write_text("\n".join([*(rows or lines()), ""]))
    if definitions:
        (folder / "f.log").write_text(definitions)
    return folder / "f.data"


def test_channels_in_their_units_and_signs(tmp_path):
    found = import_log(write(tmp_path))
    record = found.record
    np.testing.assert_allclose(record["q"], DEG_RAD * Q, atol=0.5 * 0.014 * DEG_RAD)  # half a step of the integers
    np.testing.assert_allclose(record["de_cmd"], DEG_RAD * DE, atol=1e-12)  # 25 deg assumed; nose up is elevator up
    np.testing.assert_allclose(record["da_cmd"], 0.1 * 25.0 * DEG_RAD, rtol=1e-12)
    np.testing.assert_allclose(record["thr_cmd"], 0.5, rtol=1e-12)
    taken = record.valid[:, record.channels.index("theta")]
    np.testing.assert_allclose(record["theta"][taken], (0.1 + 0.02 * np.cos(T))[taken], atol=1e-5)
    assert [m.controls for m in found.search.manoeuvres] == [("de_cmd",)]
    assert found.log.facts == {"commands": "throttle roll pitch", "aircraft": "Glider"}
    assert found.log.unread == {"ALIVE": 16}
    assert any("16 messages of other aircraft than number 7" in text for text in found.log.warnings)


def test_damaged_messages_are_left_out_and_said(tmp_path):
    rows = lines()
    rows[300], rows[400] = "6.0 7 IMU_GYRO_SCALED 1", "\ufffd\ufffd"
    found = import_log(write(tmp_path, rows))
    assert any("IMU_GYRO_SCALED: 1 messages are damaged" in text for text in found.log.warnings)


def test_of_all_aircraft_of_a_ground_station_the_one_that_flew_counts(tmp_path):
    """As older versions write them: every aircraft with its airframe, and attributes in capitals."""
    own = '<aircraft NAME="Flown" AC_ID="7"><airframe><firmware NAME="fixedwing"/><commands><axis NAME="THROTTLE"/>'
    own += '<axis NAME="ROLL"/><axis NAME="PITCH"/></commands></airframe></aircraft>'
    other = (
        own.replace("Flown", "Quad").replace('"7"', '"3"').replace("fixedwing", "rotorcraft").replace("THROTTLE", "YAW")
    )
    gps = '<message NAME="GPS" ID="8"><field NAME="alt" UNIT="mm" ALT_UNIT="m"/>'
    gps += '<field NAME="speed" UNIT="cm/s"/></message>'
    definitions = DEFINITIONS.replace('<aircraft name="Glider" ac_id="7"/>', other + own)
    definitions = definitions.replace('<message name="ALIVE"', gps + '<message name="ALIVE"')
    definitions = definitions[: definitions.index(" <airframe>")] + definitions[definitions.index(" <protocol>") :]
    rows = [f"{t:.4f} 7 GPS 200000 1500" for t in T[::10]]
    found = import_log(write(tmp_path, sorted([*lines(), *rows], key=lambda row: float(row.split()[0])), definitions))
    assert found.log.facts == {"commands": "throttle roll pitch", "aircraft": "Flown"}
    assert found.log.vehicle == ""
    np.testing.assert_allclose(found.record["de_cmd"], DEG_RAD * DE, atol=1e-12)
    assert found.record["Vg"].max() == pytest.approx(15.0)
    assert found.asked == ()
    flown = definitions.replace('NAME="fixedwing"', 'NAME="rotorcraft"')
    assert import_log(write(tmp_path, lines(), flown)).log.vehicle == "rotorcraft"


@pytest.mark.parametrize(
    ("definitions", "law"),
    [("", r"is a log of Paparazzi, .* put 'f\.log' beside it"), ("<a", "must be a file of message definitions"),
     ("<configuration/>", "must define the messages of 'f.data', but it defines none")],
)  # fmt: skip
def test_without_definitions_the_message_says_what_to_put_beside(definitions, law, tmp_path):
    with pytest.raises(RecordError, match=law):
        import_log(write(tmp_path, definitions=definitions))


def test_the_definitions_alone_are_no_log(tmp_path):
    write(tmp_path)
    with pytest.raises(RecordError, match=r"message definitions of a Paparazzi log; give the \.data file"):
        import_log(tmp_path / "f.log")


def test_flight_plans_with_bare_ampersands_and_modes_are_read(tmp_path):
    """Paparazzi writes the conditions of its flight plans as they are: no log with one could be read."""
    plan = '<plan><circle until="10 > a && b"/></plan></configuration>'
    mode = '<message name="PPRZ_MODE" id="11"><field name="ap_mode" type="uint8"/></message><message name="ALIVE"'
    definitions = DEFINITIONS.replace("</configuration>", plan).replace('<message name="ALIVE"', mode)
    rows = [*lines(), "0.01 7 PPRZ_MODE 0", "5.0 7 PPRZ_MODE 2"]
    found = import_log(write(tmp_path, sorted(rows, key=lambda row: float(row.split()[0])), definitions))
    assert [m.said for m in found.log.modes] == ["MANUAL (manual)", "AUTO2 (automatic)"]
