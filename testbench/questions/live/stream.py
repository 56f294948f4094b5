"""Where samples come from while an aircraft flies: a log played back or as it grows, a MAVLink link, a recording.

Every source is an iterator of :class:`Sample`, in the order of arrival. A source only listens.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import numpy as np

from testbench.core.door import read_text
from testbench.core.errors import MissingPackage, RecordError, missing
from testbench.core.store import OWN
from testbench.logs.mavlink import NEEDS_PYMAVLINK, values_of
from testbench.logs.signals import Mapped, find_channels
from testbench.questions.importing.ask import read_log
from testbench.questions.live.careful import Careful

GROW = (".ulg", ".bin", ".log", ".tlog", ".mcap")
"""Suffixes of logs that are written as an aircraft flies."""
RECORDING = "stream.jsonl"
"""Name of the samples of a session in its folder: a line each, in the order of arrival."""
_POLL_S = 0.2  # how often a file is looked at, and a port that is gone
_BACK_S = 2.0  # a clock since boot that falls by more has begun anew: messages overtake one another by less
_NEEDS_PYSERIAL = ("serial ports need pyserial", "logs")
_SHARE = 5.0  # times as long as reading a file took, it is left alone: a file that grows is read whole
_PWM_MID_US, _PWM_HALF_US = 1500.0, 500.0


class Sample(NamedTuple):
    """Channels (SI) that were taken at one time of the source's clock, s, and when they arrived, s."""

    t_s: float
    values: Mapping[str, float]
    arrived_s: float


class Source(NamedTuple):
    """A stream with its name, and whether it can be asked for other message rates.

    ``careful`` says how careful estimates of its runs are made: "beside" it, while it goes on; "awaited", where nobody
    flies while it waits; "" where none are, but those that it brings.
    """

    name: str
    samples: Iterator[Sample | Careful]
    radio: bool = False
    careful: Literal["beside", "awaited", ""] = ""


def open_source(
    place: str,
    throw_rad: Mapping[str, float],
    servos: Mapping[str, int],
    speed: float | None,
    replay: bool,
    idle_s: float,
    onboard: BinaryIO | None = None,
) -> Source:
    """Return the source that a place names.

    Args:
        place: "udp:14550", "serial:/dev/ttyUSB0:57600"; a folder that `testbench live` wrote; a log.
        throw_rad: control -> deflection at full command, rad; negative where full command moves it the other way.
        servos: control -> number of its servo output, of a MAVLink stream.
        speed: of a replay, over that of the flight; None: as fast as it can be read.
        replay: play a log that is whole; one of an autopilot, or in MCAP, is else followed as it grows.
        idle_s: a file that has not grown for so long has ended; so has a link that has been silent for so long.
        onboard: takes all messages of a MAVLink link as they arrive, as a telemetry log (.tlog) holds them.

    Raises:
        RecordError: there is no such log or link, or it cannot be read.
        MissingPackage: a link is to be read and pymavlink, or pyserial, is not installed.
    """
    kind, _, rest = place.partition(":")
    if kind == "udp":
        if not rest.isdecimal() or not 0 < int(rest) < 65536:
            raise RecordError(f"a port must be udp:NUMBER with a number from 1 to 65535, got '{place}'")
        heard = mavlink(f"udpin:0.0.0.0:{rest}", throw_rad, servos, idle_s, onboard=onboard)
        return Source(place, heard, radio=True, careful="beside")
    if kind == "serial":
        device, _, baud = rest.rpartition(":")
        if not device or not baud.isdecimal() or not 0 < int(baud) < 1e7:
            raise RecordError(f"a serial port must be serial:DEVICE:BAUD, as serial:/dev/ttyUSB0:57600, got '{place}'")
        name = f"serial:{Path(device).name}"
        heard = mavlink(device, throw_rad, servos, idle_s, int(baud), onboard)
        return Source(name, heard, radio=True, careful="beside")
    path = Path(place)
    if (path / RECORDING).is_file() and (path / OWN).is_dir():
        name = f"{path.resolve().name.removeprefix('live_')}_again"  # a folder of its own: this one is being read
        return Source(name, _paced(recorded(path / RECORDING), speed))
    if replay or path.suffix.lower() not in GROW:
        how: Literal["beside", "awaited"] = "awaited" if speed is None else "beside"
        return Source(path.stem, _paced(_merged(_channels(path, throw_rad)), speed), careful=how)
    return Source(path.stem, followed(path, throw_rad, idle_s), careful="beside")


