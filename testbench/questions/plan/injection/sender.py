"""Flies one flight card on a PX4 fixed-wing aircraft over MAVLink, from a companion computer; needs pymavlink.

What PX4 takes in flight. MAV_CMD_ACTUATOR_TEST is denied while armed, and SET_ACTUATOR_CONTROL_TARGET has moved nothing
since control allocation replaced the mixers (1.14). Surfaces alone, by their numbers, take ROS 2 (uXRCE-DDS, offboard
direct_actuator with actuator_servos, 1.15 and later): play the CSV there. Over MAVLink two ways are left:

manual_control    PX4 1.17 and later, flight mode MANUAL, COM_RC_IN_MODE 6 or 8 (MAVLink before radio). The sticks that
                  the pilot holds at the start are sent back with the sequence added; the throttle stays with the
                  pilot. When the sender falls silent, PX4 returns to the radio after COM_RC_LOSS_T (0.5 s as proposed).
actuator_control  PX4 1.13 with mixers (SYS_CTRL_ALLOC 0), flight mode OFFBOARD, entered from MANUAL. The outputs of the
                  autopilot at the start are sent back with the sequence added. The pilot's mode switch ends it at once.

Both give demands of roll, pitch and yaw, which PX4 mixes: elevons, V-tails and flaperons move as the vehicle is set
up, and a demand of one is full throw with PX4's own scales (CA_SV_CSn_TRQ as proposed). Set SDLOG_PROFILE to 25.

The sequence starts when the radio's start switch goes high, at the card's airspeed and with little bank. It ends within
one frame, and the last frame brings the surfaces back to where they were, when the switch leaves high, the pilot moves
the radio's stick of roll, pitch or yaw beyond a dead band, the flight mode changes, as by a geofence, the aircraft is
disarmed, radio or telemetry are older than they may be, or a limit of the card is met or is not a number. Before the
first flight: with the propeller off, play each card (--bench) and compare the deflections.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping
from typing import Any

SETTINGS: dict[str, Any] = {}
G0_M_S2 = 9.80665
MANUAL, OFFBOARD = 1, 6  # main modes of PX4
OLDEST_S = 0.25  # telemetry older than this counts as lost
OFFBOARD_STREAM_S = 1.2  # set-points that PX4 must have heard before it enters OFFBOARD
STREAMS = {
    "HEARTBEAT": 0,
    "ATTITUDE": 30,
    "LOCAL_POSITION_NED": 32,
    "RC_CHANNELS": 65,
    "MANUAL_CONTROL": 69,
    "VFR_HUD": 74,
    "HIGHRES_IMU": 105,
    "ACTUATOR_CONTROL_TARGET": 140,
}
"""Messages that are asked for at the rate of the sequence."""
NEEDED = ("ATTITUDE", "LOCAL_POSITION_NED", "RC_CHANNELS", "VFR_HUD", "HIGHRES_IMU")
SCALES = ("FW_MAN_R_SC", "FW_MAN_P_SC", "FW_MAN_Y_SC")
THROTTLE = "RC_MAP_THROTTLE"
STICKS = ("RC_MAP_ROLL", "RC_MAP_PITCH", "RC_MAP_YAW")
HIGH_US, LOW_US = 1700, 1300


class Card:
    """The run of one card: ``hear`` takes a message, ``tick`` sends a frame; nothing here waits or reads a clock.

    Args:
        settings: of the card, as the testbench wrote them.
        link: a pymavlink connection, of which only ``mav`` is used.
        parameters: of the vehicle, by name.
        say: takes a sentence.
        bench: leaves out airspeed, its limits and the window at the start, for the test on the ground.
    """

    def __init__(
        self, settings: Mapping[str, Any], link: Any, parameters: Mapping[str, float], say: Any, bench: bool = False
    ) -> None:
        self.settings, self.link, self.say, self.bench = settings, link, say, bench
        self.by_sticks = settings["interface"] == "manual_control"
        self.parameters = parameters
        self.scales = [parameters[n] if self.by_sticks else 1.0 for n in SCALES]
        self.heard: dict[str, tuple[float, Any]] = {}
        self.state = "wait for the switch to be low"
        self.held: tuple[float, float, float, float] | None = None
        self.started = self.height = 0.0
        self.sticks = [0.0, 0.0, 0.0]
        self.row = 0

    def hear(self, message: Any, now: float) -> None:
        """Keep a message of the autopilot and its time, s."""
        kind = message.get_type()
        if message.get_srcSystem() != self.settings["system_id"]:
            return  # of a ground station or another aircraft
        if kind == "HEARTBEAT" and message.get_srcComponent() != 1:
            return  # of a camera
        self.heard[kind] = (now, message)

    def tick(self, now: float) -> bool:
        """Send one frame if the card runs; False when it has ended."""
        switch = self._switch(now)
        if self.state == "wait for the switch to be low":
            if switch == "low":
                self.state = "ready"
                self.say("ready: the switch starts it")
        elif self.state == "ready":
            if switch == "high":
                return self._start(now)
        elif self.state in ("offboard", "running"):
            return self._run(now)
        return self.state != "ended"

    def _start(self, now: float) -> bool:
        reason = self._not_fit(now, (MANUAL,)) or self._not_at_the_start()
        if reason:
            self.state = "wait for the switch to be low"
            self.say(f"NOT STARTED, {reason}")
            return True
        self.held = self._now_commanded(now)
        reason = "the autopilot does not send its commands" if self.held is None else self._no_room()
        if reason:
            self.state = "wait for the switch to be low"
            self.say(f"NOT STARTED, {reason}")
            return True
        self.started, self.row, self.sticks = now, 0, self._sticks()
        self.height = -self.heard["LOCAL_POSITION_NED"][1].z
        self.state = "running" if self.by_sticks else "offboard"
        self.say("running")
        return self._run(now)

    def _run(self, now: float) -> bool:
        if self.state == "offboard":  # PX4 enters OFFBOARD only after it has heard set-points for a while
            reason = (
                "switch" if self._switch(now) != "high" else self._not_fit(now, (MANUAL, OFFBOARD)) or self._taken()
            )
            if reason:
                return self._end(f"ABORTED, {reason}", now)
            self._send((0.0, 0.0, 0.0), now)
            if now - self.started > OFFBOARD_STREAM_S:
                if self._mode() == OFFBOARD:
                    self.state, self.started = "running", now
                else:
                    self._set_mode(OFFBOARD)
            if now - self.started > 4.0 * OFFBOARD_STREAM_S:
                return self._end("ABORTED, the autopilot does not enter OFFBOARD", now)
            return True
        reason = "switch" if self._switch(now) != "high" else None
        reason = reason or self._not_fit(now, (MANUAL if self.by_sticks else OFFBOARD,)) or self._taken()
        if reason:
            return self._end(f"ABORTED, {reason}", now)
        t = now - self.started - self.settings["settle_s"]
        if t >= self.settings["duration_s"]:
            return self._end("done", now)
        times = self.settings["times_s"]
        while self.row + 1 < len(times) and times[self.row + 1] <= t + 1e-9:
            self.row += 1
        self._send(tuple(self.settings["demands"][self.row]) if t >= -1e-9 else (0.0, 0.0, 0.0), now)
        return True

    def _end(self, words: str, now: float) -> bool:
        """Send the surfaces back to where they were, give the mode back, and send nothing any more."""
        self._send((0.0, 0.0, 0.0), now)
        if not self.by_sticks and self._mode() == OFFBOARD:  # a mode that the pilot has chosen stays
            self._set_mode(MANUAL)
        self.state = "ended"
        self.say(words)
        return False

    def _switch(self, now: float) -> str:
        """Return "high", "low", "between", or "lost" where radio or telemetry is."""
        at, message = self.heard.get("RC_CHANNELS", (-math.inf, None))
        if not now - at <= OLDEST_S:
            return "lost"
        value = getattr(message, f"chan{self.settings['switch_channel']}_raw")
        if message.chancount == 0 or not 800 <= value <= 2200:
            return "lost"
        return "high" if value >= HIGH_US else "low" if value <= LOW_US else "between"

    def _mode(self) -> int:
        return int(self.heard["HEARTBEAT"][1].custom_mode) >> 16 & 0xFF

    def _not_fit(self, now: float, modes: tuple[int, ...]) -> str | None:
        """Return what keeps a run from starting or going on, whatever it measures; ``modes`` are those it may be in."""
        if not now - self.heard.get("HEARTBEAT", (-math.inf,))[0] <= 10.0 * OLDEST_S:
            return "link lost"
        for kind in NEEDED:
            if not now - self.heard.get(kind, (-math.inf,))[0] <= OLDEST_S:
                return f"link lost: no {kind}"
        if not self.heard["HEARTBEAT"][1].base_mode & 128:
            return "disarmed"
        if self._mode() not in modes:
            return "wrong flight mode"
        return None

    def _measured(self) -> dict[str, float]:
        """Return what is watched: m/s, m from the start, deg, g."""
        attitude = self.heard["ATTITUDE"][1]
        speed = self.heard["VFR_HUD"][1].airspeed * self.settings["eas2tas"]
        load = -self.heard["HIGHRES_IMU"][1].zacc / G0_M_S2
        alpha, load_at_trim, load_per_deg = self.settings["lift_curve"]
        slow = self.settings["speed_m_s"] / speed if speed > 0.0 else math.nan
        return {
            "airspeed": speed,
            "height": -self.heard["LOCAL_POSITION_NED"][1].z - self.height,
            "bank": math.degrees(attitude.roll),
            "pitch": math.degrees(attitude.pitch),
            "load factor": load,
            "alpha": alpha + (load * slow * slow - load_at_trim) / load_per_deg,
        }

    def _sticks(self) -> list[float]:
        """Return the pulses of the pilot's roll, pitch and yaw sticks, us."""
        message = self.heard["RC_CHANNELS"][1]
        return [float(getattr(message, f"chan{self.parameters[n]:.0f}_raw")) for n in STICKS]

    def _taken(self) -> str | None:
        """Return why a run does not go on: the pilot's stick beyond its dead band, or a limit."""
        moved = (abs(now - then) for now, then in zip(self._sticks(), self.sticks, strict=True))
        if not all(x <= self.settings["stick_us"] for x in moved):
            return "the pilot took the stick"
        return self._limit_met()

    def _limit_met(self) -> str | None:
        measured = self._measured()
        for name, (low, high) in self.settings["limits"].items():
            if self.bench and name in ("airspeed", "alpha"):
                continue
            if not low <= measured[name] <= high:  # what is not a number is outside
                return f"{name} limit"
        return None

    def _not_at_the_start(self) -> str | None:
        measured = self._measured()
        if not self.bench and not abs(measured["airspeed"] - self.settings["speed_m_s"]) <= self.settings["window_m_s"]:
            return "not at the speed of the card"
        if not abs(measured["bank"]) <= self.settings["bank_deg"]:
            return "too much bank"
        return None

    def _now_commanded(self, now: float) -> tuple[float, float, float, float] | None:
        """Return what is commanded now: roll, pitch (nose up) and yaw, -1 to 1, and throttle, 0 to 1."""
        at, message = self.heard.get(
            "MANUAL_CONTROL" if self.by_sticks else "ACTUATOR_CONTROL_TARGET", (-math.inf, None)
        )
        if not now - at <= OLDEST_S:
            return None
        if self.by_sticks:
            roll, pitch, yaw, throttle = message.y / 1000.0, -message.x / 1000.0, message.r / 1000.0, self._throttle()
        else:
            roll, pitch, yaw, throttle = (float(x) for x in message.controls[:4])
        inside = all(-1.0 <= x <= 1.0 for x in (roll, pitch, yaw, throttle))
        return (roll, pitch, yaw, throttle) if inside else None

    def _throttle(self) -> float:
        """Return the pilot's throttle, 0 to 1, from the radio: versions of PX4 differ in how MANUAL_CONTROL has it."""
        n = round(self.parameters[THROTTLE])
        low, high = (self.parameters[f"RC{n}_{end}"] for end in ("MIN", "MAX"))
        share = (getattr(self.heard["RC_CHANNELS"][1], f"chan{n}_raw") - low) / (high - low)
        share = 1.0 - share if self.parameters[f"RC{n}_REV"] < 0.0 else share
        return min(max(share, 0.0), 1.0)

    def _send(self, demands: tuple[float, ...], now: float) -> None:
        assert self.held is not None
        roll, pitch, yaw = (
            min(max(held + demand / scale, -1.0), 1.0)
            for held, demand, scale in zip(self.held, demands, self.scales, strict=False)
        )
        system = self.settings["system_id"]
        if self.by_sticks:
            self.link.mav.manual_control_send(
                system,
                round(-1000.0 * pitch),
                round(1000.0 * roll),
                round(1000.0 * self._throttle()),
                round(1000.0 * yaw),
                0,
            )
        else:
            controls = [roll, pitch, yaw, self.held[3], 0.0, 0.0, 0.0, 0.0]
            self.link.mav.set_actuator_control_target_send(round(1e6 * now), 0, system, 1, controls)

    def _set_mode(self, mode: int) -> None:
        # MAV_CMD_DO_SET_MODE with a custom main mode; 1 is MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.link.mav.command_long_send(self.settings["system_id"], 1, 176, 0, 1.0, float(mode), 0, 0, 0, 0, 0)

    def _no_room(self) -> str | None:
        """Return why the sequence finds no room at the demands that are held, or None."""
        assert self.held is not None
        for axis, name in enumerate(("roll", "pitch", "yaw")):
            for row in self.settings["demands"]:
                if abs(self.held[axis] + row[axis] / self.scales[axis]) > 1.0:
                    return f"no room for {name} at this trim"
        return None


