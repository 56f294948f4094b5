"""An aircraft that is served to autopilots' simulators: it flies as everywhere else, and no step is lost.

The autopilots are stand-ins that follow the published protocols; no real one is run.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest
from changed_flights import changed_aircraft
from commands import ends
from questions.sitl.stand_ins import ArduPilot, Px4, free_port

import testbench as tb
from testbench.core.errors import RecordError
from testbench.flight.air import Air
from testbench.inputs import InputSignal
from testbench.questions.sitl.ask import Served, trim_for
from testbench.questions.sitl.links import quaternion, rotation, serve, state_line
from testbench.questions.sitl.outputs import Outputs, read_settings
from testbench.sensors.kinds.rate_gyro import RateGyro
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite

SUITE = SensorSuite(
    "mems", "An inertial unit", 60.0, (RateGyro("q", 0.02, bias=0.05), Sensor("V", 0.5), Sensor("h", 1.0))
)


@cache
def taurus():
    return tb.load_aircraft("taurus", "rigid")


@cache
def trimmed(suite=None):
    return trim_for(taurus(), suite=suite)


class Patience(float):
    """Seconds of silence that are never over, until it is said: a loaded machine may be silent for long."""

    over = False

    def __gt__(self, other):
        return not self.over


@contextmanager
def serving(served, autopilot="ardupilot", outputs=None, speed=1e9):
    """Serve in a thread within the block; give the port and what is said."""
    said, faults, patience = [], [], Patience()
    port = free_port(socket.SOCK_STREAM if autopilot == "px4" else socket.SOCK_DGRAM)
    outputs = outputs or Outputs(taurus(), autopilot, {}, {})

    def run():
        try:
            serve(served, outputs, autopilot, ("127.0.0.1", port), patience, said.append, speed)
        except BaseException as error:
            faults.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    while not said and not faults:
        time.sleep(0.005)
    try:
        yield port, said
    finally:
        patience.over = True
        thread.join(60.0)
        assert not faults, faults
    assert not thread.is_alive()


def pulses_of(commands):
    """Pulses that mean commands by the usual outputs: aileron 1, elevator 2, throttle 3, rudder 4."""
    full = {n: c.full for n, c in taurus().controls.items()}
    sign = {"da": 1.0, "de": -1.0, "dr": -1.0}
    out = []
    for name in ("da", "de", "thr", "dr"):
        part = commands.get(name, trimmed().controls.get(name, 0.0)) / full.get(name, 1.0)
        out.append(round(1000.0 + 1000.0 * part) if name == "thr" else round(1500.0 + 500.0 * sign[name] * part))
    return out


def flown_alone(rows, aircraft=None, at=None):
    """The product's own flight with the same commands (n, controls), absolute; truth at every frame."""
    aircraft, at = aircraft or taurus(), at or trimmed()
    names = tuple(at.controls)
    u = np.array([[row.get(n, at.controls[n]) - at.controls[n] for n in names] for row in rows])
    late = np.vstack([np.zeros(len(names)), u])  # a step begins with the frame after it, see SteppedFlight
    moved = InputSignal(np.arange(len(late)) / at.rate_hz, late, names)
    flown = tb.fly(aircraft, at, tb.Manoeuvre("same", moved, settle_s=0.0), at.rate_hz)
    return flown.between(0.0, (len(rows) + 0.5) / at.rate_hz)


@pytest.mark.parametrize("name", ["taurus, amended", "jsbsim:c172p"])
def test_any_aircraft_is_flown_as_everywhere_else(name):
    amended = name.endswith("amended")
    aircraft = changed_aircraft("taurus", {"Cm_q": 0.6, "Cm_alpha": 1.25}) if amended else tb.load_aircraft(name)
    served = Served(aircraft, at := trim_for(aircraft))
    rows = [{"de": at.controls["de"] + 0.01 * np.sin(0.05 * k)} for k in range(200)]
    flown = []
    for row in rows:
        served.step(row)
        flown.append([served.now[n] for n in ("q", "alpha", "V", "az")])
    alone = flown_alone(rows, aircraft, at)
    for k, channel in enumerate(("q", "alpha", "V", "az")):
        np.testing.assert_allclose(np.array(flown)[:, k], alone[channel][1:], rtol=0.0, atol=1e-9)
    served.end()
    assert served.tally.flights[0].truth.provenance["amendments"] == [a.name for a in aircraft.amendments]
    assert bool(aircraft.amendments) == amended


