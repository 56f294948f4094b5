"""A complete, commented gap case for an aircraft and its records: condition, sensors, and which record judges.

A sensor suite is made from records: their channels and rate, and the noise that third differences show.
"""

from __future__ import annotations

import math
import os
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError, Refusal, located
from testbench.core.escape import one_line, quoted, real
from testbench.core.paths import AIRCRAFT, STOCK, aircraft_names, not_found, resolve, suite_names
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.store import settle
from testbench.estimators.regression.smoothing import LEAST, noise_level
from testbench.flight import FlightCondition, load_aircraft
from testbench.logs.plausible import questions_of, refusal
from testbench.page.words import grouped
from testbench.questions.gap.evidence.check import HeldOutFlight, check_signs, differences
from testbench.questions.gap.evidence.commanded import MOVED, commands, rests
from testbench.questions.gap.records import (
    WHOLE,
    Flights,
    Said,
    flights_of,
    free_name,
    named_suite,
    read_flights,
    without_wholes,
)
from testbench.questions.gap.starts import CUT, start_of
from testbench.questions.gap.windows import as_they_start
from testbench.sensors import SensorSuite, load_suite, suite_toml
from testbench.sensors.kinds import KINDS
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class NewCase:
    """What is written."""

    text: str  # of the case
    sensors: str | None  # text of the suite that lies beside it; None if the case names another
    held_out: HeldOutFlight  # how different that record is from the others
    questions: tuple[str, ...] = ()  # implausible values of the records, in words


def sensors_file(case: Path) -> Path:
    """Return where the suite of a new case lies."""
    return case.with_name(f"{case.stem}_sensors.toml")


def new_case(
    case: Path,
    aircraft: str,
    given: Sequence[Path],
    sensors: str | None = None,
    wings: str = "flexible",
    V_m_s: float | None = None,
    h_m: float | None = None,
) -> NewCase:
    """Return a gap case that runs as it is, of records (.nc) or folders that `testbench import` wrote.

    Paths in it are relative to its file. The sensors are, if not given, the packaged suite that the records name, else
    one made from the records; airspeed and altitude those of their quiet flight.

    Raises:
        RecordError: a record does not do, there is one alone, or its airspeed is not known.
        ChannelError: a record holds an unknown channel.
        TestbenchError: no such aircraft or suite, or no trim.
    """
    meant = resolve(aircraft, AIRCRAFT)
    files = record_files(given)
    if len(files) == 1:
        raise RecordError(
            f"a gap case must have a second record to judge on, got one, '{files[0]}': give one of another manoeuvre; "
            "testbench import LOG -o FOLDER cuts a log with several into records; or search without validation with "
            f"testbench gap {aircraft} {files[0]} --sensors SUITE"
        )
    records = read(files)
    asked = questions_of(records.items())
    try:
        suite, left, made = _suite(case, meant, records, sensors)
        flights = flights_of(load_aircraft(meant, wings), records, {}, Said(suite, V_m_s, h_m), left)
        check_signs(flights.believed, as_they_start(flights.naming))
    except Refusal as error:  # of values in another unit, what they lead to is not the cause
        if not asked:
            raise
        raise RecordError(refusal("the records", asked)) from error
    judge = most_different(flights)
    shared = shared_with(judge.name, flights.naming)
    paths = dict(zip(records, (_relative(f, case) for f in files), strict=True))
    own = meant if meant in aircraft_names() or meant.startswith(STOCK) else _relative(Path(meant), case)
    named = sensors_file(case).name if made else sensors or suite.name
    if not made and sensors is not None and sensors not in suite_names() and Path(sensors).is_file():
        named = _relative(Path(sensors), case)
    lines = _head(own, wings, named, made, flights)
    for name, record in flights.naming.items():
        lines += _comment(shared) if shared and name == judge.name else []
        lines += _measured(name, paths[name], record, judge, flights.believed.condition)
    text = "\n".join(lines).rstrip() + "\n"
    return NewCase(text, suite_toml(suite) if made else None, judge, asked)


