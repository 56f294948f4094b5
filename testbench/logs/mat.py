"""MAT files: variables out of version 5 (MathWorks, "MAT-File Format", chapter 1) and of version 7.3, which is HDF5.

scipy's compiled reader of version 5 is not used, because some damaged files make it end the process.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbench.core.door import NUMBER, memory_of, open_file, opened, read_bytes, require_room
from testbench.core.files import parsed

_DEEP = 32  # structures in structures; a file of references may go round in circles
_OBJECT = 500  # bytes that an array, a text or a structure takes beside what it holds


@dataclass(frozen=True)
class StructArray:
    """A structure array: its shape and its structures, columns first."""

    shape: tuple[int, ...]
    items: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class CellArray:
    """A cell array: its shape and what its cells hold, columns first."""

    shape: tuple[int, ...]
    items: tuple[Any, ...]


@dataclass(frozen=True)
class Opaque:
    """An object of a class of MATLAB (table, timeseries, ...), whose content MATLAB alone can read."""

    kind: str


def read_mat(path: Path) -> dict[str, Any]:
    """Return the variables of a MAT file of version 5 or 7.3, as :func:`mat_variables` describes them.

    Raises:
        RecordError: the file is of another format, damaged or cut short.
        SizeError: it unpacks to more than the limit of :mod:`testbench.core.door`.
    """
    with parsed(path, "a complete MAT file"):
        with open_file(path, "log") as file:
            head = file.read(8)
        if head.startswith((b"MATLAB 7", b"\x89HDF")):
            return _variables_of_hdf5(path)
        if not head.startswith(b"MATLAB 5"):
            raise ValueError("it does not begin as a MAT file of version 5 or 7.3")
        room = _Room(path)
        room.take(path.stat().st_size)
        return mat_variables(read_bytes(path, "log"), room)


class _Room:
    """Counts what a file unpacks to, and refuses before it is taken."""

    def __init__(self, path: Path | str) -> None:
        self.path, self.taken = path, 0

    def take(self, size: int) -> None:
        """Count ``size`` bytes more.

        Raises:
            SizeError: all together are more than the limit.
        """
        self.require(size)
        self.taken += size

    def require(self, size: int) -> None:
        """Check that ``size`` bytes more may be taken."""
        require_room(f"what '{self.path}' unpacks to", self.taken + size, "save the flight alone, or a part of it")


def _variables_of_hdf5(path: Path) -> dict[str, Any]:
    with opened(path) as file:
        if not any("MATLAB_class" in item.attrs for item in file.values()):
            raise ValueError("it is HDF5 that MATLAB did not write; if it is NetCDF, name it .nc")
        read, room = _Read(file, {}), _Room(path)
        return {name: _hdf5_value(read, room, item, 0) for name, item in file.items() if not name.startswith("#")}


class _Read(NamedTuple):
    """An open file of version 7.3 and what was read of it: address of the object -> value."""

    file: Any
    held: dict[int, Any]


def _hdf5_value(read: _Read, room: _Room, item: Any, depth: int) -> Any:
    """Return what an object holds, read once however many references lead to it."""
    import h5py  # type: ignore[import-untyped]

    address = h5py.h5o.get_info(item.id).addr
    if address not in read.held:
        room.take(_OBJECT)
        read.held[address] = None  # what it holds of itself, in a circle of references
        read.held[address] = _hdf5_read(read, room, item, depth)
    return read.held[address]


def _hdf5_read(read: _Read, room: _Room, item: Any, depth: int) -> Any:
    """Return what an object of a file of version 7.3 holds; arrays are stored transposed there."""
    import h5py

    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if depth > _DEEP:
        raise ValueError(f"structures must be at most {_DEEP} deep")
    if item.attrs.get("MATLAB_object_decode", 0) == 3 or kind == "FileWrapper__":
        return Opaque(kind)
    if isinstance(item, h5py.Group):
        if "MATLAB_sparse" in item.attrs:
            return None
        fields = {name: (part, _hdf5_value(read, room, part, depth + 1)) for name, part in item.items()}
        return _structures({name: (_is_array_of_structures(part), value) for name, (part, value) in fields.items()})
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.zeros((0, 0))
    room.take(memory_of([item]))
    if h5py.check_ref_dtype(item.dtype) is not None:
        cells = tuple(_hdf5_value(read, room, read.file[reference], depth + 1) for reference in item[()].ravel())
        return CellArray(item.shape[::-1], cells)
    if kind == "char":
        codes = item[()].T
        return "".join(map(chr, codes.ravel())) if codes.ndim < 2 or codes.shape[0] == 1 else None
    if item.dtype.kind not in "fiub":
        return None
    values = np.atleast_2d(np.asarray(item[()], dtype=np.float64))
    return values.T


def _is_array_of_structures(part: Any) -> bool:
    """Say whether a field holds one reference per structure: that of a cell array carries its class, this does not."""
    import h5py

    return (
        isinstance(part, h5py.Dataset) and h5py.check_ref_dtype(part.dtype) is not None
        and "MATLAB_class" not in part.attrs
    )  # fmt: skip


def _structures(fields: dict[str, tuple[bool, Any]]) -> Any:
    """Return one structure, or the structure array whose fields hold one value per structure."""
    arrays = [value for is_array, value in fields.values() if is_array]
    if not arrays or len(arrays) != len(fields) or len({len(a.items) for a in arrays}) != 1:
        return {name: value for name, (_, value) in fields.items()}
    count = len(arrays[0].items)
    items = tuple({name: value.items[i] for name, (_, value) in fields.items()} for i in range(count))
    return StructArray(arrays[0].shape, items)


def mat_variables(whole: bytes, room: _Room | None = None) -> dict[str, Any]:
    """Return the variables of a MAT file of version 5, by name.

    Numbers are arrays, text is text, a 1 x 1 structure is a dict of its fields; structure arrays, cell arrays and
    objects are :class:`StructArray`, :class:`CellArray` and :class:`Opaque`; anything else is None. Objects of old
    classes, which keep their fields in the file, are structures.

    Raises:
        ValueError, LookupError, struct.error, zlib.error, RecursionError: the file is damaged or cut short.
        SizeError: it unpacks to more than the limit of :mod:`testbench.core.door`.
    """
    order = "<" if whole[126:128] == b"IM" else ">"
    room = room or _Room("a MAT file")
    found = {}
    for kind, part in _elements(memoryview(whole)[128:], order):
        for inner, matrix in _elements(_unpacked(part, room, order), order) if kind == 15 else [(kind, part)]:
            if inner != 14:
                raise ValueError(f"an element of type {inner} stands where a matrix must")
            name, value = _matrix(matrix, order, room.take)
            found[name] = value
    return {name: value for name, value in found.items() if name}


def _unpacked(part: memoryview, room: _Room, order: str) -> memoryview:
    """Return what a compressed element holds, unpacked piece by piece so that its size is known in time."""
    unpacker, pieces = zlib.decompressobj(), []
    while part and not unpacker.eof:
        pieces.append(unpacker.decompress(part, _PIECE))
        room.take(len(pieces[-1]))
        if len(pieces) == 1 < len(pieces[0]) // 8:
            room.require(struct.unpack_from(order + "I", pieces[0], 4)[0])  # what the element itself says
        if not pieces[-1] and not unpacker.unconsumed_tail:
            break
        part = memoryview(unpacker.unconsumed_tail)
    if not unpacker.eof:
        raise ValueError("a compressed element is cut short")
    return memoryview(b"".join(pieces))


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
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
_PIECE = 1 << 24  # bytes unpacked at once
_TEXT = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def _matrix(data: memoryview, order: str, take: Callable[[int], None]) -> tuple[str, Any]:
    """Return name and value of one matrix element; ``take`` counts the memory for it."""
    parts = list(_elements(data, order))
    take(_OBJECT + 100 * len(parts))
    flags = struct.unpack_from(order + "I", parts[0][1])[0] if parts else 0
    group, is_complex = flags & 0xFF, flags & 0x800
    if group == 17 and len(parts) > 3:  # of a class: name, system of classes, class, number in that system
        return _name(parts[1][1]), Opaque(_name(parts[3][1]))
    if group not in range(1, 16):  # empty or a function
        return "", None
    shape = np.frombuffer(parts[1][1], order + "i4").tolist()
    name, rest = _name(parts[2][1]), parts[3:]
    if group >= 6 and not is_complex:
        kind, content = rest[0]
        take(NUMBER * (len(content) // np.dtype(_NUMBERS[kind]).itemsize))
        values = np.frombuffer(content, order + _NUMBERS[kind]).astype(np.float64)
        if math.prod(shape) != values.size or min(shape) < 0:
            raise ValueError(f"variable '{name}' of shape {shape} must hold as many numbers, got {values.size}")
        return name, values.reshape(shape, order="F")
    if group == 4 and shape[0] == 1:
        kind, content = rest[0]
        endian = {"<": "-le", ">": "-be"}[order] if kind in (4, 17, 18) else ""
        return name, bytes(content).decode(_TEXT[kind] + endian)
    if group == 1:
        return name, CellArray(tuple(shape), tuple(_matrix(part, order, take)[1] for _, part in rest))
    if group in (2, 3):
        rest = rest[group - 2 :]  # an object begins with the name of its class
        width = struct.unpack_from(order + "I", rest[0][1])[0]
        text = bytes(rest[1][1])
        keys = [text[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(text), width)]
        count = math.prod(shape)
        if len(rest) - 2 != count * len(keys) or min(shape) < 0:
            raise ValueError(f"structure '{name}' of shape {shape} must hold {len(keys)} fields each")
        take(_OBJECT * count)
        held = [_matrix(part, order, take)[1] for _, part in rest[2:]]
        items = [dict(zip(keys, held[i * len(keys) :], strict=False)) for i in range(count)]
        return name, items[0] if count == 1 else StructArray(tuple(shape), tuple(items))
    return name, None


def _name(part: memoryview) -> str:
    return bytes(part).decode("latin-1")
