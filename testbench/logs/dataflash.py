"""ArduPilot logs (DataFlash .bin and .log): which messages are whole, and their columns.

Format: ArduPilot, "Diagnosing problems using Logs", and the comments of AP_Logger. A message is A3 95, its type and a
body whose layout an earlier FMT message gives; FMTU, UNIT and MULT messages give the units of its columns and what they
are multiplied by. What the columns mean stands in :mod:`testbench.logs.ardupilot`.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.door import read_bytes
from testbench.core.errors import RecordError
from testbench.logs import chain
from testbench.logs.ardupilot import COLUMNS
from testbench.logs.signals import Log, Topic, dropped_in_words, make_topic

HEAD = b"\xa3\x95"
_TYPES = {
    "a": "V64", "b": "<i1", "B": "<u1", "g": "<f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "d": "<f8",
    "M": "<i1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
_SIZES = {code: np.dtype(kind).itemsize for code, kind in _TYPES.items()}
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1.0 / 1e-7}
"""By which integers of these codes are divided; text logs hold the quotient."""
_WORDS = "anNZ"
_TEXT = _WORDS + "M"  # of text logs: the mode is written as a word
_WHOLE = "bBhHiIqQ"
_OWN = ("PARM", "MSG", "VER", "FMTU", "UNIT", "MULT")
"""Messages about the log itself."""
_FIRMWARE = re.compile(r"\b(Ardu|APM:|Blimp|AntennaTracker|Rover|Tracker)\w*\s+V?\d")
_CLOCKS = {"TimeUS": 1e-6, "TimeMS": 1e-3}
_INSTANCE = ("I", "C", "Instance")
_FOLLOWED = "SERVO"  # settings whose changes in flight matter to what is read


@dataclass(frozen=True)
class Layout:
    """Name, codes of the columns, their names and the bytes of a type of message."""

    name: str
    codes: str
    columns: tuple[str, ...]
    length: int

    def offset(self, column: str) -> int:
        """Return the bytes from the beginning of a message to a column."""
        return 3 + sum(_SIZES[code] for code in self.codes[: self.columns.index(column)])


_FMT = Layout("FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"), 89)
_FMT_TYPE = 0x80
"""Layout and type of the messages that give layouts; a log need not give them."""


@dataclass(frozen=True, eq=False)
class Messages:
    """What was found whole: the columns of each type that was asked for, how many there are of each, and the damage.

    ``columns`` maps type -> column -> (n,) values or (n,) texts (bytes), in the order of the file.
    """

    columns: Mapping[str, Mapping[str, NDArray[Any]]]
    counts: Mapping[str, int]
    damage: tuple[str, ...]
    kinds: Mapping[int, Layout] = field(default_factory=dict)


def read_dataflash(path: Path | str) -> Log:
    """Read an ArduPilot log, binary or text.

    Raises:
        RecordError: the file is no such log or holds nothing that can be read.
    """
    path = Path(path)
    whole = read_bytes(path, "log")
    binary = HEAD in whole[:4096]
    found = binary_messages(whole) if binary else text_messages(whole)
    del whole
    if not set(found.counts) - {"FMT"}:
        raise RecordError(
            f"'{path}' must be an ArduPilot log, but it holds no message whose format it gives (FMT); "
            "is it another kind of file, or is its beginning lost?"
        )
    topics, lost = _topics(found)
    if not topics:
        raise RecordError(
            f"'{path}' must hold messages of a flight ({', '.join(COLUMNS)}), but none could be saved; "
            f"it holds {', '.join(sorted(found.counts))}"
        )
    damage = list(found.damage)
    if damage:
        end = max(float(topic.t_s[-1]) for topic in topics.values())
        damage[-1] += f"; saved: {sum(found.counts.values())} messages, up to t = {end:.3f} s of the log's clock"
    parameters, changed = _parameters(found.columns.get("PARM", {}))
    software = _software(found)
    facts = {"software": software} if software else {}
    unread = {name: n for name, n in found.counts.items() if name not in (*COLUMNS, *_OWN, "FMT")}
    kind = f"ArduPilot DataFlash ({'binary' if binary else 'text'})"
    return Log(path, kind, topics, facts, parameters, (*damage, *lost), unread, notes=tuple(changed))


def _software(found: Messages) -> str:
    """Return the firmware: that of VER, else the first message that is called after one, else the first message."""
    named = found.columns.get("VER", {}).get("FWS", ())
    said = [_word(text) for text in (*named, *found.columns.get("MSG", {}).get("Message", ()))]
    return next((text for text in said if _FIRMWARE.search(text)), said[0] if said else "")


def _parameters(columns: Mapping[str, NDArray[Any]]) -> tuple[dict[str, float], list[str]]:
    """Return the last value of every setting, and sentences on those of servos that were changed."""
    settings: dict[str, float] = {}
    changed: dict[str, str] = {}
    for name, value in zip(columns.get("Name", ()), columns.get("Value", ()), strict=False):
        key, new = _word(name), float(value)
        if settings.get(key, new) != new and key.startswith(_FOLLOWED):
            changed[key] = f"{key} was changed while the log ran; its last value, {new:g}, is taken for all of it"
        settings[key] = new
    return settings, list(changed.values())


def _word(raw: bytes) -> str:
    raw = raw.split(b"\0")[0]
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _topics(found: Messages) -> tuple[dict[str, Topic], list[str]]:
    units, factors = _units(found)
    topics: dict[str, Topic] = {}
    said = []
    for name, columns in found.columns.items():
        clock = next((key for key in _CLOCKS if key in columns), None)
        if clock is None or name in _OWN:
            continue
        t = _CLOCKS[clock] * columns[clock].astype(np.float64)
        numbers = {key: values for key, values in columns.items() if key != clock and values.dtype.kind in "iuf"}
        with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN, which complains as it is cast
            for key in factors.get(name, {}).keys() & numbers.keys():
                numbers[key] = factors[name][key] * numbers[key].astype(np.float64)
        for suffix, part in _instances(name, numbers, t.size):
            one = numbers if part is None else {key: values[part] for key, values in numbers.items()}
            topic, lost = make_topic(name + suffix, t if part is None else t[part], one, units.get(name))
            said.append(lost)
            if topic.t_s.size:
                topics[name + suffix] = topic
    return topics, dropped_in_words(said)


def _instances(name: str, numbers: Mapping[str, NDArray[Any]], size: int) -> list[tuple[str, NDArray[np.intp] | None]]:
    """Return suffix and rows of each instance of a message: "" for the first sensor or core, "#1" for the second."""
    key = next((key for key in _INSTANCE if key in numbers), None)
    if key is None or name in ("RCOU", "RCO2", "RCO3") or not size:
        return [("", None)]
    which = numbers[key]
    values = np.unique(which[np.isfinite(which)])
    if values.size == 1:
        return [(f"#{values[0]:g}" if values[0] else "", None)]
    return [(f"#{value:g}" if value else "", np.flatnonzero(which == value)) for value in values]


def _units(found: Messages) -> tuple[dict[str, dict[str, str]], dict[str, dict[str, float]]]:
    """Return type -> column -> unit, and type -> column -> factor where it is not one, as the log states them."""
    unit, mult, of = (found.columns.get(name, {}) for name in ("UNIT", "MULT", "FMTU"))
    labels = {int(i): _word(label) for i, label in zip(unit.get("Id", ()), unit.get("Label", ()), strict=False)}
    # a single-precision number widened to a double: its seven digits are what was meant
    sizes = {int(i): float(f"{m:.7g}") for i, m in zip(mult.get("Id", ()), mult.get("Mult", ()), strict=False)}
    units: dict[str, dict[str, str]] = {}
    factors: dict[str, dict[str, float]] = {}
    for kind, ids, scales in zip(*(of.get(key, ()) for key in ("FmtType", "UnitIds", "MultIds")), strict=False):
        layout = found.kinds.get(int(kind))
        if layout is None or layout.name not in COLUMNS:
            continue
        columns, codes = layout.columns, layout.codes
        units[layout.name] = {c: labels.get(i, "") for c, i in zip(columns, ids, strict=False)}
        factors[layout.name] = {
            c: sizes[i]
            for c, code, i in zip(columns, codes, scales, strict=False)
            if code not in _DIVISORS and c not in _CLOCKS and sizes.get(i, 0.0) not in (0.0, 1.0)
        }
    return units, factors


def _used(name: str) -> Collection[str]:
    """Return the columns of a type of message that are read; all of those about the log itself."""
    if name in COLUMNS:
        return (*COLUMNS[name], *_CLOCKS, *_INSTANCE)
    return (
        ("Name", "Value", "Message", "FWS", "FmtType", "UnitIds", "MultIds", "Id", "Label", "Mult")
        if name in _OWN
        else ()
    )


class _Reader:
    """The state of a walk through a binary log."""

    def __init__(self, whole: bytes) -> None:
        self.whole = whole
        self.bytes = np.frombuffer(whole, np.uint8)
        self.kinds: dict[int, Layout] = {_FMT_TYPE: _FMT}
        self.lengths = np.zeros(256, np.int64)  # of what runs; FMT breaks a run, because it changes what follows
        self.places: list[chain.Places] = []
        self.types: list[NDArray[np.uint8]] = []
        self.counts: Counter[str] = Counter()
        self.found: dict[str, list[tuple[Layout, chain.Places]]] = {}
        self.damage: list[str] = []

    def walk(self) -> int:
        """Take every whole message; return how many bytes belong to none.

        A message is whole if its format is known, and if another message or the end follows it or no other message
        begins inside it.
        """
        whole, size = self.whole, len(self.whole)
        done, skipped, high = 0, 0, 0  # end of what was looked at, of it in no message, end of what was searched
        starts, types = self._heads(0, 0)
        while True:
            i = int(np.searchsorted(starts, done))
            if i == starts.size:
                if high >= size:
                    break
                low, high = max(done, high), max(done, high) + chain.CHUNK
                starts, types = self._heads(low, high)
                continue
            at = int(starts[i])
            skipped += at - done
            n = chain.run_length(starts, partial(self._ends, starts, types), i)
            if n:
                self._take(starts[i : i + n], types[i : i + n])
                done = int(starts[i + n])
                continue
            layout = self.kinds.get(int(types[i]))
            done = at + (layout.length if layout else 0)
            if layout is None or (done < size and whole[done : done + 2] != HEAD and self._begins(at, done)):
                done = at + 2
                skipped += 2
            elif done > size:
                self.damage.append(f"the file ends in the middle of a message ({layout.name}); it was cut short")
                return skipped
            elif layout.name != "FMT":
                self._take(starts[i : i + 1], types[i : i + 1])
            elif self._learn(whole[at + 3 : done]):
                self.counts["FMT"] += 1
            else:
                skipped += done - at
        tail = whole[done:]
        padding = not tail.strip(b"\x00") or not tail.strip(b"\xff")  # loggers on flash chips fill the last page
        return skipped + (0 if padding else len(tail))

    def _heads(self, low: int, high: int) -> tuple[chain.Places, NDArray[np.uint8]]:
        """Return where A3 95 and a type begin in a stretch of the file, and the types."""
        part = self.bytes[low : high + 1]
        first = np.flatnonzero((part[:-1] == HEAD[0]) & (part[1:] == HEAD[1])) + low
        first = first[first + 2 < self.bytes.size]
        return first, self.bytes[first + 2]

    def _ends(self, starts: chain.Places, types: NDArray[np.uint8], a: int, b: int) -> chain.Places:
        return np.asarray(starts[a:b] + self.lengths[types[a:b]])

    def _take(self, places: chain.Places, types: NDArray[np.uint8]) -> None:
        self.places.append(places)
        self.types.append(types)

    def _begins(self, start: int, end: int) -> bool:
        """Say whether a message of a known type begins inside another."""
        inner = self.whole.find(HEAD, start + 3, end)
        return inner >= 0 and inner + 2 < len(self.whole) and self.whole[inner + 2] in self.kinds

    def _learn(self, body: bytes) -> bool:
        """Take the layout from an FMT message; say whether it is one that can be."""
        if len(body) + 3 != _FMT.length:
            return False
        kind, length, name, codes, columns = struct.unpack("<BB4s16s64s", body)
        texts = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, codes, columns)]
        if not texts[0].isalnum() or not _fits(texts[1], texts[2]):
            return False
        if length != 3 + sum(_SIZES[code] for code in texts[1]):
            return False
        layout = Layout(texts[0], texts[1], tuple(texts[2].split(",")), length)
        if (kind == _FMT_TYPE) != (layout.name == "FMT"):
            return False
        if self.kinds.get(kind, layout) != layout:
            self.settle()
        self.kinds[kind] = layout
        self.lengths[kind] = 0 if layout.name == "FMT" else length
        return True

    def settle(self) -> None:
        """Give what was taken since the last time to the layouts that hold for it."""
        if not self.places:
            return
        for kind, places in chain.grouped(np.concatenate(self.types), np.concatenate(self.places)).items():
            layout = self.kinds[kind]
            self.counts[layout.name] += places.size
            if _used(layout.name):
                self.found.setdefault(layout.name, []).append((layout, places))
        self.places, self.types = [], []


def binary_messages(whole: bytes) -> Messages:
    """Return what is whole in a binary log."""
    reader = _Reader(whole)
    skipped = reader.walk()
    reader.settle()
    damage = reader.damage
    if skipped:
        damage = [f"{skipped} of {len(whole)} bytes belong to no whole message and were left out", *damage]
    columns = {name: _columns(reader.bytes, parts) for name, parts in reader.found.items()}
    return Messages(columns, dict(reader.counts), tuple(damage), reader.kinds)


def _columns(whole: NDArray[np.uint8], parts: Sequence[tuple[Layout, chain.Places]]) -> dict[str, NDArray[Any]]:
    """Return the columns that are read of one type of message; where its layout changed, those of the first."""
    first = parts[0][0]
    parts = [(layout, places) for layout, places in parts if layout.columns == first.columns]
    out: dict[str, NDArray[Any]] = {}
    for column, code in zip(first.columns, first.codes, strict=True):
        if column in _used(first.name) and code != "a":
            out[column] = np.concatenate([_column(whole, layout, places, column) for layout, places in parts])
    return out


def _column(whole: NDArray[np.uint8], layout: Layout, places: chain.Places, column: str) -> NDArray[Any]:
    code = layout.codes[layout.columns.index(column)]
    values = chain.field(whole, places, layout.offset(column), _TYPES[code])
    return values.astype(np.float64) / _DIVISORS[code] if code in _DIVISORS else values


def _fits(codes: str, columns: str) -> bool:
    return set(codes) <= set(_SIZES) and len(columns.split(",")) == len(codes)


def text_messages(whole: bytes) -> Messages:
    """Return what is whole in a text log: the lines that fit the format given for their type."""
    kinds: dict[int, Layout] = {}
    layouts = {"FMT": _FMT}
    rows: dict[str, list[list[str]]] = {}
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
            if not own:
                layout = Layout(cells[3], cells[4], tuple(cells[5:]), 0)
                layouts[cells[3]] = kinds[int(cells[1])] = layout
        elif (
            not line.isprintable()
            or "\ufffd" in line
            or name not in layouts
            or not _readable(cells[1:], layouts[name].codes)
        ):
            bad += 1
            continue
        counts[name] += 1
        if name in _OWN or name in COLUMNS:
            wide = 1 + len(layouts[name].codes)
            last = ", ".join(cells[wide - 1 :])  # a text may hold commas
            rows.setdefault(name, []).append([*cells[1 : wide - 1], last if name == "MSG" else cells[wide - 1]])
    damage = [f"{bad} of {len(lines)} lines fit no format given and were left out"] if bad else []
    damage += ["the file ends in the middle of a line, which was left out; it was cut short"] if cut else []
    columns = {name: _text_columns(layouts[name], part) for name, part in rows.items()}
    return Messages(columns, dict(counts), tuple(damage), kinds)


def _text_columns(layout: Layout, rows: Sequence[Sequence[str]]) -> dict[str, NDArray[Any]]:
    out: dict[str, NDArray[Any]] = {}
    rows = [row for row in rows if len(row) == len(layout.codes)]
    for column, code, cells in zip(layout.columns, layout.codes, zip(*rows, strict=True), strict=False):
        if column in _used(layout.name):
            words = code in _TEXT
            out[column] = np.array([cell.encode() if words else float(cell) for cell in cells])
    return out


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