def record_files(given: Sequence[Path]) -> list[Path]:
    """Return the records that files and folders of `testbench import` mean; of a folder its cuts, if there are any.

    Raises:
        RecordError: one is no record, or a folder holds none.
    """
    if not given:
        raise RecordError("a gap case must have measured records (.nc), or folders of testbench import, got none")
    out: list[Path] = []
    for path in given:
        if settle(path).is_dir():
            found = [p for p in sorted(path.glob("*.nc")) if not p.stem.endswith("_truth")]
            if not found:
                raise RecordError(
                    f"a folder must hold records (.nc) that testbench import wrote, got '{path}', which has none"
                )
            out += found
        elif not path.is_file():
            raise RecordError(f"a record must be a file that exists, got {not_found(path)}")
        elif path.suffix.lower() == ".toml":
            raise RecordError(f"a case lists records, not descriptions, got '{path}': give its records (.nc)")
        elif path.suffix.lower() != ".nc":
            raise RecordError(
                f"a record must be NetCDF of the testbench (.nc), got '{path}': make records of it with testbench "
                f"import {path} -o FOLDER, then give FOLDER"
            )
        else:
            out.append(path)
    return without_wholes(out)


def read(files: Sequence[Path]) -> dict[str, FlightRecord]:
    """Return name -> measured record of files. What was cut from a log is named after its folder, too, if need be."""
    unclear = any(f.name == WHOLE for f in files) or len({f.name for f in files}) < len(files)
    out: dict[str, FlightRecord] = {}
    for file in files:
        ((name, _, record),) = read_flights(file)
        if unclear and (file.parent / WHOLE).is_file():
            name = " ".join(filter(None, (file.resolve().parent.name, "" if file.name == WHOLE else file.stem)))
        out[free_name(name, record, out, file)] = record
    return out


def most_different(flights: Flights) -> HeldOutFlight:
    """Return the record that judges best: it differs most from all the others.

    It moves the control that most records move, and none that no other record moves: a flight of other controls judges
    nothing. It shares no part of its log with another one. Where no record does, those that share are asked, then all.
    """
    records = as_they_start(flights.naming)
    given = {n: commands(r) for n, r in records.items()}
    moved = {n: {c for c, x in zip(cs, u.T, strict=True) if np.ptp(x) > MOVED} for n, (cs, u) in given.items()}
    count = Counter(c for own in moved.values() for c in own)
    main = max(count, key=lambda c: count[c], default="")
    fit = [n for n, own in moved.items() if main in own and all(count[c] > 1 for c in own)]
    apart = [n for n in fit if not shared_with(n, flights.naming)]
    found = [
        differences(flights.believed, {k: r for k, r in records.items() if k != n}, {n: records[n]})[0]
        for n in apart or fit or records
    ]
    return max(found, key=lambda f: f.difference)


def shared_with(name: str, records: Mapping[str, FlightRecord]) -> str:
    """Return in words how much of one log a record shares with the others, cut from it as well; "" if nothing."""
    told = {  # a record that was not cut is all of its log
        n: (r.provenance.get("sha256"), r.provenance.get(CUT) or [float(r.t_s[0]), float(r.t_s[-1])])
        for n, r in records.items()
    }
    log, own = told[name]
    out = []
    for other, (of, span) in told.items():
        if other == name or log is None or of != log:
            continue
        both_s = min(own[1], span[1]) - max(own[0], span[0])
        if both_s > 0.0:
            out.append(f"{both_s:.2g} s of its log with '{other}'")
    if not out:
        return ""
    return f"YOURS: it shares {', '.join(out)}, where it is no independent test; import with a shorter --lead or --tail"


