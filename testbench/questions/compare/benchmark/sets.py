"""The data sets of the benchmark, and their definition: what its hash is taken over."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbench.core.door import read_text
from testbench.core.errors import RecordError
from testbench.core.named import obtain
from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.compare.benchmark import bound as bounds
from testbench.questions.compare.benchmark import flights
from testbench.questions.files import find

VERSION = 1
"""Of flights and scores; raised with every change that can move a figure."""
FIRST_SEED = 1001
_UNSEEN = 50_000  # added to a seed for the flight that is kept back


@dataclass(frozen=True)
class DataSet:
    """One data set: ``case`` of :func:`~.flights.fly`, or the packaged description ``records`` of a recorded flight."""

    name: str
    words: str
    case: str = ""
    records: str = ""


SETS = {
    s.name: s
    for s in (
        DataSet("clean", "white measurement noise alone", "clean"),
        DataSet("coloured", "measurement noise coloured over a second, three times as large", "colour"),
        DataSet("closed_loop", "rate and alpha feedback, gusts", "loop"),
        DataSet("flexible", "an elastic mode of 3 Hz in the rate gyro", "flexible"),
        DataSet("turbulence", "gusts as large as the manoeuvre", "turbulence"),
        DataSet("stall", "lift and stability fall beyond 1.7 deg of alpha", "stall"),
        DataSet("8_hz", "8.3 samples per second", "slow"),
        DataSet("missing", "15 % of the samples of alpha were not taken", "missing"),
        DataSet("servo", "the command is recorded, the surface lags it by 0.08 s", "servo"),
        DataSet("attas", "ATTAS, elevator 3-2-1-1", records="records/attas_short_period"),
        DataSet("hfb320", "HFB-320 in turbulence, elevator 3-2-1-1", records="records/hfb320_longitudinal"),
        DataSet("twin_otter", "Twin Otter, elevator multistep", records="records/twin_otter_longitudinal"),
    )
}


class Flown(NamedTuple):
    """One flight: to identify from, kept back, the true or printed (wn in rad/s, zeta), the bound of both or None."""

    record: FlightRecord
    unseen: FlightRecord
    truth: FloatArray
    bound: FloatArray | None
    derivatives: Mapping[str, float]


def flown(data: DataSet, seed: int) -> Flown:
    """Return one flight of a data set.

    Raises:
        RecordError: a recorded flight is not there.
    """
    if data.records:
        return _recorded(data)
    record, surface = flights.fly_with_surface(data.case, seed)
    if data.case == "missing":
        record = _filled(record)
    truth = np.array([flights.WN, flights.ZETA])
    unseen = flights.fly(data.case, seed + _UNSEEN)
    return Flown(record, unseen, truth, bounds.bound(data.case, record, surface), flights.TRUTH)


def _filled(record: FlightRecord) -> FlightRecord:
    """Return the record as every record of the testbench is prepared: gaps are interpolated, their mask is kept."""
    from testbench.estimators.prepare import prepare

    return prepare(record, bias="none", trim_s=0.0)


def _recorded(data: DataSet) -> Flown:
    from testbench.line import prepared
    from testbench.logs.read import read_records
    from testbench.questions.identify.scenario import RecordDescription

    asked = obtain(RecordDescription, data.records)
    seen, unseen = [], []
    for _, use, record in read_records(asked):
        first, rest = record.split(asked.preparation.identification_fraction) if use == "split" else (record, record)
        if use in ("split", "identification"):
            seen.append(prepared(first, asked.trim_s, asked.preparation))
        if use in ("split", "validation"):
            unseen.append(prepared(rest, asked.trim_s, asked.preparation))
    values = asked.reference_values
    return Flown(seen[0], unseen[0], np.array([values["wn_rad_s"], values["zeta"]]), None, {})


def definition(data: DataSet) -> str | None:
    """Return the SHA-256 of what a data set is; None if it is a recorded flight that is not there."""
    told: dict[str, Any] = {"version": VERSION, "name": data.name, "words": data.words, "case": data.case}
    if data.records:
        try:
            record = _recorded(data).record
        except RecordError:
            return None
        described = read_text(find(Path(data.records), "identify"), "scenario")
        told |= {"records": str(record.provenance["sha256"]), "description": described}
    else:
        told |= {"source": inspect.getsource(flights), "bound": inspect.getsource(bounds), "first seed": FIRST_SEED}
    return sha256(told)


def sha256(told: Any) -> str:
    """Return the SHA-256 of JSON values, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(told, sort_keys=True, ensure_ascii=True).encode()).hexdigest()
