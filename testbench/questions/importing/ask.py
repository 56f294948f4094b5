"""Read one log: say what is in it, and write its manoeuvres as records with descriptions for ``testbench identify``."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.channels import CONTROLS, SURFACES, channel, unit_factor
from testbench.core.constants import DEG_RAD
from testbench.core.door import open_file, sha256
from testbench.core.errors import RecordError
from testbench.core.escape import one_line
from testbench.core.files import write_file
from testbench.core.paths import not_found
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Preparation
from testbench.core.store import ResultFolder
from testbench.inference.changes import Watch
from testbench.logs.ardupilot import ardupilot_rules
from testbench.logs.blackbox import MAGIC as BLACKBOX
from testbench.logs.dataflash import HEAD, read_dataflash
from testbench.logs.delays import Delay, delays_of
from testbench.logs.foreign import TELEMETRY, looks_like_text, refuse_foreign
from testbench.logs.instances import number_of
from testbench.logs.layout import SUFFIXES, ChannelColumn, find_data_folder
from testbench.logs.manoeuvres import QUIET_S, SMALLEST, Cutting, Manoeuvre, Search, cut_at, find_manoeuvres
from testbench.logs.mavlink import read_tlog
from testbench.logs.noise import Noise, jump_of, noise_of, true_rate
from testbench.logs.paparazzi import is_paparazzi, read_paparazzi
from testbench.logs.plausible import implausible, refusal, to_set
from testbench.logs.px4 import px4_rules
from testbench.logs.question import Question
from testbench.logs.read import read_records
from testbench.logs.readings import readings, settled, turned
from testbench.logs.resampling import common_rate, resample
from testbench.logs.ros import is_bag
from testbench.logs.sidpac import NOTHING, Told, read_columns, read_folder, read_recorder, read_recording
from testbench.logs.signals import FULL_COMMAND, UNSTATED, Log, Mapped, Rule, Topic, find_channels, scaled
from testbench.logs.stretches import Stretch, beyond_ground, flown_parts, not_flown, stretches_of
from testbench.logs.ulog import MAGIC, read_ulog
from testbench.page.shown import Shown
from testbench.page.words import listed, some
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.balance import Balance, balance_of, balance_rows
from testbench.questions.importing.recipe import (
    AXES,
    FEWEST,
    Recipe,
    lines,
    measured_in,
    moving,
    propose,
    too_few,
    too_slow,
    why_not,
)

_ANYWHERE = Cutting()
"""Quiet flight before each manoeuvre and response after it that are cut out with it."""
_HALF_S = 0.5  # over which a control that is used to fly moves by more than a dead band, more often than not
_REPEATS = 0.8  # of the rate at which it was logged: below it samples repeat those before
_LONG_S = 60.0  # of flight: beyond it windows are taken
WINDOW_S, MOST_WINDOWS = 15.0, 8
"""Windows of flight without designed inputs: ten periods of a slow short period, and enough of them to tell values."""
LOG = "log.json"
"""What a folder of records says of their log: its stretches, manoeuvres, questions with answers, and settings."""
WHOLE = "whole"
"""Name of the record of a whole log, and of its description."""
_WITHOUT_SURFACES = ("rotorcraft", "other")
_COMMANDS = tuple(f"{name}_cmd" for name in CONTROLS)
_WORD = re.compile(r"[a-z]+")
_OPTION = re.compile(r"--(?:unit|throw|axes) [\w=.-]*\w")  # of the command, as a question names it
_SURFACES = set(_WORD.findall("elev elevator elevon elevons ail aileron ailerons ailrn rud rudder ruddr stabilator"))
UNUSABLE = "no_recipe"
"""Key of the provenance of a whole record: why there is no recipe for it or for its cuts."""


@dataclass(frozen=True, eq=False)
class Imported(Shown, page="testbench.questions.importing.page:import_page"):
    """A log that was read: its channels as logged, one record of them on one clock, and the manoeuvres in it.

    ``channels`` are those of ``record``, in its order, ``noise`` is theirs, ``delays`` those that are told;
    ``stretches`` say what kind of flight each part of it is; ``balance`` says what became of every other signal;
    ``questions`` are implausible values; ``cutting`` says where manoeuvres were cut out; ``watch`` holds what
    changed in flight, if it was asked.
    """

    log: Log
    channels: tuple[Mapped, ...]
    record: FlightRecord
    rate_hz: float
    search: Search
    stretches: tuple[Stretch, ...]
    noise: Mapping[str, Noise]
    delays: Mapping[str, Delay]
    balance: Balance
    questions: tuple[Question, ...]
    description: Path | None = None
    cutting: Cutting = _ANYWHERE
    watch: Watch | None = None

    @cached_property
    def members(self) -> dict[str, dict[str, tuple[Manoeuvre | None, FlightRecord]]]:
        """Axis -> name -> (manoeuvre, record) of what can be identified; the whole record if nothing can be cut out."""
        return {
            axis: own
            for axis, every in self._groups.items()
            if (own := {name: (m, r) for name, (m, r) in every.items() if not why_not(r, controls_of(r))})
        }

    @cached_property
    def unusable(self) -> tuple[str, ...]:
        """Why nothing is identified from a cut, or from the whole record, in sentences."""
        if self.log.vehicle in _WITHOUT_SURFACES:
            what = self.log.facts.get("vehicle", "vehicle without a wing")
            return (_no_recipe([WHOLE], f"the log is of a {what}: it has no control surface of a fixed wing"),)
        if not controls_of(self.record):
            known = [f"{s.channel}: {s.reason}" for s in self.balance.left_out if s.channel in (*CONTROLS, *_COMMANDS)]
            found = "no control was found" + (f" ({'; '.join(known)})" if known else "")
            return (_no_recipe([WHOLE], found + self._like_controls()),)
        every = {name: record for own in self._groups.values() for name, (_, record) in own.items()}
        causes: dict[str, list[str]] = {}
        for name, record in every.items():
            if why := why_not(record, controls_of(record)):
                causes.setdefault(why + self._if_slower(record), []).append(name)
        alone = [_no_recipe(names, why) for why, names in causes.items()]
        if not every:
            moved = dict.fromkeys(m.reason for m in self.search.manoeuvres if m.cut_s is None)
            why = some(moved or dict.fromkeys(s.why for s in self.stretches if s.why), 2)
            alone = [_no_recipe([WHOLE], f"it contains no flight: {why}")]
        together = [_no_recipe(list(own), why) for own in self.members.values() if (why := _proposal(self, own)[2])]
        return (*alone, *together)

    def _like_controls(self) -> str:
        """Say what to do with columns that are called after a control but have no unit that a channel has."""
        found = [f"'{s.source}'" for s in self.balance.unknown if _SURFACES & set(_WORD.findall(s.source.lower()))]
        if not found or not self.log.kind.startswith("table"):
            return ""
        verb = "is" if len(found) == 1 else "are"
        return (
            f"; {listed(found)} {verb} named after one, but the name does not state an angle: write the unit in the "
            "header, [deg], or [norm] for parts of full throw (--throw de=25), or describe the table (--describe)"
        )

    def _if_slower(self, record: FlightRecord) -> str:
        """Say at which rate a control of a record would have all its samples, and whether that helps; "" if it has."""
        slow = too_slow(record, controls_of(record))
        if not slow:
            return ""
        rate = float(f"{min(c.rate_hz for c in self.channels if c.name in slow):.2g}")
        other = self.at_rate(rate)
        if any(_proposal(other, own)[1] is not None for own in other.members.values()):
            return f"; at its own rate it can be identified: testbench import LOG --rate {rate:g} -o FOLDER"
        whys = [why_not(r, controls_of(r)) for own in other._groups.values() for _, r in own.values()]
        whys += [_proposal(other, own)[2] for own in other.members.values()]
        why = next(filter(None, whys), "no control moves")
        return f"; --rate {rate:g} takes all of {'it' if len(slow) == 1 else 'them'}, but does not help: {why}"

    def at_rate(self, rate_hz: float) -> Imported:
        """Return what the same log gives at another rate."""
        record = resample(self.channels, rate_hz, self.record.provenance, CONTROLS, _COMMANDS)
        noise, search, stretches = _flown(record, self.log, self.cutting)
        return replace(self, record=record, rate_hz=rate_hz, search=search, stretches=stretches, noise=noise)

    @property
    def _groups(self) -> dict[str, dict[str, tuple[Manoeuvre | None, FlightRecord]]]:
        groups: dict[str, dict[str, tuple[Manoeuvre | None, FlightRecord]]] = {}
        for name, (m, record) in cut(self).items():
            groups.setdefault(_axis(m), {})[name] = (m, record)
        if not groups and controls_of(self.record) and self.log.vehicle not in _WITHOUT_SURFACES:
            for name, record in self.windows.items():
                groups.setdefault(WHOLE, {})[name] = (None, record)
        return groups

    @cached_property
    def fed_back(self) -> str:
        """What shows that the controls react to the motion, so that none of their movements was designed; "" if not."""
        flown = [s for s in self.stretches if s.flown]
        time = sum(s.end_s - s.start_s for s in flown)
        by = [s for s in flown if s.mode.endswith(("(stabilised)", "(automatic)"))]
        if time and sum(s.end_s - s.start_s for s in by) > 0.5 * time:
            return f"the autopilot flies ({some(dict.fromkeys(s.mode for s in by), 3, ', ')})"
        busy = busy_controls(self.record, self.stretches, controls_of(self.record))
        return f"{listed(busy)} move{'s' if len(busy) == 1 else ''} most of the time" if busy else ""

    @cached_property
    def windows(self) -> dict[str, FlightRecord]:
        """Name -> record of what is identified from where no manoeuvre can be cut out: flight without designed inputs.

        A short flight is one record; of a long one the windows with the most excitation: a state is free at the start
        of each, so that neither gusts nor what the model lacks add up.
        """
        record, parts = self.record, flown_parts(self.stretches)
        if len(parts) == 1 and parts[0][1] - parts[0][0] > 0.99 * record.duration_s <= 0.99 * _LONG_S:
            return {WHOLE: record}
        if sum(b - a for a, b in parts) > _LONG_S:
            parts = self._excited(parts)
        cuts = [record.between(a, b) for a, b in parts if (b - a) / record.dt_s >= FEWEST]
        return {
            f"window_{i}": replace(
                part,
                t_s=part.t_s - part.t_s[0],
                provenance={**part.provenance, "cut_from_record_s": [float(part.t_s[0]), float(part.t_s[-1])]},
            )
            for i, part in enumerate(cuts, 1)
        }

    def _excited(self, parts: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return the windows in which the controls move most beyond what they do in most others, in order of time."""
        spans = [
            (start, start + WINDOW_S)
            for a, b in parts
            for start in np.arange(a, b - WINDOW_S + 1.5 * self.record.dt_s, WINDOW_S).tolist()
        ] or list(parts)  # each of them shorter than a window
        cuts = [self.record.between(a, b) for a, b in spans]
        spread = np.array([[np.std(part[name]) for name in controls_of(self.record)] for part in cuts])
        usual = np.median(spread, axis=0)
        score = np.sum(spread / np.where(usual > 0.0, usual, np.inf), axis=1)
        return [spans[i] for i in sorted(np.argsort(-score, kind="stable")[:MOST_WINDOWS].tolist())]

    @property
    def repeated(self) -> tuple[str, ...]:
        """Channels whose samples repeat a slower signal, with its rate."""
        slow = {c.name: (self.noise[c.name].rate_hz, c.rate_hz) for c in self.channels}
        slow = {name: rates for name, rates in slow.items() if rates[0] < _REPEATS * rates[1]}
        return tuple(f"{name} {own:.3g} of {rate:.3g} Hz" for name, (own, rate) in slow.items())

    @property
    def jumps(self) -> tuple[str, ...]:
        """Surfaces that move in jumps, as no surface does: what was logged is a command."""
        out = []
        for c in self.channels:
            size = jump_of(c.values) if c.name in SURFACES else 0.0
            if size > SMALLEST["rad"]:
                out.append(
                    f"{c.name} ('{c.source}') jumps by {size / DEG_RAD:.2g} deg within a sample ("
                    f"{size / DEG_RAD * c.rate_hz:.0f} deg/s), as only a command can: a servo behind it is "
                    f'tried; [servo.{c.name}] with lag_s = "estimate" in the description adds one'
                )
        return tuple(out)

    @property
    def asked(self) -> tuple[str, ...]:
        """The questions in words, with what to set."""
        return (*(question.asked(self._to_set) for question in self.questions), *self.balance.disagree)

    def _to_set(self, name: str, unit: str) -> str:
        """Say how a channel of this log is read in another unit."""
        if self.description is not None:
            return to_set(self.description)(name, unit)
        if not unit:
            return ""
        if not self.log.kind.startswith("table"):
            return f"The format itself fixes the unit: this log, or the sensor, is not as {self.log.kind} has it"
        mapped = next((c for c in self.channels if c.name == name), None)
        column = "time" if mapped is None else mapped.source
        if mapped is not None and not mapped.assumed.startswith(UNSTATED):
            return (
                f"the heading of '{column}' states another one: correct it, or describe the file with unit = \"{unit}\""
            )
        if mapped is None:
            return f"write the unit in the header, '{column} [{unit}]', or describe the file with unit = \"{unit}\""
        if unit == "norm":
            return (
                f"--throw {name.removesuffix('_cmd')}=25 reads '{column}' as parts of a full throw of 25 deg, --unit "
                f"{name}=deg in degrees"
            )
        return f"--unit {name}={unit} reads '{column}' so"

    def to_json(self) -> str:
        """Return what a folder of its records says of the log, as JSON; times in s of the record."""
        content = {
            "log": self.log.file.name,
            "format": self.log.kind,
            "stretches": [{**asdict(s), "flown": s.flown} for s in self.stretches],
            "manoeuvres": [asdict(m) for m in self.search.manoeuvres],
            "questions": [{"asks": text, "answers": [w.split() for w in _OPTION.findall(text)]} for text in self.asked],
            "parameters": {name: value for name, value in self.log.parameters.items() if np.isfinite(value)},
        }
        return json.dumps(content, ensure_ascii=False, allow_nan=False)


