"""The judge: a translated model is used only after it has flown beside JSBSim.

The first flight of a model in a batch is preceded by one of 20 s in which every control moves, flown by both. Every
channel of the simulator must agree within 1e-9 of its range. The verdict is kept on disk, by a hash of the model, of
the batch's own code and of JSBSim's version.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sys
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CHANNELS, channel
from testbench.core.constants import DEG_RAD
from testbench.core.errors import TestbenchError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.flight.batch.compiled import SOURCES
from testbench.flight.batch.jobs import BATCH, Flown, Job
from testbench.flight.batch.model import BatchModel, batch_model, variant
from testbench.flight.batch.program import Untranslated
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import _Key
from testbench.flight.simulate import Manoeuvre, fly
from testbench.inputs.signal import InputSignal

TOLERANCE = 1e-9
"""Greatest difference from JSBSim, of a channel's range."""
_DURATION_S = 20.0
_SHARES = (0.02, 0.005, 0.001)  # of a control's range, tried from the greatest on until the flight stays in its limits
_AGREED = {"rad": 0.01, "rad/s": 0.01, "rad/s2": 0.1, "m/s": 0.1, "m/s2": 0.1, "m": 10.0, "N": 1.0, "Pa": 10.0,
           "1/s": 0.01, "1/s2": 0.1}  # fmt: skip
