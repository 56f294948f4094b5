"""ArduPilot logs (DataFlash .bin and .log) read with pymavlink, and how ArduPilot's messages become channels.

Format: ArduPilot, "Diagnosing problems using Logs", and the comments of AP_Logger. A message is A3 95, its type and a
body whose layout an earlier FMT message gives. Frames: body forward-right-down, angles in degrees, servo pulses in
microseconds; demands are positive for rolling right, nose up, nose right (from memory).
"""

from __future__ import annotations

import contextlib
import io
import struct
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.signals import BROKEN, NEEDS_LOGS, Log, Rule, Topic, make_topic, scaled

HEAD = b"\xa3\x95"
_SIZES = dict(
    zip("abBghHiIfnNZcCeELdMqQ", (64, 1, 1, 2, 2, 2, 4, 4, 4, 4, 16, 64, 2, 2, 4, 4, 4, 8, 1, 8, 8), strict=True)
)
_TEXT = "anNZM"  # of text logs: the mode is written as a word
_WHOLE = "bBhHiIqQ"
_FMT, _FMT_LENGTH = 0x80, 89
_AT_IMU = "the inertial unit sits at the centre of gravity"
_DEMAND = "4500 is full command, positive nose up, right wing down, nose right"
_ONE, _MINUS, _DEG = scaled(1.0), scaled(-1.0), scaled(DEG_RAD)

RULES = (
    *(Rule(n, "IMU", (f"Gyr{a}",), _ONE, "rad/s, as logged") for n, a in zip("pqr", "XYZ", strict=True)),
    *(Rule(n, "ATT", (f,), _DEG, "deg") for n, f in (("phi", "Roll"), ("theta", "Pitch"), ("psi", "Yaw"))),
    *(Rule(f"a{a.lower()}", "IMU", (f"Acc{a}",), _ONE, "m/s2, as logged", _AT_IMU) for a in "XYZ"),
    Rule("alpha", "AOA", ("AOA",), _DEG, "deg", "the vane measures the flow at the centre of gravity"),
    Rule("beta", "AOA", ("SSA",), _DEG, "deg", "the vane measures the flow at the centre of gravity"),
    Rule("V", "ARSP", ("Airspeed",), _ONE, "m/s, airspeed as logged", "true airspeed is the airspeed logged, which is "
         "indicated: right at sea level, 5 % too low at 1000 m"),
    Rule("qbar", "ARSP", ("DiffPress",), _ONE, "Pa", "incompressible: qbar is the differential pressure"),
    Rule("h", "POS", ("Alt",), _ONE, "m above sea level"),
    Rule("h", "BARO", ("Alt",), _ONE, "m, barometric", "the height counts from where the autopilot started"),
    *(Rule("hdot", k, ("VD",), _MINUS, "m/s, minus the velocity downwards") for k in ("XKF1", "NKF1", "EKF1")),
    Rule("hdot", "GPS", ("VZ",), _MINUS, "m/s, minus the velocity downwards"),
    Rule("Vg", "GPS", ("Spd",), _ONE, "m/s"),
    *(Rule(n, k, (f,), _ONE, "m, from the origin of the filter") for k in ("XKF1", "NKF1")
      for n, f in (("north", "PN"), ("east", "PE"))),
    *(Rule(n, k, (f,), _ONE, "m/s, estimated by ArduPilot") for k in ("XKF2", "NKF2")
      for n, f in (("wind_north", "VWN"), ("wind_east", "VWE"))),
    Rule("de_cmd", "AETR", ("Elev",), scaled(-1.0 / 4500.0), "minus the demand / 4500 times full throw", _DEMAND),
    Rule("da_cmd", "AETR", ("Ail",), scaled(1.0 / 4500.0), "the demand / 4500 times full throw", _DEMAND),
    Rule("dr_cmd", "AETR", ("Rudd",), scaled(-1.0 / 4500.0), "minus the demand / 4500 times full throw", _DEMAND),
    Rule("thr_cmd", "AETR", ("Thr",), scaled(PERCENT), "%"),
)  # fmt: skip
"""What needs no setting of the autopilot; :func:`servo_rules` adds the servo outputs."""
_SERVOS = {"da": (4, 1, 1.0), "de": (19, 2, -1.0), "thr": (70, 3, 1.0), "dr": (21, 4, -1.0)}
"""Surface: SERVOn_FUNCTION, usual output, sign from the demand to the channel table."""
_WANTED = ("IMU", "ATT", "AOA", "ARSP", "POS", "BARO", "XKF1", "NKF1", "EKF1", "GPS", "XKF2", "NKF2", "AETR", "RCOU")
_INSTANCE = ("I", "C", "Instance")


