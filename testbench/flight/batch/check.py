"""The judge: a translated model is used only after it has flown beside JSBSim.

The first flight of a model in a batch is preceded by one of 20 s in which every control moves, flown by both; of 10 s
if it is an amended one, in which they move one after the other and for 2 s all at once. Every channel of the simulator
must agree within 1e-9 of its range. The verdict is kept on disk, by a hash of the model's structure, of the batch's own
code and of JSBSim's version: models that differ in numbers only fly by one program, and one in two hundred flights is
flown by both whatever was found before.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import xml.etree.ElementTree as ET
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.door import read_json
from testbench.core.errors import Refusal
from testbench.core.files import keep, kept_in
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.flight.batch.jobs import BATCH, Job, Tally
from testbench.flight.batch.machine import SOURCES
from testbench.flight.batch.model import BatchModel, attributes, batch_model, variant
from testbench.flight.batch.program import Untranslated
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import model_key
from testbench.flight.simulate import Manoeuvre, fly
from testbench.inputs.signal import InputSignal

TOLERANCE = 1e-9
"""Greatest difference from JSBSim, of a channel's range."""
_DURATION_S, _AMENDED_S = 20.0, 10.0  # a search for what a model lacks amends it in a hundred ways
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
    """A verdict."""

    model: BatchModel | None  # the translated model, or None if JSBSim must fly
    reason: str = ""  # why it must, one clause
    worst: float = math.nan  # greatest difference from JSBSim, of a channel's range; nan if it has not flown
    channel: str = ""  # where it is


_JUDGED: OrderedDict[object, Judged] = OrderedDict()
_BASES: dict[object, list[Judged]] = {}
"""Text of a model, its frame rate and number of elements -> structures found equal to JSBSim, the latest first."""
_REFUSED: dict[object, Judged] = {}
"""The same by what the elements are -> verdict on what JSBSim must fly."""


def judged(aircraft: Aircraft, trimmed: TrimmedFlight) -> Judged:
    """Return whether an aircraft can be flown in a batch, after it has flown beside JSBSim.

    Models that differ in numbers only share a program and its verdict.

    Raises:
        ModelError: JSBSim refuses the aircraft.
    """
    return judged_at(aircraft, trimmed.rate_hz, trimmed.condition, lambda: trimmed)


def judged_at(
    aircraft: Aircraft, rate_hz: float, condition: FlightCondition, trimmed: Callable[[], TrimmedFlight]
) -> Judged:
    """Return the same at a condition; ``trimmed`` is called if it has to fly.

    Raises:
        ModelError: JSBSim refuses the aircraft.
        TrimError: it has no trim to fly from.
    """
    found = variant_known(aircraft, rate_hz, condition)
    if found is None:
        tree = aircraft.rigid_tree()
        try:
            found = _verdict(batch_model(aircraft, rate_hz, condition), trimmed)
        except Untranslated as missing:
            found = Judged(None, str(missing))
        if found.model is None:
            _REFUSED[_structure(aircraft, rate_hz, tree)] = found
        else:
            _BASES.setdefault(_family(aircraft, rate_hz, tree), []).insert(0, found)
        _keep(_key(aircraft, rate_hz, condition), found)
    return found


