"""A flight that is followed: what is told of it is right, what is wrong is called, and nothing is sent."""

import io
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from dataclasses import replace
from functools import cache
from http.client import HTTPConnection
from types import SimpleNamespace
from unittest.mock import Mock
from urllib.parse import urlsplit

import numpy as np
import pytest
from commands import ends

import testbench as tb
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import linearise
from testbench.inputs import InputSignal
from testbench.questions.importing.ask import import_log
from testbench.questions.live.answer import called, link_lines
from testbench.questions.live.ask import Call, Session, Update, fly_along
from testbench.questions.live.clock import Clock, Rate
from testbench.questions.live.glance import glance, served
from testbench.questions.live.stream import Sample, Source, followed, mavlink, open_source
from testbench.questions.live.track import Estimate, Plane

KNOWN = {"CL_alpha": 0.1, "Cm_alpha": 0.1, "Cm_q": 0.1, "Cm_de": 0.1}
CHANNELS = ("V", "h", "alpha", "q", "theta", "az", "ax", "de", "p", "r", "phi")


@cache
def flown() -> FlightRecord:
    """The Taurus, a 3-2-1-1 of its elevator."""
    aircraft = tb.load_aircraft("taurus", "rigid")
    trimmed = tb.trim(aircraft, tb.FlightCondition(13.0, 100.0))
    t = np.arange(round(6.0 * aircraft.rate_hz)) / aircraft.rate_hz
    u = np.zeros(t.size)
    for begin, end, size in ((0.0, 0.9, 1.0), (0.9, 1.5, -1.0), (1.5, 1.8, 1.0), (1.8, 2.1, -1.0)):
        u[(t >= begin) & (t < end)] = size * np.radians(2.0)
    steps = InputSignal(t, u[:, None], ("de",))
    return tb.fly_and_measure(tb.Job(aircraft, trimmed, tb.Manoeuvre("3211", steps, 6.0), 120.0)).flown


def arriving(rate_hz=50.0, wrong=1.0, frozen="", seed=0):
    """Samples of the flight on clocks of their own, 1 % lost, late by some ms; a control that is recorded wrongly."""
    record, rng, out = flown(), np.random.default_rng(seed), []
    for name in CHANNELS:
        t = np.arange(rng.uniform(0.0, 1.0 / rate_hz), record.t_s[-1], 1.0 / rate_hz)
        t = t[rng.random(t.size) > 0.01]
        x = np.interp(t, record.t_s, record[name]) * (wrong if name == "de" else 1.0)
        x = x + (0.0 if name == "de" else 0.002) * rng.standard_normal(t.size)
        if name == frozen:
            x[t > 7.0] = x[t > 7.0][0]
        out += [(a + 0.01 * abs(rng.standard_normal()), a, name, b) for a, b in zip(t, x, strict=True)]
    for arrived, taken, name, value in sorted(out):
        yield Sample(float(taken), {name: float(value)}, float(arrived))


def follow(samples, draws=8):
    aircraft = replace(tb.load_aircraft("taurus", "rigid"), uncertainty=KNOWN)
    session = Session("flight", aircraft)
    for _ in fly_along(Source("flight", iter(samples)), aircraft, session=session, draws=draws):
        pass
    return session


def test_derivatives_in_flight_are_those_of_the_aircraft_and_nothing_is_called():
    session = follow(arriving())
    aircraft = tb.load_aircraft("taurus", "rigid")
    trimmed = tb.trim(aircraft, tb.FlightCondition(session.V_m_s, session.h_m))
    truth = {d.name: d.held for d in dimensional_derivatives(linearise(aircraft, trimmed), trimmed)}
    found = {e.name: e for e in session.latest("longitudinal") if e.wanted}
    assert {"M_alpha", "M_q", "M_de", "Z_alpha"} <= set(found)
    for name in ("M_alpha", "M_q", "M_de"):
        assert abs(found[name].value - truth[name]) < 0.08 * abs(truth[name]), name
        assert abs(found[name].value - truth[name]) < 2.0 * found[name].half, name
    assert not [called(c) for c in session.calls if c.kind in ("stop", "instrument")]
    early = next(u for u in session.updates if u.estimates.get("longitudinal"))
    assert next(e for e in early.estimates["longitudinal"] if e.name == "M_q").half > 2.0 * found["M_q"].half


