"""The one door that files come in by: a regular file, of a size that its kind may have, read once and taken apart.

A link to a device, a pipe, a socket or a folder is refused before it is opened, so that nothing waits for bytes that
never come or never end. Size comes before content. What a file holds may then be nonsense: that is for the schemas.

The most memory that one thing may take: a file's numbers, a flight. Every door asks before memory is taken.

A file of a kilobyte can say that it holds gigabytes, and a scenario of a line that it lasts for months. The limit is
1 GB, or what the environment variable TESTBENCH_MEMORY_GB says. What a command takes in all is a few times as much.

The one door to HDF5 files that somebody else wrote: NetCDF-4, and MAT files of version 7.3.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import itertools
import json
import math
import mmap
import os
import re
import stat
import struct
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from testbench.core.errors import RecordError, ScenarioError, SizeError
from testbench.core.files import parsed

VARIABLE = "TESTBENCH_MEMORY_GB"
USUAL_GB = 1.0
NUMBER = 8
"""Bytes of a number in memory, whatever it is on disk."""


def most_bytes() -> float:
    """Return the limit in bytes.

    Raises:
        SizeError: the environment variable is set and is no number above 0.
    """
    text = os.environ.get(VARIABLE, "").strip()
    try:
        limit = float(text) if text else USUAL_GB
    except ValueError:
        limit = math.nan
    if not limit > 0.0:
        raise SizeError(f"{VARIABLE} must be a number of gigabytes above 0, got '{text[:60]}'")
    return 1e9 * limit


def require_room(what: str, size: float, fix: str) -> None:
    """Check that something may be held in memory.

    Args:
        what: what it is, the subject of the message.
        size: that it will take, bytes.
        fix: what to do about it.

    Raises:
        SizeError: it takes more than the limit.
    """
    limit = most_bytes()
    if not size <= limit:
        raise SizeError(
            f"{what} must take at most {limit / 1e9:g} GB of memory ({VARIABLE}), got {size / 1e9:.3g} GB; {fix}"
        )


class Kind(NamedTuple):
    """A kind of file: what a message calls it, and the most bytes that it may have (inf: what memory has room for)."""

    words: str
    most: float = math.inf


_MB = 1e6
KINDS = {
    **dict.fromkeys(("scenario", "suite", "aircraft", "geometry", "masses beside AVL"), Kind("TOML file", 2 * _MB)),
    **dict.fromkeys(("ground test", "structure", "prior", "project", "writer", "answers"), Kind("TOML file", 2 * _MB)),
    "JSBSim model": Kind("JSBSim file in XML", 20 * _MB),
    "AVL": Kind("AVL file", 10 * _MB),
    "airfoil": Kind("file of an airfoil", 10 * _MB),
    "shapes": Kind("CSV file", 50 * _MB),
    "model": Kind("model's JSON file", 30 * _MB),
    "pooled": Kind("pooled.json of an earlier pooling", 30 * _MB),
    "promise": Kind("promise in JSON", 30 * _MB),
    "campaign store": Kind("campaign's store"),
    "journal": Kind("journal of finished work", 200 * _MB),
    "python": Kind("Python file", 10 * _MB),
    "agent": Kind("file of an agent (.zip)", 500 * _MB),
    "key": Kind("file with the teacher's key", 1 * _MB),
    "roster": Kind("file with one name a line", 1 * _MB),
    "log": Kind("log"),
    "record": Kind("record file"),
    "recording": Kind("recording of a flight that was followed"),
    "parameters": Kind("parameter file of an autopilot", 5 * _MB),
    "definitions": Kind("file of message definitions (XML)", 50 * _MB),
    "table": Kind("table of results"),
    "text": Kind("text", 50 * _MB),
}
"""Every kind of file that is read. tests/fuzz has an example of each, and damages it."""
_NO_INPUT = frozenset({"key", "journal", "campaign store", "table", "text"})
"""What no result is made from as far as manifests say: secrets, and what the testbench writes for itself."""
READ: dict[Path, tuple[int, int, int]] = {}
"""What this process has read -> size, time of change, number of the reading; manifests list it as inputs."""
_readings = itertools.count()
_NO_FILE = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}
_DEEPEST = 200  # levels of elements
# An entity that holds another, or a long text, multiplies: ten lines of such a file unfold to gigabytes.
_BOMB = re.compile(rb"<!ENTITY[^>]*(?:[\"'][^\"'>]*&\w|[\"'][^\"'>]{1000})", re.IGNORECASE)


def _refused(path: Path, kind: str, reason: str) -> RecordError:
    return RecordError(f"a readable {KINDS[kind].words} must lie at '{path}', got: {reason}")


def checked(path: Path, kind: str) -> Path:
    """Return the path of a file that may be opened, by whatever reads it; links are followed.

    Raises:
        RecordError: there is none, it is no regular file, or it is larger than its kind may be.
    """
    from testbench.core.store import settle

    try:
        found = os.stat(settle(path))
    except (OSError, ValueError) as error:  # a name with a zero in it is a ValueError
        raise _refused(path, kind, getattr(error, "strerror", None) or str(error)) from error
    if not stat.S_ISREG(found.st_mode):
        what = _NO_FILE.get(stat.S_IFMT(found.st_mode))
        raise _refused(path, kind, f"{what}, not a file" if what else os.strerror(errno.EISDIR))
    _require_size(path, kind, found.st_size)
    if kind not in _NO_INPUT:
        READ[path.absolute()] = (found.st_size, found.st_mtime_ns, next(_readings))
    return path


def _require_size(path: Path, kind: str, size: float) -> None:
    if size > KINDS[kind].most:
        raise _refused(path, kind, f"more than the {KINDS[kind].most / _MB:g} MB that such a file may have")


@contextmanager
def open_file(path: Path, kind: str) -> Iterator[io.BufferedReader]:
    """Open a file to read its bytes; what became a pipe since it was looked at does not block.

    Raises:
        RecordError: see :func:`checked`; or reading fails.
    """
    flags = getattr(os, "O_NONBLOCK", 0)
    try:
        with open(checked(path, kind), "rb", opener=lambda name, mode: os.open(name, mode | flags)) as file:
            yield file
    except OSError as error:
        raise _refused(path, kind, error.strerror or str(error)) from error


def read_bytes(path: Path, kind: str) -> bytes:
    """Return the content of a file.

    Raises:
        RecordError: see :func:`open_file`.
        SizeError: memory has no room for it.
    """
    most = KINDS[kind].most
    with open_file(path, kind) as file:
        if math.isinf(most):
            require_room(f"the file '{path}'", path.stat().st_size, "cut it into parts")
            return file.read()
        content = file.read(int(most) + 1)  # what the system makes as it is read has no size before
    _require_size(path, kind, len(content))
    return content


def read_text(path: Path, kind: str, encoding: str = "utf-8", errors: str = "strict") -> str:
    """Return the text of a file, line ends as they are written by Python.

    Raises:
        RecordError: see :func:`read_bytes`; or it is not text of that encoding.
    """
    try:
        return io.TextIOWrapper(io.BytesIO(read_bytes(path, kind)), encoding, errors).read()
    except UnicodeDecodeError as error:
        raise _refused(path, kind, "it is not UTF-8 text") from error


def read_toml(path: Path, kind: str = "scenario") -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        RecordError: the file does not exist or cannot be read.
        ScenarioError: it is not TOML; the message carries line and column.
    """
    try:
        return tomllib.loads(read_text(path, kind))
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path} must be TOML: {error}") from error
    except RecursionError as error:
        raise ScenarioError(f"{path} must be TOML of some levels, but its brackets nest without end") from error
    except ValueError as error:  # Python reads no integer of thousands of digits
        raise ScenarioError(f"{path} must be TOML of numbers that can be read: {error}") from error


