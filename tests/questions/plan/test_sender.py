"""The MAVLink sender for PX4: a vehicle that fails at any frame, in virtual time, and an autopilot on 127.0.0.1."""

import json
import math
import runpy
import socket
import struct
import subprocess
import sys
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_lua import card_of
from test_lua_vehicles import with_limits

from testbench.core.constants import G0_M_S2
from testbench.core.errors import LimitError, ScenarioError
from testbench.flight import linearise
from testbench.questions.plan.injection import px4_script
from testbench.questions.plan.injection.scripts import sender_settings
from testbench.questions.plan.injection.sender import OFFBOARD, STREAMS, Card, refusal
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import Autopilot

PERIOD_S = 0.02
STICKS = Autopilot(system="px4")
ACTUATORS = Autopilot(system="px4", interface="actuator_control")
PARAMETERS = {
    "FW_MAN_R_SC": 1.0, "FW_MAN_P_SC": 0.8, "FW_MAN_Y_SC": 1.0, "COM_RC_IN_MODE": 6.0, "SYS_CTRL_ALLOC": 0.0,
    "RC_MAP_THROTTLE": 3.0, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0, "RC3_REV": 1.0, "SDLOG_PROFILE": 25.0,
    "RC_MAP_ROLL": 1.0, "RC_MAP_PITCH": 2.0, "RC_MAP_YAW": 4.0,
}  # fmt: skip
INTEGERS = {
    "COM_RC_IN_MODE",
    "SYS_CTRL_ALLOC",
    "SDLOG_PROFILE",
    *(f"RC_MAP_{n}" for n in ("THROTTLE", "ROLL", "PITCH", "YAW")),
}


@pytest.fixture(scope="module")
def point(eolo, eolo_trim):
    return Point(1, 13.0, 547.0, eolo_trim, linearise(eolo, eolo_trim), 100.0, None, (), None)


class Vehicle:
    """What an autopilot tells, message by message, and what it was sent; the test changes its fields."""

    def __init__(self) -> None:
        self.mode, self.armed, self.switch, self.chancount, self.throttle = 1, True, 1000, 8, 1600
        self.stick = 1500
        self.airspeed, self.z, self.roll, self.pitch, self.az = 12.66, -100.0, 0.0, 0.05, -G0_M_S2
        self.silent = set()
        self.commands: list[tuple] = []
        self.sent: list[tuple] = []
        self.mav = SimpleNamespace(
            manual_control_send=lambda *x: self.sent.append(x),
            set_actuator_control_target_send=lambda *x: self.sent.append(tuple(x[4])),
            command_long_send=self._command,
        )

    def _command(self, *fields) -> None:
        self.commands.append(fields)
        if fields[2] == 176:
            self.mode = round(fields[5])

    def fields(self) -> dict[str, dict]:
        channels = {f"chan{i}_raw": 1500 for i in range(1, 19)}
        return {
            "HEARTBEAT": {"custom_mode": self.mode << 16, "base_mode": 128 if self.armed else 0},
            "ATTITUDE": {"roll": self.roll, "pitch": self.pitch},
            "LOCAL_POSITION_NED": {"z": self.z},
            "RC_CHANNELS": {
                **channels,
                "chan2_raw": self.stick,
                "chan7_raw": self.switch,
                "chan3_raw": self.throttle,
                "chancount": self.chancount,
            },
            "MANUAL_CONTROL": {"x": 40, "y": -20, "z": 0, "r": 10},
            "VFR_HUD": {"airspeed": self.airspeed},
            "HIGHRES_IMU": {"zacc": self.az},
            "ACTUATOR_CONTROL_TARGET": {"controls": [-0.02, -0.04, 0.01, 0.6, 0.0, 0.0, 0.0, 0.0]},
        }

    def tell(self, card: Card, now: float) -> None:
        for kind, fields in self.fields().items():
            if kind not in self.silent:
                card.hear(
                    SimpleNamespace(
                        get_type=lambda k=kind: k, get_srcComponent=lambda: 1, get_srcSystem=lambda: 1, **fields
                    ),
                    now,
                )


class Run:
    """A card on a vehicle in virtual time."""

    def __init__(self, settings, parameters=PARAMETERS) -> None:
        self.vehicle, self.words, self.now, self.going = Vehicle(), [], 100.0, True
        self.card = Card({**settings, "system_id": 1}, self.vehicle, parameters, self.words.append)

    def frames(self, count: int) -> None:
        for _ in range(count):
            self.now += PERIOD_S
            self.vehicle.tell(self.card, self.now)
            self.going = self.going and self.card.tick(self.now)

    def start(self) -> None:
        self.frames(3)
        self.vehicle.switch = 2000


