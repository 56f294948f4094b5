"""Measured flights as a user hands them in: files become records, checked, with what is believed of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import RecordError, located
from testbench.core.paths import find_scenario, not_found, suite_names
from testbench.core.record import FlightRecord, load_record
from testbench.flight import FlightCondition, load_aircraft
from testbench.logs.read import read_records
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import drive_records
from testbench.questions.gap.evidence.commanded import not_compared, quiet_samples
from testbench.questions.gap.scenario import Drive
from testbench.questions.gap.starts import Start, marked, record_key, start_of, timed
from testbench.questions.gap.windows import restless
from testbench.questions.identify.scenario import RecordDescription
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.sensor import whole_ratio

SAME_SPEED = 0.05  # share of an airspeed within which records start from one condition: one trim serves them all
SAME_HEIGHT_M = 300.0  # the same of heights: three percent of density
SAME_RATE = 0.01
LATEST = 0.5  # samples by which a record's clock may be off at its end to be put right to the suite's rate


@dataclass(frozen=True, eq=False)
class Flights:
    """What a user hands in."""

    believed: Believed  # aircraft, sensors and condition
    # naming, held_out: name -> measured record
    naming: Mapping[str, FlightRecord]
    held_out: Mapping[str, FlightRecord]
    notes: tuple[str, ...]  # what was assumed or chosen for the user, in sentences
    # what tells how the controls moved: commands, recorded surfaces, or surfaces where no command is recorded
    drive: Drive = "both"


@dataclass(frozen=True)
class Said:
    """What is said of measured flights beside their records."""

    # believed suite, itself, by name or as a file; if not given, the one that the records say made them
    sensors: str | SensorSuite | None = None
    # airspeed that all flights start from; if not given, its mean over the quiet flight before the commands. Flights
    # whose airspeeds or altitudes differ are then each flown from their own.
    V_m_s: float | None = None
    h_m: float | None = None  # altitude, likewise; the aircraft's design altitude where h is not recorded
    # "both" are commands, and recorded surfaces where no command is recorded; "surface" takes surfaces wherever they
    # are recorded, "command" none
    drive: Drive = "both"


WHOLE = "whole.nc"  # record of a whole log in a folder of `testbench import`, whose cuts lie beside it


def without_wholes(files: Sequence[Path]) -> list[Path]:
    """Return records without those of whole logs whose cuts are among them: no sample counts twice or judges itself."""
    cut = {f.parent.resolve() for f in files if f.suffix == ".nc" and f.name != WHOLE}
    return [f for f in files if f.name != WHOLE or f.parent.resolve() not in cut]


def load_flights(
    aircraft: str,
    files: Sequence[Path | str],
    hold_out: Sequence[Path | str] = (),
    said: Said = Said(),
    wings: str = "flexible",
    data_folder: Path | str | None = None,
) -> Flights:
    """Read measured flights and set up what is believed of them.

    Args:
        aircraft: name of the believed aircraft.
        files: records of the testbench (NetCDF) or descriptions of recorded flights (TOML); of a description, records
            for "validation" are held out.
        hold_out: the same; all of their records are held out. If nothing is held out and there are two records or more,
            the last one is.
        said: of them, beside the records.
        wings: "flexible" or "rigid".
        data_folder: folder of the files that descriptions name.

    Raises:
        ModelError: no such aircraft.
        ScenarioError, ChannelError: a description or suite is wrong.
        RecordError: a file is none of the above, or a record does not hold what is needed; file and record are named.
    """
    believed_aircraft = load_aircraft(aircraft, wings)
    if not files:
        raise RecordError(
            f"measured records of {aircraft} must be given (.nc, as testbench import writes them, or descriptions "
            f".toml), got none: testbench gap {aircraft} RECORD.nc ..."
        )
    naming: dict[str, FlightRecord] = {}
    held: dict[str, FlightRecord] = {}
    files = without_wholes([Path(f) for f in files])
    kept = {Path(f).resolve() for f in hold_out}  # a pattern such as flown/*.nc names those held out, too
    for given, always in [
        *((f, False) for f in files if Path(f).resolve() not in kept),
        *((f, True) for f in hold_out),
    ]:
        for name, use, record in read_flights(given, data_folder):
            free = free_name(name, record, {**naming, **held}, given)
            (held if always or use == "validation" else naming)[free] = record
    notes: list[str] = []
    if not held and len(naming) > 1:
        last = list(naming)[-1]
        held[last] = naming.pop(last)
        notes.append(
            f"no record was chosen to be held out, so the last record, '{last}', is; choose others with --hold-out"
        )
    if not naming:
        raise RecordError(
            "at least one record must be left for the search, got none: give records other than those of --hold-out"
        )
    if not held:
        notes.append("no record is held out, so the amended model is not validated; give --hold-out")
    return flights_of(believed_aircraft, naming, held, said, notes)


def flights_of(
    aircraft: Aircraft,
    naming: Mapping[str, FlightRecord],
    held: Mapping[str, FlightRecord],
    said: Said = Said(),
    notes: Sequence[str] = (),
) -> Flights:
    """Set up what is believed of records that were read; see :func:`load_flights`."""
    told = list(notes)
    suite = _suite(said.sensors, {**naming, **held}, told)
    records = check_records(suite, {**naming, **held}, told, said.drive != "command")
    condition, records = _conditions(aircraft, suite, records, said, told)
    with located(None, f"sensors '{suite.name}'"):
        believed = Believed(aircraft, suite, condition, frame_rate(aircraft, suite, told))
    told += not_compared(suite)
    named, judged = ({n: records[n] for n in part} for part in (naming, held))
    return Flights(believed, named, judged, tuple(told), said.drive)


def read_flights(given: Path | str, data_folder: Path | str | None = None) -> Iterable[tuple[str, str, FlightRecord]]:
    """Return name, use ("" if nothing says it) and record of each measured flight in a file.

    Raises:
        RecordError, ScenarioError: it is neither a measured record nor a description of some, or cannot be read.
    """
    path = Path(given)
    if path.suffix == ".nc":
        if not path.is_file():
            raise RecordError(f"a record must be a file that exists, got {not_found(path)}")
        record = load_record(path)
        with located(path, "kind"):
            if record.kind != "measured":
                raise RecordError(
                    "the gap workflow takes measured records only, got one of kind 'truth', which a real flight does "
                    "not have; leave the files that end in _truth.nc out"
                )
        manoeuvre = record.provenance.get("manoeuvre")
        return [(str(manoeuvre) if isinstance(manoeuvre, str) else path.stem, "", record)]
    found = path if path.is_file() else find_scenario(Path("records") / path)
    if not found.is_file():
        raise RecordError(f"a record must be a file that exists, got {not_found(path)}")
    if found.suffix != ".toml":
        raise RecordError(
            f"records must be NetCDF of the testbench (.nc) or a description of recorded flights (.toml), got "
            f"'{path}'; make records of a log with: testbench import {path} -o FOLDER"
        )
    return read_records(RecordDescription.load(found), data_folder)


def _suite(sensors: str | SensorSuite | None, records: Mapping[str, FlightRecord], notes: list[str]) -> SensorSuite:
    if isinstance(sensors, SensorSuite):
        return sensors
    if sensors is not None:
        return load_suite(sensors)
    if name := named_suite(records):
        notes.append(f"the sensors are assumed to be those of the records, {name}; choose others with --sensors")
        return load_suite(name)
    raise RecordError(
        "the sensors must be known, but these records do not name them; give --sensors with one of "
        f"{', '.join(suite_names())}, or a suite file (.toml)"
    )


def named_suite(records: Mapping[str, FlightRecord]) -> str:
    """Return the packaged suite that all records name; "" if they do not."""
    stated = {str(r.provenance.get("suite", "")) for r in records.values()}
    return stated.pop() if len(stated) == 1 and stated <= {*suite_names()} else ""


def free_name(name: str, record: FlightRecord, known: Mapping[str, FlightRecord], file: Path | str) -> str:
    """Return a name for a record of a file that no ``known`` one has: a manoeuvre may be flown again."""
    same = next((n for n, r in known.items() if record_key(r) == record_key(record)), None)
    if same is not None:
        raise RecordError(f"measured records must differ, got '{same}' twice ({file}); give it once")
    return next(n for n in (name, *(f"{name} ({k})" for k in range(2, 3 + len(known)))) if n not in known)


def check_records(
    suite: SensorSuite, records: Mapping[str, FlightRecord], notes: list[str] | None = None, surfaces: bool = True
) -> dict[str, FlightRecord]:
    """Check that every record holds what the believed suite says; return them, their times at the suite's own rate.

    A clock that is off by no more than half a sample at the end of a record is put right, with a note. With
    ``surfaces``, those that are recorded stand in place of commands that are not (:func:`.drive.drive_records`).

    Raises:
        RecordError: a record was aborted, lacks a channel or all that could drive the model, or has another rate.
    """
    out = {}
    for name, record in records.items():
        with located(None, f"record '{name}'"):
            if record.outcome != "completed":
                raise RecordError(f"a record must be complete, got one that was aborted: {record.reason}")
            lacking = [c for c in suite.channels if c not in record]
            if lacking:
                raise RecordError(
                    f"a record must have every channel of the assumed sensors, {suite.name}, but it lacks "
                    f"{', '.join(lacking)} (it holds {', '.join(record.channels)}); give --sensors a suite without "
                    "them"
                )
            off = abs(record.dt_s * suite.rate_hz - 1.0)
            if off * len(record) > LATEST:
                raise RecordError(
                    f"a record must have the rate of the assumed sensors, {suite.rate_hz:g} Hz ({suite.name}), got "
                    f"{1.0 / record.dt_s:.7g} Hz; correct rate_hz and the noise in a suite file of your own"
                )
            if whole_ratio(1.0 / record.dt_s, suite.rate_hz) is None:
                if notes is not None:
                    notes.append(
                        f"the clock of '{name}' runs at {1.0 / record.dt_s:.7g} Hz, which is {off * len(record):.2g} "
                        f"samples off at its end; the sensors' {suite.rate_hz:g} Hz is used in its place"
                    )
                record = replace(record, t_s=record.t_s[0] + np.arange(len(record)) / suite.rate_hz)
            out[name] = record
    return drive_records(suite, out, "both" if surfaces else "command")


def check_speeds(suite: SensorSuite, records: Mapping[str, FlightRecord], V_m_s: float) -> None:
    """Check the airspeed in the quiet flight of every record that holds it.

    Raises:
        RecordError: one of them is not ``V_m_s``, or that which the record says it was flown from, within SAME_SPEED.
    """
    for name, record in records.items():
        start = start_of(record)
        at = V_m_s if start is None else start.condition.V_m_s
        speed = _quiet_mean(suite, record, "V") if "V" in record else at
        if abs(speed - at) > SAME_SPEED * at:
            raise RecordError(
                f"a record must start within {100 * SAME_SPEED:g} % of the airspeed of its condition, got {speed:.2f} "
                f"m/s in '{name}' and {at:.2f} m/s as the condition; without --V each record has the condition of "
                'its quiet flight, in a scenario with condition = "recorded" or a separate condition of the record'
            )


def at_its_own(suite: SensorSuite, record: FlightRecord, h_m: float) -> FlightCondition:
    """Return the condition that a record's quiet flight tells; ``h_m`` is taken if it holds no height."""
    if "V" not in record:
        raise RecordError("the airspeed of a record must be known, but it is not recorded; give its condition")
    return FlightCondition(_quiet_mean(suite, record, "V"), _quiet_mean(suite, record, "h") if "h" in record else h_m)


