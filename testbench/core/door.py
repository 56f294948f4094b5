"""The one door that files come in by: a regular file, of a size that its kind may have, read once and taken apart.

A link to a device, a pipe, a socket or a folder is refused before it is opened, so that nothing waits for bytes that
never come or never end. Size comes before content. What a file holds may then be nonsense: that is for the schemas.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import re
import stat
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from testbench.core.errors import RecordError, ScenarioError
from testbench.core.files import parsed
from testbench.core.sizes import require_room


class Kind(NamedTuple):
    """A kind of file: what a message calls it, and the most bytes that it may have (inf: what memory has room for)."""

    words: str
    most: float = math.inf


_MB = 1e6
KINDS = {
    **dict.fromkeys(
        ("scenario", "suite", "aircraft", "geometry", "ground test", "structure", "prior", "answers"),
        Kind("TOML file", 2 * _MB),
    ),
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
    "key": Kind("file with the teacher's key", 1 * _MB),
    "roster": Kind("file with one name a line", 1 * _MB),
    "log": Kind("log"),
    "record": Kind("record file"),
    "definitions": Kind("file of message definitions (XML)", 50 * _MB),
    "table": Kind("table of results"),
    "text": Kind("text", 50 * _MB),
}
"""Every kind of file that is read. tests/fuzz has an example of each, and damages it."""
_NO_INPUT = frozenset({"key", "journal", "campaign store", "table", "text"})
"""What no result is made from as far as manifests say: secrets, and what the testbench writes for itself."""
READ: dict[Path, tuple[int, int]] = {}
"""What this process has read -> size, time of change: manifests list it as inputs."""
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
        READ[path.absolute()] = (found.st_size, found.st_mtime_ns)
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
        raise ScenarioError([f"{path} must be TOML: {error}"]) from error
    except RecursionError as error:
        raise ScenarioError([f"{path} must be TOML of some levels, but its brackets nest without end"]) from error
    except ValueError as error:  # Python reads no integer of thousands of digits
        raise ScenarioError([f"{path} must be TOML of numbers that can be read: {error}"]) from error


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