@pytest.mark.parametrize(("wrong", "said"), [(-1.0, -1.0), (2.0, 0.5)])
def test_a_control_that_does_something_else_is_called_within_three_seconds(wrong, said):
    stops = [c for c in follow(arriving(wrong=wrong)).calls if c.kind == "stop" and c.words == "gain"]
    assert stops
    assert stops[0].t_s < 6.0 + 3.0
    assert stops[0].value == pytest.approx(said, abs=0.15)
    assert called(stops[0]).startswith("stop: de has ")


def test_an_instrument_that_stands_still_is_called():
    calls = [c for c in follow(arriving(frozen="V"), draws=0).calls if c.kind == "instrument" and c.words == "frozen"]
    assert [c.channel for c in calls] == ["V"]
    assert 8.0 < calls[0].t_s < 10.0


def test_a_link_that_is_too_slow_is_said_and_nothing_is_made_of_it():
    session = follow(arriving(rate_hz=2.0), draws=0)
    assert all(session.told.values())
    assert not session.latest("longitudinal")
    said = list(link_lines(session.rates, session.told, radio=True))
    assert any("cannot be told" in line for line in said)
    assert "SET_MESSAGE_INTERVAL 30 20000" in said[-1]


def test_a_short_stream_is_refused():
    with pytest.raises(RecordError, match="must give 3 s of samples"):
        follow(s for s in arriving() if s.t_s < 1.0)


def test_the_clock_takes_samples_late_twice_and_out_of_order():
    clock, rng = Clock(), np.random.default_rng(0)
    t = np.arange(0.0, 4.0, 0.02)
    for k in range(t.size):
        clock.add(Sample(float(t[k]), {"q": float(np.sin(3.0 * t[k]))}, float(t[k] + rng.uniform(0.0, 0.1))))
        clock.add(Sample(float(t[max(k - 2, 0)]), {"q": 99.0}, float(t[k])))
        if k == 100:
            clock.start(40.0)
    block = clock.block(("q",))
    assert block is not None
    assert block["q"] == pytest.approx(np.sin(3.0 * block.t_s), abs=1e-4)
    assert clock.rates()["q"] == Rate(pytest.approx(50.0), 0.0, pytest.approx(0.029, abs=0.01))


@pytest.mark.parametrize(("source_hz", "clock_hz"), [(50.0, 50.0), (25.0, 25.0), (200.0, 50.0)])
def test_noise_is_that_of_the_samples_as_they_came_whatever_the_clock_makes_of_them(source_hz, clock_hz):
    clock, rng = Clock(), np.random.default_rng(2)
    for k in range(int(20 * source_hz)):
        t = k / source_hz + 0.003
        clock.add(Sample(t, {"q": 0.2 * np.sin(t) + 0.01 * rng.standard_normal()}, t))
        if k == 100:
            clock.start(clock_hz)
    averaged = source_hz / clock_hz
    assert clock.noise("q", 5.0) == pytest.approx(0.01 / np.sqrt(averaged), rel=0.25)  # four deviations of 125 samples


def test_the_command_records_a_session_that_plays_again_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    record = flown().decimate(3)
    record = replace(record.select([n for n in CHANNELS if n in record]), kind="measured")
    record.save(tmp_path / "flight.nc")
    assert ends(monkeypatch, capsys, "live", "flight.nc", "--aircraft", "taurus", "-o", "out")[0] == 0
    said = (tmp_path / "out" / "live_flight" / "updates.jsonl").read_text()
    source = open_source("out/live_flight", {}, {}, None, False, 0.0)
    assert source.name == "flight_again"
    again = fly_along(source, tb.load_aircraft("taurus"))
    assert len(said.splitlines()) > 5
    assert '"careful", "channel": "longitudinal", "value": 0.0' in said
    assert "".join(u.line() for u in again) == said
    line = json.loads((tmp_path / "out" / "live_flight" / "stream.jsonl").read_text().splitlines()[0])
    assert set(line[2]) <= set(CHANNELS)


def test_who_no_longer_reads_what_is_called_loses_no_flight(tmp_path, monkeypatch, capsys):
    from testbench.questions.live import command

    monkeypatch.chdir(tmp_path)
    replace(flown().decimate(3).select(["V", "h", "alpha", "q", "az", "de"]), kind="measured").save("flight.nc")
    screen = SimpleNamespace(is_terminal=False, print=Mock(side_effect=BrokenPipeError))
    monkeypatch.setattr(command, "console", lambda: screen)
    assert ends(monkeypatch, capsys, "live", "flight.nc", "--aircraft", "taurus", "-o", "out") == (141, [])
    assert (tmp_path / "out" / "live_flight" / "report.html").is_file()
    samples = [x for x in (tmp_path / "out" / "live_flight" / "stream.jsonl").read_text().splitlines() if x[0] == "["]
    assert json.loads(samples[-1])[0] > flown().t_s[-1] - 0.1
    assert screen.print.call_count == 1


