"""The published interfaces between an autopilot's simulator and physics, which wait for each other step by step.

ArduPilot's JSON interface (libraries/SITL/examples/JSON in its sources): a packet of servo pulses comes by UDP, a line
of JSON goes back to where it came from. PX4's simulator MAVLink API: PX4 connects by TCP, gets HIL_SENSOR, HIL_GPS and
HIL_STATE_QUATERNION, and answers each HIL_SENSOR with HIL_ACTUATOR_CONTROLS.
"""

from __future__ import annotations

import json
import math
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np

from testbench.core.atmosphere import air_density, air_pressure
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.flight.executive import body_from_earth
from testbench.logs.mavlink import dialect
from testbench.questions.sitl.ask import Served
from testbench.questions.sitl.outputs import Outputs

PORTS = {"ardupilot": 9002, "px4": 4560}
"""Autopilot -> the port that it looks for physics at."""
_PACKETS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}  # magic -> magic, rate, count, pulses
_COUNTS = 1 << 32
_LATE = 1000  # packets that may overtake one another; a count that falls by more has begun anew
_POLL_S = 0.2
_SAID_S = 10.0  # of flight between two lines

_HOME = (47.397742, 8.545594)  # latitude and longitude, deg, where PX4's simulators begin
_FIELD_G = (0.2158, 0.0113, 0.4297)  # magnetic field there north, east, down, gauss (World Magnetic Model 2020)
_EARTH_M = 6371000.0  # the sphere of PX4's own projection
_IMU, _MAG, _BARO, _PITOT = 0x3F, 0x1C0, 0x1A00, 0x400  # bits of HIL_SENSOR.fields_updated
_SLOW_HZ, _GPS_HZ, _STATE_HZ = 50.0, 5.0, 200.0
_ARMED, _LOCKSTEP = 128, 1  # of HIL_ACTUATOR_CONTROLS: mode, flags
_STATE, _SET_INTERVAL = 115, 511  # HIL_STATE_QUATERNION, MAV_CMD_SET_MESSAGE_INTERVAL
_PATIENCE_S = 1.0  # for the answer to a HIL_SENSOR
Say = Callable[[str], None]


def serve(
    served: Served,
    outputs: Outputs,
    autopilot: str,
    at: tuple[str, int],
    idle_s: float = math.inf,
    say: Say = print,
    speed: float = 1.0,
) -> None:
    """Serve an aircraft to the simulator of an autopilot until nothing has come for ``idle_s``.

    Args:
        served: the aircraft, at its trim.
        outputs: what the autopilot's outputs mean.
        autopilot: "ardupilot" or "px4".
        at: address and port where to listen.
        idle_s: without a packet, s of the clock.
        say: called with a sentence where something begins or ends.
        speed: of PX4's clock over ours; ArduPilot keeps time itself.

    Raises:
        RecordError: the port cannot be had.
        MissingPackage: PX4 is served and pymavlink is not installed.
    """
    if autopilot == "px4":
        dialect()
    kind = socket.SOCK_STREAM if autopilot == "px4" else socket.SOCK_DGRAM
    with _listening(kind, *at) as link:
        say(f"waiting for {'PX4' if autopilot == 'px4' else 'ArduPilot'} at {at[0]}, port {at[1]}")
        if autopilot == "px4":
            _serve_px4(link, served, outputs, idle_s, speed, _Teller(served, say))
        else:
            _serve_ardupilot(link, served, outputs, idle_s, _Teller(served, say))


@contextmanager
def _listening(kind: socket.SocketKind, address: str, port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, kind) as link:
        try:
            if kind == socket.SOCK_STREAM:
                link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # of a connection that has ended
            link.bind((address, port))
            if kind == socket.SOCK_STREAM:
                link.listen(1)
        except OSError as error:
            name = "TCP" if kind == socket.SOCK_STREAM else "UDP"
            raise RecordError(
                f"{name} port {port} of {address} must be free, got '{error.strerror or error}'; end what has it, or "
                "give another by --port"
            ) from error
        link.settimeout(_POLL_S)
        yield link