def read_parameters(link: Any, system: int, names: tuple[str, ...], timeout_s: float = 5.0) -> dict[str, float]:
    """Return parameters of the vehicle, whole numbers too; those that it does not answer for are left out."""
    import struct

    out: dict[str, float] = {}
    end = time.monotonic() + timeout_s
    while time.monotonic() < end and len(out) < len(names):
        for name in names:
            if name not in out:
                link.mav.param_request_read_send(system, 1, name.encode(), -1)
        pause = time.monotonic() + 0.5
        while time.monotonic() < pause and len(out) < len(names):
            message = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=0.1)
            if message is not None and message.get_srcSystem() == system and message.param_id in names:
                value = float(message.param_value)
                if message.param_type == 6:  # PX4 sends the bytes of an INT32 as if they were those of a float
                    value = float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])
                out[message.param_id] = value
    return out


def refusal(settings: Mapping[str, Any], parameters: Mapping[str, float]) -> str | None:
    """Return why a vehicle set up like this must not fly the card, or None."""
    if settings["interface"] == "manual_control":
        if parameters.get("COM_RC_IN_MODE") not in (6.0, 8.0):
            return (
                "COM_RC_IN_MODE 6 or 8 must hold (MAVLink before radio; PX4 1.17 and later), got "
                f"{parameters.get('COM_RC_IN_MODE', 'no answer')}"
            )
        if any(not parameters.get(n, 0.0) > 0.0 for n in (*SCALES, THROTTLE)):
            got = ", ".join(f"{n} {parameters.get(n, 'no answer')}" for n in (*SCALES, THROTTLE))
            return f"the scales of the sticks and the channel of the throttle must be set, got {got}"
    elif parameters.get("SYS_CTRL_ALLOC") != 0.0:
        return (
            "SYS_CTRL_ALLOC 0 must hold (PX4 1.13 with mixers): later versions move nothing by actuator controls, got "
            f"{parameters.get('SYS_CTRL_ALLOC', 'no answer')}"
        )
    if any(not 1.0 <= parameters.get(n, 0.0) <= 18.0 for n in STICKS):
        got = ", ".join(f"{n} {parameters.get(n, 'no answer')}" for n in STICKS)
        return f"the channels of the pilot's sticks must be set, so that they end a run, got {got}"
    return None