def test_a_flight_that_is_ended_by_hand_is_kept_and_plays_again(tmp_path):
    """In a process of its own, which alone can be interrupted; some four seconds."""
    replace(flown().decimate(3).select(["V", "h", "alpha", "q", "az", "de"]), kind="measured").save(tmp_path / "a.nc")
    words = ["live", "--replay", "a.nc", "--speed", "2", "--aircraft", "taurus", "-o", "out"]
    running = subprocess.Popen(
        [sys.executable, "-m", "testbench", *words],
        cwd=tmp_path,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    kept, until = tmp_path / "out" / "live_a" / "stream.jsonl", time.monotonic() + 60.0
    while time.monotonic() < until and not (kept.is_file() and len(kept.read_text().splitlines()) > 200):
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    said, errors = running.communicate(timeout=60.0)
    assert running.returncode == 0, errors
    assert not errors
    assert "Ended by hand." in said
    assert (tmp_path / "out" / "live_a" / "report.html").is_file()
    again = open_source(str(tmp_path / "out" / "live_a"), {}, {}, None, False, 0.0)
    times = [s.t_s for s in again.samples if isinstance(s, Sample)]
    assert 3.0 < times[-1] < flown().t_s[-1] - 1.0


def test_what_no_clock_or_instrument_can_give_is_dropped():
    clock = Clock()
    for k in range(100):
        clock.add(Sample(0.02 * k, {"q": 0.1}, 0.02 * k))
    clock.start(50.0)
    for wrong in (np.nan, np.inf, 1e308, -2000.0):
        clock.add(Sample(2.0, {"q": wrong}, 2.0))
        clock.add(Sample(wrong if wrong != -2000.0 else np.nan, {"q": 0.1}, 2.0))
    assert clock.rates()["q"].lost == 0.0
    assert clock.newest_s == 2.0
    clock.add(Sample(1e5, {"q": 0.2}, 1e5))
    leapt = clock.block(("q",))
    assert leapt is None or len(leapt) < 100
    for k in range(100):  # a clock that was set, or hours without a link: their samples are not made up
        clock.add(Sample(1e9 + 0.02 * k, {"q": 0.2}, 1e9))
    block = clock.block(("q",))
    assert block is not None
    assert len(block) < 200
    assert block["q"][-1] == pytest.approx(0.2)


def test_a_channel_that_the_link_drops_in_a_run_is_waited_for():
    plane = object.__new__(Plane)
    plane.sources, plane._trim, plane._done, plane.regression = {"de": "de"}, np.zeros(3), 0, Mock()
    plane._run, plane._valid = [np.zeros(3)] * 9, [np.array([True, False, True])] * 9
    plane._feed()
    assert plane._done == 0  # so that these samples come with the next ones, or end the run
    plane.regression.add.assert_not_called()


def test_a_file_that_grows_is_followed_to_its_end(tmp_path):
    rows = [f"{0.05 * k:.2f},{np.sin(k):.6f},0.1" for k in range(60)]
    file = tmp_path / "growing.csv"
    file.write_text("\n".join(["t [s],q [rad/s],alpha [rad]", *rows[:30], ""]))
    source, got = followed(file, {}, 0.5), []
    for sample in source:
        got.append(sample)
        if len(got) == 10:
            file.write_text("\n".join(["t [s],q [rad/s],alpha [rad]", *rows, ""]))
    assert len(got) == 60
    assert np.diff([s.t_s for s in got]).min() > 0.0


def test_mavlink_is_heard_and_not_answered():
    mavutil = pytest.importorskip("pymavlink.mavutil")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    samples = mavlink(f"udpin:127.0.0.1:{port}", {"de": 0.4}, {"de": 2}, 1.0)
    vehicle = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=7, dialect="ardupilotmega")

    def fly():
        time.sleep(0.2)
        for k in range(20):
            vehicle.mav.attitude_send(1000 + 20 * k, 0.1, 0.2, 0.3, 0.0, 0.01 * k, 0.0)
            vehicle.mav.servo_output_raw_send(1000, 0, 1500, 1750, 0, 0, 0, 0, 0, 0)
            vehicle.mav.vfr_hud_send(18.0, 18.0, 0, 50, 120.0, 0.0)

    flight = threading.Thread(target=fly)
    flight.start()
    got = list(samples)
    flight.join()
    q = [s for s in got if "q" in s.values]
    assert [s.t_s for s in q] == pytest.approx(1.0 + 0.02 * np.arange(20))
    assert q[-1].values["q"] == pytest.approx(0.19)
    assert {s.values["de_cmd"] for s in got if "de_cmd" in s.values} == {0.2}
    assert {s.values["V"] for s in got if "V" in s.values} == {18.0}
    vehicle.port.setblocking(False)
    with pytest.raises(BlockingIOError):  # nothing was sent to the vehicle
        vehicle.port.recv(2048)
    vehicle.close()


