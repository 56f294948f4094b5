"""Tables that mavlogdump, Mission Planner and ulog2csv make of logs: read by the rules of the logs themselves."""

import numpy as np
import pytest
from scipy.io import savemat

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.questions.importing.ask import import_log

T = np.arange(0.0, 8.0, 0.02)
PITCH = 0.05 + 0.1 * np.sin(2.0 * T)  # rad
Q = 0.2 * np.cos(2.0 * T)
STAMP = np.rint(1e6 * (100.0 + T))


def table(path, columns):
    lines = [
        ",".join(columns),
        *(",".join(f"{x:.9g}" if x == x else "" for x in row) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


IMU = {"timestamp": 1.6e9 + T, "TimeUS": STAMP, "I": 0.0 * T,
       "GyrX": 0.01 * np.sin(T), "GyrY": Q, "GyrZ": 0.02 * np.sin(T),
       "AccX": 9.8 * np.sin(PITCH), "AccY": 0.1 * np.sin(T), "AccZ": -9.8 * np.cos(PITCH)}  # fmt: skip


def test_mavlogdump_s_message_is_ardupilot_s(tmp_path):
    record = import_log(table(tmp_path / "flight.csv", IMU)).record
    assert set(record.channels) == {"p", "q", "r", "ax", "ay", "az"}
    np.testing.assert_allclose(record["q"], Q, atol=1e-8)
    assert record["az"].max() < -9.0


def test_mavlogdump_s_messages_side_by_side_and_two_units(tmp_path):
    rows = np.repeat(np.arange(T.size), 3)
    part = np.tile(np.arange(3), T.size)
    columns = {"timestamp": 1.6e9 + T[rows]}
    for name, of, values in (
        ("IMU.TimeUS", (0, 1), STAMP), ("IMU.I", (0, 1), None), ("IMU.GyrY", (0, 1), Q),
        ("ATT.TimeUS", (2,), STAMP), ("ATT.Pitch", (2,), PITCH / DEG_RAD),
    ):  # fmt: skip
        held = part.astype(float) if values is None else values[rows] * (1.0 - 2.0 * (part == 1) * (name == "IMU.GyrY"))
        columns[name] = np.where(np.isin(part, of), held, np.nan)
    found = import_log(table(tmp_path / "flight.csv", columns))
    np.testing.assert_allclose(found.record["q"], Q, atol=1e-8)  # of the first unit
    np.testing.assert_allclose(found.record["theta"], PITCH, atol=1e-8)
    assert any("IMU#1" in text for text in found.balance.sensors)


def test_mission_planner_s_matrices_are_ardupilot_s_with_settings(tmp_path):
    imu = np.column_stack([np.arange(T.size), STAMP, Q])
    out = np.column_stack([np.arange(T.size), STAMP, 1500.0 + 100.0 * (T > 3.0)])
    settings = np.array([["SERVO2_FUNCTION", 19.0], ["SERVO2_MIN", 1000.0]], dtype=object)
    held = {"IMU_0": imu, "IMU_label": np.array(["LineNo", "TimeUS", "GyrY"], dtype=object), "RCOU": out,
            "RCOU_label": np.array(["LineNo", "TimeUS", "C2"], dtype=object), "PARM": settings}  # fmt: skip
    savemat(tmp_path / "flight.mat", held)
    found = import_log(tmp_path / "flight.mat", throw_rad={"de": 20.0 * DEG_RAD})
    np.testing.assert_allclose(found.record["q"], Q, atol=1e-8)
    assert found.record["de_cmd"].min() == pytest.approx(-4.0 * DEG_RAD)
    assert "elevator: servo 2" in next(c.said for c in found.channels if c.name == "de_cmd")


def test_ulog2csv_s_file_and_folder_are_px4_s(tmp_path):
    half = 0.5 * PITCH
    folder = tmp_path / "flight"
    folder.mkdir()
    zero = 0.0 * T
    table(folder / "log_1_vehicle_attitude_0.csv",
          {"timestamp": STAMP, "q[0]": np.cos(half), "q[1]": zero, "q[2]": np.sin(half), "q[3]": zero})  # fmt: skip
    rates = {"timestamp": STAMP + 300.0, "timestamp_sample": STAMP, "xyz[0]": 0.1 * Q, "xyz[1]": Q, "xyz[2]": 0.2 * Q}
    alone = import_log(table(folder / "log_1_vehicle_angular_velocity_0.csv", rates))
    assert "reads all" in " ".join(alone.log.notes)
    table(folder / "log_1_battery_status_0.csv", {"timestamp": STAMP, "voltage_v": 12.0 + zero})
    found = import_log(folder)
    assert "log_1_battery_status_0.csv" in found.log.unread
    np.testing.assert_allclose(found.record["theta"], PITCH, atol=1e-6)
    np.testing.assert_allclose(found.record["q"], Q, atol=1e-8)


def test_a_folder_without_topics_is_refused_with_what_it_must_hold(tmp_path):
    (tmp_path / "some.csv").write_text("a,b\n0,1\n1,2\n")
    with pytest.raises(RecordError, match=r"the topics of one log \(as CSV"):
        import_log(tmp_path)


def test_a_folder_of_topics_of_ros_is_one_log_with_a_clock_each(tmp_path):
    """As rostopic echo -p writes them: nanoseconds, axes forward, left, up; one topic says in its name what it is."""
    start, slow = 1.6e18, T[::5]
    stamp = [f"{start + 1e9 * t:.0f}" for t in T]
    imu = {"field.angular_velocity.x": 0.01 * T, "field.angular_velocity.y": -Q, "field.angular_velocity.z": 0.0 * T,
           "field.linear_acceleration.x": 0.0 * T, "field.linear_acceleration.y": 0.0 * T,
           "field.linear_acceleration.z": 9.81 + 0.0 * T}  # fmt: skip
    rows = [
        ",".join(["%time", *imu]),
        *(",".join(r) for r in zip(stamp, *(map("{:.6f}".format, x) for x in imu.values()), strict=True)),
    ]
    (tmp_path / "f-mavros-imu-data.csv").write_text("\n".join(rows))
    rows = [f"{start + 1e9 * t:.0f},9.0,{x / DEG_RAD:.6f}" for t, x in zip(slow, PITCH[::5], strict=True)]
    (tmp_path / "f-mavros-nav_info-pitch.csv").write_text("\n".join(["%time,field.commanded,field.measured", *rows]))
    (tmp_path / "f-notes.csv").write_text("a,b\n1,2\n")
    found = import_log(tmp_path)
    assert {"p", "q", "r", "az", "theta"} >= set(found.record.channels) >= {"q", "az", "theta"}
    np.testing.assert_allclose(found.record["q"], Q, atol=2e-6)
    taken = found.record.valid[:, found.record.channels.index("theta")]
    assert np.count_nonzero(taken) == slow.size
    np.testing.assert_allclose(found.record["theta"][taken], PITCH[::5], atol=2e-6)
    assert "theta is taken in deg" in " ".join(found.log.notes)
    assert "f-notes.csv" in found.log.reasons


def test_tables_of_a_folder_that_share_no_time_are_refused(tmp_path):
    table(tmp_path / "a.csv", {"t": T, "q": Q})
    table(tmp_path / "b.csv", {"t": T + 100.0, "theta": PITCH})
    with pytest.raises(RecordError, match=r"must share a time, but 'b\.csv' begins after others have"):
        import_log(tmp_path)


def test_a_table_of_one_s_own_with_ardupilot_s_clock_keeps_its_controls(tmp_path):
    own = {"TimeUS": STAMP, "GyrY": Q, "q": Q, "de": 0.1 * (T > 3.0)}
    assert set(import_log(table(tmp_path / "own.csv", own)).record.channels) == {"q", "de"}
