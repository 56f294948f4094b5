"""Damage to files: by bytes, by lines and numbers of a text, by values of a TOML file. One generator, one damage."""

import re
import struct
from collections.abc import Callable

import numpy as np

Generator = np.random.Generator
_WORDS = (
    0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF,
    0x7FF0000000000000, 0x7FF8000000000000, 0x7FE1CCF385EBC8A0,
)  # fmt: skip
"""Sizes and counts at the edge, then inf, nan and 1e308 as the bits of a float."""


def damaged(content: bytes, rng: Generator) -> bytes:
    """Return bytes with one to four damages: bits, words, chunks doubled, moved, lost or made up, the end cut off."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        if not data:
            break
        at = _place(len(data), rng)
        size = int(min(2 ** rng.integers(0, 12), len(data) - at)) or 1
        other = _place(len(data), rng)
        match int(rng.integers(0, 9)):
            case 0 | 1 | 2:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 3:
                width = int(rng.choice([1, 2, 4, 8]))
                word = struct.pack("<Q", _WORDS[int(rng.integers(0, len(_WORDS)))])[:width]
                data[at : at + width] = word if rng.integers(0, 2) else word[::-1]
            case 4:
                data[other:other] = data[at : at + size]
            case 5:
                del data[at : at + size]
            case 6:
                data[other : other + size] = data[at : at + size]
            case 7:
                data[at : at + size] = rng.bytes(size)
            case _:
                del data[at:]
    return bytes(data)


def _place(length: int, rng: Generator) -> int:
    """Return a place; half of them in the first 2000 bytes, where headers lie."""
    return int(rng.integers(0, min(length, 2000) if rng.integers(0, 2) else length))


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_CELLS = (
    "", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "-1", "0", "1e9", "1,5", "1.2.3", "0x10", "1_000", "abc",
    '"', '"a', "9" * 400, "\ufffd", "\x00", "12:34:56", "2024-02-30T25:61:00", "1e400", "\u0661", "-", "'",
)  # fmt: skip


def garbled(text: str, rng: Generator) -> str:
    """Return a text with one to four damages: numbers become others or none, lines are lost, doubled or moved."""
    for _ in range(int(rng.integers(1, 5))):
        lines = text.splitlines(keepends=True) or [""]
        k = int(rng.integers(0, min(len(lines), 8) if rng.integers(0, 2) else len(lines)))
        match int(rng.integers(0, 6)):
            case 0 | 1 | 2:
                lines[k] = _one_number(lines[k], _CELLS[int(rng.integers(0, len(_CELLS)))], rng)
            case 3:
                lines.insert(int(rng.integers(0, len(lines))), lines[k])
            case 4:
                del lines[k]
            case _:
                other = str(rng.choice([",", ";", "\t", " ", "\r", "|", "#", "%"]))
                lines[k] = lines[k].replace(str(rng.choice([",", " ", "."])), other)
        text = "".join(lines)
    return text


def _one_number(line: str, new: str, rng: Generator) -> str:
    found = list(_NUMBER.finditer(line))
    if not found:
        return line + new
    where = found[int(rng.integers(0, len(found)))]
    return line[: where.start()] + new + line[where.end() :]


_VALUES = (
    "0", "-1", "1", "2.5", "1e308", "-1e308", "1e-320", "inf", "nan", "1e12", "9223372036854775807", "9" * 5000,
    "1000000000000", "0.0", '""', '"x"', '"../../etc"', '"a\\u0000b"', '"\\n"', "true", "[]", "[1]", '["q", "q"]',
    "[[1, 2], [3]]", "{}", '{ x = 1 }', "1979-05-27", "07:32:00", "[" * 3000, "{ a = " * 900, '"' + "q" * 3000 + '"',
    "[inf, nan]", "[1e300, -1e300]", "1e-9", "1e6", "100000000",
)  # fmt: skip
_ASSIGNED = re.compile(r"(?<![=<>!])=\s*([^\n#,}\]]+)")


def mistyped(text: str, rng: Generator) -> str:
    """Return TOML with one or two values that became others, keys that are lost, doubled or moved, or bits flipped."""
    for _ in range(int(rng.integers(1, 3))):
        lines = text.splitlines(keepends=True) or [""]
        places = [k for k, line in enumerate(lines) if "=" in line and not line.startswith("#")] or [0]
        k = places[int(rng.integers(0, len(places)))]
        match int(rng.integers(0, 8)):
            case 0 | 1 | 2 | 3 | 4:
                found = list(_ASSIGNED.finditer(lines[k]))
                if found:
                    where = found[int(rng.integers(0, len(found)))]
                    new = _VALUES[int(rng.integers(0, len(_VALUES)))]
                    lines[k] = lines[k][: where.start(1)] + new + lines[k][where.end(1) :].lstrip(" ")
                    lines[k] = lines[k] if lines[k].endswith("\n") else lines[k] + "\n"
            case 5:
                del lines[k]
            case 6:
                lines.insert(places[int(rng.integers(0, len(places)))], lines[k])
            case _:
                return damaged(text.encode(), rng).decode("utf-8", "replace")
        text = "".join(lines)
    return text


def nudged(text: str, rng: Generator) -> str:
    """Return TOML with one number that became another of the same kind, between zero and twice as much or negative."""
    lines = text.splitlines(keepends=True)
    places = [k for k, line in enumerate(lines) if _ASSIGNED.search(line) and _NUMBER.search(line.partition("=")[2])]
    if not places:
        return text
    k = places[int(rng.integers(0, len(places)))]
    key, _, values = lines[k].partition("=")
    where = list(_NUMBER.finditer(values))
    found = where[int(rng.integers(0, len(where)))]
    new = float(found[0]) * float(rng.choice([-1.0, 0.0, 0.5, 0.9, 1.1, 1.5, 2.0]))
    written = str(round(new)) if found[0].lstrip("-").isdigit() else repr(new)
    lines[k] = f"{key}={values[: found.start()]}{written}{values[found.end() :]}"
    return "".join(lines)


Damage = Callable[[bytes, Generator], bytes]


def of_text(content: bytes, rng: Generator) -> bytes:
    """Damage a text as text, every third time as bytes."""
    return damaged(content, rng) if rng.integers(0, 3) == 0 else garbled(content.decode(), rng).encode()
