"""The one door to HDF5 files that somebody else wrote: NetCDF-4, and MAT files of version 7.3."""

from __future__ import annotations

import contextlib
import math
import mmap
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from testbench.core.door import open_file
from testbench.core.sizes import NUMBER

_HEAP = b"GCOL\x01"  # a global heap of version 1
_HEAP_HEAD, _OBJECT_HEAD = 16, 16


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open an HDF5 file to read it; inside, h5py raises what it pleases.

    Raises:
        ValueError: a heap of the file is damaged in a way that HDF5 does not return from.
    """
    import h5py  # type: ignore[import-untyped]

    _check_heaps(path)
    with h5py.File(path, "r") as file:
        yield file


def memory_of(datasets: Iterable[Any]) -> int:
    """Return the bytes that numbers of datasets take once they are read; a chunk of a file is read whole.

    What does not lie in the file counts too: chunks that were never written are read as zeros, compressed ones unpack.
    """
    total = 0
    for dataset in datasets:
        chunk = math.prod(dataset.chunks) if dataset.chunks else 0
        total += max(math.prod(dataset.shape or ()), chunk) * max(NUMBER, dataset.dtype.itemsize)
    return total


def _check_heaps(path: Path) -> None:
    """Check that the objects of each global heap follow each other: HDF5 2.0 goes round for ever where one has no size.

    A heap is "GCOL", its version, 3 bytes, its size (8 bytes), and objects of an index, a count (2 bytes each), 4
    bytes, a size (8 bytes) and as many bytes, up to a multiple of 8. Index 0 is what is free, its head counted
    (HDF5 File Format Specification, III.E).
    """
    with (
        open_file(path, "record") as file,
        contextlib.closing(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) as data,
    ):
        at = data.find(_HEAP)
        while at >= 0:
            if at + _HEAP_HEAD <= len(data):
                end = min(at + struct.unpack_from("<Q", data, at + 8)[0], len(data))
                place = at + _HEAP_HEAD
                while place + _OBJECT_HEAD <= end:
                    index, size = struct.unpack_from("<H6xQ", data, place)
                    step = size if index == 0 else _OBJECT_HEAD + -(-size // 8) * 8
                    if step < _OBJECT_HEAD or place + step > end:
                        raise ValueError(f"the heap at byte {at} holds an object of {size} bytes")
                    place += step
            at = data.find(_HEAP, at + 1)