def servo_rules(parameters: Mapping[str, float]) -> tuple[Rule, ...]:
    """Return the rules for servo pulses (RCOU): their output, centre, ends and sense from the settings of the log."""
    rules = []
    for name in CONTROLS:
        function, usual, sign = _SERVOS[name]
        outputs = [i for i in range(1, 17) if parameters.get(f"SERVO{i}_FUNCTION") == function]
        i = outputs[0] if outputs else usual
        low, trim, high = (
            parameters.get(f"SERVO{i}_{key}", value) for key, value in (("MIN", 1000.0), ("TRIM", 1500.0), ("MAX", 2e3))
        )
        if not low < high or (name != "thr" and not low < trim < high):
            continue
        sense = -sign if parameters.get(f"SERVO{i}_REVERSED") == 1 else sign
        pulse: Callable[..., FloatArray] = partial(_throttle, low=low, high=high, reversed_=sense < 0.0)
        if name != "thr":
            pulse = partial(_deflection, low=low, trim=trim, high=high, sense=sense)
        said = f"servo {i}, {low:g} to {high:g} us" + (f", centre {trim:g} us" if name != "thr" else "")
        guess = "" if outputs else f"output {i} drives it and its ends are those, as is usual; no setting says so"
        rules.append(Rule(f"{name}_cmd", "RCOU", (f"C{i}",), pulse, said, guess))
    return tuple(rules)


def _deflection(pulse: FloatArray, low: float, trim: float, high: float, sense: float) -> FloatArray:
    off = pulse - trim
    return sense * np.where(off > 0.0, off / (high - trim), off / (trim - low))


def _throttle(pulse: FloatArray, low: float, high: float, reversed_: bool) -> FloatArray:
    part = (pulse - low) / (high - low)
    return 1.0 - part if reversed_ else part


def read_dataflash(path: Path | str) -> Log:
    """Read an ArduPilot log, binary or text.

    Damaged messages are left out before pymavlink sees them, because it stops at some of them.

    Raises:
        RecordError: pymavlink is not installed, or the file is no such log or holds nothing that can be read.
    """
    path = Path(path)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            from pymavlink import DFReader
    except ImportError as error:
        raise RecordError(
            f"'{path}' cannot be read: ArduPilot logs {NEEDS_LOGS.format(package='pymavlink')}"
        ) from error
    whole = path.read_bytes()
    binary = HEAD in whole[:4096]
    clean, counts, damage = intact_messages(whole) if binary else intact_lines(whole)
    if not clean:
        raise RecordError(
            f"'{path}' must be an ArduPilot log, but it holds no message whose format it gives (FMT); "
            "is it another kind of file, or is its beginning lost?"
        )
    raw: dict[str, dict[str, list[Any]]] = {}
    parameters: dict[str, float] = {}
    said = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        part = Path(folder) / path.name
        part.write_bytes(clean)
        damage += _read(DFReader.DFReader_binary if binary else DFReader.DFReader_text, part, raw, parameters)
    facts = {"software": str(raw["MSG"]["Message"][0])} if raw.get("MSG", {}).get("Message") else {}
    topics, lost = _topics(raw)
    if not topics:
        held = ", ".join(sorted(counts))
        raise RecordError(
            f"'{path}' must hold messages of a flight ({', '.join(_WANTED)}), but none could be saved; it holds {held}"
        )
    if damage:
        end = max(float(topic.t_s[-1]) for topic in topics.values())
        damage[-1] += f"; saved: {sum(counts.values())} messages, up to t = {end:.3f} s of the log's clock"
    unread = {name: n for name, n in counts.items() if name not in (*_WANTED, "PARM", "MSG", "FMT")}
    kind = f"ArduPilot DataFlash ({'binary' if binary else 'text'})"
    return Log(path, kind, topics, facts, parameters, (*damage, *lost), unread)


