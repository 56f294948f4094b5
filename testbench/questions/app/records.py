"""What the pages of the workbench show of records: a log's timeline, channels over time, spectra, the motion to replay.

A record is a NetCDF file below the folder of results; ``log.json`` beside it, which import writes, says what was flown.
Pages name them by their paths in the folder of the workbench; a flight of a data set by its store, "#" and a number.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft.outline import faces, usual
from testbench.core.channels import CONTROLS
from testbench.core.door import read_json, read_toml
from testbench.core.errors import RecordError, Refusal, ScenarioError
from testbench.core.paths import AIRCRAFT, resolve
from testbench.core.project import FILE
from testbench.core.record import FlightRecord, FloatArray, load_record
from testbench.core.store import OWN, manifest_of
from testbench.estimators.frequency.response import estimate_frequency_response
from testbench.flight import load_aircraft
from testbench.page.explore import View, to_json
from testbench.page.figure import COLOURS, QUIET, Curve, Panel, Span, line_look
from testbench.page.labels import axis_label, shown_unit
from testbench.questions.dataset.open import flight_so_far
from testbench.questions.dataset.store import STORE

LOG = "log.json"
_MOST, _MOST_SHOWN = 2000, 12  # records that are listed, and that are laid over each other
_POINTS = 400_000  # of a curve: an hour at 100 Hz is sent whole
_FRAMES = 20_000  # of a replay
_SILENT_S, _MISSED = 1.0, 5.0  # without samples for so long, and for so many of a channel's steps, its line is broken
_SEGMENTS = 8  # of a stretch whose spectra are taken
_CHANCE = 0.05  # probability that what has nothing in common shows a coherence above the line
_USUAL = 0.5, 2.0, 0.1, 1.0, 0.06, 1.0
"""Wing area, span, tail area and arm, fin area and arm of an aircraft that nobody has described, in half spans."""
_FIRST = ("de", "de_cmd", "da", "dr", "V", "alpha", "q", "az", "theta", "p", "r", "h")
_SHOWN = 6  # channels at first


@dataclass(frozen=True)
class Shown:
    """One record with its name on pages, and what ``log.json`` says of it; {} without one."""

    path: str
    place: Path
    name: str
    record: FlightRecord
    log: Mapping[str, Any]


def inside(folder: Path, path: object, kind: str = ".nc") -> Path:
    """Return a file of a folder by its path there, whose name ends as its kind does.

    Raises:
        RecordError: it is not one, or lies elsewhere.
    """
    text = str(path)
    file = (folder / text).resolve() if "\0" not in text else folder
    if not file.is_relative_to(folder.resolve()) or not file.is_file() or file.suffix != kind:
        raise RecordError(
            f"a {kind} file in the folder of the app must be named, got '{text[:200]}'; choose one it lists"
        )
    return file


def shown(folder: Path, path: object) -> Shown:
    """Return a record by its path in the folder.

    Raises:
        RecordError: there is none.
    """
    of, _, number = str(path).rpartition(f"/{STORE}#")
    place = (folder / of.replace("\0", "")).resolve()
    if of and number.isdecimal() and place.is_relative_to(folder.resolve()):
        return Shown(str(path), place, f"{place.name}: flight {number}", flight_so_far(place, int(number)), {})
    file = inside(folder, path)
    record = _read(file, file.stat().st_mtime_ns)
    beside = file.with_name(LOG)
    whole = file.stem == "whole" and beside.is_file()
    log: Mapping[str, Any] = read_json(beside, "model") if whole else {}
    name = Path(str(log["log"])).stem if log else f"{file.parent.name}: {file.stem}"
    path = file.relative_to(folder.resolve()).as_posix()
    return Shown(path, file.parent, name.removeprefix("records: "), record, log)


@lru_cache(maxsize=_MOST_SHOWN)
def _read(file: Path, changed: int) -> FlightRecord:
    return load_record(file)


def list_records(folder: Path) -> list[dict[str, Any]]:
    """Return path, result and name of every record below a folder, the newest result first."""
    found = [p for p in folder.rglob("*.nc") if OWN not in p.parts and not p.is_symlink()]
    newest = sorted(found, key=lambda p: (-p.parent.stat().st_mtime, str(p)))[:_MOST]
    return [
        {
            "path": p.relative_to(folder).as_posix(),
            "of": (p.parent.parent if p.parent.name == "records" else p.parent).relative_to(folder).as_posix(),
            "name": p.stem,
        }
        for p in newest
    ]


def record_told(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a page says of a ``record``: channels, rate, and of a log its timeline, questions and next steps."""
    one = shown(folder, given.get("record"))
    place = one.place
    made = manifest_of(place)
    order = [n for n in _FIRST if n in one.record] + [n for n in one.record.channels if n not in _FIRST]
    return {
        "path": one.path,
        "name": one.name,
        "begin_s": float(one.record.t_s[0]),
        "end_s": float(one.record.t_s[-1]),
        "rate_hz": round((len(one.record) - 1) / max(one.record.duration_s, 1e-9), 3),
        "channels": [{"name": n, "label": axis_label(n)} for n in order],
        "controls": [n for n in order if n.removesuffix("_cmd") in CONTROLS],
        "first": order[:_SHOWN],
        "log": {k: v for k, v in one.log.items() if k != "parameters"},
        "settings": len(one.log.get("parameters", {})),
        "command": [] if made is None else list(made.command[1:]),
        "folder": place.relative_to(folder.resolve()).as_posix(),
        "descriptions": [{"name": p.name, "chooses": _fits(p)} for p in sorted(place.glob("*.toml"))]
        if one.log
        else [],
    }


