"""Stand-ins for the simulators of ArduPilot and PX4, by the published protocols, to the byte."""

import json
import socket
import struct
import time

FORMS = {16: (18458, "<HHI16H"), 32: (29569, "<HHI32H")}
STATE = {"timestamp", "imu", "position", "attitude", "velocity"}


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class ArduPilot:
    """Sends servo pulses, waits for the state, and sends them again, the frame not counted on, where none comes.

    ``keep`` decides of (frame, try) whether a packet arrives, ``keep_answer`` whether its answer does.
    """

    def __init__(self, port, outputs=16, keep=lambda n, k: True, keep_answer=lambda n, k: True, patience_s=1.0):
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link.settimeout(patience_s)
        self.where, self.frame, self.outputs, self.time_s = ("127.0.0.1", port), 0, outputs, 0.0
        self.keep, self.keep_answer, self.buffer, self.sent = keep, keep_answer, b"\n", []

    def packet(self, pulses, frame):
        magic, form = FORMS[self.outputs]
        return struct.pack(form, magic, 400, frame, *pulses, *[0] * (self.outputs - len(pulses)))

    def step(self, pulses):
        end, k = time.monotonic() + 60.0, -1
        while time.monotonic() < end:
            k += 1
            packet = self.packet(pulses, self.frame)
            if self.keep(self.frame, k):
                self.link.sendto(packet, self.where)
                self.sent.append(packet)
            state = self.receive()
            if state is not None and state["timestamp"] > self.time_s and self.keep_answer(self.frame, k):
                self.frame, self.time_s = self.frame + 1, state["timestamp"]  # one that comes twice is heard once
                return state
        raise AssertionError(f"frame {self.frame} was never answered")

    def receive(self):
        """Take what stands between the last two line ends, as ArduPilot does."""
        try:
            self.buffer += self.link.recv(65000)
        except (TimeoutError, ConnectionError):
            return None
        *_, line, rest = self.buffer.rsplit(b"\n", 2)
        self.buffer = b"\n" + rest
        state = json.loads(line)
        assert state.keys() >= STATE
        assert line.index(b'"velocity"') < line.index(b'"velocity_wind"')  # the first that begins so is taken
        return state

    def close(self):
        self.link.close()


class Px4:
    """Connects, takes its time from HIL_SENSOR, and answers each with outputs, armed or not, in lockstep."""

    def __init__(self, port, mavlink, boot=0):
        self.connection = socket.create_connection(("127.0.0.1", port), timeout=20.0)
        self.link = mavlink.MAVLink(self.connection.makefile("wb", buffering=0), srcSystem=1, srcComponent=1)
        self.mavlink, self.boot, self.heard = mavlink, boot, []
        self.link.heartbeat_send(1, 12, 0, 0, 0)
        self.link.command_long_send(0, 0, 511, 0, 115, 5e3, 0, 0, 0, 0, 0)

    def until_sensor(self):
        """Return the next HIL_SENSOR, and what came before it."""
        before = []
        while True:
            while self.heard:
                message = self.heard.pop(0)
                if message.get_type() == "HIL_SENSOR":
                    return message, before
                before.append(message)
            data = self.connection.recv(65536)
            if not data:
                raise EOFError
            self.heard += self.link.parse_buffer(data) or []

    def answer(self, controls, time_usec, armed=True, lockstep=True):
        controls = [*controls, *[0.0] * (16 - len(controls))]
        self.link.hil_actuator_controls_send(time_usec, controls, 1 | 128 * armed, int(lockstep))

    def close(self):
        self.connection.shutdown(socket.SHUT_RDWR)
        self.connection.close()