NOT_FLOWN = "not_flown"
"""Key of the provenance of records: how much of the log does not fly, in words."""


def read_log(path: Path | str, told: Told = NOTHING) -> tuple[Log, tuple[Rule, ...]]:
    """Read a log of any known format, told by its first bytes, else by its suffix; return it and its rules.

    ``told`` says of a table what it does not say itself.

    Raises:
        RecordError: the file is missing, empty, of no known format, or damaged beyond use.
    """
    path = Path(path)
    head = b""
    if path.is_dir() and any(path.glob("*.csv")):
        return read_folder(path, told)
    if not path.is_file() and not is_bag(path, head):
        raise RecordError(f"a log must be a file that exists, got {not_found(path)}")
    if path.is_file():
        with open_file(path, "log") as file:
            head = file.read(8000)
    if is_bag(path, head):
        return read_recording(path, told)
    if head.startswith(BLACKBOX):
        return read_recorder(path, told)
    if (told.axes or told.units) and path.suffix.lower() not in SUFFIXES:
        raise RecordError(f"--unit and --axes are for tables ({', '.join(SUFFIXES)}), which '{path}' is not")
    suffix = path.suffix.lower()
    if not head:
        raise RecordError(f"a log must hold samples, but '{path}' is empty")
    if suffix == ".toml":
        return read_described(path, told.part)
    if told.part is not None:
        raise RecordError(
            f"--record chooses among those of a description (.toml) or a blackbox (.bbl), but '{path}' is none"
        )
    if TELEMETRY.match(head):
        return read_tlog(path)
    if not head.startswith((MAGIC, HEAD)):
        refuse_foreign(path, head, SUFFIXES.get(suffix, ""))
    if head.startswith(MAGIC) or suffix == ".ulg":
        return px4_rules(read_ulog(path))
    if head.startswith(HEAD) or suffix == ".bin" or (suffix in (".log", ".txt") and b"FMT," in head):
        return ardupilot_rules(read_dataflash(path))
    if is_paparazzi(head) and (suffix not in SUFFIXES or suffix in (".txt", ".log")):
        return read_paparazzi(path)
    if suffix in SUFFIXES:
        return read_columns(path, told)
    raise RecordError(
        "a log must be PX4's ULog (.ulg), ArduPilot's DataFlash (.bin, .log), telemetry of MAVLink (.tlog), a "
        "recording of ROS (.bag, .mcap, .db3), a blackbox of Betaflight or iNav (.bbl), Paparazzi's messages (.data), "
        "a table "
        f"({', '.join(SUFFIXES)}) or the description of one (.toml), got '{path}', which begins as none of them"
        + ("; if it is a table, name it .csv or .txt" if looks_like_text(head) else "")
    )


