"""Which of several equal sensors a log is read from: the inertial units, pitot tubes, receivers and filters of one log.

A topic's second instance carries "#1" behind its name. One instance is taken for all channels of a topic, because rates
and accelerations of two units do not sit on one clock. The first is taken unless another is better in this order:
numbers that move, flags that say healthy, agreement with the others (of three or more), the length of the log, that the
autopilot used it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.errors import RecordError
from testbench.core.record import FloatArray

if TYPE_CHECKING:
    from testbench.logs.signals import Topic

KINDS = {
    "imu": r"IMU|ACC|GYR|IMT|sensor_(combined|gyro|accel)|vehicle_(imu|angular_velocity|acceleration)",
    "airspeed": r"ARSP|ASP2|airspeed|airspeed_validated|differential_pressure",
    "gps": r"GPS|GPA|sensor_gps|vehicle_gps_position",
    "baro": r"BARO|sensor_baro|vehicle_air_data",
    "ekf": r"(XKF|NKF|EKF)\w+|estimator_\w+|wind|wind_estimate",
}
"""Kind of sensor -> the names of its topics."""
_FLAGS = {"GH": 1.0, "AH": 1.0, "H": 1.0, "Health": 1.0, "Status": 3.0, "fix_type": 3.0}
"""Column that says whether the sensor is healthy -> the least value of a healthy one (3: a fix in three dimensions)."""
_SHARE = 0.5  # of the samples must carry the flag
_LONG = 0.9  # of the longest instance
_APART = 3.0  # an instance this many times further from the median than the median instance does not agree
_MOVES = 0.3  # of the movement: what instances may differ by, besides their biases
_COMPARED = 2000  # samples
_ABOVE_NOISE = 3.0  # movement over noise of a column by which two instances can be told apart


@dataclass(frozen=True)
class Choice:
    """The instance of a topic that was taken, and (topic, why not) of the others.

    ``doubt`` says that two healthy instances disagree, so that one of them is wrong; "" if they agree.
    """

    kind: str
    taken: str
    others: tuple[tuple[str, str], ...]
    said: str
    doubt: str = ""


def instances_of(topic: str, topics: Iterable[str]) -> list[str]:
    """Return the names of the instances of ``topic`` among ``topics``, the first instance first."""
    pattern = re.compile(re.escape(topic) + r"(#\d+)?")
    return sorted((name for name in topics if pattern.fullmatch(name)), key=number_of)


def number_of(name: str) -> int:
    """Return the number of the instance that a topic's name says: 1 for "IMU#1", 0 for "IMU"."""
    return int(name.partition("#")[2] or 0)


def _kind(topic: str) -> str:
    return next((kind for kind, names in KINDS.items() if re.fullmatch(names, topic)), topic)


def choose_instances(
    topics: Mapping[str, Topic],
    used: Mapping[str, Iterable[str]],
    asked: Mapping[str, int],
    preferred: Mapping[str, tuple[str, str]],
) -> tuple[Choice, ...]:
    """Return a choice for each topic that has several instances.

    Args:
        topics: name -> topic, of one log.
        used: topic -> the columns that become channels.
        asked: kind of sensor -> the instance that the user chose.
        preferred: topic -> the instance that the autopilot used, and how the log says so.

    Raises:
        RecordError: a kind is not one of :data:`KINDS`, or the log does not hold the instance asked for.
    """
    for kind, number in asked.items():
        if kind not in KINDS:
            raise RecordError(f"a kind of sensor must be one of {', '.join(KINDS)}, got '{kind}'")
        held = {number_of(name) for topic in used if _kind(topic) == kind for name in instances_of(topic, topics)}
        if number not in held:
            there = f"holds {', '.join(map(str, sorted(held)))}" if held else "holds none"
            raise RecordError(f"the instance of {kind} must be one that the log holds, got {number}; it {there}")
    choices = []
    for topic, columns in used.items():
        names = instances_of(topic, topics)
        if len(names) < 2:
            continue
        faults = _faults({name: topics[name] for name in names}, list(columns))
        used_one, how = preferred.get(topic, ("", ""))
        best = min(names, key=lambda name: ([bool(f) for f in faults[name]], name != used_one, number_of(name)))
        kind = _kind(topic)
        wanted = next((name for name in names if number_of(name) == asked.get(kind)), None)
        choice = _choice(kind, wanted or best, names, faults, wanted is not None, how if best == used_one else "")
        healthy = [topics[name] for name in names if not any(faults[name])]
        doubt = _disagree(healthy[0], healthy[1], list(columns)) if len(healthy) == 2 else ""
        choices.append(
            replace(choice, doubt=doubt and f"{kind}: {doubt}; {choice.taken} is used: is it the right one?")
        )
    return tuple(choices)


