"""Recordings of ROS: bags (.bag), and those of ROS 2 in MCAP or SQLite (.mcap, .db3, or the folder with metadata.yaml).

The libraries rosbags and mcap read them without ROS; MCAP with messages in JSON, too, and as it grows. Every topic
becomes a table of its messages, a column a number, called by its path (``angular_velocity.x``, ``q[0]``), on the clock
of its stamp where there is one; what the columns mean is told as of any table, those of PX4's topics by its own rules.
"""

from __future__ import annotations

import contextlib
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbench.core.door import open_file
from testbench.core.errors import MissingPackage, RecordError, missing
from testbench.core.files import parsed
from testbench.logs import px4
from testbench.logs.tables import Table

MAGIC = (b"#ROSBAG", b"\x89MCAP")
SQLITE = b"SQLite format 3"
METADATA = "metadata.yaml"
_STAMPS = ("header.stamp", "timestamp")
_LONGEST = 16  # numbers of a vector: covariances, images and clouds hold more
_LARGEST = 8192  # bytes of a message: a larger one is no motion


class Bag(NamedTuple):
    """The tables of a recording, name of a topic -> its table; name -> number of messages of what is not read; whether
    it has an end: one that is being written, or was cut short, has none.
    """

    tables: Mapping[str, Table]
    unread: Mapping[str, int]
    whole: bool = True


class _Message(NamedTuple):
    """A message: its topic, when it was recorded, s, what it is (None: its type is not known), and units by path."""

    topic: str
    at_s: float
    content: Any
    units: Mapping[str, str] = {}


def is_bag(path: Path, head: bytes) -> bool:
    """Say whether a file, by its first bytes, or a folder is a recording of ROS."""
    if path.is_dir():
        return (path / METADATA).is_file()
    return head.startswith(MAGIC) or (head.startswith(SQLITE) and path.suffix.lower() == ".db3")


def read_bag(path: Path) -> Bag:
    """Read the topics of a recording; of one in MCAP that has no end what is whole.

    Raises:
        RecordError: it is damaged, or its messages have definitions that it does not hold.
        MissingPackage: rosbags, or mcap, is not installed.
    """
    held: dict[str, list[tuple[float, dict[str, float]]]] = {}
    unread: dict[str, int] = {}
    units: dict[str, Mapping[str, str]] = {}
    whole = True
    with parsed(path, "a complete recording"):
        for message in _of_mcap(path) if path.suffix.lower() == ".mcap" else _of_ros(path):
            if message is None:
                whole = False
                break
            if message.content is None or message.topic in unread:
                unread[message.topic] = unread.get(message.topic, 0) + 1
                continue
            numbers: dict[str, float] = {}
            _flatten(message.content, "", numbers)
            stamp = next((s for head in _STAMPS if (s := _stamp(numbers, head))), 0.0)
            numbers.pop("header.seq", None)
            if numbers:
                held.setdefault(message.topic, []).append((stamp or message.at_s, numbers))
                units[message.topic] = message.units
            else:
                unread[message.topic] = 1
    first = min((rows[0][0] for rows in held.values()), default=0.0)
    tables = {_called(name): _table(path, _called(name), rows, first, units[name]) for name, rows in held.items()}
    if not tables:
        raise RecordError(f"'{path}' must hold messages with numbers, but it holds {', '.join(unread) or 'none'}")
    return Bag(tables, unread, whole)