def variant_known(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> Judged | None:
    """Return the verdict on an aircraft if one has been given in this process, on it or on another of its structure.

    Raises:
        ModelError: an amendment does not fit the model.
    """
    key = _key(aircraft, rate_hz, condition)
    found = _JUDGED.get(key)
    if found is None:
        tree = aircraft.rigid_tree()
        bases = _BASES.get(_family(aircraft, rate_hz, tree), [])
        for i, base in enumerate(bases):
            model = None if base.model is None else variant(base.model, aircraft, condition, tree)
            if model is not None:
                found = replace(base, model=model)
                bases.insert(0, bases.pop(i))
                break
        else:
            found = _REFUSED.get(_structure(aircraft, rate_hz, tree))
            if found is None:
                return None
        _keep(key, found)
    _JUDGED.move_to_end(key)
    if found.model is not None and found.model.aircraft is not aircraft:  # whose limits may be others
        found = replace(found, model=replace(found.model, aircraft=aircraft))
    return found


def distrust(model: BatchModel, reason: str) -> None:
    """Let JSBSim fly all models of a structure from now on, in this process."""
    for bases in _BASES.values():
        bases[:] = [b for b in bases if b.model is not None and b.model.program is not model.program]
    for key in [k for k, each in _JUDGED.items() if each.model and each.model.program is model.program]:
        del _JUDGED[key]
    _REFUSED[_structure(model.aircraft, model.rate_hz, model.aircraft.rigid_tree())] = Judged(None, reason)


def _key(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> object:
    return model_key(aircraft, rate_hz, condition), tuple(aircraft.limits), aircraft.mass  # forces are read per mass


def _family(aircraft: Aircraft, rate_hz: float, tree: ET.Element) -> object:
    return hash(aircraft.xml), rate_hz, sum(1 for _ in tree.iter())


def _structure(aircraft: Aircraft, rate_hz: float, tree: ET.Element) -> object:
    """Return what models have in common that differ in numbers: tags, attributes and all texts that are no numbers."""
    modes = aircraft.flown_modes()
    elements = tuple((e.tag, *sorted(attributes(e).items()), _word(e.text)) for e in tree.iter())
    return hash(aircraft.xml), rate_hz, 0 if modes is None else len(modes), elements


def _word(text: str | None) -> str:
    try:
        float(text or "")
    except ValueError:
        return (text or "").strip()
    return ""


def _keep(key: object, found: Judged) -> None:
    _JUDGED[key] = found
    if len(_JUDGED) > _KEPT:
        _JUDGED.popitem(last=False)


def _verdict(model: BatchModel, trimmed: Callable[[], TrimmedFlight]) -> Judged:
    """Return the verdict on a model, from disk if there is one."""
    kept = _place(model)
    if kept is not None:
        with suppress(Refusal, OSError, ValueError, KeyError, TypeError):  # not there, not ours to read, or damaged
            known = read_json(kept, "model")
            worst, name = float(known["worst"]), str(known["channel"])
            return _of(model, worst, name)
    worst, name = compared(model, trimmed())
    if kept is not None and math.isfinite(worst):
        keep(kept, json.dumps({"worst": worst, "channel": name}).encode())
    return _of(model, worst, name)


def _of(model: BatchModel, worst: float, name: str) -> Judged:
    if worst <= TOLERANCE:
        return Judged(model, "", worst, name)
    if math.isnan(worst):
        return Judged(None, name, worst)
    return Judged(None, f"its {name} departs from JSBSim's by {worst:.1g} of its range", worst, name)


def _place(model: BatchModel) -> Path | None:
    """Return the file of a verdict, or None if there is no place for it."""
    place = kept_in("batch")
    if place is None:
        return None
    p = model.program
    parts = (
        model.aircraft.xml,
        model.rate_hz,
        model.shape,
        *(code.tobytes() for code in (p.before, p.frame, p.log)),
        (SOURCES, version("jsbsim"), sys.platform),
    )
    text = repr(parts)
    return place / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.json"


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
            if error.record is None or len(error.record) * 4 < _duration_s(model.aircraft) * job.log_rate_hz:
                continue
            truth = error.record
        except Refusal as error:
            return math.nan, str(error)
        record = fly_block([job], [model], Tally())[0]
        if isinstance(record, Refusal):
            return math.nan, str(record)
        if record.provenance.get("simulator") != BATCH:
            return math.nan, "the flight that compares it with JSBSim comes near the ground"
        if abs(len(record) - len(truth)) > 1:
            return math.nan, f"its flight departs from JSBSim's by its end, {len(record)} rows for {len(truth)}"
        return difference(record, truth)
    return math.nan, reason


def _duration_s(aircraft: Aircraft) -> float:
    return _AMENDED_S if aircraft.amendments else _DURATION_S


def _log_rate(rate_hz: float) -> float:
    return rate_hz / max(1, round(rate_hz / 50.0))


def every_control(aircraft: Aircraft, trimmed: TrimmedFlight, share: float) -> Manoeuvre:
    """Return a manoeuvre in which each control moves by a share of its range, one after the other, then all at once."""
    rate = trimmed.rate_hz
    t = np.arange(round(_duration_s(aircraft) * rate)) / rate
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


def least_range(name: str) -> float:
    """Return the least range that a difference in a channel is taken of, SI."""
    return _AGREED.get(channel(name).unit, _SMALL)


def difference(record: FlightRecord, truth: FlightRecord) -> tuple[float, str]:
    """Return the greatest difference of two records of one flight, of a channel's range, and the channel."""
    n = min(len(record), len(truth))
    worst, where = 0.0, ""
    for name in truth.channels:
        a, b = record[name][:n], truth[name][:n]
        gap = np.abs(a - b)
        if channel(name).unit == "rad":
            gap = np.minimum(gap, np.abs(gap - 360.0 * DEG_RAD))
        spread = np.ptp(b) if name != "psi" else np.ptp(np.unwrap(b))
        size = float(np.max(gap)) / max(float(spread), least_range(name))
        if not size <= worst:
            worst, where = size, name
        if math.isnan(size):
            return math.inf, name
    return worst, where