class _Teller:
    """Says where a flight begins and ends, and now and then how it goes."""

    def __init__(self, served: Served, say: Say) -> None:
        self._served, self.say, self._due_s, self._ended = served, say, 0.0, False

    def begins(self, who: str) -> None:
        self._due_s, self._ended = _SAID_S, False
        self.say(f"{who}: flight {len(self._served.tally.flights) + 1} begins at its trim, in the air")

    def goes(self) -> None:
        served, now = self._served, self._served.now
        if served.reason and not self._ended:
            self._ended = True
            self.say(
                f"the flight has ended at {served.t_s:.2f} s: {served.reason}; start the autopilot again for another"
            )
        elif served.t_s >= self._due_s:
            self._due_s += _SAID_S
            lost = served.tally.missed + served.tally.unanswered
            angles = ", ".join(f"{n} {now[n] / DEG_RAD:.1f} deg" for n in ("phi", "theta"))
            self.say(f"{served.t_s:.0f} s: {now['V']:.1f} m/s, {now['h']:.0f} m, {angles}; {lost} steps lost")


# --- ArduPilot --------------------------------------------------------------------------------------------------------


def state_line(served: Served) -> bytes:
    """Return the answer to a packet of servo pulses: one line of JSON between line ends.

    The inertial unit and the airspeed are what the instruments tell. Position, velocity and attitude are true:
    ArduPilot makes its satellite navigation, barometer and compass of them, with errors of its own (SIM_...).
    """
    told, now = served.told, served.now
    state = {
        "timestamp": served.t_s,
        "imu": {"gyro": [told[n] for n in "pqr"], "accel_body": [told[n] for n in ("ax", "ay", "az")]},
        "position": [now["north"], now["east"], served.ground_m - now["h"]],
        "attitude": [now[n] for n in ("phi", "theta", "psi")],
        "velocity": list(served.velocity(now)),
        "velocity_wind": [now[f"wind_{n}"] for n in ("north", "east", "down")],
        "airspeed": served.equivalent_airspeed(),
    }
    return b"\n" + json.dumps(state, separators=(",", ":")).encode() + b"\n"