def _channels(path: Path, throw_rad: Mapping[str, float]) -> Sequence[Mapped]:
    log, rules = read_log(path)
    found = find_channels(log, rules, throw_rad).channels
    if not found:
        raise RecordError(f"'{path}' must hold signals of the channel table, got none")
    return found


def _merged(channels: Sequence[Mapped], after_s: Mapping[str, float] | None = None) -> Iterator[Sample]:
    """Yield the samples of channels in the order of their times; of each only those after a time, if it is given."""
    after = after_s or {}
    kept = [(c.name, c.t_s, c.values, c.t_s > after.get(c.name, -np.inf)) for c in channels]
    t = np.concatenate([times[new] for _, times, _, new in kept])
    x = np.concatenate([values[new] for _, _, values, new in kept])
    of = np.repeat(np.arange(len(kept)), [int(new.sum()) for *_, new in kept])
    order = np.argsort(t, kind="stable")
    t, x, of = t[order], x[order], of[order]
    for part in np.split(np.arange(t.size), np.flatnonzero(np.diff(t) > 0.0) + 1):
        at = float(t[part[0]]) if part.size else 0.0
        values = {kept[of[i]][0]: float(x[i]) for i in part if np.isfinite(x[i])}
        if values:
            yield Sample(at, values, at)


def _paced(samples: Iterator[Sample | Careful], speed: float | None) -> Iterator[Sample | Careful]:
    """Yield samples no sooner than a clock that runs ``speed`` times as fast as theirs allows."""
    begun = first = None
    for sample in samples:
        if speed is not None and isinstance(sample, Sample):
            if begun is None or first is None:
                begun, first = time.monotonic(), sample.arrived_s
            wait = begun + (sample.arrived_s - first) / speed - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
        yield sample


def line_of(sample: Sample | Careful) -> str:
    """Return a sample, or a careful estimate where it arrived, as a line of a recording."""
    told = asdict(sample) if isinstance(sample, Careful) else [sample.t_s, sample.arrived_s, dict(sample.values)]
    return json.dumps(told) + "\n"


def recorded(file: Path) -> Iterator[Sample | Careful]:
    """Yield what a session has recorded; a last line that was not finished is left out.

    Raises:
        RecordError: a line is no sample.
    """
    lines = read_text(file, "recording").split("\n")
    for number, line in enumerate(lines[:-1], 1):
        try:
            told = json.loads(line)
            if isinstance(told, dict):
                yield Careful.read(told)
                continue
            t_s, arrived_s, values = told
            yield Sample(float(t_s), {str(k): float(v) for k, v in values.items()}, float(arrived_s))
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
            raise RecordError(
                f"line {number} of '{file}' must be [time, arrival, channels], got {line[:40]!r}"
            ) from error


def followed(path: Path, throw_rad: Mapping[str, float], idle_s: float) -> Iterator[Sample]:
    """Yield the samples of a log of an autopilot as it grows, until it has not grown for ``idle_s``.

    Raises:
        RecordError: there is no such file, or it has ended and no samples were found in it.
    """
    last: dict[str, float] = {}
    sources: dict[str, str] = {}
    size, grown_at, failed = -1, time.monotonic(), None
    while True:
        now = path.stat().st_size if path.is_file() else -1
        if now < 0 and not sources:
            raise RecordError(f"a log must be a file that exists, got '{path}'")
        if now == size:
            if time.monotonic() - grown_at > idle_s:
                if not sources and failed is not None:
                    raise failed
                return
            time.sleep(_POLL_S)
            continue
        size, grown_at = now, time.monotonic()
        try:
            found = [c for c in _channels(path, throw_rad) if sources.setdefault(c.name, c.source) == c.source]
        except RecordError as error:  # its head is not whole yet
            failed, found = error, []
        arrived = time.monotonic()
        for sample in _merged(found, last) if found else ():
            last.update(dict.fromkeys(sample.values, sample.t_s))
            yield sample._replace(arrived_s=arrived)
        time.sleep(_SHARE * (arrived - grown_at))


