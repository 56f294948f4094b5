"""ULog files, message by message: which are whole, and the length of each by the formats in the file.

A message is its size (2 bytes), its type (1 byte) and a body; the file begins with 16 other bytes. PX4 guide, "ULog
File Format".
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping

HEADER = 16
_SIZES = {
    "int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
    "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8,
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")
_KINDS = b"BFIMPQARDLCSO"
_HEAD = re.compile(rb"(?s)(?=..[%s])" % _KINDS)
_SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_FLAGS = 40  # bytes: 8 compatible, 8 incompatible, three offsets of appended data
_DEEPEST = 8  # types within types


class _Layouts:
    """The formats and subscriptions seen so far, and whether a message fits them."""

    def __init__(self) -> None:
        self.formats: dict[str, list[tuple[str, int, str]]] = {}
        self.lengths: dict[int, tuple[int, int]] = {}

    def fits(self, kind: bytes, body: bytes) -> bool:
        """Say whether a body is what a message of its kind must hold."""
        if kind == b"D":
            low, high = self.lengths.get(int.from_bytes(body[:2], "little"), (1, 0))
            return low <= len(body) <= high
        if kind in b"IMPQ":
            at = 2 if kind in b"MQ" else 1
            key = body[at : at + body[at - 1]] if len(body) >= at else b""
            return bool(key) and len(key) == body[at - 1] and key.isascii() and len(key.split(b" ")) == 2
        if kind == b"F":
            return _format(body) is not None
        if kind == b"A":
            return self._length(body) is not None
        if kind == b"L":
            return len(body) >= 9 and body[0] in b"01234567"
        return {b"B": len(body) >= _FLAGS, b"C": len(body) >= 11, b"S": body == _SYNC}.get(kind, len(body) == 2)

    def learn(self, kind: bytes, body: bytes) -> None:
        """Keep what a format or a subscription that fits says."""
        if kind == b"F" and (found := _format(body)) is not None:
            self.formats[found[0]] = found[1]
        elif kind == b"A" and (length := self._length(body)) is not None:
            self.lengths[int.from_bytes(body[1:3], "little")] = length

    def _length(self, body: bytes) -> tuple[int, int] | None:
        """Return the fewest and most bytes of the data of a subscription: PX4 leaves out the padding at the end."""
        name = body[3:].decode("ascii", "replace")
        full = _size(name, self.formats)
        if full is None:
            return None
        kind, count, last = self.formats[name][-1]
        padding = count * (_size(kind, self.formats) or 0) if last.startswith("_padding") else 0
        return 2 + full - padding, 2 + full


def _format(body: bytes) -> tuple[str, list[tuple[str, int, str]]] | None:
    """Return name and fields (type, number, name) of a format, None if it is none."""
    name, _, text = body.decode("ascii", "replace").partition(":")
    matches = [_FIELD.fullmatch(field) for field in text.split(";") if field]
    if not re.fullmatch(r"[\w/-]+", name) or not matches or None in matches:
        return None
    return name, [(m[1], int(m[2] or 1), m[3]) for m in matches if m is not None]


def _size(kind: str, formats: Mapping[str, list[tuple[str, int, str]]], depth: int = 0) -> int | None:
    """Return the bytes of a type, None if it is not known."""
    if kind in _SIZES:
        return _SIZES[kind]
    if kind not in formats or depth > _DEEPEST:
        return None
    parts = [(count, _size(part, formats, depth + 1)) for part, count, _ in formats[kind]]
    return sum(count * size for count, size in parts if size is not None) if all(s for _, s in parts) else None


def intact_messages(whole: bytes) -> tuple[bytes, list[str]]:
    """Return a log of the messages that are whole, and what is wrong with the others, in sentences.

    A message that follows another is taken if it fits its format. After a message that does not fit, the next is sought
    byte by byte; it is taken if another message or the end follows it.
    """
    layouts = _Layouts()
    keep = [whole[:HEADER]]
    at, skipped, size = HEADER, 0, len(whole)
    cut = False
    while at + 3 <= size:
        end = _end(whole, at, layouts)
        if end is not None:
            layouts.learn(whole[at + 2 : at + 3], whole[at + 3 : end])
            keep.append(whole[at:end])
            at = end
            continue
        after = _next(whole, at + 1, layouts)
        if after is None:
            cut = at + 3 + int.from_bytes(whole[at : at + 2], "little") > size
            skipped += 0 if cut else size - at
            at = size
            break
        skipped += after - at
        at = after
    cut = cut or at < size
    if not skipped and not cut:
        return whole, []
    damage = [f"{skipped} of {size} bytes belong to no whole message and were left out"] if skipped else []
    damage += ["the file ends in the middle of a message; it was cut short"] if cut else []
    return b"".join(_without_offsets(message) for message in keep), damage


def _end(whole: bytes, at: int, layouts: _Layouts) -> int | None:
    """Return where a message ends that begins at ``at`` and is whole, else None."""
    length, kind = struct.unpack_from("<Hc", whole, at) if at + 3 <= len(whole) else (0, b"")
    end = at + 3 + length
    if not kind or kind not in _KINDS or end > len(whole):
        return None
    return end if layouts.fits(kind, whole[at + 3 : end]) else None


def _next(whole: bytes, start: int, layouts: _Layouts) -> int | None:
    """Return where the next message that is followed by another, or by the end, begins."""
    for match in _HEAD.finditer(whole, start):
        end = _end(whole, match.start(), layouts)
        if end is not None and (end == len(whole) or _end(whole, end, layouts) is not None):
            return match.start()
    return None


def _without_offsets(message: bytes) -> bytes:
    """Return a flags message without the places of appended data, which no longer hold and need not be known."""
    if message[2:3] != b"B" or len(message) < 3 + _FLAGS:
        return message
    body = bytearray(message)
    body[3 + 8] &= 0xFE
    body[3 + 16 : 3 + 40] = bytes(24)
    return bytes(body)
