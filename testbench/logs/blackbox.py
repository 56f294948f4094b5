"""Blackbox logs of Betaflight and iNav (.bbl, .bfl): headers in text, then frames of differences in few bytes each.

Frames: I holds whole values, P differences against those before it, S and G what changes seldom (modes, GPS), H the
home position, E events (Betaflight's documentation, "Blackbox internals"). The library orangebox knows how a field is
coded and predicted. What is damaged is judged here by the laws of blackbox_decode, because the library goes on with the
differences after a frame was lost, and then every value is wrong: after damage, and before the first I, no P counts.

The columns are called, and have the units, that blackbox_decode gives them, so that a log is read by the same table of
the catalogue (``writers/blackbox.toml``) in either form.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.door import read_bytes, require_room
from testbench.core.errors import MissingPackage, RecordError, missing
from testbench.core.files import parsed
from testbench.core.record import FloatArray
from testbench.logs.signals import MIN_SAMPLES
from testbench.logs.tables import Table

MAGIC = b"H Product:Blackbox"
_HEADER = re.compile(rb"H ([^:\n]{1,60}):([^\n]*)\n")
_FIELD = re.compile(r"Field ([IPSGH]) (name|predictor|encoding)")
_READ = re.compile(r"loopIteration|(gyroADC|accSmooth|attitude|servo|motor|navPos|navVel|GPS_\w+)(\[\d\])?"
                   r"|rcCommand\[\d\]|BaroAlt|airSpeed")  # fmt: skip
_LONGEST = 256  # bytes of a frame
_JUMP_US, _JUMP_FRAMES = 10_000_000, 5000  # beyond them a frame is none, however well it can be read
_WRAP_US = 1 << 32  # the clock counts microseconds in 32 bits
_LATITUDE, _HOME, _HOME_EAST = "GPS_coord[1]", 7, 256  # the library's own number for the second home coordinate
_GPS_UNITS = {"GPS_speed": (0.01, "m/s"), "GPS_coord[0]": (1e-7, "deg"), "GPS_coord[1]": (1e-7, "deg"),
              "GPS_ground_course": (0.1, "deg")}  # fmt: skip
_BY_HAND = "make a table of it: blackbox_decode FILE (https://github.com/iNavFlight/blackbox-tools)"


class Flight(NamedTuple):
    """One flight of a blackbox: its table, what its headers say, and what was not read or lost.

    ``facts`` are words and ``parameters`` numbers of the headers, ``unread`` fields that are no motion, with the number
    of their samples; ``notes`` name the other flights of the file, ``warnings`` what is damaged.
    """

    table: Table
    facts: Mapping[str, str]
    parameters: Mapping[str, float]
    unread: Mapping[str, int]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def read_blackbox(path: Path, part: str | None = None) -> Flight:
    """Read a flight of a blackbox log, which holds one for every time that the vehicle was armed.

    Args:
        path: the file.
        part: number of the flight, from 1, as text; the longest if not given.

    Raises:
        RecordError: there is no such flight, it holds no whole frame, or fields in a coding that is not known.
        MissingPackage: orangebox is not installed.
    """
    try:
        import orangebox  # noqa: F401
    except ImportError as error:
        raise MissingPackage(
            f"{missing('the blackbox of Betaflight and iNav needs orangebox', 'logs')}, or {_BY_HAND}"
        ) from error
    content = read_bytes(path, "log")
    starts = [found.start() for found in re.finditer(re.escape(MAGIC), content)]
    pieces = [content[a:b] for a, b in zip(starts, [*starts[1:], len(content)], strict=True)]
    if part is not None and part not in {str(i) for i in range(1, len(pieces) + 1)}:
        raise RecordError(f"--record must be the number of a flight in '{path}', 1 to {len(pieces)}, got '{part}'")
    i = int(part) - 1 if part else int(np.argmax([len(piece) for piece in pieces]))
    require_room(f"the frames of '{path}'", 10 * len(pieces[i]), "give one flight alone: --record NUMBER")
    notes = []
    if len(pieces) > 1:
        sizes = ", ".join(f"{k + 1}: {len(piece) / 1000:.0f} kB" for k, piece in enumerate(pieces))
        why = "as told" if part else "the longest"
        notes.append(
            f"the file holds {len(pieces)} flights; number {i + 1} is read, {why}; --record reads another ({sizes})"
        )
    with parsed(path, "a blackbox log"):
        return _flight(path, pieces[i], i + 1, notes)


def _flight(path: Path, content: bytes, number: int, notes: list[str]) -> Flight:
    headers, at = _headers(content)
    frames = _Frames(path, headers)
    if frames.coded:
        frames.walk(_Bytes(content, at))
    n = len(frames.time_us)
    if n < MIN_SAMPLES:
        other = "choose another by --record, or " if notes else ""
        raise RecordError(
            f"flight {number} of '{path}' must hold {MIN_SAMPLES} whole frames, got {n} and {frames.damaged} damaged "
            f"places in its {len(content) - at} bytes; {other}{_BY_HAND}"
        )
    columns = frames.columns()
    scale = headers.get("gyro_scale")
    if isinstance(scale, int):  # the bits of a float: deg/s per count
        factor = struct.unpack("<f", struct.pack("<I", scale & 0xFFFFFFFF))[0]
        columns |= {name: factor * v for name, v in columns.items() if name.startswith("gyroADC")}
    units = {"time": "us"}
    one_g = headers.get("acc_1G")
    for name in columns:
        if name in _GPS_UNITS:
            factor, units[name] = _GPS_UNITS[name]
            columns[name] = factor * columns[name]
        elif name.startswith("accSmooth") and isinstance(one_g, int) and one_g > 0:
            columns[name], units[name] = columns[name] / one_g, "g"
        elif name.startswith("gyroADC"):
            units[name] = "deg/s"
    names = ("time", *columns)
    cells = (np.array(frames.time_us), *columns.values())
    table = Table(path, names, tuple(units.get(name, "") for name in names), cells)
    words = {"firmware": "Firmware revision", "board": "Board information", "craft": "Craft name"}
    facts = {name: str(headers[key]) for name, key in words.items() if headers.get(key)}
    numbers = {name: float(v) for name, v in headers.items() if isinstance(v, int | float)}
    unread = dict.fromkeys(frames.unread, n)
    return Flight(table, facts, numbers, unread, tuple(notes), frames.said())


def _headers(content: bytes) -> tuple[dict[str, Any], int]:
    """Return the headers of a flight, as numbers where they are, and where its frames begin."""
    headers: dict[str, Any] = {"P interval": "1/1"}
    at = 0
    while found := _HEADER.match(content, at):
        at = found.end()
        name, text = (part.decode("utf-8", "replace").strip() for part in found.groups())
        plain = _FIELD.fullmatch(name) or name == "motorOutput"
        headers[name] = [_number(v) for v in text.split(",")] if plain else _number(text)
    if headers["P interval"] == 0:  # no frames of differences
        headers["P interval"] = "1/1"
    return headers, at


def _number(text: str) -> int | float | str:
    for kind in (lambda t: int(t, 0), float):
        with suppress(ValueError):
            return kind(text)
    return text


class _Bytes(Iterator[int]):
    """The bytes of a flight, one by one, as the library's decoders take them; StopIteration at the end."""

    def __init__(self, content: bytes, at: int) -> None:
        self.content, self.at = content, at

    def __next__(self) -> int:
        if self.at >= len(self.content):
            raise StopIteration
        self.at += 1
        return self.content[self.at - 1]

    def has_subsequent(self, data: bytes) -> bool:
        """Say whether ``data`` comes next; the library asks this at the end of a log."""
        return self.content.startswith(data, self.at)