def _read(
    opener: Callable[..., Any], part: Path, raw: dict[str, dict[str, list[Any]]], parameters: dict[str, float]
) -> list[str]:
    """Fill the columns and parameters from a file; return what went wrong, in sentences."""
    damage = []
    reader = None
    try:
        reader = opener(str(part), zero_time_base=True)
        while (message := reader.recv_match(type=["PARM", "MSG", *_WANTED], strict=True)) is not None:
            _keep(message, raw)
    except BROKEN as error:
        damage.append(f"the file is damaged so that reading broke off ({type(error).__name__})")
    if reader is not None:
        parameters.update({str(k): float(v) for k, v in reader.params.items() if isinstance(v, int | float)})
        reader.close()
        reader.filehandle.close()
    return damage


def _keep(message: Any, raw: dict[str, dict[str, list[Any]]]) -> None:
    """Add a message to the columns of its topic; a number that cannot be read becomes NaN."""
    names = message.get_fieldnames()
    values: dict[str, Any] = {}
    for name, code in zip(names, message.fmt.format, strict=False):
        try:
            values[name] = getattr(message, name)
        except (ValueError, TypeError):
            values[name] = "" if code in "anNZ" else float("nan")
    topic = message.get_type()
    for key in _INSTANCE:
        if values.get(key) and topic != "RCOU":
            topic += f"#{values[key]:g}" if isinstance(values[key], int | float) else ""
    columns = raw.setdefault(topic, {name: [] for name in values})
    if columns.keys() == values.keys():
        for name, value in values.items():
            columns[name].append(value)


def _topics(raw: Mapping[str, Mapping[str, list[Any]]]) -> tuple[dict[str, Topic], list[str]]:
    topics: dict[str, Topic] = {}
    said = []
    for name, columns in raw.items():
        clock, factor = ("TimeUS", 1e-6) if "TimeUS" in columns else ("TimeMS", 1e-3)
        if clock not in columns or name in ("PARM", "MSG"):
            continue
        numbers = {
            key: np.array(column, dtype=np.float64)
            for key, column in columns.items()
            if key != clock and all(isinstance(value, int | float) for value in column)
        }
        topic, lost = make_topic(name, factor * np.array(columns[clock], dtype=np.float64), numbers)
        if lost:
            said.append(lost)
        if topic.t_s.size:
            topics[name] = topic
    return topics, said