def read_json(path: Path, kind: str) -> Any:
    """Return what a JSON file holds.

    Raises:
        RecordError: it cannot be read, or is not JSON.
    """
    with parsed(path, f"a {KINDS[kind].words}"):
        return json.loads(read_text(path, kind))


_AMPERSAND = re.compile(rb"&(?!#?\w+;)")


def read_xml(path: Path, kind: str, bare: bool = False) -> ET.Element:
    """Return the root element of an XML file.

    Args:
        path: the file.
        kind: of it, one of :data:`KINDS`.
        bare: take an ampersand that begins no entity as itself, as writers with parsers of their own do.

    Raises:
        RecordError: it cannot be read, is not XML (with line and column), nests without end, or has entities that
            unfold.
    """
    data = read_bytes(path, kind)
    if _BOMB.search(data):
        raise RecordError(
            f"entities of a {KINDS[kind].words} must be short texts without other entities, got others in '{path}'; "
            "write them out"
        )
    data = _AMPERSAND.sub(b"&amp;", data) if bare else data
    depth = 0
    with parsed(path, f"a {KINDS[kind].words}"):
        steps = ET.iterparse(io.BytesIO(data), ("start", "end"))
        for event, _ in steps:
            depth += 1 if event == "start" else -1
            if depth > _DEEPEST:
                raise ValueError(f"its elements nest more than {_DEEPEST} deep")
        root: ET.Element = steps.root  # type: ignore[attr-defined]
    return root


def sha256(path: Path, kind: str) -> str:
    """Return the SHA-256 of a file, a part of it in memory at a time.

    Raises:
        RecordError: see :func:`open_file`.
    """
    with open_file(path, kind) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