def _suite(
    case: Path, aircraft: str, records: Mapping[str, FlightRecord], sensors: str | None
) -> tuple[SensorSuite, list[str], bool]:
    """Return the suite, what it leaves out in sentences, and whether it was made from the records."""
    if sensors is not None:
        return load_suite(sensors), [], False
    if name := named_suite(records):
        return load_suite(name), [], False
    for file, record in records.items():
        with located(None, f"record '{file}'"):
            if not any(n.removesuffix("_cmd") in CONTROLS for n in record.channels):
                raise RecordError(
                    "a record must hold what drives the model, a command such as de_cmd or a surface such as de, got "
                    f"{', '.join(record.channels)}; if a column is the command, name it so and import the log again"
                )
    suite, left = suite_of_records(sensors_file(case).stem, Path(aircraft).name.removeprefix(STOCK), records)
    return suite, left, True


def _relative(file: Path, case: Path) -> str:
    return Path(os.path.relpath(file.resolve(), case.resolve().parent)).as_posix()


def _head(aircraft: str, wings: str, suite: str, made: bool, flights: Flights) -> list[str]:
    believed = flights.believed
    recorded = all("h" in r for r in flights.naming.values())
    height = "" if recorded else "YOURS: not recorded; "
    said = "  # made from the records: check its lines with YOURS" if made else ""
    other = "rigid" if wings == "flexible" else "flexible"
    elastic = believed.aircraft.elastic is not None or wings != "flexible"
    return [
        "# A gap case, made by `testbench gap new`. It can be run unchanged. Enter your own values, then",
        "#     testbench check THIS_FILE",
        "#     testbench gap THIS_FILE",
        "# Lines with YOURS are guesses.",
        f"title = {quoted(f'{believed.aircraft.name}: does the simulation fly as the aircraft does?')}",
        'question = "What does the simulation lack that the aircraft has?"',
        f"aircraft = {quoted(aircraft)}  # the a-priori model",
        *([f'wings = "{wings}"  # or "{other}": whether its elastic modes move'] if elastic else []),
        f"suite = {quoted(suite)}{said}",
        'windows = "auto"  # records without quiet trim flight are cut; "off": none; 4.0: all, into windows of 4 s',
        'drive = "both"  # by commands, and surfaces without one; "surface": by all recorded; "command": by none',
        '# effects = ["actuator_lag"]  # searched in place of the whole library (testbench list effects)',
        '# more_effects = ["my_effect.py:EFFECT"]  # searched in addition: your own, or names of the library',
        "",
        *(line for note in flights.notes for line in _comment(note)),
        "",
        "[condition]  # that the records start from",
        f"V_m_s = {real(believed.condition.V_m_s, 5)}  # true airspeed",
        f"h_m = {real(believed.condition.h_m, 5)}  # {height}above sea level",
        "# gamma_deg = 0.0  # flight path angle, climbing positive",
        "",
        "# [simulation]",
        f"# rate_hz = {real(believed.rate_hz)}  # frames per second of the simulation; this if left out",
        "",
        '# use = "naming": for the search. use = "held_out": for validation only.',
        "# Optional keys of a record that was not flown like the others:",
        '#     condition = "recorded"  # that of its quiet flight; or { V_m_s = 16.0, h_m = 500.0 }',
        "#     load_kg = 0.5           # beyond that of the model; negative for burnt fuel",
        "#     load_aft_m = 0.1        # place of the load behind the centre of gravity of the model",
        "#     flown_at_s = 600.0      # its beginning after take-off, for a battery or fuel that empties",
        "",
    ]


def _comment(text: str) -> list[str]:
    return textwrap.wrap(one_line(text), 118, initial_indent="# ", subsequent_indent="#   ", break_long_words=False)