_MESSAGES = ("ATTITUDE", "HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "VFR_HUD", "AOA_SSA")
_HEARD = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "h")
REQUESTS = {"ATTITUDE": 30, "SCALED_IMU": 26, "SERVO_OUTPUT_RAW": 36, "VFR_HUD": 74, "AOA_SSA": 11020}
"""Message that identification lives on -> its number, for MAV_CMD_SET_MESSAGE_INTERVAL."""


def mavlink(
    address: str,
    throw_rad: Mapping[str, float],
    servos: Mapping[str, int],
    idle_s: float,
    baud: int = 57600,
    onboard: BinaryIO | None = None,
) -> Iterator[Sample]:
    """Return the samples that arrive on a MAVLink link; the first vehicle that is heard is the one.

    The time is that since boot which a message holds; of one without, arrival less the shortest delay so far. A vehicle
    that starts again goes on where its arrival puts it. A serial port that goes is opened again when it is there.

    Raises:
        MissingPackage: pymavlink is not installed, or pyserial, and a serial port is to be read.
        RecordError: the link cannot be opened.
    """
    try:
        from pymavlink import mavutil
    except ImportError as error:
        raise MissingPackage(missing(*NEEDS_PYMAVLINK)) from error

    def opened() -> Any:
        return mavutil.mavlink_connection(address, baud=baud, dialect="ardupilotmega")

    try:
        link = opened()
    except ImportError as error:
        raise MissingPackage(missing(*_NEEDS_PYSERIAL)) from error
    except (OSError, ValueError) as error:  # pyserial's of a baud rate is the latter
        said = getattr(error, "strerror", None) or error
        raise RecordError(f"port '{address}' cannot be opened: {said}; close what has it, or give another") from error
    return _heard(_messages(link, opened, idle_s, onboard), throw_rad, servos)


def _messages(link: Any, opened: Callable[[], Any], idle_s: float, onboard: BinaryIO | None) -> Iterator[Any]:
    """Yield messages of a link until it has been silent for ``idle_s``; it is opened again where it breaks."""
    heard = time.monotonic()
    try:
        while (left := heard + idle_s - time.monotonic()) > 0.0:
            try:
                link = link or opened()
                message = link.recv_match(blocking=True, timeout=min(left, _POLL_S))
            except (OSError, ValueError, TypeError):  # unplugged; pyserial has a few words for it
                if link is not None:
                    link.close()
                link = None
                time.sleep(min(left, _POLL_S))
                continue
            if message is None:
                continue
            heard = time.monotonic()
            if onboard is not None and message.get_type() != "BAD_DATA":
                onboard.write(round(1e6 * time.time()).to_bytes(8, "big") + bytes(message.get_msgbuf()))
            yield message
    finally:
        if link is not None:
            link.close()


def _heard(messages: Iterator[Any], throw_rad: Mapping[str, float], servos: Mapping[str, int]) -> Iterator[Sample]:
    system, delay, begun, last = None, np.inf, 0.0, -np.inf
    source: dict[str, str] = {}
    for m in messages:
        kind, arrived = m.get_type(), time.time()
        system = m.get_srcSystem() if system is None and kind in _MESSAGES else system
        if m.get_srcSystem() != system:
            continue
        values = {n: x for n, x in values_of(m).items() if n in _HEARD} if kind in _MESSAGES else {}
        if kind == "SERVO_OUTPUT_RAW":
            values = _deflections(m, throw_rad, servos)
        values = {n: float(x) for n, x in values.items() if source.setdefault(n, kind) == kind and np.isfinite(x)}
        if not values:
            continue
        boot = getattr(m, "time_boot_ms", None)
        if boot is not None:
            if boot * 1e-3 + begun < last - _BACK_S:  # it has started again
                begun = arrived - delay - boot * 1e-3
            taken = last = boot * 1e-3 + begun
            delay = min(delay, arrived - taken)
        elif np.isfinite(delay):
            taken = arrived - delay
        else:
            continue
        yield Sample(taken, values, arrived)


def _deflections(m: Any, throw_rad: Mapping[str, float], servos: Mapping[str, int]) -> dict[str, float]:
    out = {}
    for control, number in servos.items():
        share = (getattr(m, f"servo{number}_raw", 0) - _PWM_MID_US) / _PWM_HALF_US
        if abs(share) <= 1.5:  # 0: the output is not used
            thr = control == "thr"
            out[f"{control}_cmd"] = 0.5 * (share + 1.0) if thr else share * throw_rad.get(control, np.nan)
    return out