def intact_messages(whole: bytes) -> tuple[bytes, dict[str, int], list[str]]:
    """Return the messages of a binary log that are whole, their number by type, and what is wrong, in sentences.

    A message counts as whole if its format is known, and if another message or the end follows it or no other message
    begins inside it.
    """
    lengths: dict[int, tuple[str, int]] = {_FMT: ("FMT", _FMT_LENGTH)}
    keep: list[bytes] = []
    counts: Counter[str] = Counter()
    damage: list[str] = []
    at, skipped, size = 0, 0, len(whole)
    while (found := whole.find(HEAD, at)) >= 0 and found + 3 <= size:
        skipped += found - at
        at = found
        name, length = lengths.get(whole[at + 2], ("", 0))
        end = at + length
        if not length or (
            end <= size and end < size and whole[end : end + 2] != HEAD and _begins(whole, at, end, lengths)
        ):
            at, skipped = at + 2, skipped + 2
            continue
        if end > size:
            damage.append(f"the file ends in the middle of a message ({name}); it was cut short")
            at = size
            break
        body = whole[at:end]
        if name != "FMT" or _learn(body, lengths):
            keep.append(body)
            counts[name] += 1
        else:
            skipped += length
        at = end
    tail = whole[at:]
    padding = not tail.strip(b"\x00") or not tail.strip(b"\xff")  # loggers on flash chips fill the last page
    skipped += 0 if padding else len(tail)
    if skipped:
        damage.insert(0, f"{skipped} of {size} bytes belong to no whole message and were left out")
    useful = set(counts) - {"FMT"}
    return (b"".join(keep) if useful else b""), dict(counts), damage


def _begins(whole: bytes, start: int, end: int, lengths: Mapping[int, tuple[str, int]]) -> bool:
    inner = whole.find(HEAD, start + 3, end)
    return inner >= 0 and inner + 2 < len(whole) and whole[inner + 2] in lengths


def _learn(body: bytes, lengths: dict[int, tuple[str, int]]) -> bool:
    """Take the layout from an FMT message; say whether it is one that can be."""
    kind, length, name, layout, columns = struct.unpack("<BB4s16s64s", body[3:])
    texts = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, layout, columns)]
    if not texts[0].isalnum() or not _fits(texts[1], texts[2]):
        return False
    if length != 3 + sum(_SIZES[code] for code in texts[1]):
        return False
    lengths[kind] = (texts[0], length)
    return True


def _fits(layout: str, columns: str) -> bool:
    return set(layout) <= set(_SIZES) and len(columns.split(",")) == len(layout)


def intact_lines(whole: bytes) -> tuple[bytes, dict[str, int], list[str]]:
    """Return the lines of a text log that fit the format given for their type, their numbers, and what is wrong."""
    layouts = {"FMT": "BBnNZ"}
    keep: list[str] = []
    counts: Counter[str] = Counter()
    bad = 0
    lines = whole.decode("utf-8", "replace").splitlines()
    cut = bool(lines) and not whole.endswith((b"\n", b"\r"))  # the last number may have lost digits
    for line in lines[:-1] if cut else lines:
        cells = [cell.strip() for cell in line.split(",")]
        name = cells[0]
        if not line.strip():
            continue
        if name == "FMT" and len(cells) >= 6 and cells[1].isdigit() and cells[2].isdigit():
            own = cells[3] == "FMT"  # old logs name one column too few for it
            if not (set(cells[4]) <= set(_SIZES) if own else _fits(cells[4], ",".join(cells[5:]))):
                bad += 1
                continue
            layouts[cells[3]] = cells[4]
        elif not line.isprintable() or "\ufffd" in line or not _readable(cells[1:], layouts.get(name, "")):
            bad += 1
            continue
        keep.append(f"{name}, {', '.join(cells[1:5])}, {','.join(cells[5:])}" if name == "FMT" else ", ".join(cells))
        counts[name] += 1
    damage = [f"{bad} of {len(lines)} lines fit no format given and were left out"] if bad else []
    damage += ["the file ends in the middle of a line, which was left out; it was cut short"] if cut else []
    useful = set(counts) - {"FMT"}
    return ("\n".join(keep) + "\n").encode() if useful else b"", dict(counts), damage


def _readable(cells: Sequence[str], layout: str) -> bool:
    """Say whether the cells are as many as the layout has, and numbers where it has numbers."""
    if not layout or len(cells) < len(layout):
        return False
    try:
        for cell, code in zip(cells, layout, strict=False):
            if code in _WHOLE:
                int(cell)
            elif code not in _TEXT:
                float(cell)
    except ValueError:
        return False
    return True
