"""MAT files of version 5: bytes in, variables out. After MathWorks, "MAT-File Format", chapter 1.

scipy's compiled reader is not used, because some damaged files make it end the process.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np


def mat_variables(whole: bytes) -> dict[str, Any]:
    """Return the variables of a MAT file: numbers as arrays, text, 1 x 1 structures as dicts, None for anything else.

    Raises:
        ValueError: the file is damaged or cut short.
    """
    order = "<" if whole[126:128] == b"IM" else ">"
    found = {}
    try:
        for kind, part in _elements(whole[128:], order):
            for inner, matrix in _elements(zlib.decompress(part), order) if kind == 15 else [(kind, part)]:
                if inner != 14:
                    raise ValueError(f"an element of type {inner} stands where a matrix must")
                name, value = _matrix(matrix, order)
                found[name] = value
    except (LookupError, ArithmeticError, RecursionError, MemoryError, struct.error, zlib.error) as error:
        raise ValueError(str(error)) from error
    return {name: value for name, value in found.items() if name}


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and content of the elements that follow each other in ``data``."""
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from(order + "II", data, place)
        begin, end = place + 8, place + 8 + (size if kind == 15 else -(-size // 8) * 8)
        if kind >> 16:  # up to 4 bytes lie in the tag itself
            kind, size, begin, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if begin + size > min(end, len(data)):
            raise ValueError(f"an element of {size} bytes does not fit into it; is the file cut short?")
        yield kind, data[begin : begin + size]
        place = end


_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def _matrix(data: bytes, order: str) -> tuple[str, Any]:
    """Return name and value of one matrix element."""
    parts = list(_elements(data, order))
    flags = struct.unpack_from(order + "I", parts[0][1])[0] if parts else 0
    group, is_complex = flags & 0xFF, flags & 0x800
    if group not in range(1, 16):  # empty, a function or an opaque object
        return "", None
    shape = np.frombuffer(parts[1][1], order + "i4").tolist()
    name, rest = parts[2][1].decode("latin-1"), parts[3:]
    if group >= 6 and not is_complex:
        kind, content = rest[0]
        values = np.frombuffer(content, order + _NUMBERS[kind]).astype(np.float64)
        if math.prod(shape) != values.size or min(shape) < 0:
            raise ValueError(f"variable '{name}' of shape {shape} must hold as many numbers, got {values.size}")
        return name, values.reshape(shape, order="F")
    if group == 4 and shape[0] == 1:
        kind, content = rest[0]
        endian = {"<": "-le", ">": "-be"}[order] if kind in (4, 17, 18) else ""
        return name, content.decode(_TEXT[kind] + endian)
    if group == 2 and math.prod(shape) == 1:
        width = struct.unpack_from(order + "I", rest[0][1])[0]
        text = rest[1][1]
        keys = [text[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(text), width)]
        return name, {key: _matrix(part, order)[1] for key, (_, part) in zip(keys, rest[2:], strict=True)}
    return name, None