def _choice(
    kind: str, taken: str, names: list[str], faults: Mapping[str, tuple[str, ...]], asked: bool, how: str
) -> Choice:
    said = {name: ", ".join(filter(None, faults[name])) for name in names}
    option = f" (--{kind} {{}} reads this one)" if kind in KINDS else ""
    fine = "not requested" if asked else "as good as the one used"
    others = tuple(
        (name, f"{said[name] or fine}; {taken} is read instead{option.format(number_of(name))}")
        for name in names
        if name != taken
    )
    better = len({bool(said[name]) for name in names}) > 1
    why = "as asked," if asked else "the best" if better else f"because {how}," if how else "the first"
    rest = "; ".join(f"{name}: {said[name]}" for name in names if said[name])
    return Choice(
        kind, taken, others, f"{kind}: {taken} is read, {why} of {', '.join(names)}" + (f" ({rest})" if rest else "")
    )


def _faults(topics: Mapping[str, Topic], columns: list[str]) -> dict[str, tuple[str, ...]]:
    """Return for each instance what is wrong with it, by rank: dead, still, unhealthy, apart, short; "" where right."""
    data = {name: _numbers(topic, columns) for name, topic in topics.items()}
    length = {name: float(topic.t_s[-1] - topic.t_s[0]) if topic.t_s.size else 0.0 for name, topic in topics.items()}
    longest = max(length.values())
    still = {name: _still(values) for name, values in data.items()}
    apart = _apart({name: topics[name] for name in topics if not still[name]}, columns)
    out: dict[str, tuple[str, ...]] = {}
    for name, topic in topics.items():
        short = f"{length[name]:.3g} s of {longest:.3g} s logged" if length[name] < _LONG * longest else ""
        out[name] = (still[name], _unhealthy(topic), apart.get(name, ""), short)
    return out


def _numbers(topic: Topic, columns: list[str]) -> list[FloatArray]:
    with np.errstate(invalid="ignore"):
        held = [np.asarray(topic.columns[c], dtype=np.float64) for c in columns if c in topic.columns]
    return [column[np.isfinite(column)] for column in held]


def _still(columns: list[FloatArray]) -> str:
    full = [column for column in columns if column.size]
    if not full:
        return "no numbers"
    if not any(np.any(column) for column in full):
        return "zero throughout"
    return "" if any(np.ptp(column) > 0.0 for column in full) else "constant throughout"


def _unhealthy(topic: Topic) -> str:
    for flag, least in _FLAGS.items():
        column = topic.columns.get(flag)
        if column is not None and column.size and np.mean(np.asarray(column, dtype=np.float64) >= least) < _SHARE:
            return f"{flag} is {float(np.median(np.asarray(column, dtype=np.float64))):g}, not {least:g}"
    return ""


def _disagree(one: Topic, other: Topic, columns: list[str]) -> str:
    """Say in which column two instances move differently, by more than their noise; "" if in none.

    The noise is told by the changes from sample to sample. A column in which neither moves tells nothing.
    """
    start, end = max(float(one.t_s[0]), float(other.t_s[0])), min(float(one.t_s[-1]), float(other.t_s[-1]))
    if not start < end:
        return ""
    at = np.linspace(start, end, _COMPARED)
    worst, where = _MOVES, ""
    for column in columns:
        if column not in one.columns or column not in other.columns:
            continue
        a, b = (np.nan_to_num(np.asarray(topic.columns[column], dtype=np.float64)) for topic in (one, other))
        noise = max(float(np.std(np.diff(x))) / np.sqrt(2.0) for x in (a, b))
        rows = np.array([np.interp(at, topic.t_s, x) for topic, x in ((one, a), (other, b))])
        moves = float(rows.std(axis=1).max())
        apart = float(np.std(rows[0] - rows[1])) / moves if moves > _ABOVE_NOISE * noise else 0.0
        if apart > worst:
            worst, where = apart, column
    return f"{one.name} and {other.name} differ in {where} by {worst:.2g} times their motion" if where else ""


def _apart(topics: Mapping[str, Topic], columns: list[str]) -> dict[str, str]:
    """Return what to say of instances that do not move as the others do; of two nothing says which is right."""
    if len(topics) < 3:
        return {}
    start = max(float(topic.t_s[0]) for topic in topics.values())
    end = min(float(topic.t_s[-1]) for topic in topics.values())
    shared = [c for c in columns if all(c in topic.columns for topic in topics.values())]
    if not start < end or not shared:
        return {}
    at = np.linspace(start, end, _COMPARED)
    off = np.zeros(len(topics))
    for column in shared:
        rows = np.array(
            [np.interp(at, t.t_s, np.nan_to_num(np.asarray(t.columns[column], float))) for t in topics.values()]
        )
        rows -= rows.mean(axis=1, keepdims=True)
        typical = np.median(rows, axis=0)
        moves = float(np.median(rows.std(axis=1)))
        if moves > 0.0:
            off = np.maximum(off, np.sqrt(np.mean((rows - typical) ** 2, axis=1)) / moves)
    limit = max(_MOVES, _APART * float(np.median(off)))
    return {
        name: f"differs from the others by {value:.2g} times their motion"
        for name, value in zip(topics, off, strict=True)
        if value > limit
    }