def _measured(name: str, file: str, record: FlightRecord, judge: HeldOutFlight, general: FlightCondition) -> list[str]:
    held = name == judge.name
    lines = []
    if held:
        lines += _comment(f"YOURS to choose: of the possible held-out records, this one differs most: {judge.sentence}")
    use = "held_out" if held else "naming"
    lines += ["[[measured]]", f"name = {quoted(name)}", f"file = {quoted(file)}", f'use = "{use}"']
    start = start_of(record)
    if start is not None and start.condition != general:
        at = f"{{ V_m_s = {real(start.condition.V_m_s, 5)}, h_m = {real(start.condition.h_m, 5)} }}"
        told = f'"recorded"  # {start.condition.V_m_s:.4g} m/s, {start.condition.h_m:.4g} m' if "V" in record else at
        lines.append(f"condition = {told}")
    if start is not None and start.load_kg:
        lines += [f"load_kg = {real(start.load_kg)}", f"load_aft_m = {real(start.load_aft_m)}"]
    if start is not None and start.at_s is not None:
        began_s = max(start.at_s - 0.5 * record.duration_s, 0.0)
        why = "in its log, whose beginning is taken for take-off" if record.provenance.get(CUT) else "after take-off"
        lines.append(f"flown_at_s = {real(began_s, 4)}  # {why}")
    return [*lines, ""]


_USUAL = {  # channel -> kind of sensor, noise of one sample if the record does not show it (the packaged suites'), SI
    "V": ("pitot", 0.2),
    **dict.fromkeys(("alpha", "beta"), ("flow_vane", 0.25 * DEG_RAD)),
    **dict.fromkeys(("p", "q", "r"), ("rate_gyro", 0.2 * DEG_RAD)),
    **dict.fromkeys(("phi", "theta"), ("", 0.2 * DEG_RAD)),
    **dict.fromkeys(("ax", "ay", "az"), ("accelerometer", 0.2)),
    "h": ("barometer", 0.5),
    **dict.fromkeys(("de", "da", "dr"), ("surface_position", 0.1 * DEG_RAD)),
    **{f"{n}_cmd": ("command_log", 0.0) for n in CONTROLS},
}
_SMOOTHED = 0.1  # of the usual noise: less was filtered away before it was recorded, and the error left is no noise
_CLEAN = 0.02  # likewise, where third differences are those of white noise: such a sensor is cleaner than usual
_WHITE = -0.65  # their correlation with the next one, at most; that of white noise is -0.75, what was filtered has more
_RESTS = 0.2  # of the samples of a command that must rest in white noise if it was measured
_EXACT = 0.02  # of what counts as motion: less noise than this drives nothing
_NEAR = 1e-3  # by which a rate may be off from a whole number that is meant


def suite_of_records(name: str, aircraft: str, records: Mapping[str, FlightRecord]) -> tuple[SensorSuite, list[str]]:
    """Return the sensors that records show, and what is left out of them, in sentences.

    Lags, biases and places are those of the packaged suites of the aircraft, where it has such a sensor, else none.

    Raises:
        RecordError: rates differ, or nothing is left that can be compared.
    """
    rates = {n: 1.0 / r.dt_s for n, r in records.items()}
    low, high = min(rates, key=lambda n: rates[n]), max(rates, key=lambda n: rates[n])
    if rates[high] > (1.0 + _NEAR) * rates[low]:
        raise RecordError(
            f"records of a gap case must have one rate, got {rates[low]:.6g} Hz in '{low}' and {rates[high]:.6g} Hz in "
            f"'{high}'; import the logs again with one --rate"
        )
    rate = rates[low]
    rate = float(round(rate)) if abs(rate - round(rate)) < _NEAR * rate else rate
    every = list(dict.fromkeys(c for r in records.values() for c in r.channels))
    why = {c: _left_out(c, records) for c in every}
    # Of the packaged suites of the aircraft, the one most like what the records hold says most.
    suites = [load_suite(n) for n in suite_names() if n.startswith(f"{aircraft}_")]
    suites.sort(key=lambda suite: len({*every} ^ set(suite.channels)))
    known = {s.channel: s for suite in reversed(suites) for s in suite.sensors}
    kept = [c for c in _USUAL if c in every and not why[c]]
    if all(c.removesuffix("_cmd") in CONTROLS for c in kept):
        raise RecordError(
            "records must share a channel that is compared (V, alpha, beta, p, q, r, phi, theta, ax, ay, az, h), got "
            f"{', '.join(every)}"
        )
    sensors = tuple(_sensor(c, records, known.get(c)) for c in kept)
    left = [f"no sensor of the suite: {', '.join(names)} ({reason})" for reason, names in grouped(why).items()]
    return SensorSuite(name, f"what the records of {aircraft} hold, at {rate:g} Hz", rate, sensors), left