class _Frames:
    """The frames of a flight as they are read: the values that are kept, and what was lost."""

    def __init__(self, path: Path, headers: Mapping[str, Any]) -> None:
        from orangebox.context import Context
        from orangebox.types import Frame, FrameType

        self.frame, self.kinds = Frame, {kind.value: kind for kind in FrameType}
        self.coded = self._coded(path, headers)
        self.context = Context(headers, self.coded)
        named = [name for kind in ("I", "G") for name in headers.get(f"Field {kind} name", ()) if name != "time"]
        self.unread = [name for name in named if not _READ.fullmatch(name)]
        main = list(headers.get("Field I name", ()))
        self.at = {name: i for i, name in enumerate(main) if _READ.fullmatch(name)}
        self.clock, self.count = (main.index(n) if n in main else 0 for n in ("time", "loopIteration"))
        gps = headers.get("Field G name", ())
        self.gps_at = {name: i for i, name in enumerate(gps) if _READ.fullmatch(name)}
        self.time_us, self.values, self.fixes = array("d"), array("q"), array("b")
        self.fixed: list[int] = []
        self.valid, self.damaged, self.dropped = False, 0, 0
        self.last: tuple[int, int] | None = None  # clock and count of the last frame
        self.now_us = 0.0

    def _coded(self, path: Path, headers: Mapping[str, Any]) -> dict[Any, list[Any]]:
        """Return kind of frame -> how each of its fields is coded."""
        from orangebox.decoders import decoder_map
        from orangebox.predictors import predictor_map
        from orangebox.types import FieldDef

        version = headers.get("Data version", 1)
        known = set(decoder_map) - {10} - ({8} if version < 2 else set())  # not written in the library
        out: dict[Any, list[Any]] = {}
        for kind in "IPSGH":
            encodings, predictors = (headers.get(f"Field {kind} {what}") for what in ("encoding", "predictor"))
            names = headers.get(f"Field {'I' if kind == 'P' else kind} name")
            if names is None or encodings is None or predictors is None:
                continue
            strange = {f"encoding {e}" for e in encodings if e not in known}
            strange |= {f"predictor {p}" for p in predictors if p not in predictor_map}
            if strange or not len(names) == len(encodings) == len(predictors):
                got = ", ".join(sorted(strange)) or f"{len(names)} names for {len(encodings)} fields"
                raise RecordError(
                    f"fields of '{path}' must be coded in a way that orangebox knows, got {got}; {_BY_HAND}"
                )
            fields = []
            for name, encoding, predictor in zip(names, encodings, predictors, strict=True):
                by = _HOME_EAST if (name, predictor) == (_LATITUDE, _HOME) else predictor
                decoder = decoder_map[encoding](version) if encoding == 8 else decoder_map[encoding]
                fields.append(FieldDef(self.kinds[kind], name, 1, by, encoding, decoder, predictor_map[by]))
            # The library counts a group of fields that ends with the frame one short: one without bytes ends it.
            fields.append(FieldDef(self.kinds[kind], "", 1, 0, 9, decoder_map[9], predictor_map[0]))
            out[self.kinds[kind]] = fields
        return out

    def walk(self, data: _Bytes) -> None:
        """Read all frames, by the laws of blackbox_decode on what is one."""
        lost = False  # among bytes that begin no frame
        while data.at < len(data.content):
            start = data.at
            kind = self.kinds.get(chr(next(data)))
            if kind is None or (kind.value != "E" and kind not in self.coded):
                self.damaged += not lost
                self.valid, lost = False, True
                continue
            try:
                read, ends = self._event(data) if kind.value == "E" else (self._frame(kind, data), False)
            except (StopIteration, ValueError, IndexError, KeyError, TypeError, OverflowError):
                read, ends = None, False  # nonsense is what a frame of other bytes comes to
            follows = data.content[data.at : data.at + 1].decode("latin-1")
            if read is None or data.at - start > _LONGEST or not (ends or not follows or follows in self.kinds):
                self.damaged += not lost
                self.valid, lost, data.at = False, True, start + 1
                continue
            lost = False
            if ends:
                return
            if kind.value in "IP":
                self._keep(kind, read)
            elif kind.value == "G":
                self.fixed = [read[i] for i in self.gps_at.values()]
            elif kind.value == "H":
                self.context.add_frame(self.frame(kind, read))

    def _frame(self, kind: Any, data: _Bytes) -> Any:
        """Return the values of a frame, its marker already read."""
        context, fields = self.context, self.coded[kind]
        context.frame_type, context.field_index, context.current_frame = kind, 0, ()
        out: tuple[int, ...] = ()
        while context.field_index < len(fields):
            raw = fields[context.field_index].decoderfun(data, context)
            for value in raw if isinstance(raw, tuple) else (raw,):
                out += (fields[context.field_index].predictorfun(value, context),)
                context.field_index += 1
            context.current_frame = out
        return out[:-1]

    def _event(self, data: _Bytes) -> tuple[tuple[int, ...], bool]:
        """Read an event; return () and whether the log ends with it."""
        from orangebox.events import event_map
        from orangebox.types import EventType

        kind = EventType(next(data))
        said = event_map[kind](data)
        if kind is EventType.LOGGING_RESUME and self.last is not None:
            self.now_us += (said["time"] - self.last[0]) % _WRAP_US
            self.last = (said["time"], said["iter"])
        return (), kind is EventType.LOG_END

    def _keep(self, kind: Any, values: tuple[int, ...]) -> None:
        """Keep a frame of main values if it follows those before it."""
        clock, count = values[self.clock], values[self.count]
        step = 0
        if self.last is not None:
            step = (clock - self.last[0]) % _WRAP_US
            follows = step < _JUMP_US and 0 <= count - self.last[1] < _JUMP_FRAMES
            self.valid = follows and (self.valid or kind.value == "I")
        else:
            self.valid = self.valid or kind.value == "I"
        if not self.valid:
            self.dropped += 1
            return
        kept = [values[i] for i in self.at.values()]
        kept += self.fixed or ([0] * len(self.gps_at))
        self.values.extend(kept)
        self.fixes.append(bool(self.fixed))
        self.fixed = []
        self.now_us = self.now_us + step if self.last is not None else float(clock)
        self.time_us.append(self.now_us)
        self.last = (clock, count)
        self.context.last_iter = count
        self.context.add_frame(self.frame(kind, values))

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns that are read, (n,) each; those of GPS are not numbers but where it was heard anew."""
        names = [*self.at, *self.gps_at]
        rows: NDArray[Any] = np.array(self.values, dtype=np.int64).reshape(len(self.time_us), len(names))
        out = {name: rows[:, i].astype(np.float64) for i, name in enumerate(names)}
        fresh = np.array(self.fixes, dtype=bool)
        return {name: np.where(fresh, v, np.nan) if name in self.gps_at else v for name, v in out.items()}

    def said(self) -> tuple[str, ...]:
        """Return what was lost, in words."""
        if not self.damaged and not self.dropped:
            return ()
        places = "1 place is" if self.damaged == 1 else f"{self.damaged} places are"
        frames = "1 frame was" if self.dropped == 1 else f"{self.dropped} frames were"
        return (
            f"{places} damaged; {frames} left out that cannot be told without those before (a log on a full or worn "
            "card loses some)",
        )