def read_described(path: Path, part: str | None = None) -> tuple[Log, tuple[Rule, ...]]:
    """Read one record of a description as a log; return it and its rules.

    Raises:
        RecordError, ScenarioError: the description is incomplete, its data cannot be read, or it has several records
            and ``part`` is not one of them.
    """
    description = RecordDescription.load(path)
    records = {name: record for name, _, record in read_records(description)}
    if (part or "") not in (records if part is not None or len(records) > 1 else ("",)):
        raise RecordError(
            f"one of the records of '{path}' must be chosen by --record: {', '.join(records)}; got {part or 'none'}"
        )
    name = part or next(iter(records))
    record = records[name]
    columns = {n: np.where(record.valid[:, i], record.data[:, i], np.nan) for i, n in enumerate(record.channels)}
    rules = tuple(
        Rule(c.name, "", (c.name,), scaled(1.0), _column_in_words(c), in_si=True) for c in description.channel
    )
    file = find_data_folder(description) / next(spec.file for spec in description.record if name in spec.parts)
    return Log(file, "a table, as described", {"": Topic("", record.t_s, columns)}), rules


def _column_in_words(c: ChannelColumn) -> str:
    """Return how a channel is made of the columns of a table: "0.5 (column 29 - column 28), deg"."""
    text = f"column {c.column}"
    if c.minus_column is not None:
        text += f" - column {c.minus_column}"
        text = f"({text})" if c.scale != 1.0 else text
    text = f"{'' if c.scale == 1.0 else f'{c.scale:g} '}{text}"
    return f"{text}{f' {c.offset:+g}' if c.offset else ''}, {c.unit}"