def _left_out(name: str, records: Mapping[str, FlightRecord]) -> str:
    """Return why a channel becomes no sensor; "" if it does."""
    if name not in _USUAL:
        return "not compared by a generated gap case; add it to the suite if it is reliable"
    lacking = [n for n, r in records.items() if name not in r]
    if lacking:
        return f"'{lacking[0]}' does not hold it"
    if not name.endswith("_cmd") and all(np.ptp(r[name]) == 0.0 for r in records.values()):
        return "it never changes"
    return ""


def _sensor(name: str, records: Mapping[str, FlightRecord], known: Sensor | None) -> Sensor:
    kind, usual = _USUAL[name]
    plain = KINDS.get(kind, Sensor)(channel=name)
    if name.endswith("_cmd"):
        sent = known or replace(plain, part="command log", source="exact: the number that was sent.")
        return _command(sent, [_taken(r, name) for r in records.values()], next(iter(records.values())).dt_s)
    sensor = known or plain
    sensor = replace(sensor, rate_hz=None, dropout=0.0)  # records mark the samples that were taken
    if known is not None:
        usual = math.hypot(known.noise_std, known.quantum / math.sqrt(12.0)) or usual
    rest = "lag, bias and place as in the packaged suites of this aircraft" if known else "YOURS: lag, bias and place"
    own = [y for r in records.values() if (y := _taken(r, name)).size >= LEAST]
    found = [noise_level(y) for y in own]
    noise = float(np.median(found)) if found else 0.0
    thirds = [np.diff(y, 3) for y in own]
    correlations = [float(d[1:] @ d[:-1]) / max(float(d @ d), np.finfo(float).tiny) for d in thirds]
    white = bool(found) and float(np.median(correlations)) < _WHITE
    if noise < (_CLEAN if white else _SMOOTHED) * usual:
        told = (
            f"YOURS: the noise is assumed, because the records are too smooth or too short to show it ({noise:.2g}, SI)"
        )
        noise = usual
    else:
        told = "noise from third differences of the records"
    own_noise = math.sqrt(max(noise**2 - sensor.quantum**2 / 12.0, 0.0))
    part = known.part if known else "YOURS: which sensor"
    return replace(sensor, noise_std=float(f"{own_noise:.3g}"), part=part, source=f"{told}; {rest}.")


def _command(sent: Sensor, commands: Sequence[FloatArray], dt_s: float) -> Sensor:
    """Return the sensor of a command (n,) in each record: ``sent``, or one with noise where it rests as noise does."""
    long = [u for u in commands if u.size >= LEAST]
    noise = float(f"{np.median([noise_level(u) for u in long]):.3g}") if long else 0.0
    still = sum(b - a for u in long for a, b in rests(u, noise, dt_s)) if noise > 0.0 else 0
    if still < _RESTS * sum(u.size for u in long) or noise < _EXACT * MOVED:
        return sent
    told = (
        "YOURS: assumed to be the position of a lever or stick, because it has white noise at rest, which does not "
        "drive the model; 0.0 if it is the number that was sent"
    )
    return replace(sent, noise_std=noise, part="YOURS: which sensor", source=f"noise from third differences; {told}.")


def _taken(record: FlightRecord, name: str) -> FloatArray:
    i = record.channels.index(name)
    return np.asarray(record.data[record.valid[:, i], i])
