"""The content of a log: topics with their own clocks, and the rules that turn their columns into channels.

The columns of a topic are logged together: a uORB topic of PX4, a message type of ArduPilot, the rows of a table.
Nothing is resampled here; a mapped channel keeps the times at which it was logged.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import SURFACES
from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.logs.clocks import gaps, usual_step
from testbench.logs.instances import Choice, choose_instances, instances_of, number_of
from testbench.logs.names import LARGEST

VEHICLES = ("fixed wing", "VTOL", "rotorcraft", "other")
"""What may have flown: a VTOL has a wing and hovers, a rotorcraft has no surfaces, others do not fly."""
MIN_SAMPLES = 4
ZERO = "zero throughout"
AT_IMU = "the inertial unit is at the centre of gravity"
"""What is assumed of accelerations where no setting of the autopilot says where they were measured."""
ONE_TURN = 2.02 * np.pi  # rad; beyond it an angle was not cut at half or whole turns, or is no angle in rad
FAR = 2.0  # times the span of all but 2 % of the times, from its middle: what lies beyond is no time of the flight
UNSTATED = "the file states no unit"
"""Begins what is assumed of a channel whose unit nobody stated."""
FULL_COMMAND = "full command is"
"""Stands in what is assumed of a control that was logged as a part of full throw."""
_SURFACES = (*SURFACES, "de_cmd", "da_cmd", "dr_cmd")
TURNING = ("phi", "psi")
"""Angles that jump by a turn where they pass half of one."""
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


@dataclass(frozen=True)
class Mode:
    """A mode of the autopilot: from when on, s of the log's clock, its name, and who flies in it, "" if not known."""

    t_s: float
    name: str
    flown: str = ""

    @property
    def said(self) -> str:
        """The mode in words."""
        return f"{self.name} ({self.flown})" if self.flown else self.name


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
        unread: name -> number of messages or samples of what no rule uses.
        reasons: name of ``unread`` -> why it was left out, where a rule would know it.
        assumed: sentences on what the file does not say and was assumed of all its channels.
        notes: sentences on what was set or changed while the log ran and matters to what is read.
        preferred: topic with several instances -> the one that the autopilot used ("ARSP#1"), and how the log says so.
        imu_m: instance of the inertial unit -> its position from the centre of gravity by the autopilot's own settings,
            forward, right, down, m; only those that are set.
        filtered_hz: (topic without its instance, channel) -> cut-off of the autopilot's own low pass of second order
            before it was logged, Hz.
        vehicle: what flew, one of :data:`VEHICLES`; "" if the log does not say it.
        modes: those of the autopilot, in the order of time.
        flags: what the autopilot says of its flight ("landed", "hover", "transition") -> times (n,), s of the log's
            clock, and values (n,), each held until the next.
    """

    file: Path
    kind: str
    topics: Mapping[str, Topic]
    facts: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    unread: Mapping[str, int] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    preferred: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    imu_m: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)
    filtered_hz: Mapping[tuple[str, str], float] = field(default_factory=dict)
    vehicle: str = ""
    modes: tuple[Mode, ...] = ()
    flags: Mapping[str, tuple[FloatArray, NDArray[np.bool_]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Rule:
    """How columns of one topic become a channel; of several rules for a channel the first whose columns exist counts.

    Args:
        channel: the channel of the table.
        topic: where the columns are.
        fields: the columns, in the order of the arguments of ``convert``.
        convert: columns, each (n,) float -> channel (n,) in its SI unit; surfaces and their commands as a fraction of
            full throw, in the sign of the channel table.
        said: the conversion in words.
        assumed: what the log does not say and was assumed.
        in_si: True where surfaces and their commands come out in rad, and no throw is to be multiplied.
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

    @cached_property
    def lost(self) -> NDArray[np.intp]:
        """Indices of the samples after which samples were lost."""
        return gaps(self.t_s)

    @cached_property
    def step_s(self) -> float:
        """The usual step: the mean outside gaps."""
        return usual_step(self.t_s, self.lost)

    @property
    def rate_hz(self) -> float:
        """The usual rate."""
        return 1.0 / self.step_s

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Last time before and first time after each stretch without samples."""
        return [(float(self.t_s[i]), float(self.t_s[i + 1])) for i in self.lost]


@dataclass(frozen=True, eq=False)
class Passed:
    """A signal that could be channel ``name`` and was not taken: its times as logged, (n,), where from, and why."""

    name: str
    t_s: FloatArray
    source: str
    reason: str


@dataclass(frozen=True, eq=False)
class Found:
    """What the rules found: channels, signals that were passed over, and which of several sensors was taken."""

    channels: tuple[Mapped, ...]
    passed: tuple[Passed, ...]
    choices: tuple[Choice, ...]


def modes_of(topic: Topic | None, column: str, names: Mapping[int, str], flown: Mapping[str, str]) -> tuple[Mode, ...]:
    """Return the modes that a topic logs by number, one for each change.

    Args:
        topic: None if the log has none.
        column: of it, the number of the mode.
        names: number -> name.
        flown: who flies ("manual", "stabilised", "automatic") -> the names of its modes, with spaces between.
    """
    if topic is None or column not in topic.columns or not topic.t_s.size:
        return ()
    numbers = np.asarray(topic.columns[column], dtype=np.float64)
    who = {name: by for by, listed in flown.items() for name in listed.split()}
    out = []
    for i in np.flatnonzero(np.diff(numbers, prepend=np.nan) != 0.0):
        name = names.get(int(numbers[i]), f"mode {numbers[i]:g}") if np.isfinite(numbers[i]) else "mode not known"
        out.append(Mode(float(topic.t_s[i]), name, who.get(name, "")))
    return tuple(out)


def without(log: Log, topics: Iterable[str]) -> Mapping[str, Topic]:
    """Return the topics of a log but those that were read for what they say of the flight itself."""
    read = set(topics)
    return {name: topic for name, topic in log.topics.items() if name.partition("#")[0] not in read}


def scaled(factor: float) -> Callable[[FloatArray], FloatArray]:
    """Return the conversion ``factor * x``."""
    return lambda x: factor * x


def filter_delay_s(cut_hz: float) -> float:
    """Return the delay, s, of a Butterworth low pass of second order well below its cut-off, Hz.

    From 1 + sqrt(2) s/w + (s/w)^2: sqrt(2)/w. Its next term, which would widen a step, is zero.
    """
    return math.sqrt(2.0) / (2.0 * math.pi * cut_hz)


def filters(parameters: Mapping[str, float], settings: Mapping[str, tuple[str, str]]) -> dict[tuple[str, str], float]:
    """Return (topic, channel) -> cut-off, Hz, of the low passes that are set and on.

    Args:
        parameters: settings of the autopilot.
        settings: setting -> topic, and its channels with spaces between.
    """
    return {
        (topic, channel): float(parameters[name])
        for name, (topic, channels) in settings.items()
        if parameters.get(name, 0.0) > 0.0
        for channel in channels.split()
    }


def placed(parameters: Mapping[str, float], setting: str) -> tuple[float, float, float] | None:
    """Return the position (x, y, z), m, by the settings ``setting`` with X, Y, Z behind; None if not set or zero."""
    x, y, z = (float(parameters.get(f"{setting}{axis}", 0.0)) for axis in "XYZ")
    return (x, y, z) if any((x, y, z)) else None


def find_channels(
    log: Log,
    rules: Iterable[Rule],
    throw_rad: Mapping[str, float] | None = None,
    sensors: Mapping[str, int] | None = None,
) -> Found:
    """Return every channel that the rules find in ``log``, in the order of the rules, and what they passed over.

    Args:
        log: the log.
        rules: by preference; a rule whose columns are absent, hold fewer than 4 numbers or never leave zero is passed
            over. Of several instances of a topic ("IMU", "IMU#1") one is taken for all its channels.
        throw_rad: surface ("de", "da", "dr") -> its deflection at full command, rad; 25 deg where not given.
        sensors: kind of sensor ("imu", "airspeed", "gps", "baro", "ekf") -> the instance to take; the best if not
            given, see :func:`testbench.logs.instances.choose_instances`.

    Raises:
        RecordError: an instance asked for is not in the log.
    """
    rules = list(rules)
    used: dict[str, dict[str, None]] = {}
    for rule in rules:
        used.setdefault(rule.topic, {}).update(dict.fromkeys(rule.fields))
    choices = choose_instances(log.topics, used, sensors or {}, log.preferred)
    turned_down = {name: why for choice in choices for name, why in choice.others}
    found: dict[str, Mapped] = {}
    passed: list[Passed] = []
    for rule in rules:
        for name in instances_of(rule.topic, log.topics):
            topic = log.topics[name]
            if not set(rule.fields) <= set(topic.columns):
                continue
            path = rule.fields[0].rpartition(".")[0] + "."
            shared = len(path) if all(field.startswith(path) for field in rule.fields) else 0
            fields = rule.fields[0][:shared] + "/".join(field[shared:] for field in rule.fields)
            source = fields if name in ("", fields) else f"{name}.{fields}"
            if name in turned_down:
                reason = _unless_zero(_raw(rule, topic), turned_down[name])
            elif rule.channel in found:
                reason = _second(found[rule.channel], rule, topic)
            else:
                result = _mapped(log, rule, topic, source, throw_rad or {})
                if isinstance(result, Mapped):
                    found[rule.channel] = result
                    continue
                reason = result
            passed.append(Passed(rule.channel, topic.t_s, source, reason))
    _of_velocities(found)
    return Found(tuple(found.values()), tuple(passed), choices)


def _of_velocities(found: dict[str, Mapped]) -> None:
    """Add V, alpha and beta where they were not logged, but the velocities along the body axes were, on one clock."""
    u, v, w = (found.get(name) for name in "uvw")
    if u is None or v is None or w is None or not (np.array_equal(u.t_s, v.t_s) and np.array_equal(u.t_s, w.t_s)):
        return
    speed = np.sqrt(u.values**2 + v.values**2 + w.values**2)
    side = np.divide(v.values, speed, out=np.zeros_like(speed), where=speed > 0.0)
    for name, values, said in (
        ("V", speed, "length of (u, v, w)"),
        ("alpha", np.arctan2(w.values, u.values), "arctan(w / u)"),
        ("beta", np.arcsin(side), "arcsin(v / V)"),
    ):
        if name not in found:
            found[name] = Mapped(name, u.t_s, values, f"{u.source}/{v.source}/{w.source}", said, u.assumed)


def _raw(rule: Rule, topic: Topic) -> list[FloatArray]:
    with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN, which complains as it is cast
        return [np.asarray(topic.columns[name], dtype=np.float64) for name in rule.fields]


def _second(first: Mapped, rule: Rule, topic: Topic) -> str:
    """Say that the channel was taken from elsewhere, and whether this signal says the same."""
    said = f"{rule.channel} is taken from {first.source}"
    columns = _raw(rule, topic)
    if rule.in_si and np.array_equal(first.t_s, topic.t_s):
        same = np.array_equal(rule.convert(*columns) + 0.0, first.values)
        said += ", which has the same values" if same else ", which has other values"
    return _unless_zero(columns, said)


def _unless_zero(columns: list[FloatArray], reason: str) -> str:
    """Return the reason for which a signal was passed over: that it holds nothing, if it does not, comes first."""
    held = any(np.any(column[np.isfinite(column)]) for column in columns)
    return reason if held or reason.startswith(ZERO) else f"{ZERO}; {reason}"


def _mapped(log: Log, rule: Rule, topic: Topic, source: str, throws: Mapping[str, float]) -> Mapped | str:
    """Return the channel that a rule makes of a topic, or why it makes none."""
    raw = _raw(rule, topic)
    ok = np.all(np.isfinite(raw), axis=0)
    if np.count_nonzero(ok) < MIN_SAMPLES:
        return f"{np.count_nonzero(ok)} of {ok.size} samples are numbers, at least {MIN_SAMPLES} are needed"
    if not any(np.any(column[ok]) for column in raw):
        return ZERO
    values = rule.convert(*(column[ok] for column in raw)) + 0.0  # no minus zero
    assumed, said = rule.assumed, rule.said
    place = log.imu_m.get(number_of(topic.name))
    if place is not None and rule.assumed == AT_IMU:
        assumed = ""
        where = ", ".join(f"{x:g}" for x in place)
        said += f"; by the log's settings {where} m forward, right, down of the centre of gravity"
    surface = rule.channel.removesuffix("_cmd")
    if rule.channel in _SURFACES and surface in throws and assumed.startswith(UNSTATED):
        assumed, said = f"{FULL_COMMAND} {throws[surface] / DEG_RAD:g} deg (as given)", "times full throw"
        values = values * throws[surface]
    elif rule.channel in _SURFACES and not rule.in_si:
        throw = throws.get(surface, DEFAULT_THROW_RAD)
        values = values * throw
        known = "as given" if surface in throws else "assumed, the log does not state it"
        assumed = "; ".join(filter(None, [assumed, f"{FULL_COMMAND} {throw / DEG_RAD:g} deg ({known})"]))
    finite = np.abs(values) <= LARGEST
    every = bool(ok.all() and finite.all())  # then its channels share the times of a topic
    values = values if every else values[finite]
    if values.size < MIN_SAMPLES:
        return f"{values.size} of {ok.size} samples can be converted, at least {MIN_SAMPLES} are needed"
    if rule.channel in TURNING and np.max(np.abs(values)) <= ONE_TURN:
        values = np.unwrap(values)
    t_s = topic.t_s if every else topic.t_s[ok][finite]
    cut_hz = log.filtered_hz.get((topic.name.partition("#")[0], rule.channel))
    if cut_hz is not None:
        late_s = filter_delay_s(cut_hz)
        t_s = t_s - late_s
        said += (
            f"; taken {1e3 * late_s:.1f} ms earlier than logged: the low pass at {cut_hz:g} Hz of the log's settings"
        )
    return Mapped(rule.channel, t_s, values, source, said, assumed)


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


@dataclass(frozen=True)
class Dropped:
    """Samples of a topic that were left out for their times: how many of how many, and what is wrong with the times."""

    topic: str
    count: int
    of: int
    why: str


def dropped_in_words(dropped: Iterable[Dropped | None]) -> list[str]:
    """Return a sentence for each thing that is wrong with times, and the topics that lost samples by it."""
    by: dict[str, list[Dropped]] = {}
    for one in dropped:
        if one is not None:
            by.setdefault(one.why, []).append(one)
    out = []
    for why, same in by.items():
        first = same[0]
        head = f"{first.topic}: " if first.topic else ""
        rest = ", ".join(f"{d.topic} ({d.count} of {d.of})" for d in same[1:])
        also = f"; so have {rest}" if rest else ""
        out.append(f"{head}{first.count} of {first.of} samples left out, because {why}{also}")
    return out


def make_topic(
    name: str, t_s: FloatArray, columns: Mapping[str, NDArray[Any]], units: Mapping[str, str] | None = None
) -> tuple[Topic, Dropped | None]:
    """Return the topic with times that increase, and the samples left out for it, None if none were."""
    keep = increasing(t_s)
    if keep.size == t_s.size:
        return Topic(name, t_s, columns, units or {}), None
    topic = Topic(name, t_s[keep], {key: column[keep] for key, column in columns.items()}, units or {})
    return topic, Dropped(name, t_s.size - keep.size, t_s.size, _wrong_with(t_s))


def _wrong_with(t: FloatArray) -> str:
    """Say what is wrong with times of which some were left out."""
    steps = np.diff(t[np.isfinite(t)])
    back = steps[steps < 0.0]
    if not steps.size:
        return "they have no times"
    if not back.size:
        return "their times repeat the one before, or lie far from the others"
    if back.size == 1 and not np.any(
        steps[: np.argmin(steps)] > -back[0]
    ):  # not a wrong time that comes back by itself
        return f"the clock runs backwards, once, by {-float(back[0]):.3g} s: it was set back, or the logger restarted"
    return f"their times run backwards, {back.size} times, by {-float(back.min()):.3g} s at most"