def telemetry(mavlink, k, boot_ms, system=7):
    """The bytes of one attitude, q counting up by 0.01, as vehicle ``system`` sends it."""
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    return mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0.0, 0.01 * k, 0.0).pack(link)


def test_a_serial_port_that_is_unplugged_and_a_vehicle_that_starts_again_are_followed(tmp_path):
    mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    pytest.importorskip("serial")
    device, kept = tmp_path / "ttyUSB0", io.BytesIO()

    def plug():
        master, slave = os.openpty()
        tty.setraw(slave)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(slave))
        return master, slave

    def fly(master, first, boot_ms):
        for k in range(20):
            os.write(master, telemetry(mavlink, first + k, boot_ms + 20 * k))
            time.sleep(0.01)

    master, slave = plug()
    source = open_source(f"serial:{device}:57600", {}, {}, None, False, 4.0, kept)
    assert source.radio

    def flight():
        nonlocal master, slave
        time.sleep(0.2)
        fly(master, 0, 90_000)
        time.sleep(0.3)
        os.close(slave)
        os.close(master)
        device.unlink()
        time.sleep(0.5)
        master, slave = plug()
        time.sleep(0.5)
        fly(master, 20, 1_000)  # the vehicle has lost its power, too: its clock begins anew

    thread = threading.Thread(target=flight)
    thread.start()
    got = list(source.samples)
    thread.join()
    os.close(slave)
    os.close(master)
    assert [s.values["q"] for s in got] == pytest.approx(0.01 * np.arange(40))
    assert np.diff([s.t_s for s in got]).min() > 0.0
    assert got[20].t_s - got[19].t_s == pytest.approx(got[20].arrived_s - got[19].arrived_s, abs=0.15)
    assert got[0].t_s == pytest.approx(90.0)
    assert kept.getvalue().count(telemetry(mavlink, 0, 90_000)[10:20]) == 1


def test_what_is_kept_on_board_is_a_telemetry_log_that_import_reads(tmp_path, monkeypatch, capsys):
    mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def fly():
        link = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            time.sleep(1.0)
            for k in range(400):
                if k % 50 == 0:
                    vehicle.sendto(mavlink.MAVLink_heartbeat_message(1, 3, 81, 5, 4, 3).pack(link), ("127.0.0.1", port))
                speed = mavlink.MAVLink_vfr_hud_message(13.0, 13.0, 0, 50, 100.0, 0.0)
                vehicle.sendto(telemetry(mavlink, k, 1000 + 20 * k), ("127.0.0.1", port))
                vehicle.sendto(speed.pack(link), ("127.0.0.1", port))
                time.sleep(0.002)

    thread = threading.Thread(target=fly)
    thread.start()
    words = ["live", f"udp:{port}", "--aircraft", "taurus", "--idle", "4", "--onboard", "logs/flight.tlog", "-o", "out"]
    status, said = ends(monkeypatch, capsys, *words)
    thread.join()
    assert (status, said) == (0, [])
    found = {c.name: c for c in import_log("logs/flight.tlog").channels}
    assert found["q"].values == pytest.approx(0.01 * np.arange(400), abs=1e-6)
    assert np.diff(found["q"].t_s) == pytest.approx(0.02, abs=1e-6)
    again = open_source("logs/flight.tlog", {}, {}, None, True, 0.0)
    assert sum("q" in s.values for s in again.samples) == 400
    status, said = ends(monkeypatch, capsys, *words)
    assert status == 2
    assert "name another file" in " ".join(said)