def test_sticks_carry_the_card_and_leave_the_throttle_to_the_pilot(point, eolo):
    run = Run(sender_settings(with_limits(point, "elevator"), eolo, STICKS))
    run.start()
    run.frames(100)
    run.vehicle.throttle = 1700
    run.frames(200)
    assert run.words[-1] == "done"
    assert not run.going
    sent = np.array(run.vehicle.sent, float)
    settings = run.card.settings
    t = np.arange(len(sent) - 1) * PERIOD_S - settings["settle_s"]
    rows = np.searchsorted(settings["times_s"], t + 1e-9, side="right") - 1
    pitch = np.where(rows >= 0, np.array(settings["demands"])[np.maximum(rows, 0), 1], 0.0)
    assert np.abs(pitch).max() == pytest.approx(4.0 / 25.0)
    np.testing.assert_allclose(sent[:-1, 1], 40.0 - 1000.0 * pitch / 0.8, atol=0.51)  # nose up is stick back
    np.testing.assert_array_equal(sent[:, [2, 4]], np.tile([-20.0, 10.0], (len(sent), 1)))
    np.testing.assert_array_equal(np.unique(sent[:, 3]), [600.0, 700.0])
    assert sent[-1, 1] == 40.0  # the last frame brings the surfaces back
    count = len(sent)
    run.frames(10)
    assert len(run.vehicle.sent) == count
    run = Run(settings, {**PARAMETERS, "RC3_REV": -1.0})
    run.start()
    run.frames(2)
    assert {sent[3] for sent in run.vehicle.sent} == {400.0}  # a stick that is up at 1000 us


def test_actuator_controls_wait_for_offboard_and_give_the_mode_back(point, eolo):
    run = Run(sender_settings(with_limits(point, "lateral"), eolo, ACTUATORS))
    run.start()
    run.frames(30)
    assert run.vehicle.mode == 1  # set-points come first
    run.frames(35)
    assert run.vehicle.mode == OFFBOARD
    assert run.vehicle.commands == [(1, 1, 176, 0, 1.0, float(OFFBOARD), 0, 0, 0, 0, 0)]
    run.frames(300)
    assert run.words[-1] == "done"
    assert run.vehicle.mode == 1
    sent = np.array(run.vehicle.sent, float)
    assert sent[:, 0].max() == pytest.approx(-0.02 + 3.0 / 25.0)  # right wing down is positive
    assert sent[:, 2].min() == pytest.approx(0.01 - 5.0 / 25.0)  # trailing edge left turns left
    assert set(sent[:, 1]) == {-0.04}
    assert set(sent[:, 3]) == {0.6}
    # the pilot's own mode stays
    run = Run(sender_settings(with_limits(point, "lateral"), eolo, ACTUATORS))
    run.start()
    run.frames(120)
    run.vehicle.mode = 8
    run.frames(2)
    assert run.words[-1] == "ABORTED, wrong flight mode"
    assert run.vehicle.mode == 8


FAULTS = {
    "switch": {"switch": 1000},
    "radio lost": {"chancount": 0},
    "mode switched": {"mode": 8},
    "disarmed": {"armed": False},
    "too slow": {"airspeed": 8.0},
    "too fast": {"airspeed": 17.0},
    "airspeed is no number": {"airspeed": math.nan},
    "no airspeed": {"airspeed": 0.0},
    "infinite": {"airspeed": math.inf},
    "too low": {"z": -74.0},
    "height is no number": {"z": math.nan},
    "bank": {"roll": 0.51},
    "bank is no number": {"roll": math.nan},
    "pitch": {"pitch": -0.41},
    "load factor": {"az": -2.01 * G0_M_S2},
    "load factor is no number": {"az": math.nan},
    "the pilot pulls": {"stick": 1551},
    "the pilot pushes": {"stick": 1449},
}


@pytest.mark.parametrize("autopilot", [STICKS, ACTUATORS], ids=["sticks", "actuators"])
@pytest.mark.parametrize("fault", list(FAULTS))
def test_controls_return_within_one_frame_whenever_it_fails(point, eolo, fault, autopilot):
    settings = sender_settings(with_limits(point, "elevator"), eolo, autopilot)
    ready = Run(settings)
    ready.start()
    ready.frames(1)
    (trim,) = ready.vehicle.sent
    for k in (1, 2, 30, 64, 70, 90, 120, 150, 200, 249):
        run = Run(settings)
        run.start()
        run.frames(k)
        before = len(run.vehicle.sent)
        assert before == k
        for key, value in FAULTS[fault].items():
            setattr(run.vehicle, key, value)
        run.frames(1)
        assert run.words[-1].startswith("ABORTED")
        assert run.vehicle.sent[before:] == [trim]
        mode = run.vehicle.mode
        run.frames(20)
        assert len(run.vehicle.sent) == before + 1
        assert run.vehicle.mode == mode == (8 if fault == "mode switched" else 1)