def frame_rate(aircraft: Aircraft, suite: SensorSuite, notes: list[str]) -> float:
    """Return the rate to simulate at, Hz: the aircraft's own, or the next multiple of the suite's."""
    rate = math.ceil(aircraft.rate_hz / suite.rate_hz - SAME_RATE) * suite.rate_hz
    if abs(rate - aircraft.rate_hz) > 1e-6 * rate:
        notes.append(
            f"the aircraft is simulated at {rate:g} Hz, a multiple of the records' {suite.rate_hz:g} Hz, in place of "
            f"its own {aircraft.rate_hz:g} Hz"
        )
    return rate


def _conditions(
    aircraft: Aircraft, suite: SensorSuite, records: Mapping[str, FlightRecord], said: Said, notes: list[str]
) -> tuple[FlightCondition, dict[str, FlightRecord]]:
    """Return the condition of most records, and the records: those flown from elsewhere say so.

    What a record says of its start already is believed.
    """
    V_m_s, h_m = said.V_m_s, said.h_m
    open_ = {n: r for n, r in records.items() if start_of(r) is None}
    if V_m_s is not None:
        check_speeds(suite, records, V_m_s)
    elif any("V" not in r for r in open_.values()):
        raise RecordError("the airspeed must be known, but it is not recorded; give --V in m/s")
    if not open_:
        told = next(start for r in records.values() if (start := start_of(r)) is not None)
        return told.condition, dict(records)
    recorded = h_m is None and all("h" in r for r in open_.values())
    default = aircraft.design_h_m if h_m is None else h_m
    if h_m is None and not recorded:
        notes.append(
            f"the altitude is not recorded, so the aircraft's design altitude, {default:g} m, is taken; give it with "
            "--h"
        )
    quiet = {
        n: (_quiet_mean(suite, r, "V") if V_m_s is None else V_m_s, _quiet_mean(suite, r, "h") if recorded else default)
        for n, r in open_.items()
    }
    groups = _alike(quiet)
    means = [_mean([quiet[n] for n in names]) for names in groups]
    most = max(range(len(groups)), key=lambda i: len(groups[i]))
    out, tells = dict(records), "quiet flight before the first commands"
    if any(restless(records[n]) for n in open_):
        tells += ", or where there is none their mean,"
    for i, names in enumerate(groups):
        out |= {n: marked(records[n], Start(means[i])) for n in names if i != most}
    if len(groups) > 1:
        each = "; ".join(
            f"{c.V_m_s:.4g} m/s and {c.h_m:.4g} m in {', '.join(g)}" for c, g in zip(means, groups, strict=True)
        )
        notes.append(f"the records start from {len(groups)} conditions, determined from their {tells}: {each}")
    elif V_m_s is None:
        at = means[0]
        notes.append(f"the condition, {at.V_m_s:.4g} m/s and {at.h_m:.4g} m, is that of the {tells.rstrip(',')}")
    return means[most], timed(out, means[most])