def test_a_recording_in_mcap_is_followed_as_its_own_library_writes_it(tmp_path):
    writer_of = pytest.importorskip("mcap.writer")
    file = tmp_path / "growing.mcap"
    units = {name: {"type": "number", "unit": unit} for name, unit in (("q", "rad/s"), ("V", "m/s"))}
    told = json.dumps({"type": "object", "properties": units}).encode()
    with file.open("wb") as out:
        writer = writer_of.Writer(out, chunk_size=1000)
        writer.start()
        schema = writer.register_schema("imu", "jsonschema", told)
        topic = writer.register_channel("/imu", "json", schema)

        def write(first, last):
            for k in range(first, last):
                said = json.dumps({"q": float(np.sin(k)), "V": 13.0 + 0.01 * k}).encode()
                writer.add_message(topic, log_time=int(2e7 * k), publish_time=0, data=said)
            out.flush()

        write(0, 100)
        source, got = open_source(str(file), {}, {}, None, False, 1.0), []
        for sample in source.samples:
            got.append(sample)
            if len(got) == 20:
                write(100, 200)
                writer.finish()
                out.flush()
    assert [s.values["q"] for s in got] == pytest.approx(np.sin(np.arange(200)))
    assert [s.t_s for s in got] == pytest.approx(0.02 * np.arange(200))
    whole = open_source(str(file), {}, {}, None, True, 0.0)
    assert [s.values for s in whole.samples] == [s.values for s in got]


@pytest.mark.parametrize(
    "place", ["udp:x", "udp:0", "serial:x", "serial:/dev/null/x:9600", "nowhere.csv", "nowhere.mcap"]
)
def test_a_source_that_is_none_is_refused_in_one_line(monkeypatch, capsys, place):
    status, said = ends(monkeypatch, capsys, "live", place, "--aircraft", "taurus")
    assert status == 2
    assert len(said) == 1
    with pytest.raises(RecordError):
        list(open_source(place, {}, {}, None, True, 0.1).samples)


def test_runs_of_cards_are_recognised_and_the_next_one_is_named(tmp_path, monkeypatch, capsys):
    from studies.reliability.small import PLAN, made

    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PLAN)
    log = next(made("logs", tmp_path).glob("*.csv"))
    assert ends(monkeypatch, capsys, "live", log, "--plan", "plan.toml", "-o", "out")[0] == 0
    updates = [json.loads(line) for line in (tmp_path / "out" / f"live_{log.stem}" / "updates.jsonl").open()]
    runs = [c for u in updates for c in u["calls"] if c["kind"] == "run"]
    assert [(c["channel"], c["other"], c["words"]) for c in runs] == [("1", 1, ""), ("1", 0, "")]


def _asked(home, path=None, host=None):
    split = urlsplit(home)
    link = HTTPConnection(split.hostname, split.port, timeout=10)
    link.request("GET", split.path if path is None else path, headers={"Host": host} if host else {})
    answer = link.getresponse()
    return answer.status, answer.read()


def test_the_page_is_shown_to_who_has_its_token_at_the_address_that_was_chosen():
    session = Session("flight", tb.load_aircraft("taurus", "rigid"))
    session.told = {"longitudinal": ""}
    session.calls = [Call(10.0, "stop", "de", 0.5, 0.97, "gain")]
    estimate = Estimate("M_q", -1.4, 0.14, 0.3, -1.3, 0.13, False, 6.2)
    session.updates = [Update(12.0, (), {"longitudinal": (estimate,)}, {}, ())]
    with served("flight", "127.0.0.2", 0) as (page, home):
        assert home.startswith("http://127.0.0.2:")
        page.show(glance(session, session.updates[-1]))
        assert _asked(home)[0] == 200
        now = json.loads(_asked(home, f"{page.home}now")[1])
        assert (now["word"], now["kind"], now["stops"]) == ("STOP", "stop", 1)
        assert now["line"] == "de has 0.5 of the effect that is expected (97 % likely)"
        assert now["derivatives"] == [{"name": "M_q", "error": 10.77, "wanted": 10.0, "reached": False,
                                       "more": "in 6 s of such manoeuvres"}]  # fmt: skip
        for path in ("/", "/now", f"{page.home[:-2]}/now", "/x/now"):
            assert _asked(home, path)[0] == 404
        assert _asked(home, host="evil.example")[0] == 421  # a name that its owner lets point here
        assert _asked(home, host="127.0.0.1")[0] == 421
    later = replace(session.updates[-1], t_s=40.0)
    assert glance(session, later)["word"] == "READY"


@pytest.mark.parametrize("given", ["0.0.0.0:8701", "8701", "here:1", "127.0.0.1:x", "224.0.0.1:80", "127.0.0.1:99999"])
def test_a_page_must_have_one_address(monkeypatch, capsys, given):
    status, said = ends(monkeypatch, capsys, "live", "nowhere.csv", "--aircraft", "taurus", "--view", given)
    assert status == 2
    assert "--view must be one address of this machine and a port" in " ".join(said)