@pytest.mark.parametrize("kind", [k for k in STREAMS if k not in ("MANUAL_CONTROL", "ACTUATOR_CONTROL_TARGET")])
def test_telemetry_that_stops_ends_the_run(point, eolo, kind):
    run = Run(sender_settings(with_limits(point, "elevator"), eolo, STICKS))
    run.start()
    run.frames(40)
    run.vehicle.silent.add(kind)
    run.frames(14 if kind != "HEARTBEAT" else 130)
    assert run.words[-1].startswith("ABORTED")
    assert "link lost" in run.words[-1] or run.words[-1] == "ABORTED, switch"


def test_nothing_starts_where_it_may_not(point, eolo):
    settings = sender_settings(with_limits(point, "elevator"), eolo, STICKS)
    for change, words in (
        ({"airspeed": 15.0}, "not at the speed"),
        ({"airspeed": math.nan}, "not at the speed"),
        ({"roll": 0.3}, "too much bank"),
        ({"mode": 4}, "wrong flight mode"),
        ({"armed": False}, "disarmed"),
    ):
        run = Run(settings)
        for key, value in change.items():
            setattr(run.vehicle, key, value)
        run.start()
        run.frames(20)
        assert not run.vehicle.sent
        assert words in run.words[-1]
    run = Run(settings)
    run.vehicle.switch = 2000  # high since before
    run.frames(50)
    assert not run.vehicle.sent
    run = Run(settings)
    run.vehicle.silent.add("MANUAL_CONTROL")
    run.start()
    run.frames(5)
    assert not run.vehicle.sent
    assert "does not send its commands" in run.words[-1]
    run = Run({**settings, "demands": [[0.0, 5.0 * row[1], 0.0] for row in settings["demands"]]})
    run.start()
    run.frames(5)
    assert not run.vehicle.sent
    assert "no room for pitch" in run.words[-1]


def test_messages_of_others_do_not_count(point, eolo):
    """A ground station on the same link that says MANUAL and armed, and a camera of the aircraft itself."""
    run = Run(sender_settings(with_limits(point, "elevator"), eolo, STICKS))
    run.vehicle.silent.add("HEARTBEAT")
    run.start()
    for system, component in ((255, 190), (2, 1), (1, 100)):
        beat = SimpleNamespace(
            get_type=lambda: "HEARTBEAT", get_srcSystem=lambda s=system: s, get_srcComponent=lambda c=component: c,
            custom_mode=1 << 16, base_mode=128,
        )  # fmt: skip
        run.card.hear(beat, run.now)
    run.frames(5)
    assert not run.vehicle.sent
    assert run.words[-1] == "NOT STARTED, link lost"


def test_a_vehicle_that_is_set_up_otherwise_is_refused():
    sticks, actuators = {"interface": "manual_control"}, {"interface": "actuator_control"}
    assert refusal(sticks, PARAMETERS) is None
    assert refusal(actuators, PARAMETERS) is None
    assert "COM_RC_IN_MODE 6 or 8 must hold" in refusal(sticks, {**PARAMETERS, "COM_RC_IN_MODE": 3.0})
    assert "got no answer" in refusal(sticks, {})
    assert "FW_MAN_P_SC no answer" in refusal(sticks, {k: v for k, v in PARAMETERS.items() if k != "FW_MAN_P_SC"})
    assert "later versions move nothing" in refusal(actuators, {**PARAMETERS, "SYS_CTRL_ALLOC": 1.0})


def test_a_card_s_name_stays_data_and_what_cannot_be_sent_is_refused(point, eolo, tmp_path):
    card = card_of(point, "elevator")
    for name in ("'); import os; os.mkdir('hurt') #", '"""\nimport os', "\\'", "{x}\u2028y", "x'\\n'"):
        hostile = replace(card, spec=card.spec.model_copy(update={"name": name}))
        file = tmp_path / "card.py"
        file.write_text(px4_script(hostile, eolo, STICKS), encoding="utf-8")
        found = runpy.run_path(str(file))["SETTINGS"]
        assert json.dumps(found) == json.dumps(sender_settings(hostile, eolo, STICKS))
    with pytest.raises(LimitError, match="throttle"):
        px4_script(card_of(point, "throttle"), eolo, STICKS)
    with pytest.raises(ScenarioError, match="f_max_hz"):
        px4_script(card_of(point, "multisine"), eolo, STICKS.model_copy(update={"period_ms": 50}))


