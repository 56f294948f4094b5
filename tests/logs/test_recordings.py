"""Telemetry of MAVLink and recordings of ROS, as the formats' own libraries write them, are read as they were flown."""

from functools import cache

import numpy as np
import pytest
from recordings import write_bag, write_px4_tlog, write_tlog
from writers import quaternion

from testbench.core.constants import G0_M_S2
from testbench.core.errors import MissingPackage, RecordError
from testbench.logs.sidpac import Told
from testbench.questions.importing.ask import import_log, read_log

MOTION = ("p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
THROW = np.radians(25.0)


@cache
def flown():
    """A flight of 40 s at 50 Hz: all axes move, each at its own frequency; a doublet on the elevator."""
    t = np.arange(0.0, 40.0, 0.02)
    phi, theta, psi = 0.3 * np.sin(0.7 * t), 0.1 + 0.05 * np.sin(1.3 * t), 2.0 + 0.02 * t
    f = {"t": t, "phi": phi, "theta": theta, "psi": psi, "alpha": theta - 0.02}
    f["p"], f["q"], f["r"] = 0.21 * np.cos(0.7 * t), 0.065 * np.cos(1.3 * t), 0.02 * np.cos(phi)
    f["ax"], f["ay"], f["az"] = 0.5 * np.sin(t), 0.4 * np.cos(1.1 * t), -G0_M_S2 - 0.8 * np.sin(1.3 * t)
    f["V"], f["Vg"] = 18.0 + 0.5 * np.sin(0.3 * t), 20.0 + 0.0 * t
    f["h"], f["hdot"] = 120.0 + 2.0 * np.sin(0.2 * t), 0.4 * np.cos(0.2 * t)
    pulse = ((t >= 10.0) & (t < 11.0)) * 1.0 - ((t >= 11.0) & (t < 12.0))
    return f, {"de": 0.2 * pulse, "da": 0.1 * np.sin(2.0 * t), "dr": 0.05 * np.cos(3.0 * t)}


def assert_as_flown(found, names, room=0.003):
    f, _ = flown()
    for name in names:
        c = next(c for c in found.channels if c.name == name)
        off = c.values - np.interp(c.t_s - c.t_s[0], f["t"], f[name])
        off -= np.mean(off) if name == "psi" else 0.0
        assert np.max(np.abs(off)) < room * (10.0 if name[0] == "a" else 1.0), name


def test_telemetry_is_read_on_the_clock_of_the_vehicle(tmp_path):
    f, parts = flown()
    found = import_log(write_tlog(tmp_path / "flight.tlog", f, parts))
    assert found.log.kind == "telemetry of MAVLink"
    assert found.log.vehicle == "fixed wing"
    assert found.log.facts["software"] == "ArduPlane V4.5.7"
    assert {s.mode for s in found.stretches} == {"FBWA (stabilised)"}
    assert_as_flown(found, MOTION)
    for c in found.channels:  # the radio takes 0.15 to 0.25 s, and more for some than for others
        if c.name in (*MOTION, "de_cmd"):
            assert np.allclose(np.diff(c.t_s), 0.02, atol=2e-3), c.name
    sources = {c.name: c.source for c in found.channels}
    assert sources["V"] == "VFR_HUD.airspeed"
    assert sources["de_cmd"] == "SERVO_OUTPUT_RAW.servo2_raw"
    for c in found.channels:
        if c.name in ("de_cmd", "da_cmd", "dr_cmd"):  # as far as a pulse is a whole microsecond
            asked = THROW * np.interp(c.t_s - c.t_s[0], f["t"], parts[c.name[:2]])
            assert np.max(np.abs(c.values - asked)[100:-100]) < 0.003, c.name


def test_telemetry_of_px4_has_its_modes_landings_and_commands(tmp_path):
    f, parts = flown()
    found = import_log(write_px4_tlog(tmp_path / "px4.tlog", f, parts))
    assert found.log.vehicle == "fixed wing"
    assert [m.said for m in found.log.modes] == ["MANUAL (manual)", "OFFBOARD (automatic)"]
    assert not found.stretches[0].flown
    assert found.stretches[0].end_s == pytest.approx(5.0, abs=0.6)
    assert_as_flown(found, ("p", "q", "r", "phi", "theta"))
    by_name = {c.name: c for c in found.channels}
    for name in ("de", "da", "dr"):
        c = by_name[f"{name}_cmd"]
        np.testing.assert_allclose(c.values, THROW * np.interp(c.t_s - c.t_s[0], f["t"], parts[name]), atol=2e-3)
    assert by_name["thr_cmd"].source == "ACTUATOR_CONTROL_TARGET.controls[3]"


def test_telemetry_with_a_torn_part_says_so_and_keeps_the_rest(tmp_path):
    f, parts = flown()
    path = write_tlog(tmp_path / "flight.tlog", f, parts)
    whole = bytearray(path.read_bytes())
    whole[100_000:101_000] = bytes(1000)
    path.write_bytes(whole)
    log, _ = read_log(path)
    assert any("bytes belong to no whole message" in text for text in log.warnings)
    assert log.topics["ATTITUDE"].t_s.size > 1970
    path.write_bytes(bytes(whole[:60]))
    with pytest.raises(RecordError, match="heartbeat of a vehicle"):
        read_log(path)


@pytest.mark.parametrize("name", ["flight.bag", "flight.mcap", "flight.db3"])
def test_a_recording_of_ros_is_read_by_its_topics(tmp_path, name):
    f, _ = flown()
    path = write_bag(tmp_path / name, f)
    found = import_log(path)
    assert found.log.kind == "a recording of ROS (2 topics read)"
    assert_as_flown(found, MOTION)
    by_name = {c.name: c for c in found.channels}
    assert by_name["V"].source.startswith("mavros-vfr_hud.")
    assert "states no unit" not in by_name["V"].assumed
    assert by_name["q"].rate_hz == pytest.approx(50.0)
    assert by_name["V"].rate_hz == pytest.approx(10.0)
    assert by_name["q"].said.endswith("axes forward, left, up")
    assert "/rosout_text" in {s.source for s in found.balance.unknown}
    if name != "flight.bag":  # ROS 2 records into a folder
        assert import_log(path.parent).record.channels == found.record.channels
    turned = next(c for c in import_log(path, told=Told("frd")).channels if c.name == "q")
    assert np.array_equal(turned.values, -by_name["q"].values)


def test_topics_of_px4_in_a_recording_have_the_rules_of_its_log(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store, kind = get_typestore(Stores.ROS2_HUMBLE), "px4_msgs/msg/VehicleAttitude"
    store.register(get_types_from_msg("uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q", kind))
    f, _ = flown()
    turned = quaternion(f["phi"], f["theta"], f["psi"]).astype(np.float32)
    with Writer(tmp_path / "of_px4", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/fmu/out/vehicle_attitude", kind, typestore=store)
        for t, q in zip(f["t"].tolist(), turned, strict=True):
            us = round(1e6 * t) + 7_000_000
            message = store.types[kind](us + 900, us, q)
            writer.write(topic, 1000 * us, store.serialize_cdr(message, kind))
    found = import_log(tmp_path / "of_px4")
    assert_as_flown(found, ("phi", "theta", "psi"))
    assert "q[0]" in found.channels[0].source


@pytest.mark.parametrize(("name", "keep"), [("flight.bag", 4000), ("flight.mcap", 3000), ("flight.db3", 5000)])
def test_a_recording_that_was_cut_short_is_refused_by_its_name(tmp_path, name, keep):
    path = write_bag(tmp_path / name, flown()[0])
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(RecordError, match=path.name):
        read_log(path)


def test_messages_without_their_library_name_the_extra(tmp_path, monkeypatch):
    f, parts = flown()
    logs = write_tlog(tmp_path / "flight.tlog", f, parts), write_bag(tmp_path / "flight.bag", f)
    for name in ("pymavlink.dialects.v20", "rosbags.highlevel"):
        monkeypatch.setitem(__import__("sys").modules, name, None)
    for path in logs:
        with pytest.raises(MissingPackage, match=r"pip install '.*\[logs\]'"):
            read_log(path)


def test_damaged_recordings_are_read_as_far_as_they_are_whole_or_refused(tmp_path):
    f, parts = ({name: x[:150] for name, x in each.items()} for each in flown())
    whole = [write_tlog(tmp_path / "a.tlog", f, parts), write_px4_tlog(tmp_path / "b.tlog", f, parts)]
    whole += [write_bag(tmp_path / name, f) for name in ("c.bag", "d.mcap", "e.db3")]
    rng, came, refused = np.random.default_rng(5), [], []
    for path in whole:
        content = np.frombuffer(path.read_bytes(), np.uint8)
        for k in range(8):
            torn = content.copy()
            at = rng.integers(0, torn.size if k % 2 else 400, int(rng.integers(1, 30)))
            torn[at] = rng.integers(0, 256, at.size)
            file = tmp_path / f"torn{path.suffix}"
            file.write_bytes(torn.tobytes())
            try:
                came.append(len(import_log(file).channels) > 0)
            except RecordError as error:
                refused.append((file.name, error.message))
    assert all(came)
    assert 10 < len(came) < 35
    assert all(name in message for name, message in refused)