def import_log(
    path: Path | str,
    rate_hz: float | None = None,
    throw_rad: Mapping[str, float] | None = None,
    sensors: Mapping[str, int] | None = None,
    told: Told = NOTHING,
    cutting: Cutting = _ANYWHERE,
    strict: bool = False,
) -> Imported:
    """Read a log, map it to the channel table, put it on one clock and find its manoeuvres.

    Args:
        path: the log.
        rate_hz: rate of the record; :func:`testbench.logs.resampling.common_rate` chooses it if none is given.
        throw_rad: surface ("de", "da", "dr") -> its deflection at full command, rad.
        sensors: kind of sensor ("imu", "airspeed", "gps", "baro", "ekf") -> the instance to read, counted from 0; the
            best if not given.
        told: what you say of a table.
        cutting: where manoeuvres are cut out.
        strict: refuse implausible values (``questions``).

    Raises:
        RecordError: the log cannot be read, holds no channel of the table or not the sensor asked for, a number given
            is out of its range, or ``strict`` and a value is implausible.

    Example:
        >>> import testbench as tb
        >>> found = tb.import_log("flight.bin", sensors={"imu": 1})  # doctest: +SKIP
        >>> print([s.channel for s in found.balance.kept], found.asked)  # doctest: +SKIP
    """
    axes = told.axes
    log, rules = read_log(path, told)
    found = find_channels(log, rules, throw_rad, sensors)
    if not found.channels:
        raise RecordError(
            f"'{path}' must hold signals of the channel table, but none of its topics is known as one, or they hold "
            f"fewer than 4 samples or nothing but zeros: {', '.join(name or 'the table' for name in log.topics)}"
        )
    plain = log.kind.startswith(("table", "a folder", "a recording"))
    described = Path(path) if Path(path).suffix.lower() == ".toml" else None
    unstated = [c.name for c in found.channels if c.assumed.startswith(UNSTATED)]
    stated = [] if described else [c.name for c in found.channels if c.name not in unstated]
    doubtful = [c.name for c in found.channels if plain and FULL_COMMAND in c.assumed]
    vectors = any("axes forward" in c.said for c in found.channels)  # whose axes were told or seen as they were read
    loose = plain and axes is None and not vectors
    open_ = {*unstated, *(name for name in doubtful if name.removesuffix("_cmd") not in (throw_rad or {})), "axes"}
    channels = turned(found.channels) if axes == "flu" and plain and not vectors else found.channels
    signals = {c.name: (c.t_s, c.values) for c in channels}
    likelier = readings(signals, unstated, doubtful, loose, stated)
    sure = [reading for reading in likelier if reading.certain and reading.channel in open_]
    channels, notes = settled(channels, sure)
    found, log = replace(found, channels=channels), replace(log, notes=(*log.notes, *notes))
    rate = common_rate(channels) if rate_hz is None else rate_hz
    provenance: dict[str, Any] = {
        "file": log.file.name,
        "sha256": _digest(log.file),
        "format": log.kind,
        "log": dict(log.facts),
        "warnings": list(log.warnings),
    }
    record = resample(channels, rate, provenance, CONTROLS, _COMMANDS)
    balance = balance_of(log, found, record)
    channels = tuple(c for c in channels if c.name in record)
    said = {
        "channels": {c.name: {"source": c.source, "conversion": c.said, "assumed": c.assumed} for c in channels},
        "left_out": [{"source": s.source, "channel": s.channel, "reason": s.reason} for s in balance.left_out],
        "sensors": list(balance.sensors),
    }
    record = replace(record, provenance={**record.provenance, **said})
    noise, search, stretches = _flown(record, log, cutting)
    noise |= {c.name: replace(noise[c.name], rate_hz=true_rate(c.values, c.rate_hz)) for c in channels}
    questions = implausible(
        {c.name: (c.t_s, c.values) for c in channels},
        unstated=[c.name for c in channels if c.assumed.startswith(UNSTATED)],
        stated=stated,
        found=[reading for reading in likelier if reading not in sure],
    )
    rest = "" if log.vehicle in _WITHOUT_SURFACES else not_flown(stretches)
    record = replace(record, provenance={**record.provenance, **({NOT_FLOWN: rest} if rest else {})})
    imported = Imported(
        log, channels, record, rate, search, stretches, noise,
        delays_of(record, channels, flown_parts(stretches)), balance, questions, described, cutting,
    )  # fmt: skip
    if strict and imported.asked:
        raise RecordError(refusal(path, imported.asked))
    return imported


