"""Attitude, rates and specific forces as vectors in the columns of a table: ROS, quaternions, axes."""

import numpy as np
import pytest
from test_tables_of_topics import PITCH, Q, T, table

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import ChannelError, RecordError
from testbench.logs.sidpac import Told
from testbench.questions.importing.ask import import_log, parse_units

BANK, HEADING = 0.1 * np.sin(T), 2.0 + 0.05 * T


def quaternion(bank, pitch, turned):
    """Return w, x, y, z of 3-2-1 Euler angles."""
    a, b, c = 0.5 * bank, 0.5 * pitch, 0.5 * turned
    return (
        np.cos(a) * np.cos(b) * np.cos(c) + np.sin(a) * np.sin(b) * np.sin(c),
        np.sin(a) * np.cos(b) * np.cos(c) - np.cos(a) * np.sin(b) * np.sin(c),
        np.cos(a) * np.sin(b) * np.cos(c) + np.sin(a) * np.cos(b) * np.sin(c),
        np.cos(a) * np.cos(b) * np.sin(c) - np.sin(a) * np.sin(b) * np.cos(c),
    )


def of_ros(prefix="field."):
    """Columns of a topic of sensor_msgs/Imu: forward, left, up; east, north, up."""
    w, x, y, z = quaternion(BANK, -PITCH, 0.5 * np.pi - HEADING)
    parts = {"orientation.x": x, "orientation.y": y, "orientation.z": z, "orientation.w": w,
             "angular_velocity.x": 0.1 * Q, "angular_velocity.y": -Q, "angular_velocity.z": -0.2 * Q,
             "linear_acceleration.x": 0.3 * Q, "linear_acceleration.y": 0.2 * Q,
             "linear_acceleration.z": 9.8 + 0.1 * Q}  # fmt: skip
    return {"%time": np.rint(1e9 * T), **{prefix + name: values for name, values in parts.items()}}


def is_the_flight(record):
    for name, values in (("phi", BANK), ("theta", PITCH), ("psi", HEADING), ("q", Q), ("r", 0.2 * Q), ("ay", -0.2 * Q)):
        np.testing.assert_allclose(record[name], values, atol=1e-6, err_msg=name)
    assert "w" not in record
    assert record["az"].max() < -9.0


@pytest.mark.parametrize("prefix", ["field.", "", "/imu/data/"])
def test_a_topic_of_ros_is_read_in_its_axes(prefix, tmp_path):
    found = import_log(table(tmp_path / "imu.csv", of_ros(prefix)))
    is_the_flight(found.record)
    assert any("forward, left, up: the specific force is 9.8" in note for note in found.log.notes)


def test_axes_forward_right_down_are_told_by_the_specific_force(tmp_path):
    w, x, y, z = quaternion(BANK, PITCH, HEADING)
    columns = {name: -values if name.endswith(("y", ".z")) else values for name, values in of_ros("").items()}
    columns |= {"orientation.w": w, "orientation.x": x, "orientation.y": y, "orientation.z": z}
    is_the_flight(import_log(table(tmp_path / "imu.csv", columns)).record)


@pytest.mark.parametrize(
    "names", [("q[0]", "q[1]", "q[2]", "q[3]"), ("qw", "qx", "qy", "qz"), ("q1", "q2", "q3", "q4")]
)
def test_a_quaternion_is_attitude_and_its_axes_are_asked(names, tmp_path):
    columns = {"time": T, **dict(zip(names, quaternion(BANK, PITCH, HEADING), strict=True))}
    path = table(tmp_path / "attitude.csv", columns)
    found = import_log(path)
    assert set(found.record.channels) == {"phi", "theta", "psi"}
    np.testing.assert_allclose(found.record["theta"], PITCH, atol=1e-6)
    assert "--axes flu" in " ".join(found.log.assumed)
    other = import_log(path, told=Told("flu"))
    np.testing.assert_allclose(other.record["theta"], -PITCH, atol=1e-6)
    assert not other.log.assumed


def test_four_columns_that_are_no_quaternion_keep_their_meaning(tmp_path):
    own = {"time": T, "air.x": Q, "air.y": Q, "air.z": Q, "air.w": 2.0 + Q}
    assert import_log(table(tmp_path / "own.csv", own)).record.channels == ("w",)


def test_what_is_told_must_fit_the_table(tmp_path):
    path = table(tmp_path / "plain.csv", {"time": T, "q": Q, "theta": PITCH})
    assert import_log(path, told=Told(units={"q": "deg/s"})).record["q"].max() == pytest.approx(np.deg2rad(Q.max()))
    turned = import_log(path, told=Told("flu")).record  # of vectors or not
    np.testing.assert_allclose(turned["q"], -import_log(path).record["q"])
    with pytest.raises(RecordError, match="axes must be one of frd, flu, got 'up'"):
        import_log(path, told=Told("up"))
    with pytest.raises(RecordError, match=r"--unit is for channels that .* got alpha"):
        import_log(path, told=Told(units={"alpha": "deg"}))
    with pytest.raises(ChannelError, match="measured in rad or deg, got unit 'm'"):
        parse_units(["alpha=m"])


def test_a_blackbox_counts_nose_down_and_one_g_in_counts(tmp_path):
    columns = {"loopIteration": np.arange(T.size), "time (us)": 1e6 * T, "gyroADC[0]": 0.1 * Q / DEG_RAD,
               "gyroADC[1]": -Q / DEG_RAD, "gyroADC[2]": -0.2 * Q / DEG_RAD, "accSmooth[0]": 50.0 * Q,
               "accSmooth[1]": -10.0 * Q, "accSmooth[2]": 512.0 + 0.0 * T, "attitude[0]": 10.0 * BANK / DEG_RAD,
               "attitude[1]": -10.0 * PITCH / DEG_RAD, "attitude[2]": 10.0 * HEADING / DEG_RAD}  # fmt: skip
    record = import_log(table(tmp_path / "LOG00001.01.csv", columns)).record
    for name, values in (("phi", BANK), ("theta", PITCH), ("psi", HEADING), ("q", Q), ("r", 0.2 * Q)):
        np.testing.assert_allclose(record[name], values, atol=1e-6, err_msg=name)
    np.testing.assert_allclose(record["az"], -G0_M_S2, rtol=1e-3)