def main(settings: Mapping[str, Any], arguments: list[str] | None = None) -> int:
    """Connect, ask for telemetry, and fly the card; return 0 if it was flown to its end."""
    parser = argparse.ArgumentParser(description=f"Fly card {settings['card']}: {settings['title']}")
    parser.add_argument("--connect", default="udpin:127.0.0.1:14540", help="as pymavlink writes it, or a serial port")
    parser.add_argument("--baud", type=int, default=921600, help="of a serial port")
    parser.add_argument("--bench", action="store_true", help="on the ground: airspeed is not asked for")
    parser.add_argument("--timeout", type=float, default=600.0, help="s after which nobody waits for the switch")
    chosen = parser.parse_args(arguments)
    try:
        from pymavlink import mavutil
    except ImportError:
        print("error: this script needs pymavlink: pip install pymavlink", file=sys.stderr)
        return 2
    link = mavutil.mavlink_connection(chosen.connect, baud=chosen.baud, source_system=255, source_component=191)
    end = time.monotonic() + 30.0
    while not link.target_system and time.monotonic() < end:  # heartbeats of ground stations do not count
        link.wait_heartbeat(timeout=1.0)
    if not link.target_system:
        print("error: no heartbeat from an autopilot within 30 s", file=sys.stderr)
        return 3
    system = link.target_system
    settings = {**settings, "system_id": system}
    by_sticks = settings["interface"] == "manual_control"
    names = (*SCALES, THROTTLE, "COM_RC_IN_MODE") if by_sticks else ("SYS_CTRL_ALLOC",)
    parameters = read_parameters(link, system, (*names, *STICKS, "SDLOG_PROFILE"))
    reason = refusal(settings, parameters)
    if by_sticks and not reason:
        ends = tuple(f"RC{parameters[THROTTLE]:.0f}_{end}" for end in ("MIN", "MAX", "REV"))
        parameters |= read_parameters(link, system, ends)
        if not parameters.keys() >= set(ends) or not parameters[ends[0]] < parameters[ends[1]]:
            reason = f"the ends of the throttle's channel, {', '.join(ends)}, must be set and readable"
    if reason:
        print(f"error: {reason}", file=sys.stderr)
        return 3
    if int(parameters.get("SDLOG_PROFILE", 0.0)) & 24 != 24:
        print("note: SDLOG_PROFILE 25 logs commands and inertial data fast enough to identify from")
    for number in STREAMS.values():
        period_us = 1000.0 * settings["period_ms"]
        link.mav.command_long_send(system, 1, 511, 0, float(number), period_us, 0, 0, 0, 0, 0)
    card = Card(settings, link, parameters, lambda words: print(f"card {settings['card']}: {words}", flush=True))
    card.bench = chosen.bench
    return _play(card, link, settings["period_ms"] / 1000.0, chosen.timeout)


def _play(card: Card, link: Any, period_s: float, timeout_s: float) -> int:
    """Tick the card at its rate until it ends; return 0 if it was flown to its end."""
    words: list[str] = []
    inner = card.say

    def say(text: str) -> None:
        words.append(text)
        inner(text)

    card.say = say
    begun = due = time.monotonic()
    while card.state in ("offboard", "running") or time.monotonic() - begun < timeout_s:
        message = link.recv_match(blocking=True, timeout=max(due - time.monotonic(), 0.0) or 1e-4)
        now = time.monotonic()
        if message is not None:
            card.hear(message, now)
        if now >= due:
            due = max(due + period_s, now)
            if not card.tick(now):
                return 0 if words[-1] == "done" else 4
    print("nobody moved the switch")
    return 4


if __name__ == "__main__":
    sys.exit(main(SETTINGS))