def _digest(file: Path) -> str:
    """Return the SHA-256 of a log, of a folder that of the digests of its tables, in the order of their names."""
    if file.is_file():
        return sha256(file, "log")
    files = sorted(file.glob("*.csv")) or sorted(part for part in file.iterdir() if part.is_file())
    parts = "".join(sha256(part, "log") for part in files)
    return hashlib.sha256(parts.encode()).hexdigest()


def _flown(record: FlightRecord, log: Log, cutting: Cutting) -> tuple[dict[str, Noise], Search, tuple[Stretch, ...]]:
    """Return the noise of each channel of a record, where its controls move, and what kind of flight each stretch is.

    What moves where nothing flies is not cut out; cuts that somebody chose take the place of all that was found.
    """
    taken = {name: record.valid[:, i] for i, name in enumerate(record.channels)}
    noise = {name: noise_of(record.t_s[ok], record[name][ok]) for name, ok in taken.items()}
    seen = {name: np.count_nonzero(ok) / max(record.duration_s, record.dt_s) for name, ok in taken.items()}
    every = () if log.vehicle in _WITHOUT_SURFACES else controls_of(record)
    controls = tuple(name for name in every if seen[name] * _HALF_S >= 1.0)  # a slower one shows no manoeuvre
    search = find_manoeuvres(record, controls, cutting.lead_s, cutting.tail_s) if controls else Search((), ())
    stretches = stretches_of(record, log, search.manoeuvres, noise)
    if cutting.at:
        return noise, cut_at(record, controls, cutting.at), stretches
    found = beyond_ground(search.manoeuvres, stretches, record, noise)
    busy = set(busy_controls(record, stretches, controls))
    found = tuple(replace(m, cut_s=None, reason=_STEERED) if m.cut_s and busy & set(m.controls) else m for m in found)
    return noise, replace(search, manoeuvres=found), stretches