"""Least range that a difference is taken of, by SI unit: what stands still has none of its own.

Heights are differences of radii of 6.4e6 m, which doubles hold to 1e-9 m.
"""
_SMALL = 1e-3  # the same of a throttle and of modal coordinates
_KEPT = 4096


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict.

    Attributes:
        model: the translated model, or None if JSBSim must fly.
        reason: why it must, one clause.
        worst: greatest difference from JSBSim, of a channel's range; nan if it has not flown.
        channel: where it is.
    """

    model: BatchModel | None
    reason: str = ""
    worst: float = math.nan
    channel: str = ""


_JUDGED: OrderedDict[object, Judged] = OrderedDict()
_BASES: dict[object, list[Judged]] = {}


def judged(aircraft: Aircraft, trimmed: TrimmedFlight) -> Judged:
    """Return whether an aircraft can be flown in a batch, after it has flown beside JSBSim.

    Models that differ in numbers only share a program and its verdict.

    Raises:
        ModelError: JSBSim refuses the aircraft.
    """
    key = _Key.of(aircraft, trimmed.rate_hz, trimmed.condition)
    limits = tuple(aircraft.limits.items())
    if (key, limits) not in _JUDGED:
        _JUDGED[key, limits] = _judged(aircraft, trimmed)
        if len(_JUDGED) > _KEPT:
            _JUDGED.popitem(last=False)
    _JUDGED.move_to_end((key, limits))
    return _JUDGED[key, limits]


def _judged(aircraft: Aircraft, trimmed: TrimmedFlight) -> Judged:
    c = trimmed.condition
    family = hash(aircraft.xml), trimmed.rate_hz
    bases = _BASES.setdefault(family, [])
    known = _variant_of(bases, aircraft, c)
    if known is not None:
        return known
    try:
        found = _verdict(batch_model(aircraft, trimmed.rate_hz, c), trimmed)
    except Untranslated as missing:
        return Judged(None, str(missing))
    bases.append(found)
    return found


def _variant_of(bases: Sequence[Judged], aircraft: Aircraft, condition: FlightCondition) -> Judged | None:
    tree = aircraft.rigid_tree() if bases else None
    for base in bases:
        assert tree is not None
        model = None if base.model is None else variant(base.model, aircraft, condition, tree)
        if model is not None:
            return Judged(model, base.reason, base.worst, base.channel)
    return None


def variant_known(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> BatchModel | None:
    """Return the model of an aircraft if one of its shape has been found equal to JSBSim in this process.

    Raises:
        ModelError: an amendment does not fit the model.
    """
    found = _variant_of(_BASES.get((hash(aircraft.xml), rate_hz), []), aircraft, condition)
    return None if found is None else found.model


def _verdict(model: BatchModel, trimmed: TrimmedFlight) -> Judged:
    """Return the verdict on a model, from disk if there is one."""
    kept = _place(model, trimmed)
    if kept is not None and kept.is_file():
        with suppress(OSError, ValueError, KeyError):
            known = json.loads(kept.read_text(encoding="utf-8"))
            worst, name = float(known["worst"]), str(known["channel"])
            return _of(model, worst, name)
    worst, name = compared(model, trimmed)
    if kept is not None and math.isfinite(worst):
        with suppress(OSError):
            kept.parent.mkdir(parents=True, exist_ok=True)
            partial = kept.with_suffix(f".{os.getpid()}")
            partial.write_text(json.dumps({"worst": worst, "channel": name}), encoding="utf-8")
            partial.replace(kept)
    return _of(model, worst, name)


def _of(model: BatchModel, worst: float, name: str) -> Judged:
    if worst <= TOLERANCE:
        return Judged(model, "", worst, name)
    if math.isnan(worst):
        return Judged(None, name, worst)
    return Judged(None, f"its {name} departs from JSBSim's by {worst:.1g} of its range", worst, name)


def _place(model: BatchModel, trimmed: TrimmedFlight) -> Path | None:
    """Return the file of a verdict, or None if there is no place for it."""
    base = os.environ.get("XDG_CACHE_HOME") or (Path.home() / ".cache" if _has_home() else None)
    if base is None:
        return None
    p = model.program
    parts = (
        model.start.tobytes(),
        *(code.tobytes() for code in (p.before, p.frame, p.log, p.tables)),
        (model.rate_hz, trimmed.alpha, sorted(trimmed.controls.items())),
        (SOURCES, version("jsbsim"), sys.platform),
    )
    text = repr(parts)
    return Path(base) / "flight-testbench" / "batch" / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.json"


def _has_home() -> bool:
    with suppress(RuntimeError):
        Path.home()
        return True
    return False


def compared(model: BatchModel, trimmed: TrimmedFlight) -> tuple[float, str]:
    """Fly a manoeuvre that moves every control by both; return the greatest difference of a range and its channel.

    The first is nan if it cannot be flown, the second then says why.
    """
    from testbench.flight.batch.fly import fly_block

    reason = ""
    for share in _SHARES:
        manoeuvre = every_control(model.aircraft, trimmed, share)
        job = Job(model.aircraft, trimmed, manoeuvre, _log_rate(trimmed.rate_hz))
        try:
            truth = fly(model.aircraft, trimmed, manoeuvre, job.log_rate_hz)
        except FlightAborted as error:
            reason = f"the flight that compares it with JSBSim leaves its limits: {error.reason}"
            if error.record is None or len(error.record) * 4 < _DURATION_S * job.log_rate_hz:
                continue
            truth = error.record
        except TestbenchError as error:
            return math.nan, str(error)
        record = fly_block([job], [model], Flown())[0]
        if isinstance(record, TestbenchError):
            return math.nan, str(record)
        if record.provenance.get("simulator") != BATCH:
            return math.nan, "the flight that compares it with JSBSim comes near the ground"
        if abs(len(record) - len(truth)) > 1:
            return math.nan, f"its flight departs from JSBSim's by its end, {len(record)} rows for {len(truth)}"
        return difference(record, truth)
    return math.nan, reason


def _log_rate(rate_hz: float) -> float:
    return rate_hz / max(1, round(rate_hz / 50.0))


def every_control(aircraft: Aircraft, trimmed: TrimmedFlight, share: float) -> Manoeuvre:
    """Return a manoeuvre in which each control moves by a share of its range, one after the other, then all at once."""
    rate = trimmed.rate_hz
    t = np.arange(round(_DURATION_S * rate)) / rate
    names = tuple(aircraft.controls)
    u = np.zeros((t.size, len(names)))
    for i, name in enumerate(names):
        control, at = aircraft.controls[name], trimmed.controls[name]
        size = min(share * (control.full - control.low), 0.9 * max(min(control.full - at, at - control.low), 0.0))
        together = np.sin(2.0 * np.pi * (0.4 + 0.3 * i) * t) * ((t > 8.0) & (t < 14.0))
        u[:, i] = size * (_doublet(t, 0.5 + 1.7 * i, 0.6 + 0.1 * i) + together)
    return Manoeuvre("every control", InputSignal(t, u, names), settle_s=0.0)


def _doublet(t: FloatArray, start: float, width: float) -> FloatArray:
    return ((t >= start) & (t < start + width)).astype(float) - ((t >= start + width) & (t < start + 2.0 * width))


def difference(record: FlightRecord, truth: FlightRecord) -> tuple[float, str]:
    """Return the greatest difference of two records of one flight, of a channel's range, and the channel."""
    n = min(len(record), len(truth))
    worst, where = 0.0, ""
    for name in truth.channels:
        a, b = record[name][:n], truth[name][:n]
        unit = channel(name).unit if name not in CHANNELS else CHANNELS[name].unit
        gap = np.abs(a - b)
        if unit == "rad":
            gap = np.minimum(gap, np.abs(gap - 360.0 * DEG_RAD))
        spread = np.ptp(b) if name != "psi" else np.ptp(np.unwrap(b))
        size = float(np.max(gap)) / max(float(spread), _AGREED.get(unit, _SMALL))
        if not size <= worst:
            worst, where = size, name
        if math.isnan(size):
            return math.inf, name
    return worst, where