def _mean(conditions: Sequence[tuple[float, float]]) -> FlightCondition:
    V, h = (list(column) for column in zip(*conditions, strict=True))
    return FlightCondition(float(np.mean(V)), float(np.mean(h)))


def _alike(quiet: Mapping[str, tuple[float, float]]) -> list[list[str]]:
    """Return the names of those records together that one trim serves, of airspeeds and heights."""

    def near(at: tuple[float, float], of: tuple[float, float]) -> bool:
        return abs(at[0] - of[0]) <= SAME_SPEED * of[0] and abs(at[1] - of[1]) <= SAME_HEIGHT_M

    mean = _mean(list(quiet.values()))
    if all(near(at, (mean.V_m_s, mean.h_m)) for at in quiet.values()):
        return [list(quiet)]
    groups: list[list[str]] = []
    for name in sorted(quiet, key=lambda n: quiet[n]):
        known = next((g for g in groups if near(quiet[name], quiet[g[0]])), None)
        if known is None:
            groups.append([name])
        else:
            known.append(name)
    return groups


def _quiet_mean(suite: SensorSuite, record: FlightRecord, name: str) -> float:
    """Return what a sensor reads in the quiet flight, in all of a record without it, less bias and scale."""
    sensor = next((s for s in suite.sensors if s.channel == name), None)
    bias, scale = (0.0, 1.0) if sensor is None else (sensor.bias, sensor.scale)
    n = quiet_samples(record) if not restless(record) else len(record)
    return (float(np.mean(record[name][:n])) - bias) / scale
