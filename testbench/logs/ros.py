"""Recordings of ROS: bags (.bag), and those of ROS 2 in MCAP or SQLite (.mcap, .db3, or the folder with metadata.yaml).

The library rosbags reads them without ROS. Every topic becomes a table of its messages, a column a number, called by
its path (``angular_velocity.x``, ``q[0]``), on the clock of the stamp in its header where there is one; what the
columns mean is told as of any table, those of PX4's topics by its own rules.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbench.core.errors import MissingPackage, RecordError
from testbench.core.files import parsed
from testbench.logs import px4
from testbench.logs.tables import Table

MAGIC = (b"#ROSBAG", b"\x89MCAP")
SQLITE = b"SQLite format 3"
METADATA = "metadata.yaml"
_LONGEST = 16  # numbers of a vector: covariances, images and clouds hold more
_LARGEST = 8192  # bytes of a message: a larger one is no motion


class Bag(NamedTuple):
    """The tables of a recording, name of a topic -> its table, and name -> number of messages of what is not read."""

    tables: Mapping[str, Table]
    unread: Mapping[str, int]


def is_bag(path: Path, head: bytes) -> bool:
    """Say whether a file, by its first bytes, or a folder is a recording of ROS."""
    if path.is_dir():
        return (path / METADATA).is_file()
    return head.startswith(MAGIC) or (head.startswith(SQLITE) and path.suffix.lower() == ".db3")


def read_bag(path: Path) -> Bag:
    """Read the topics of a recording.

    Raises:
        RecordError: it is damaged, or its messages have definitions that it does not hold.
        MissingPackage: rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingPackage(
            "recordings of ROS need rosbags, which is not installed; pip install 'flight-testbench[logs]'"
        ) from error
    held: dict[str, list[tuple[float, dict[str, float]]]] = {}
    unread: dict[str, int] = {}
    with (
        parsed(path, "a complete recording of ROS"),
        AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader,
    ):
        for of, stamp_ns, raw in reader.messages():
            if of.topic in unread or len(raw) > _LARGEST:
                unread[of.topic] = unread.get(of.topic, 0) + 1
                continue
            try:
                message = reader.deserialize(raw, of.msgtype)
            except KeyError:  # a type that neither the recording nor the library defines
                unread[of.topic] = 1
                continue
            numbers: dict[str, float] = {}
            _flatten(message, "", numbers)
            stamp = numbers.pop("header.stamp.sec", 0.0) + 1e-9 * numbers.pop("header.stamp.nanosec", 0.0)
            numbers.pop("header.seq", None)
            if numbers:
                held.setdefault(of.topic, []).append((stamp or 1e-9 * stamp_ns, numbers))
            else:
                unread[of.topic] = 1
    first = min((rows[0][0] for rows in held.values()), default=0.0)
    tables = {_called(name): _table(path, _called(name), rows, first) for name, rows in held.items()}
    if not tables:
        raise RecordError(f"'{path}' must hold messages with numbers, but it holds {', '.join(unread) or 'none'}")
    return Bag(tables, unread)


def _flatten(message: Any, path: str, out: dict[str, float]) -> None:
    """Put the numbers of a message into ``out``, by their paths."""
    for name, value in vars(message).items():
        key = f"{path}{name}"
        if isinstance(value, bool | int | float | np.number):
            out[key] = float(value)
        elif isinstance(value, np.ndarray):
            if value.size <= _LONGEST and value.dtype.kind in "iufb" and "covariance" not in name:
                out |= {f"{key}[{i}]": float(x) for i, x in enumerate(value.tolist())}
        elif hasattr(value, "__dataclass_fields__"):
            _flatten(value, f"{key}.", out)


def _called(topic: str) -> str:
    """Return the name of a topic as the files are called that are made of one: mavros-imu-data."""
    parts = topic.strip("/").split("/")
    return f"{parts[-1]}_0" if parts[-1] in px4.COLUMNS else "-".join(parts)


def _table(path: Path, name: str, rows: list[tuple[float, dict[str, float]]], first: float) -> Table:
    """Return the messages of a topic as a table; the columns are those of its first message."""
    columns = list(rows[0][1])
    cells = [np.array([numbers.get(column, np.nan) for _, numbers in rows]) for column in columns]
    stamps = np.array([stamp for stamp, _ in rows]) - first
    own_clock = any(column == px4.CLOCK for column in columns)
    heads = ([], []) if own_clock else (["t"], ["s"])
    units = (*heads[1], *([""] * len(columns)))
    return Table(path.parent / name, (*heads[0], *columns), units, tuple(cells if own_clock else [stamps, *cells]))
