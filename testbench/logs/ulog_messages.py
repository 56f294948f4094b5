"""ULog files, message by message: which are whole, and where the samples of each topic lie.

A message is its size (2 bytes), its type (1 byte) and a body; the file begins with 16 other bytes. Formats and
subscriptions in the file give the length of a sample. PX4 guide, "ULog File Format".
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from testbench.logs import chain

HEADER = 16
_TYPES = {
    "int8_t": "<i1", "uint8_t": "<u1", "bool": "<i1", "char": "<i1", "int16_t": "<i2", "uint16_t": "<u2",
    "int32_t": "<i4", "uint32_t": "<u4", "float": "<f4", "int64_t": "<i8", "uint64_t": "<u8", "double": "<f8",
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")
_KINDS = b"BFIMPQARDLCSO"
_HEAD = re.compile(rb"(?s)(?=..[%s])" % _KINDS)
_SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_FLAGS = 40  # bytes: 8 compatible, 8 incompatible, three offsets of appended data
_DEEPEST = 8  # types within types
_LONGEST = 65535  # bytes of a message
Formats = Mapping[str, list[tuple[str, int, str]]]


@dataclass(frozen=True)
class Field:
    """A number in a sample: its name (``xyz[0]`` in an array, ``a.b`` in a type within a type), place and type."""

    name: str
    offset: int
    dtype: str


@dataclass(frozen=True)
class Subscription:
    """A topic that is logged under a number: its name, which instance, its fields, fewest and most bytes of a sample.

    PX4 leaves out the padding at the end of a sample.
    """

    topic: str
    instance: int
    fields: tuple[Field, ...]
    low: int
    high: int
    BODY = 5
    """Bytes from the beginning of a message to those of its sample."""


class Walk:
    """A walk through a log that takes every whole message, and what it found.

    Attributes:
        data: subscription -> places of its messages, in the order of the file.
        parameters, info: (type, key, value in bytes) of each setting at the beginning and of each fact.
        dropouts_ms: lengths of the stretches that the logger says it lost.
        unknown_flags: whether the log says that it cannot be read without knowing more than its format.
    """

    def __init__(self, whole: bytes) -> None:
        self.whole = whole
        self.bytes = np.frombuffer(whole, np.uint8)
        self.data: dict[Subscription, list[chain.Places]] = {}
        self.parameters: list[tuple[str, str, bytes]] = []
        self.info: list[tuple[str, str, bytes]] = []
        self.dropouts_ms: list[int] = []
        self.unknown_flags = False
        self._formats: dict[str, list[tuple[str, int, str]]] = {}
        self._subscribed: dict[int, Subscription] = {}
        self._low = np.ones(65536, np.int32)  # fewest bytes by number; without a subscription more than the most
        self._high = np.zeros(65536, np.int32)
        self._places: list[chain.Places] = []
        self._numbers: list[NDArray[np.uint16]] = []
        self._logging = False  # subscriptions have begun: what follows is no definition any more

    def run(self) -> list[str]:
        """Take every whole message; return what is wrong, in sentences.

        A message that follows another is taken if it fits its format. After a message that does not fit, the next is
        sought byte by byte; it is taken if another message or the end follows it.
        """
        at, skipped, size = HEADER, 0, len(self.whole)
        cut = False
        searched, high = np.zeros(0, np.int64), 0
        starts: chain.Places | None = None  # of what was searched, those that fit; None: to be found
        while at + 3 <= size:
            end = self._end(at)
            if end is None:
                after = self._next(at + 1)
                if after is None:
                    cut = at + 3 + int.from_bytes(self.whole[at : at + 2], "little") > size
                    skipped += 0 if cut else size - at
                    at = size
                    break
                skipped += after - at
                at = after
                continue
            kind = self.whole[at + 2 : at + 3]
            if kind != b"D":
                if self._learn(kind, self.whole[at + 3 : end]):
                    starts = None
                at = end
                continue
            if at >= high:
                high = at + chain.CHUNK
                searched, starts = self._samples(at, high), None
            if starts is None:
                starts = self._fitting(searched[np.searchsorted(searched, at) :])
            i = int(np.searchsorted(starts, at))
            n = chain.run_length(starts, partial(self._ends, starts), i) if i < starts.size else 0
            self._take(starts[i : i + n] if n else np.array([at]))
            at = int(starts[i + n]) if n else end
        self._settle()
        damage = [f"{skipped} of {size} bytes belong to no whole message and were left out"] if skipped else []
        cut = cut or at < size
        return damage + (["the file ends in the middle of a message; it was cut short"] if cut else [])

    def _samples(self, low: int, high: int) -> chain.Places:
        """Return where, in a stretch of the file, a sample may begin: its type is there."""
        part = self.bytes[low + 2 : min(high + 2, self.bytes.size - 2)]
        return np.asarray(np.flatnonzero(part == ord("D")) + low)

    def _fitting(self, places: chain.Places) -> chain.Places:
        """Return those of the places where number and size fit a subscription."""
        numbers = chain.field(self.bytes, places, 3, "<u2")
        sizes = chain.field(self.bytes, places, 0, "<u2")
        return places[(self._low[numbers] <= sizes) & (sizes <= self._high[numbers])]

    def _ends(self, starts: chain.Places, a: int, b: int) -> chain.Places:
        return np.asarray(starts[a:b] + 3 + chain.field(self.bytes, starts[a:b], 0, "<u2").astype(np.int64))

    def _take(self, places: chain.Places) -> None:
        self._places.append(places)
        self._numbers.append(np.asarray(chain.field(self.bytes, places, 3, "<u2")).astype(np.uint16))

    def _settle(self) -> None:
        """Give the samples taken since the last time to the subscriptions that hold for them."""
        if not self._places:
            return
        for number, places in chain.grouped(np.concatenate(self._numbers), np.concatenate(self._places)).items():
            self.data.setdefault(self._subscribed[number], []).append(places)
        self._places, self._numbers = [], []

    def _end(self, at: int) -> int | None:
        """Return where a message ends that begins at ``at`` and is whole, else None."""
        length, kind = struct.unpack_from("<Hc", self.whole, at) if at + 3 <= len(self.whole) else (0, b"")
        end = at + 3 + length
        if not kind or kind not in _KINDS or end > len(self.whole):
            return None
        return end if self._fits(kind, self.whole[at + 3 : end]) else None

    def _next(self, start: int) -> int | None:
        """Return where the next message that is followed by another, or by the end, begins."""
        for match in _HEAD.finditer(self.whole, start):
            end = self._end(match.start())
            if end is not None and (end == len(self.whole) or self._end(end) is not None):
                return match.start()
        return None

    def _fits(self, kind: bytes, body: bytes) -> bool:
        """Say whether a body is what a message of its kind must hold."""
        if kind == b"D":
            number = int.from_bytes(body[:2], "little")
            return len(body) >= 2 and bool(self._low[number] <= len(body) <= self._high[number])
        if kind in b"IMPQ":
            at = 2 if kind in b"MQ" else 1
            key = body[at : at + body[at - 1]] if len(body) >= at else b""
            return bool(key) and len(key) == body[at - 1] and key.isascii() and len(key.split(b" ")) == 2
        if kind == b"F":
            return _format(body) is not None
        if kind == b"A":
            return self._subscription(body) is not None
        if kind == b"L":
            return len(body) >= 9 and body[0] in b"01234567"
        return {b"B": len(body) >= _FLAGS, b"C": len(body) >= 11, b"S": body == _SYNC}.get(kind, len(body) == 2)

    def _learn(self, kind: bytes, body: bytes) -> bool:
        """Keep what a message that fits and is no sample says; return whether other samples fit after it."""
        if kind == b"F" and (found := _format(body)) is not None:
            self._formats[found[0]] = found[1]
        elif kind == b"A" and (subscription := self._subscription(body)) is not None:
            self._logging = True
            number = int.from_bytes(body[1:3], "little")
            if self._subscribed.get(number, subscription) != subscription:
                self._settle()
            self._subscribed[number] = subscription
            low, high = 2 + subscription.low, 2 + subscription.high
            changed = (low, high) != (self._low[number], self._high[number])
            self._low[number], self._high[number] = low, high
            return changed
        elif kind in b"IP" and (kind == b"I" or not self._logging):  # a later P is a change in flight
            into = self.info if kind == b"I" else self.parameters
            name, _, key = body[1 : 1 + body[0]].decode().partition(" ")
            into.append((name, key, body[1 + body[0] :]))
        elif kind == b"O":
            self.dropouts_ms.append(int.from_bytes(body, "little"))
        elif kind == b"L" or kind == b"C":
            self._logging = True
        elif kind == b"B":
            self.unknown_flags = bool(body[8] & ~1) or any(body[9:16])
        return False

    def _subscription(self, body: bytes) -> Subscription | None:
        """Return what a subscription says, None if its format is not known or its samples are too long."""
        topic = body[3:].decode("ascii", "replace")
        if len(body) < 4 or (full := _size(topic, self._formats)) is None or full + 2 > _LONGEST:
            return None
        fields = list(_fields("", topic, self._formats, 0))
        while fields and fields[-1].name.rpartition(".")[2].startswith("_padding"):
            fields.pop()
        low = fields[-1].offset + np.dtype(fields[-1].dtype).itemsize if fields else 0
        return Subscription(topic, body[0], tuple(fields), low, full)


def _format(body: bytes) -> tuple[str, list[tuple[str, int, str]]] | None:
    """Return name and fields (type, number or 0, name) of a format, None if it is none."""
    name, _, text = body.decode("ascii", "replace").partition(":")
    matches = [_FIELD.fullmatch(field) for field in text.split(";") if field]
    if not re.fullmatch(r"[\w/-]+", name) or not matches or None in matches:
        return None
    return name, [(m[1], int(m[2] or 0), m[3]) for m in matches if m is not None]


def _size(kind: str, formats: Formats, depth: int = 0) -> int | None:
    """Return the bytes of a type, None if it is not known."""
    if kind in _TYPES:
        return np.dtype(_TYPES[kind]).itemsize
    if kind not in formats or depth > _DEEPEST:
        return None
    parts = [(max(count, 1), _size(part, formats, depth + 1)) for part, count, _ in formats[kind]]
    return sum(count * size for count, size in parts if size is not None) if all(s for _, s in parts) else None


def _fields(prefix: str, kind: str, formats: Formats, offset: int) -> Iterator[Field]:
    """Return the numbers in a type, those of types within it included."""
    for part, count, name in formats[kind]:
        size = _size(part, formats) or 0
        for i in range(max(count, 1)):
            label = f"{prefix}{name}[{i}]" if count else f"{prefix}{name}"
            if part in _TYPES:
                yield Field(label, offset, _TYPES[part])
            else:
                yield from _fields(f"{label}.", part, formats, offset)
            offset += size