def _fits(description: Path) -> bool:
    """Return whether a description of flights has an estimator of a structure, whose parameters can be chosen among."""
    with suppress(RecordError, ScenarioError, KeyError, TypeError):
        return any("structure" in e for e in read_toml(description)["identification"]["estimators"])
    return False


def _asked(folder: Path, given: Mapping[str, Any]) -> tuple[list[Shown], list[str]]:
    """Return the records and the channels that a page asks for, those that a record has."""
    paths, names = given.get("records"), given.get("channels")
    if not isinstance(paths, list) or not isinstance(names, list) or not 0 < len(paths) <= _MOST_SHOWN:
        raise RecordError(f"records and channels must be lists, of 1 to {_MOST_SHOWN} records, got {paths!r:.200}")
    found = [shown(folder, path) for path in paths]
    return found, [n for n in map(str, names) if any(n in one.record for one in found)]


def _zero_s(one: Shown, align: object) -> float:
    """Return the time of a record that is 0 on the page: that of the log, of take-off, or of the first manoeuvre."""
    of = {"flight": [s for s in one.log.get("stretches", ()) if s["flown"]], "manoeuvre": one.log.get("manoeuvres", ())}
    parts = of.get(str(align), ())
    return min((float(part["start_s"]) for part in parts), default=0.0)


def _heard(record: FlightRecord, name: str) -> FloatArray:
    """Return a channel, each value held until the next, but NaN where it was silent."""
    taken = np.flatnonzero(record.valid[:, record.channels.index(name)])
    if not taken.size:
        return np.full(len(record), np.nan)
    t = record.t_s
    last = t[taken][np.maximum(np.searchsorted(taken, np.arange(len(record)), side="right") - 1, 0)]
    steps = np.diff(t[taken]) if taken.size > 1 else np.array([np.inf])
    return np.where(t - last > max(_SILENT_S, _MISSED * float(np.median(steps))), np.nan, record[name])