class Autopilot127(threading.Thread):
    """An autopilot: answers for parameters, tells its state at 50 Hz, moves the switch, keeps what comes."""

    def __init__(self, port: int, mavutil) -> None:
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1)
        self.vehicle, self.stopped = Vehicle(), threading.Event()
        self.intervals: dict[int, float] = {}

    def run(self) -> None:
        mav, asked = self.link.mav, math.inf
        while not self.stopped.is_set():
            now = time.monotonic()
            asked = min(asked, now) if len(self.intervals) == len(STREAMS) else math.inf
            self.vehicle.switch = 2000 if now > asked + 1.0 else 1000
            f = self.vehicle.fields()
            mav.heartbeat_send(1, 12, f["HEARTBEAT"]["base_mode"], f["HEARTBEAT"]["custom_mode"], 4)
            mav.attitude_send(0, self.vehicle.roll, self.vehicle.pitch, 0.0, 0.0, 0.0, 0.0)
            mav.local_position_ned_send(0, 0.0, 0.0, self.vehicle.z, 0.0, 0.0, 0.0)
            rc = f["RC_CHANNELS"]
            mav.rc_channels_send(0, rc["chancount"], *(rc[f"chan{i}_raw"] for i in range(1, 19)), 100)
            mav.manual_control_send(1, 40, -20, 0, 10, 0)
            mav.vfr_hud_send(self.vehicle.airspeed, 13.0, 0, 60, 100.0, 0.0)
            mav.highres_imu_send(0, 0.0, 0.0, self.vehicle.az, *(0.0,) * 10, 0)
            until = time.monotonic() + PERIOD_S
            while (left := until - time.monotonic()) > 0.0:
                message = self.link.recv_match(blocking=True, timeout=left)
                if message is not None:
                    self._hear(message)

    def _hear(self, message) -> None:
        kind = message.get_type()
        if kind == "PARAM_REQUEST_READ":
            name = message.param_id
            value, number = PARAMETERS[name], 9
            if name in INTEGERS:  # as PX4 sends them
                value, number = struct.unpack("<f", struct.pack("<i", int(value)))[0], 6
            self.link.mav.param_value_send(name.encode(), value, number, 1, 0)
        elif kind == "COMMAND_LONG" and message.command == 511:
            self.intervals[round(message.param1)] = message.param2
        elif kind == "MANUAL_CONTROL":
            self.vehicle.sent.append((time.monotonic(), message.x, message.y, message.z, message.r))


@pytest.mark.parametrize("fails", [False, True])
def test_against_an_autopilot_on_127_0_0_1(point, eolo, tmp_path, fails):
    mavutil = pytest.importorskip("pymavlink.mavutil")
    card = with_limits(point, "elevator")
    spec = card.spec.model_copy(update={"settle_s": 0.2, "duration_s": 3.0})
    script = tmp_path / "card.py"
    script.write_text(px4_script(replace(card, spec=spec), eolo, STICKS), encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, script, "--connect", f"udpin:127.0.0.1:{port}", "--timeout", "20"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    autopilot = Autopilot127(port, mavutil)
    autopilot.start()
    try:
        if fails:
            end = time.monotonic() + 20.0
            while len(autopilot.vehicle.sent) < 50 and time.monotonic() < end:
                time.sleep(0.005)
            autopilot.vehicle.roll = math.nan
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
        autopilot.stopped.set()
        autopilot.join(5.0)
    assert err == ""
    assert autopilot.intervals == dict.fromkeys(STREAMS.values(), 20000.0)
    sent = np.array(autopilot.vehicle.sent)
    assert set(sent[:, 3]) == {600.0}
    assert sent[-1, 1] == 40.0
    if fails:
        assert process.returncode == 4
        assert "ABORTED, bank limit" in out
        assert len(sent) < 80
    else:
        assert process.returncode == 0
        assert out.splitlines()[-1] == "card 7: done"
        assert sent[:, 1].max() == 40.0 + 4.0 / 25.0 * 1000.0 / 0.8
        assert 140 <= len(sent) <= 162  # 3.2 s at 50 Hz, on a machine that does other things too