def _serve_ardupilot(link: socket.socket, served: Served, outputs: Outputs, idle_s: float, tell: _Teller) -> None:
    last, sender, answer, heard = None, None, b"", time.monotonic()
    while time.monotonic() - heard < idle_s:
        for count, (pulses, where) in _packets(link, served, last):
            heard = time.monotonic()
            ahead = 0 if last is None else (count - last + _COUNTS // 2) % _COUNTS - _COUNTS // 2
            if last is None or ahead < -_LATE or (ahead < 0 and where != sender):
                served.begin()
                tell.begins(f"ArduPilot at {where[0]}, frame {count}")
            elif ahead < 0:
                served.tally.late += 1
                continue
            elif ahead == 0:  # the answer was lost
                served.tally.repeated += 1
                if not served.reason:
                    link.sendto(answer, where)
                continue
            else:
                served.tally.missed += ahead - 1
            last, sender = count, where
            served.step(outputs.commands(pulses))
            tell.goes()
            if not served.reason:  # a flight that has ended has no state; ArduPilot asks again until it is restarted
                answer = state_line(served)
                link.sendto(answer, where)


def _packets(link: socket.socket, served: Served, last: int | None) -> list[tuple[int, tuple[list[int], Any]]]:
    """Return what has come, (frame, (pulses, sender)), each frame once, in the order of the frames if it was lost."""
    found: dict[int, tuple[list[int], Any]] = {}
    wait = _POLL_S
    while select.select([link], [], [], wait)[0]:
        wait = 0.0
        try:
            data, where = link.recvfrom(2048)
        except ConnectionError:  # of an answer to who has gone
            continue
        form = _PACKETS.get(int.from_bytes(data[:2], "little"))
        if form is None or len(data) != form.size:
            served.tally.foreign += 1
            continue
        _, _, count, *pulses = form.unpack(data)
        served.tally.repeated += count in found
        found[count] = pulses, where
    begin = next(iter(found), 0) if last is None else last
    return sorted(found.items(), key=lambda x: (x[0] - begin + _COUNTS // 2) % _COUNTS)


# --- PX4 --------------------------------------------------------------------------------------------------------------


def _serve_px4(
    link: socket.socket, served: Served, outputs: Outputs, idle_s: float, speed: float, tell: _Teller
) -> None:
    heard = time.monotonic()
    while time.monotonic() - heard < idle_s:
        try:
            connection, where = link.accept()
        except TimeoutError:
            continue
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            served.begin()
            tell.begins(f"PX4 at {where[0]}")
            try:
                _Px4(connection, served, outputs, tell).fly(idle_s, speed)
            except (ConnectionError, EOFError):
                tell.say(f"PX4 has gone at {served.t_s:.2f} s of the flight")
        heard = time.monotonic()


class _Px4:
    """One connection of PX4, from its first byte to its last."""

    def __init__(self, connection: socket.socket, served: Served, outputs: Outputs, tell: _Teller) -> None:
        self._connection, self._served, self._outputs, self._tell = connection, served, outputs, tell
        self._link = dialect().MAVLink(SimpleNamespace(write=connection.sendall), srcSystem=1, srcComponent=200)
        self._link.robust_parsing = True
        self._state_hz, self._locked, self._answered_us = _STATE_HZ, False, -1
        self._commands: dict[str, float] = {}

    def fly(self, idle_s: float, speed: float) -> None:
        """Fly until PX4 goes, is silent, or the flight leaves its limits.

        Until its first outputs PX4 starts up, and waits for nothing but time: it gets a frame when it is due by the
        clock. From then on a frame also waits for the outputs that answer the one before.
        """
        served, heard, due = self._served, time.monotonic(), time.monotonic()
        while time.monotonic() - heard < idle_s:
            served.step(self._commands)
            self._tell.goes()
            if served.reason:
                return
            time_us = round(1e6 * served.t_s)
            self._send(time_us)
            pace = speed if self._locked else min(speed, 1.0)
            due = max(due + 1.0 / (served.rate_hz * pace), time.monotonic() - _PATIENCE_S)
            if self._wait(time_us, due):
                heard = time.monotonic()
            elif self._locked:
                served.tally.unanswered += 1
            time.sleep(max(due - time.monotonic(), 0.0))

    def _wait(self, time_us: int, due: float) -> bool:
        """Take what comes until the outputs that answer a frame, or until it is time; return whether they came."""
        sent = time.monotonic()
        while self._answered_us < time_us:
            left = (sent + _PATIENCE_S if self._locked else due) - time.monotonic()
            if left <= 0.0 or not select.select([self._connection], [], [], left)[0]:
                break
            data = self._connection.recv(4096)
            if not data:
                raise EOFError
            for message in self._link.parse_buffer(data) or ():
                self._hear(message, time_us)
        return self._answered_us >= time_us

    def _hear(self, message: Any, time_us: int) -> None:
        kind = message.get_type()
        if kind == "HIL_ACTUATOR_CONTROLS":
            # Of a PX4 that does not run by our clock, each one answers.
            in_lockstep = bool(message.flags & _LOCKSTEP)
            self._answered_us = max(self._answered_us, min(message.time_usec, time_us) if in_lockstep else time_us)
            self._locked = True
            self._commands = self._outputs.commands(message.controls) if message.mode & _ARMED else {}
        elif kind == "COMMAND_LONG" and message.command == _SET_INTERVAL and message.param1 == _STATE:
            self._state_hz = 1e6 / message.param2 if message.param2 > 0.0 else _STATE_HZ * (message.param2 == 0.0)
        elif kind == "BAD_DATA":
            self._served.tally.foreign += 1

    def _due(self, hz: float) -> bool:
        """Return whether what goes out so often goes out with this frame."""
        rate, frames = self._served.rate_hz, self._served.frames
        return hz > 0.0 and math.floor(frames * hz / rate + 1e-9) > math.floor((frames - 1) * hz / rate + 1e-9)

    def _new(self, channels: tuple[str, ...], hz: float) -> bool:
        """Return whether an instrument brought one of these, or, where none reads them, whether they are due."""
        suite = self._served.suite
        sensed = set(channels) & set(() if suite is None else suite.channels)
        return bool(sensed & self._served.fresh) if sensed else self._due(hz)

    def _send(self, time_us: int) -> None:
        served, told, now = self._served, self._served.told, self._served.now
        if served.suite is None:
            satellite = barometric = now["h"]
        else:  # one suite has one h: of its barometer, or of its receiver
            by_receiver = any(s.channel == "h" and s.KIND == "gps" for s in served.suite.sensors)
            satellite, barometric = (told["h"], now["h"]) if by_receiver else (now["h"], told["h"])
        q = quaternion(now["phi"], now["theta"], now["psi"])
        fields = _IMU
        fields |= _MAG if self._new(("psi",), _SLOW_HZ) else 0
        fields |= _BARO if self._new(("h",), _SLOW_HZ) else 0
        fields |= _PITOT if self._new(("V", "qbar"), _SLOW_HZ) else 0
        magnetic = rotation(now["phi"], now["theta"], told["psi"]) @ _FIELD_G
        pressure = 0.5 * air_density(0.0) * served.equivalent_airspeed() ** 2
        if self._due(_GPS_HZ):
            v = served.velocity(told)
            course = math.degrees(math.atan2(v[1], v[0])) % 360.0
            self._link.hil_gps_send(
                time_us, 3, *_place(told), round(1e3 * satellite), 30, 40,
                _fits(1e2 * math.hypot(*v[:2]), 0, 65534), *(_fits(1e2 * x) for x in v), round(1e2 * course) % 36000,
                12,
            )  # fmt: skip
        if self._due(self._state_hz):
            a = [now[n] for n in ("ax", "ay", "az")]
            self._link.hil_state_quaternion_send(
                time_us, q, now["p"], now["q"], now["r"], *_place(now), round(1e3 * now["h"]),
                *(_fits(1e2 * x) for x in served.velocity(now)), _fits(1e2 * served.equivalent_airspeed(), 0, 65535),
                _fits(1e2 * now["V"], 0, 65535), *(_fits(1e3 * x / G0_M_S2) for x in a),
            )  # fmt: skip
        self._link.hil_sensor_send(  # the last of them: it lets PX4's clock go on
            time_us, *(told[n] for n in ("ax", "ay", "az", "p", "q", "r")), *magnetic.tolist(),
            1e-2 * air_pressure(barometric), 1e-2 * pressure, barometric, 15.0 - 0.0065 * now["h"], fields,
        )  # fmt: skip


def _place(of: Mapping[str, float]) -> tuple[int, int]:
    """Return latitude and longitude, 1e-7 deg."""
    lat = _HOME[0] + of["north"] / _EARTH_M / DEG_RAD
    return round(1e7 * lat), round(1e7 * (_HOME[1] + of["east"] / _EARTH_M / DEG_RAD / math.cos(_HOME[0] * DEG_RAD)))


def _fits(x: float, low: int = -32768, high: int = 32767) -> int:
    return min(max(round(x), low), high)


def quaternion(phi: float, theta: float, psi: float) -> list[float]:
    """Return the quaternion (4,), scalar first, of the attitude, rad: from body axes to north, east, down."""
    (cp, sp), (ct, st), (cy, sy) = ((math.cos(0.5 * x), math.sin(0.5 * x)) for x in (phi, theta, psi))
    return [
        cp * ct * cy + sp * st * sy,
        sp * ct * cy - cp * st * sy,
        cp * st * cy + sp * ct * sy,
        cp * ct * sy - sp * st * cy,
    ]


def rotation(phi: float, theta: float, psi: float) -> np.ndarray:
    """Return the matrix (3, 3) that takes north, east, down to body axes at an attitude, rad."""
    c, s = math.cos(psi), math.sin(psi)
    return np.asarray(body_from_earth(theta, phi)) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