def channels_figure(folder: Path, given: Mapping[str, Any]) -> str:
    """Return ``channels`` of ``records`` over time, laid over each other, as a page explores them.

    Several are put on one clock, so that one cursor reads them all; ``align`` says what is at 0 s: the start of the
    "log", of the "flight" or of the first "manoeuvre".
    """
    found, names = _asked(folder, given)
    if len(found) == 1:
        clocks, t = [found[0].record.t_s], found[0].record.t_s
        spans = [Span(low=m["start_s"], high=m["end_s"]) for m in found[0].log.get("manoeuvres", ())]
    else:
        clocks = [one.record.t_s - _zero_s(one, given.get("align")) for one in found]
        step = min((c[-1] - c[0]) / max(c.size - 1, 1) for c in clocks)
        low, high = min(c[0] for c in clocks), max(c[-1] for c in clocks)
        t, spans = low + max(step, (high - low) / _POINTS) * np.arange(int((high - low) / max(step, 1e-9)) + 1), []
        t = t[t <= high]

    def curve(k: int, name: str) -> Curve:
        y = shown_unit(name)[0] * _heard(found[k].record, name)
        if len(found) > 1:
            y = np.interp(t, clocks[k], y, left=np.nan, right=np.nan)
        look = {"colour": COLOURS[0]} if len(found) == 1 else line_look(k)
        return Curve(x=t, y=y, name=found[k].name if len(found) > 1 else "as recorded", width=1.0, **look)

    panels = [
        Panel(
            draws=[*spans, *(curve(k, name) for k, one in enumerate(found) if name in one.record)],
            x="t, s",
            y=axis_label(name),
        )
        for name in names
    ]
    return to_json([View(name="flights", panels=panels)], _POINTS * sum(len(p.curves) for p in panels))


def spectra_figure(folder: Path, given: Mapping[str, Any]) -> str:
    """Return spectra of ``channels`` from ``begin_s`` to ``end_s``, and their coherence with a ``control``.

    Power by Welch's method, one side, with Hann windows of an eighth of the stretch; coherence as
    :func:`testbench.estimators.frequency.response.estimate_frequency_response` has it.

    Raises:
        RecordError, EstimationError: the stretch is too short.
    """
    from scipy.signal import welch

    found, names = _asked(folder, given)
    control, panels, second = str(given.get("control", "")), list[Panel](), list[Panel]()
    parts = [one.record.between(*_ends(one, given)) for one in found]
    looks = [{"colour": COLOURS[0]} if len(found) == 1 else line_look(k) for k in range(len(found))]
    for name in names:
        factor, unit = shown_unit(name)
        power, common = list[Curve](), list[Curve]()
        for one, part, look in zip(found, parts, looks, strict=True):
            if name not in part:
                continue
            size = len(part) // _SEGMENTS * 2
            if size < 16:
                raise RecordError(
                    f"spectra need a stretch of 64 samples, got {len(part)} of {one.name}; show more of it"
                )
            f, density = welch(factor * part[name], 1.0 / part.dt_s, nperseg=size, detrend="linear")
            label = one.name if len(found) > 1 else "as recorded"
            power.append(Curve(x=f[1:], y=density[1:], name=label, **look))
            if control in part and control != name and np.ptp(part[control]) > 0.0:
                H = estimate_frequency_response([part], [control], [name], window_s=size * part.dt_s)
                chance = 1.0 - _CHANCE ** (1.0 / np.maximum(H.averages - 1.0, 1.0))
                f = H.omega_rad_s / (2.0 * np.pi)
                common.append(Curve(x=f, y=H.coherence[:, 0], name=label, **look))
                if len(common) == 1:
                    common.append(Curve(x=f, y=chance, name="by chance, 95 %", colour=QUIET, dash=(4, 2)))
        label = axis_label(name)
        base = label.split(",")[0]
        per = f"({unit})²/Hz" if unit else "1/Hz"
        panels.append(Panel(draws=power, x="frequency, Hz", y=f"{base}, {per}", log_x=True, log_y=True))
        if common:
            title = f"coherence of {base} with {axis_label(control).split(',')[0]}"
            second.append(Panel(draws=common, x="frequency, Hz", y=title, log_x=True, y_range=(0.0, 1.0)))
    views = [View(name="spectra", panels=panels)]
    views += [View(name=f"coherence with {control}", panels=second)] if second else []
    return to_json(views)