def busy_controls(record: FlightRecord, stretches: Sequence[Stretch], controls: Sequence[str]) -> list[str]:
    """Return the controls that steer a flight of more than a minute: within half a second they move, mostly."""
    m = max(2, round(_HALF_S / record.dt_s))
    parts = [record.between(a, b) for a, b in flown_parts(stretches) if b > a]
    out = []
    for name in controls if sum(part.duration_s for part in parts) > _LONG_S else ():
        ranges = [np.ptp(part[name][: len(part) // m * m].reshape(-1, m), axis=1) for part in parts]
        if float(np.median(np.concatenate(ranges))) > SMALLEST.get(channel(name).unit, 0.0):
            out.append(name)
    return out


_STEERED = "its control moves most of the time: it steers, without a designed input"


def parse_units(given: Sequence[str]) -> dict[str, str]:
    """Return channel -> unit from texts such as "alpha=deg".

    Raises:
        RecordError, ChannelError: a text is not of that form, or the channel has no such unit.
    """
    out = {}
    for text in given:
        name, _, unit = text.partition("=")
        unit_factor(name, unit)
        out[name] = unit
    return out


def parse_cuts(given: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """Return first and last time, s, from texts such as "12.5:20".

    Raises:
        RecordError: a text is not of that form.
    """
    out = []
    for text in given:
        low, _, high = text.partition(":")
        try:
            out.append((float(low), float(high)))
        except ValueError:
            raise RecordError(f"a cut must be START:END in s of the record, as 12.5:20, got '{text}'") from None
    return tuple(out)


def parse_throws(given: Sequence[str]) -> dict[str, float]:
    """Return surface -> deflection at full command, rad, from texts such as "de=20" (deg).

    Raises:
        RecordError: a text is not of that form, or the deflection is not between 0 and 90 deg.
    """
    out = {}
    for text in given:
        name, _, size = text.partition("=")
        try:
            degrees = float(size)
        except ValueError:
            degrees = np.nan
        if name not in SURFACES or not 0.0 < abs(degrees) <= 90.0:
            raise RecordError(
                "a throw must be de, da or dr = degrees up to 90, as de=20, or de=-20 where full command moves it the "
                f"other way, got '{text}'"
            )
        out[name] = degrees * DEG_RAD
    return out


def controls_of(record: FlightRecord) -> tuple[str, ...]:
    """Return the controls of a record: the deflection where it was logged, else the command."""
    names = (name if name in record else f"{name}_cmd" for name in CONTROLS)
    return tuple(name for name in names if name in record)


def cut(imported: Imported) -> dict[str, tuple[Manoeuvre, FlightRecord]]:
    """Return name -> (manoeuvre, record), time counted from the start of each cut, for those that can be cut out."""
    out: dict[str, tuple[Manoeuvre, FlightRecord]] = {}
    usable = [m for m in imported.search.manoeuvres if m.cut_s is not None]
    for i, m in enumerate(usable, start=1):
        assert m.cut_s is not None
        part = imported.record.between(m.cut_s[0], m.cut_s[1] + 0.5 / imported.rate_hz)
        part = replace(
            part, t_s=part.t_s - part.t_s[0], provenance={**part.provenance, "cut_from_record_s": list(m.cut_s)}
        )
        out[f"{i:02d}_{'_'.join(name.removesuffix('_cmd') for name in m.controls)}"] = (m, part)
    return out


def write_import(imported: Imported, folder: Path | str | ResultFolder) -> list[Path]:
    """Write a log's page, the whole record, one per manoeuvre (NetCDF), and a description per axis; return their paths.

    Descriptions are named after the log: FILE_longitudinal.toml, FILE_lateral.toml, FILE_combined.toml; if no manoeuvre
    can be cut out, FILE_whole.toml, which splits the whole record. What cannot support a recipe (``imported.unusable``)
    is written as a record and has no description. Each is read back as ``testbench identify`` would
    read it. All of it takes the place of what an earlier import wrote there. Neither the page is among the paths, nor
    log.json, which says of the log what the pages of the workbench show.

    Raises:
        BusyError: another process writes into the folder.
        WriteError: the folder cannot be written to, or has a file of such a name that no import wrote.
    """
    from testbench.questions.importing.page import import_page

    if not isinstance(folder, ResultFolder):
        with ResultFolder(folder) as place:
            return write_import(imported, place)
    new = folder.new
    said = {UNUSABLE: list(imported.unusable)} if imported.unusable else {}
    whole = replace(imported.record, provenance={**imported.record.provenance, **said})
    paths = [whole.save(new / f"{WHOLE}.nc")]
    write_file(new / LOG, imported.to_json())
    cuts = {name: record for name, (_, record) in cut(imported).items()}
    cuts |= {name: r for own in imported.members.values() for name, (_, r) in own.items() if name != WHOLE}
    paths += [record.save(new / f"{name}.nc") for name, record in cuts.items()]
    stem = imported.log.file.stem
    for axis, members in imported.members.items():
        text = describe(imported, axis, members)
        if text:
            paths.append(write_file(new / f"{stem}_{axis}.toml", text))
            RecordDescription.load(paths[-1])
    import_page(imported).write(folder)
    return [folder.path / path.name for path in paths]


def _no_recipe(names: Sequence[str], why: str) -> str:
    return f"no recipe for {some(['the whole record' if name == WHOLE else name for name in names], 3, ', ')}: {why}"


def _axis(m: Manoeuvre) -> str:
    bases = {name.removesuffix("_cmd") for name in m.controls}
    return next((axis for axis, own in AXES.items() if bases <= set(own)), "combined")


def describe(imported: Imported, axis: str, members: Mapping[str, tuple[Manoeuvre | None, FlightRecord]]) -> str:
    """Return the description (TOML) of some records of one log, "" if nothing was measured that could be an output.

    Manoeuvres of the same controls identify and validate in turn; a single one is split. A comment at every channel
    says where it comes from and what was assumed.
    """
    log = imported.log
    records = [record for _, record in members.values()]
    held = measured_in(records)
    cut_out = any(m is not None for m, _ in members.values())
    inputs, recipe, _ = _proposal(imported, members)
    if recipe is None:
        return ""
    what = (
        f"{axis} manoeuvres"
        if cut_out
        else "the whole record"
        if WHOLE in members
        else "flight without designed inputs"
    )
    leads = [m.start_s - m.cut_s[0] for m, _ in members.values() if m is not None and m.cut_s is not None]
    trim = np.floor(10.0 * min(leads, default=0.0)) / 10.0
    q = json.dumps
    head = [
        "# Written by testbench import. Edit it: uses, inputs, outputs and estimators are proposals.",
        *(f"# Log: {one_line(text)}" for text in log.warnings),
        *(f"# Assumed: {one_line(text)}" for text in log.assumed),
        *(f"# A command? {text}" for text in imported.jumps),
        *([f"# Closed loop: {imported.fed_back}"] if imported.fed_back else []),
        *(f"# Flight only: {text}" for text in (not_flown(imported.stretches),) if text),
        *(f"# Question: {one_line(text)}" for text in imported.asked),
        *_balance_lines(imported, held),
        f"title = {q(f'{log.file.name}: {what}')}",
        f"source = {q(f'{log.file.name}, {log.kind}')}",
        'rights = "state here the owner of the data and who may use them"',
        'folder = "."',
        *([f"trim_s = {trim:g}"] if trim >= QUIET_S else []),
        "",
        "[time]",
        'column = "t"',
    ]
    for (name, (m, _)), use in zip(members.items(), _uses(members), strict=True):
        head += ["", "[[record]]"]
        if m is not None and m.cut_s is not None:
            head.append(
                f"# {m.cut_s[0]:.2f} to {m.cut_s[1]:.2f} s of whole.nc; controls move from {m.start_s:.2f} s on"
            )
        head += [f"name = {q(name)}", f"file = {q(name + '.nc')}", f"use = {q(use)}"]
    for c in imported.channels:
        if c.name in held:
            head += ["", f"# {one_line(c.source)}: {one_line(c.said)}"]
            head += [f"# assumed: {one_line(c.assumed)}"] if c.assumed else []
            head += ["[[channel]]", f"name = {q(c.name)}", f"column = {q(c.name)}", f"unit = {q(channel(c.name).unit)}"]
            head.append('missing = "mask"')
    head += ["", "[preparation]", f'bias = "{"trim" if trim >= QUIET_S else "mean"}"', *lines(recipe, inputs)]
    return "\n".join([*head, ""])


def _proposal(
    imported: Imported, members: Mapping[str, tuple[Manoeuvre | None, FlightRecord]]
) -> tuple[list[str], Recipe | None, str]:
    """Return the inputs and the recipe for some records of one log; without a recipe why there is none."""
    records = [record for _, record in members.values()]
    held = measured_in(records)
    used = [m for m, _ in members.values() if m is not None] or imported.search.manoeuvres
    moved = {name for m in used for name in m.controls}
    inputs = [n for n in controls_of(records[0]) if n in held and (n in moved or not moved)]
    inputs = moving(records, inputs)
    if not inputs:
        return inputs, None, "no control that moves has samples in every one of them"
    places = imported.log.imu_m
    place = next((places.get(number_of(c.source.partition(".")[0])) for c in imported.channels if c.name == "az"), None)
    recipe = propose(inputs, records, imported.rate_hz, place, bool(imported.fed_back))
    if recipe is None:
        return inputs, None, f"nothing was measured that shows {', '.join(inputs)}"
    share = Preparation.model_fields["identification_fraction"].default
    parts = zip(records, _uses(members), strict=True)
    fit = [r.split(share)[0] if use == "split" else r for r, use in parts if use != "validation"]
    why = too_few(fit, recipe, inputs)
    return inputs, None if why else recipe, why


def _balance_lines(imported: Imported, held: Sequence[str]) -> list[str]:
    """Return the balance as remarks: what was kept, chosen and left out, and what this file does not name."""
    balance = imported.balance
    out = ["# Balance (channel, source, samples, rate, share of the record's samples that were taken):"]
    out += [f"#   {one_line('  '.join(filter(None, row)))}" for row in balance_rows(balance.kept)]
    out += [f"# Sensor: {one_line(text)}" for text in balance.sensors]
    if balance.left_out:
        out.append("# Left out:")
        out += [f"#   {one_line(f'{s.channel} from {s.source}: {s.reason}')}" for s in balance.left_out]
    absent = [s.channel for s in balance.kept if s.channel not in held]
    if absent:
        out.append(f"# In whole.nc and not named below, because a record here holds no sample: {', '.join(absent)}")
    return out


def _uses(members: Mapping[str, tuple[Manoeuvre | None, FlightRecord]]) -> list[str]:
    groups = [m.controls if m is not None else () for m, _ in members.values()]
    total, seen = Counter(groups), Counter[tuple[str, ...]]()
    out = []
    for group in groups:
        out.append("split" if total[group] == 1 else ("identification", "validation")[seen[group] % 2])
        seen[group] += 1
    return out
