"""PX4 logs (ULog): their topics, settings and facts. What the columns mean stands in :mod:`testbench.logs.px4`.

Format: PX4 guide, "ULog File Format".
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.door import read_bytes
from testbench.core.errors import RecordError
from testbench.logs import chain
from testbench.logs.px4 import CLOCK, COLUMNS, SAMPLED, sampled
from testbench.logs.signals import Log, Topic, dropped_in_words, make_topic
from testbench.logs.ulog_messages import Subscription, Walk

MAGIC = b"ULog\x01\x12\x35"
_NUMBERS = {"int32_t": "<i", "float": "<f", "int64_t": "<q", "uint32_t": "<I", "uint64_t": "<Q", "double": "<d",
            "int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "bool": "<?"}  # fmt: skip
_FACTS = ("sys_name", "ver_hw", "ver_sw")


def read_ulog(path: Path | str) -> Log:
    """Read a PX4 log.

    If a topic says when its sensor was read (timestamp_sample), that time is taken, because topics are published later.

    Raises:
        RecordError: the file is no ULog, asks for what is not known, or holds nothing that can be read.
    """
    path = Path(path)
    whole = read_bytes(path, "log")
    if not whole.startswith(MAGIC):
        raise RecordError(f"'{path}' must be a PX4 log, but it does not begin as one (ULog and its version)")
    walk = Walk(whole)
    damage = walk.run()
    if walk.unknown_flags:
        raise RecordError(f"'{path}' must be a readable PX4 log, but it says that it needs more than is known (flags)")
    topics, lost = _topics(walk)
    counts = {_name(s): sum(p.size for p in places) for s, places in walk.data.items()}
    if not topics:
        raise RecordError(
            f"'{path}' must hold logged samples of a flight ({', '.join(COLUMNS)}), but none could be saved; "
            f"{'; '.join(damage) or 'it ends after its definitions' if not counts else 'it holds ' + ', '.join(counts)}"
        )
    if damage:
        end = max(float(topic.t_s[-1]) for topic in topics.values())
        damage[-1] += f"; saved: {len(topics)} topics up to t = {end:.3f} s of the log's clock"
    if walk.dropouts_ms:
        longest = max(walk.dropouts_ms)
        lengths = f"{len(walk.dropouts_ms)} dropouts, the longest" if len(walk.dropouts_ms) > 1 else "a dropout of"
        lost.append(f"the logger itself reports {lengths} {longest} ms")
    values = {key: _value(kind, body) for kind, key, body in walk.parameters}
    parameters = {key: float(value) for key, value in values.items() if isinstance(value, int | float)}
    facts = {key: str(_value(kind, body)) for kind, key, body in walk.info if key in _FACTS}
    unread = {name: n for name, n in counts.items() if name.partition("#")[0] not in COLUMNS}
    return Log(path, "PX4 ULog", topics, facts, parameters, (*damage, *lost), unread)


def _value(kind: str, body: bytes) -> float | str | bytes:
    if kind.startswith("char["):
        return body.decode("utf-8", "ignore")
    if kind in _NUMBERS and len(body) == struct.calcsize(_NUMBERS[kind]):
        return struct.unpack(_NUMBERS[kind], body)[0]
    return body


def _name(s: Subscription) -> str:
    return s.topic + (f"#{s.instance}" if s.instance else "")


def _topics(walk: Walk) -> tuple[dict[str, Topic], list[str]]:
    parts: dict[str, list[dict[str, NDArray[Any]]]] = {}
    for s, places in walk.data.items():
        if s.topic in COLUMNS and (columns := _columns(walk, s, places)):
            parts.setdefault(_name(s), []).append(columns)
    topics: dict[str, Topic] = {}
    said = []
    for name, pieces in sorted(parts.items()):
        columns = _joined(pieces)
        clock = sampled(columns.pop(CLOCK), columns.pop(SAMPLED, None))
        topic, lost = make_topic(name, clock.astype(np.float64) * 1e-6, columns)
        said.append(lost)
        if topic.t_s.size:
            topics[name] = topic
    return topics, dropped_in_words(said)


def _columns(walk: Walk, s: Subscription, places: Sequence[chain.Places]) -> dict[str, NDArray[Any]]:
    """Return the columns of one subscription that are read, {} if it has no clock."""
    at = np.concatenate(places)
    wanted = {CLOCK, SAMPLED, *COLUMNS[s.topic]}
    held = [f for f in s.fields if f.name in wanted]
    if not any(f.name == CLOCK for f in held) or not at.size:
        return {}
    return {f.name: chain.field(walk.bytes, at, s.BODY + f.offset, f.dtype) for f in held}


def _joined(pieces: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Join the parts of a topic that was subscribed to several times: the columns that all have."""
    keys = [key for key in pieces[0] if all(key in piece for piece in pieces)]
    return {key: np.concatenate([piece[key] for piece in pieces]) for key in keys}
