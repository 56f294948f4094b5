"""The content of a log: topics with their own clocks, and the rules that turn their columns into channels.

The columns of a topic are logged together: a uORB topic of PX4, a message type of ArduPilot, the rows of a table.
Nothing is resampled here; a mapped channel keeps the times at which it was logged.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray

GAP = 1.75  # a step this many times the usual one means that samples were lost; loggers jitter by up to half a step
MIN_SAMPLES = 4
FAR = 2.0  # times the span of all but 2 % of the times, from its middle: what lies beyond is no time of the flight
_SURFACES = ("de_cmd", "da_cmd", "dr_cmd")
DEFAULT_THROW_RAD = 25.0 * DEG_RAD
"""Deflection at full command where a log holds commands without a unit: a usual value for models, nothing known."""


@dataclass(frozen=True, eq=False)
class Topic:
    """Columns that are logged together.

    Args:
        name: as the log calls it, "#1" behind it for the second instance.
        t_s: (n,) times in s, strictly increasing, on the clock of the log.
        columns: name -> (n,) values as logged.
        units: name -> unit as the log states it.
    """

    name: str
    t_s: FloatArray
    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Log:
    """Everything read from one file.

    Args:
        file: the file.
        kind: its format in words.
        topics: name -> topic.
        facts: what the log says of itself (vehicle, software).
        parameters: settings of the autopilot, by name.
        warnings: sentences on what is damaged, what was left out and what was saved.
        unread: name -> number of messages of the types that no rule uses.
        notes: sentences on what was set or changed while the log ran and matters to what is read.
        preferred: topic with several instances -> the one that the autopilot used ("ARSP#1"), and how the log says so.
    """

    file: Path
    kind: str
    topics: Mapping[str, Topic]
    facts: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    unread: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    preferred: Mapping[str, tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Rule:
    """How columns of one topic become a channel; of several rules for a channel the first whose columns exist counts.

    Args:
        channel: the channel of the table.
        topic: where the columns are.
        fields: the columns, in the order of the arguments of ``convert``.
        convert: columns, each (n,) float -> channel (n,) in its SI unit; commands of surfaces as a fraction of full
            throw, in the sign of the channel table.
        said: the conversion in words.
        assumed: what the log does not say and was assumed.
        in_si: True where commands of surfaces come out in rad and no throw is to be multiplied.
        takes: the unit of the columns, where the log may state another one.
    """

    channel: str
    topic: str
    fields: tuple[str, ...]
    convert: Callable[..., FloatArray]
    said: str
    assumed: str = ""
    in_si: bool = False
    takes: str = ""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A channel at the times at which it was logged, (n,) each, and where it comes from."""

    name: str
    t_s: FloatArray
    values: FloatArray
    source: str
    said: str
    assumed: str = ""

    @property
    def step_s(self) -> float:
        """The usual step: the median."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def rate_hz(self) -> float:
        """The usual rate."""
        return 1.0 / self.step_s

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Last time before and first time after each stretch without samples."""
        cuts = np.flatnonzero(np.diff(self.t_s) > GAP * self.step_s)
        return [(float(self.t_s[i]), float(self.t_s[i + 1])) for i in cuts]


def scaled(factor: float) -> Callable[[FloatArray], FloatArray]:
    """Return the conversion ``factor * x``."""
    return lambda x: factor * x


def map_channels(log: Log, rules: Iterable[Rule], throw_rad: Mapping[str, float] | None = None) -> list[Mapped]:
    """Return every channel that the rules find in ``log``, in the order of the rules.

    Args:
        log: the log.
        rules: by preference; a rule whose columns are absent, hold fewer than 4 numbers or never leave zero is passed
            over.
        throw_rad: surface ("de", "da", "dr") -> its deflection at full command, rad; 25 deg where not given.
    """
    throws = throw_rad or {}
    found: dict[str, Mapped] = {}
    for rule in rules:
        topic = log.topics.get(log.preferred.get(rule.topic, (rule.topic,))[0])
        if rule.channel in found or topic is None or not set(rule.fields) <= set(topic.columns):
            continue
        with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN, which complains as it is cast
            raw = [np.asarray(topic.columns[name], dtype=np.float64) for name in rule.fields]
        ok = np.all(np.isfinite(raw), axis=0)
        if np.count_nonzero(ok) < MIN_SAMPLES or not any(np.any(column[ok]) for column in raw):
            continue
        values = rule.convert(*(column[ok] for column in raw)) + 0.0  # no minus zero
        assumed = rule.assumed
        if rule.channel in _SURFACES and not rule.in_si:
            surface = rule.channel.removesuffix("_cmd")
            throw = throws.get(surface, DEFAULT_THROW_RAD)
            values = values * throw
            known = "as given" if surface in throws else "assumed, the log does not hold it"
            assumed = "; ".join(filter(None, [assumed, f"full command is {throw / DEG_RAD:g} deg ({known})"]))
        if channel(rule.channel).unit == "rad" and rule.channel not in _SURFACES:
            values = np.unwrap(values)
        finite = np.isfinite(values)
        if np.count_nonzero(finite) < MIN_SAMPLES:
            continue
        source = f"{topic.name}.{'/'.join(rule.fields)}" if rule.topic else "/".join(rule.fields)
        found[rule.channel] = Mapped(rule.channel, topic.t_s[ok][finite], values[finite], source, rule.said, assumed)
    return list(found.values())


def increasing(t: FloatArray) -> NDArray[np.intp]:
    """Return the indices of samples with increasing times, without repeated times and isolated wrong ones.

    It keeps a longest increasing subsequence (Schensted 1961, by patience sorting). If that would leave out more than 5
    %, the clock was set back, and only the longest stretch without a step back is kept.
    """
    usable = np.flatnonzero(np.isfinite(t))
    if usable.size > 2:  # one damaged time far off, which may come last, would stretch the record to years
        low, high = np.quantile(t[usable], [0.01, 0.99])
        usable = usable[np.abs(t[usable] - 0.5 * (low + high)) <= FAR * (high - low)]
    times = t[usable]
    if times.size < 2 or np.all(np.diff(times) > 0.0):
        return usable
    tails: list[float] = []
    heads: list[int] = []
    before = np.full(times.size, -1)
    for i, value in enumerate(times.tolist()):
        k = bisect_left(tails, value)
        before[i] = heads[k - 1] if k else -1
        if k == len(tails):
            tails.append(value)
            heads.append(i)
        else:
            tails[k], heads[k] = value, i
    chain = []
    i = heads[-1]
    while i >= 0:
        chain.append(i)
        i = int(before[i])
    repeated = int(np.count_nonzero(np.diff(times) == 0.0))
    if times.size - len(chain) - repeated > max(2, 0.05 * times.size):
        pieces = np.split(np.arange(times.size), np.flatnonzero(np.diff(times) < 0.0) + 1)
        longest = max(pieces, key=len)
        return usable[longest[np.r_[True, np.diff(times[longest]) > 0.0]]]
    return usable[chain[::-1]]


def make_topic(
    name: str, t_s: FloatArray, columns: Mapping[str, NDArray[Any]], units: Mapping[str, str] | None = None
) -> tuple[Topic, str]:
    """Return the topic with times that increase, and a sentence on the samples left out for it ("" if none)."""
    keep = increasing(t_s)
    if keep.size == t_s.size:
        return Topic(name, t_s, columns, units or {}), ""
    topic = Topic(name, t_s[keep], {key: column[keep] for key, column in columns.items()}, units or {})
    lost = t_s.size - keep.size
    return topic, f"{name}: {lost} of {t_s.size} samples left out, because their times do not run on"