def _of_ros(path: Path) -> Iterator[_Message]:
    """Yield the messages of a recording of ROS."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise _missing("rosbags") from error
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        for of, stamp_ns, raw in reader.messages():
            content = None
            if len(raw) <= _LARGEST:
                with contextlib.suppress(KeyError):  # a type that neither the recording nor the library defines
                    content = reader.deserialize(raw, of.msgtype)
            yield _Message(of.topic, 1e-9 * stamp_ns, content)


def _of_mcap(path: Path) -> Iterator[_Message | None]:
    """Yield the messages of a recording in MCAP, in JSON or of ROS, as they were written; None where it has no end."""
    try:
        from mcap.exceptions import EndOfFile
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise _missing("mcap") from error
    schemas: dict[int, Any] = {}
    topics: dict[int, tuple[str, Callable[[bytes], Any], Mapping[str, str]]] = {}
    with open_file(path, "log") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel) and record.id not in topics:
                    schema = schemas.get(record.schema_id)
                    topics[record.id] = record.topic, *_reading(record.message_encoding, schema)
                elif isinstance(record, Message):
                    topic, read, units = topics[record.channel_id]
                    content = read(record.data) if len(record.data) <= _LARGEST else None
                    yield _Message(topic, 1e-9 * record.log_time, content, units)
        except (EndOfFile, struct.error):
            if file.read(1):  # damaged, not unfinished
                raise
            yield None


def _reading(encoding: str, schema: Any) -> tuple[Callable[[bytes], Any], Mapping[str, str]]:
    """Return what reads the messages of a channel, and the units that its schema states."""
    if encoding == "json":
        told = json.loads(schema.data) if schema is not None and schema.encoding == "jsonschema" else {}
        properties = told.get("properties", {})
        return json.loads, {n: p["unit"] for n, p in properties.items() if isinstance(p.get("unit"), str)}
    if encoding not in ("cdr", "ros1") or schema is None:
        return lambda raw: None, {}
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError as error:
        raise _missing("rosbags") from error
    store = get_typestore(Stores.EMPTY if schema.data else Stores.LATEST)
    if schema.data:
        text = schema.data.decode()
        store.register(
            get_types_from_idl(text) if schema.encoding == "ros2idl" else get_types_from_msg(text, schema.name)
        )
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/", 1)
    if name not in store.fielddefs:
        return lambda raw: None, {}
    return lambda raw: (store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr)(raw, name), {}


def _missing(package: str) -> MissingPackage:
    return MissingPackage(missing(f"recordings need {package}", "logs"))


def _stamp(numbers: dict[str, float], head: str) -> float:
    """Take a stamp out of the numbers of a message; 0 if there is none."""
    parts = [f"{head}.{name}" for name in ("sec", "nanosec", "nsec")]
    return sum(numbers.pop(part, 0.0) * unit for part, unit in zip(parts, (1.0, 1e-9, 1e-9), strict=True))


def _flatten(message: Any, path: str, out: dict[str, float]) -> None:
    """Put the numbers of a message into ``out``, by their paths."""
    for name, value in (message if isinstance(message, dict) else vars(message)).items():
        key = f"{path}{name}"
        if isinstance(value, list):  # of JSON
            value = np.array(value if all(isinstance(x, int | float) for x in value) else [])
        if isinstance(value, bool | int | float | np.number):
            out[key] = float(value)
        elif isinstance(value, np.ndarray):
            if value.size <= _LONGEST and value.dtype.kind in "iufb" and "covariance" not in name:
                out |= {f"{key}[{i}]": float(x) for i, x in enumerate(value.tolist())}
        elif isinstance(value, dict) or hasattr(value, "__dataclass_fields__"):
            _flatten(value, f"{key}.", out)


def _called(topic: str) -> str:
    """Return the name of a topic as the files are called that are made of one: mavros-imu-data."""
    parts = topic.strip("/").split("/")
    return f"{parts[-1]}_0" if parts[-1] in px4.COLUMNS else "-".join(parts)


def _table(
    path: Path, name: str, rows: list[tuple[float, dict[str, float]]], first: float, units: Mapping[str, str]
) -> Table:
    """Return the messages of a topic as a table; the columns are those of its first message."""
    columns = list(rows[0][1])
    cells = [np.array([numbers.get(column, np.nan) for _, numbers in rows]) for column in columns]
    stamps = np.array([stamp for stamp, _ in rows]) - first
    own_clock = any(column == px4.CLOCK for column in columns)
    heads = ([], []) if own_clock else (["t"], ["s"])
    stated = (*heads[1], *(units.get(column, "") for column in columns))
    return Table(path.parent / name, (*heads[0], *columns), stated, tuple(cells if own_clock else [stamps, *cells]))