def _ends(one: Shown, given: Mapping[str, Any]) -> tuple[float, float]:
    ends = [given.get(key) for key in ("begin_s", "end_s")]
    low, high = (float(v) if isinstance(v, (int, float)) else np.nan for v in ends)
    t = one.record.t_s
    return (low if low > t[0] else float(t[0])), (high if high < t[-1] else float(t[-1]))


def settings_told(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the autopilot in which two logs differ: name and both values, None where one has none."""
    found, _ = _asked(folder, {**given, "channels": []})
    first, second = (one.log.get("parameters", {}) for one in (found[0], found[-1]))
    names = sorted(n for n in {*first, *second} if first.get(n) != second.get(n))
    rows = [[n, first.get(n), second.get(n)] for n in names]
    return {"names": [found[0].name, found[-1].name], "equal": len({*first, *second}) - len(rows), "rows": rows}


def _craft(folder: Path, one: Shown) -> dict[str, Any]:
    """Return name, span and faces of the aircraft that a record is of, or of a usual one without a name.

    The record says whose it is; else a description beside it, or the project of the folder.
    """
    made = one.record.provenance
    names = [made["truth"].get("aircraft") if isinstance(made.get("truth"), Mapping) else made.get("aircraft")]
    for file in (*sorted(one.place.glob("*.toml")), folder / FILE):
        with suppress(Refusal):
            names.append(read_toml(file).get("aircraft") if file.is_file() else None)
    for name in names:
        with suppress(Refusal):
            aircraft = load_aircraft(resolve(name, AIRCRAFT, folder)) if isinstance(name, str) else None
            if aircraft is not None and aircraft.outline is not None:
                return {"name": aircraft.name, "span_m": aircraft.outline.wing.span_m, "faces": faces(aircraft.outline)}
    return {"name": "", "span_m": 2.0, "faces": faces(usual(*_USUAL))}


def motion_told(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return attitude and path of a ``record`` to replay, as float32 in base64, and what of it was not recorded.

    Angles in rad, north, east and up in m. An angle that was not recorded is the integral of its rate; without a
    position the path follows from speed, pitch and heading. ``craft`` is what flies, as faces in body axes, m.
    """
    one = shown(folder, given.get("record"))
    record = one.record
    rows = np.arange(0, len(record), max(1, -(-len(record) // _FRAMES)))
    t, said = record.t_s, list[str]()

    def total(rate: FloatArray) -> FloatArray:
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t)
        return np.concatenate([[0.0], np.cumsum(steps)])

    angles = {}
    for name, rate in (("phi", "p"), ("theta", "q"), ("psi", "r")):
        if name in record:
            angles[name] = record[name]
        else:
            angles[name] = total(record[rate]) if rate in record else np.zeros(len(record))
            said.append(f"{name} from {rate}" if rate in record else f"{name} = 0")
    speed = next((record[n] for n in ("V", "Vg", "u") if n in record), None)
    if speed is None:
        said.append("20 m/s")
        speed = np.full(len(record), 20.0)
    if "north" in record and "east" in record:
        north, east = record["north"], record["east"]
    else:
        said.append("path from speed, pitch and heading")
        level = speed * np.cos(angles["theta"])
        north, east = total(level * np.cos(angles["psi"])), total(level * np.sin(angles["psi"]))
    up = record["h"] if "h" in record else total(speed * np.sin(angles["theta"]))
    held = {"t": t, **angles, "north": north, "east": east, "up": up}
    craft = _craft(folder, one)
    return {
        "said": said,
        "craft": craft,
        **{k: base64.b64encode(v[rows].astype("<f4").tobytes()).decode() for k, v in held.items()},
    }