@pytest.mark.parametrize("steps", [1000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_steps_in_lockstep_fly_as_the_product_does_and_none_is_lost(steps):
    served, outputs = Served(taurus(), trimmed()), Outputs(taurus(), "ardupilot", {}, {})
    rng, states, commands = np.random.default_rng(0), [], []
    with serving(served, outputs=outputs) as (port, _):
        autopilot = ArduPilot(port)
        for k in range(steps):
            if k % 60 == 0:  # what a pilot does, about what holds the trim
                pulses = pulses_of(trimmed().controls)
                pulses[0] += int(rng.integers(-20, 21)) - round(100.0 * (states[-1]["attitude"][0] if states else 0.0))
                pulses[1] += int(rng.integers(-6, 7))
            commands.append(outputs.commands(pulses))
            states.append(autopilot.step(pulses))
        autopilot.close()
    tally = served.tally
    assert (tally.steps, tally.missed, tally.repeated, tally.late, tally.foreign) == (steps, 0, 0, 0, 0)
    alone = flown_alone(commands)
    for k, name in enumerate(("phi", "theta", "psi")):
        np.testing.assert_allclose([s["attitude"][k] for s in states], alone[name][1:], rtol=0.0, atol=1e-9)
    for k, name in enumerate("pqr"):
        np.testing.assert_allclose([s["imu"]["gyro"][k] for s in states], alone[name][1:], rtol=0.0, atol=1e-9)
    for k, name in enumerate(("ax", "ay", "az")):
        np.testing.assert_allclose([s["imu"]["accel_body"][k] for s in states], alone[name][1:], rtol=0.0, atol=1e-9)
    for k, name in enumerate(("north", "east")):
        np.testing.assert_allclose([s["position"][k] for s in states], alone[name][1:], rtol=0.0, atol=1e-9)
    down = [s["position"][2] for s in states]
    np.testing.assert_allclose(served.ground_m - np.array(down), alone["h"][1:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose([s["timestamp"] for s in states], alone.t_s[1:], rtol=0.0, atol=1e-9)
    assert np.ptp(alone["phi"]) > 0.02


def test_lost_packets_and_lost_answers_are_asked_for_again_and_no_frame_is_flown_twice():
    served, rng = Served(taurus(), trimmed()), np.random.default_rng(1)

    def arrives(frame, tried):
        return tried > 8 or rng.random() > 0.1

    with serving(served) as (port, _):
        autopilot = ArduPilot(port, 32, arrives, arrives, patience_s=0.02)
        states = [autopilot.step(pulses_of({})) for _ in range(300)]
        autopilot.close()
    assert served.tally.steps == 300
    assert served.tally.repeated > 5
    assert served.tally.missed == 0
    assert [s["timestamp"] for s in states] == pytest.approx(np.arange(1, 301) / served.rate_hz)


def test_packets_out_of_order_twice_missing_or_foreign_are_told_apart():
    served = Served(taurus(), trimmed())
    with serving(served) as (port, _):
        autopilot = ArduPilot(port)
        autopilot.step(pulses_of({}))
        for frame in (1, 1, 3, 2, 3):  # 2 was overtaken: it comes in time where both wait, else late
            autopilot.link.sendto(autopilot.packet(pulses_of({}), frame), autopilot.where)
        time.sleep(0.2)
        autopilot.link.sendto(autopilot.packet(pulses_of({}), 2), autopilot.where)
        for foreign in (b"", b"x", autopilot.packet(pulses_of({}), 4)[:-1], b"\x00" * 40):
            autopilot.link.sendto(foreign, autopilot.where)
        time.sleep(0.2)
        while autopilot.receive() is not None:
            pass
        autopilot.frame = 9
        state = autopilot.step(pulses_of({}))
        autopilot.close()
    tally = served.tally
    assert tally.steps + tally.missed == 10  # frames 0 to 9, each flown or counted as lost
    assert tally.missed in (5, 6)
    assert tally.late >= 1
    assert tally.repeated >= 2
    assert tally.foreign == 4
    assert state["timestamp"] == pytest.approx(tally.steps / served.rate_hz)


def test_an_autopilot_that_starts_anew_begins_another_flight_at_the_trim():
    served = Served(taurus(), trimmed(), ground_m=40.0)
    with serving(served) as (port, said):
        first = ArduPilot(port)
        before = [first.step([1500, 1540, 1500, 1500]) for _ in range(60)]
        first.close()
        second = ArduPilot(port)
        after = [second.step([1500, 1540, 1500, 1500]) for _ in range(60)]
        second.close()
    assert before == after
    assert before[0]["position"][2] == pytest.approx(40.0 - trimmed().condition.h_m, abs=0.01)
    served.end()
    assert [f.duration_s for f in served.tally.flights] == pytest.approx([0.25, 0.25])
    assert sum("begins at its trim" in text for text in said) == 2


def test_a_flight_that_leaves_its_limits_ends_and_waits_for_a_new_start():
    served = Served(taurus(), trimmed())
    with serving(served) as (port, said):
        first = ArduPilot(port)
        while not any("has ended at" in text for text in said):
            first.link.sendto(first.packet([1500, 2000, 2000, 1500], first.frame), first.where)
            first.frame += first.receive() is not None
        first.close()
        second = ArduPilot(port)
        assert second.step(pulses_of({}))["timestamp"] == pytest.approx(1.0 / served.rate_hz)
        second.close()
    served.end()
    assert served.tally.flights[0].truth.outcome == "aborted"
    assert "must hold" in served.tally.flights[0].reason
    assert sum("has ended at" in text for text in said) == 1


def test_the_trim_is_flown_until_commands_act():
    served = Served(taurus(), trimmed(), release_s=0.5)
    for _ in range(round(0.5 * served.rate_hz)):
        served.step({"de": -0.1})
        assert served.now["de_cmd"] == pytest.approx(trimmed().controls["de"], rel=1e-6)
    served.step({"de": -0.1})
    served.step({"de": -0.1})
    assert served.now["de_cmd"] == pytest.approx(-0.1)


def test_what_the_sensors_tell_is_sent_and_is_what_the_suite_makes_of_the_truth():
    at = trimmed(SUITE)
    served = Served(taurus(), at, SUITE, seed=5)
    lines = []
    for _ in range(480):
        served.step({"de": at.controls["de"] - 0.01})
        lines.append(json.loads(state_line(served)))
    served.end()
    (flight,) = served.tally.flights
    assert flight.measured is not None
    assert flight.truth.dt_s == pytest.approx(3.0 / at.rate_hz)  # 80 Hz of 240
    told = np.array([line["imu"]["gyro"][1] for line in lines])
    held = np.repeat(flight.measured["q"], 4)[1:481]
    np.testing.assert_array_equal(told, held)
    whole = flown_alone([{"de": at.controls["de"] - 0.01}] * 480, at=at)
    again = SUITE.measure(whole, 5)
    np.testing.assert_allclose(flight.measured.data, again.data[: len(flight.measured)], atol=1e-9)
    assert np.std(told - whole["q"][1:481]) > 0.01
    qbar = [0.5 * 1.225 * line["airspeed"] ** 2 for line in lines]
    assert np.std(qbar) > 1.0  # of the airspeed's noise


@pytest.mark.parametrize("frames", [1000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_px4_flies_in_lockstep_as_the_product_does(frames):
    mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
    served, outputs = Served(taurus(), trimmed()), Outputs(taurus(), "px4", {}, {})
    commands, sensors, others = [{}], [], {}
    with serving(served, "px4", outputs=outputs) as (port, _):
        px4 = Px4(port, mavlink)
        full = {n: c.full for n, c in taurus().controls.items()}
        base = {n: trimmed().controls[n] / full[n] for n in trimmed().controls}
        for k in range(frames):
            sensor, before = px4.until_sensor()
            sensors.append(sensor)
            for message in before:
                others.setdefault(message.get_type(), []).append(message)
            wiggle = 0.01 * np.sin(0.01 * k)
            roll, pitch = base.get("da", 0.0) + wiggle, -base["de"] + wiggle
            controls = [0.0] * 16
            controls[5], controls[6], controls[7] = -roll, roll, pitch
            controls[2], controls[4] = -base.get("dr", 0.0), base["thr"]
            controls = np.float32(controls).tolist()
            armed = (
                k >= 100
            )  # until it is, the trim is flown: frames that went out before the first answer do not differ
            commands.append(outputs.commands(controls) if armed else {})
            px4.answer(controls, sensor.time_usec, armed)
        px4.close()
    assert served.tally.unanswered == 0
    assert served.tally.foreign == 0
    assert served.tally.steps in (frames, frames + 1)
    alone = flown_alone(commands[:frames])
    times = np.array([m.time_usec for m in sensors])
    np.testing.assert_array_equal(times, np.rint(1e6 * np.arange(1, frames + 1) / served.rate_hz))
    for field, name in (("ygyro", "q"), ("xgyro", "p"), ("zacc", "az"), ("pressure_alt", "h")):
        flown = np.float32(alone[name][1:])
        np.testing.assert_allclose([getattr(m, field) for m in sensors], flown, rtol=1e-6, atol=1e-9)
    assert np.ptp(alone["q"]) > 0.01
    seconds = frames / served.rate_hz
    assert len(others["HIL_GPS"]) == pytest.approx(5.0 * seconds, abs=1)
    assert len(others["HIL_STATE_QUATERNION"]) == pytest.approx(200.0 * seconds, abs=2)
    fix = others["HIL_GPS"][-1]
    assert (fix.fix_type, fix.alt) == (3, pytest.approx(1e3 * alone["h"][-1], abs=100.0))
    assert fix.vn == pytest.approx(1e2 * alone["v_north"][-1], abs=5)
    pitot = [m for m in sensors if m.fields_updated & 0x400]
    assert len(pitot) == pytest.approx(50.0 * seconds, abs=1)
    assert 1e2 * pitot[0].diff_pressure == pytest.approx(trimmed().state["qbar"], rel=1e-3)
    assert all(m.fields_updated & 0x3F == 0x3F for m in sensors)


def test_px4_that_starts_up_disarms_repeats_and_comes_back():
    mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
    served = Served(taurus(), trimmed())
    with serving(served, "px4", speed=1.0) as (port, said):
        first, begun = Px4(port, mavlink), time.monotonic()
        while first.until_sensor()[0].time_usec < 200_000:  # no outputs yet: time goes on by the clock
            pass
        assert time.monotonic() - begun > 0.15
        sensor, _ = first.until_sensor()
        first.answer([1.0] * 16, sensor.time_usec - 5_000, armed=False)  # of a frame before: it still waits
        while first.heard or sensor.time_usec < 300_000:
            sensor, _ = first.until_sensor()
            first.answer([1.0] * 16, sensor.time_usec, armed=False)
        assert served.now["de_cmd"] == pytest.approx(trimmed().controls["de"], rel=1e-6)  # not armed: the trim is flown
        first.connection.sendall(b"no message of MAVLink")
        first.close()
        second = Px4(port, mavlink)
        assert second.until_sensor()[0].time_usec < 50_000  # anew
        second.close()
    served.end()
    assert len(served.tally.flights) == 2
    assert any("PX4 has gone" in text for text in said)


def test_pulses_become_commands_by_the_settings_of_the_autopilot(tmp_path):
    usual = Outputs(taurus(), "ardupilot", {}, {})
    de = taurus().controls["de"].full
    at = usual.commands([1500, 2000, 1750, 1500])
    assert at["de"] == pytest.approx(-de)  # a long pulse is nose up, which is a negative deflection
    assert at["thr"] == pytest.approx(0.75)
    assert "thr" not in usual.commands([1500, 1500, 0, 1500])  # no pulse: the output is off
    file = tmp_path / "mine.parm"
    file.write_text(
        "# comment\nSERVO1_FUNCTION 77\nSERVO2_FUNCTION,78\nSERVO3_FUNCTION\t70\n1 1 SERVO2_REVERSED 1 6\n"
        "SERVO1_MIN 1100\nSERVO1_TRIM 1480\nSERVO1_MAX 1900\n"
    )
    elevons = Outputs(taurus(), "ardupilot", read_settings(file), {"de": 0.2})
    both = elevons.commands([1900, 1000, 1500])
    assert both["de"] == pytest.approx(-0.2)
    assert "elevons" in elevons.said["de"]
    turned = Outputs(taurus(), "ardupilot", {}, {"de": -0.2})
    assert turned.commands([1500, 1750, 1000, 1500])["de"] == pytest.approx(0.1)
    assert turned.commands([1500, 2200, 1000, 1500])["de"] == pytest.approx(de)  # the surface ends there
    px4 = Outputs(
        taurus(), "px4", {"CA_SV_CS_COUNT": 1, "CA_SV_CS0_TYPE": 3, "PWM_MAIN_FUNC2": 201, "PWM_MAIN_REV": 2}, {}
    )
    assert px4.commands([0.0, 0.5])["de"] == pytest.approx(0.5 * de)
    assert "thr" not in px4.said
    file.write_text("nothing\n")
    with pytest.raises(RecordError, match="must hold lines"):
        read_settings(file)
    with pytest.raises(RecordError, match="must drive one of"):
        Outputs(taurus(), "px4", {"PWM_MAIN_FUNC2": 201}, {})


def test_attitudes_are_those_of_the_channel_table():
    phi, theta, psi = 0.3, -0.2, 2.0
    w, x, y, z = quaternion(phi, theta, psi)
    assert np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(phi)
    assert np.arcsin(2 * (w * y - z * x)) == pytest.approx(theta)
    assert np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(psi)
    assert rotation(0.0, 0.0, np.pi / 2) @ [0.0, 1.0, 0.0] == pytest.approx([1.0, 0.0, 0.0])


def test_wind_and_speed_are_those_that_were_asked_for():
    at = trim_for(taurus(), 14.0, 200.0, (3.0, -2.0, 0.0), rate_hz=480.0)
    served = Served(taurus(), at)
    served.step({})
    line = json.loads(state_line(served))
    assert line["velocity_wind"] == pytest.approx([3.0, -2.0, 0.0])
    assert served.now["V"] == pytest.approx(14.0, abs=1e-3)
    assert line["velocity"][0] == pytest.approx(14.0 + 3.0, abs=0.1)
    assert line["timestamp"] == pytest.approx(1.0 / 480.0)
    assert served.ground_m == 100.0
    assert Air(3.0, -2.0).wind_m_s[:2] == (3.0, -2.0)


def test_a_port_in_use_and_a_silent_port_are_one_clear_error(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    for autopilot, kind in (("ardupilot", socket.SOCK_DGRAM), ("px4", socket.SOCK_STREAM)):
        with socket.socket(socket.AF_INET, kind) as held:
            held.bind(("127.0.0.1", 0))
            if kind == socket.SOCK_STREAM:
                held.listen()
            port = held.getsockname()[1]
            status, said = ends(monkeypatch, capsys, "sitl", "taurus", "--to", autopilot, "--port", port)
        assert status == 2
        assert len(said) == 1
        assert f"port {port} of 127.0.0.1 must be free" in said[0]
    status, said = ends(monkeypatch, capsys, "sitl", "taurus", "--idle", "0.3", "--port", free_port())
    assert (status, len(said)) == (2, 1)
    assert "but none did" in said[0]
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    "words",
    [["--wind", "3"], ["--wind", "a,b"], ["--throw", "de=0"], ["--sensors", "no_such"], ["--parameters", "no.parm"]],
)
def test_bad_options_are_refused_in_one_line(monkeypatch, capsys, tmp_path, words):
    monkeypatch.chdir(tmp_path)
    status, said = ends(monkeypatch, capsys, "sitl", "taurus", "--idle", "0.1", *words)
    assert status == 2
    assert len(said) <= 3


def test_ctrl_c_before_an_autopilot_comes_is_an_interruption(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("testbench.questions.sitl.links.serve", raised_by_hand)
    status, said = ends(monkeypatch, capsys, "sitl", "taurus", "--port", free_port())
    assert status == 130
    assert "none did" not in said[-1]
    assert not (tmp_path / "results").exists()


def raised_by_hand(*_):
    raise KeyboardInterrupt


def test_ctrl_c_ends_the_command_with_its_records(tmp_path):
    port = free_port()
    words = ["sitl", "taurus", "--port", str(port), "--release", "0", "--sensors", "taurus_8hz", "-o", "out"]
    process = subprocess.Popen(
        [sys.executable, "-m", "testbench", *words], cwd=tmp_path, env=os.environ, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    autopilot = ArduPilot(port, patience_s=0.2)
    for _ in range(480):
        autopilot.step(pulses_of({}))
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    autopilot.close()
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert "no real autopilot was run" in err
    assert "480 steps" in out
    place = tmp_path / "out" / "sitl_taurus"
    truth = tb.load_record(place / "records" / "flight_1.nc")
    assert truth.kind == "truth"
    assert truth.t_s[-1] == pytest.approx(2.0, abs=0.02)
    assert tb.load_record(place / "records" / "flight_1_taurus_8hz.nc").channels[:2] == ("theta", "q")
    assert (place / "report.html").is_file()
