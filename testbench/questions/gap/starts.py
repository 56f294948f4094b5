"""What a record says of itself: which one it is, and what it was flown from where that is not what the others were."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from hashlib import blake2b

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.effects.mass import with_load
from testbench.flight import FlightCondition
from testbench.sensors import SensorSuite

CUT = "cut_from_record_s"
"""Of the provenance of a record that was cut from a log: beginning and end there."""
KEY = "flown_from"
"""Of a record's provenance, under which its start stands: what is cut out of a record or made of it keeps it."""
APART_S = 60.0
"""Records show what grows over a flight only if they lie so far apart: batteries and fuel last for many minutes."""


@dataclass(frozen=True)
class Start:
    """The condition that a record starts from, and what the aircraft carried beyond what is believed of it.

    Attributes:
        condition: that is trimmed.
        load_kg: more than the believed mass; negative if less was carried, fuel that was burnt for one.
        load_aft_m: place of the load behind the believed centre of gravity, on the centre line.
        at_s: time since take-off in the middle of the record; None where that is not known.
        changed: whether what begins in flight (:mod:`.onset`) has begun.
    """

    condition: FlightCondition
    load_kg: float = 0.0
    load_aft_m: float = 0.0
    at_s: float | None = None
    changed: bool = False

    def loaded(self, aircraft: Aircraft, suite: SensorSuite) -> tuple[Aircraft, SensorSuite]:
        """Return an aircraft that carries the load, and the sensors, whose places are told from the centre of gravity.

        Raises:
            RecordError: nothing would be left of the mass.
        """
        if self.load_kg == 0.0:
            return aircraft, suite
        if self.load_kg <= -aircraft.mass.mass_kg:
            raise RecordError(
                f"load_kg > {-aircraft.mass.mass_kg:.4g} must hold, as the aircraft weighs no more, "
                f"got {self.load_kg:g}"
            )
        return with_load(aircraft, suite, "load", self.load_kg, self.load_aft_m)

    def __str__(self) -> str:
        load = f", {self.load_kg:+.3g} kg" if self.load_kg else ""
        return str(self.condition) + load + ("" if self.at_s is None else f", {self.at_s:.4g} s after take-off")

    def later(self, by_s: float) -> Start:
        """Return the start so many s later; itself where the time is not known."""
        return self if self.at_s is None else replace(self, at_s=self.at_s + by_s)


def marked(record: FlightRecord, start: Start) -> FlightRecord:
    """Return a record that says what it was flown from."""
    told = {**asdict(start.condition), "load_kg": start.load_kg, "load_aft_m": start.load_aft_m}
    told |= {} if start.at_s is None else {"at_s": start.at_s}
    told |= {"changed": 1.0} if start.changed else {}
    return replace(record, provenance={**record.provenance, KEY: told})


def timed(records: Mapping[str, FlightRecord], general: FlightCondition) -> dict[str, FlightRecord]:
    """Return records, of which those cut from one log far apart say when: its beginning is taken for take-off.

    ``general`` is the condition of those that say nothing of their own.
    """
    logs: dict[str, dict[str, float]] = defaultdict(dict)
    for name, record in records.items():
        if span := record.provenance.get(CUT):
            logs[str(record.provenance.get("sha256"))][name] = 0.5 * float(sum(span))
    out = dict(records)
    for middles in logs.values():
        if not far_apart(middles.values()):
            continue
        for name, at_s in middles.items():
            start = start_of(records[name]) or Start(general)
            if start.at_s is None:
                out[name] = marked(records[name], replace(start, at_s=at_s))
    return out


def times_of(records: Iterable[FlightRecord]) -> set[float]:
    """Return the times after take-off, s, that records say."""
    return {s.at_s for s in map(start_of, records) if s is not None and s.at_s is not None}


def far_apart(times_s: Collection[float]) -> bool:
    """Return whether two of these times lie so far apart that what grows over a flight can be seen."""
    return len(times_s) > 1 and max(times_s) - min(times_s) >= APART_S


def start_of(record: FlightRecord) -> Start | None:
    """Return what a record says that it was flown from; None if it says nothing, as the condition of all is its own.

    Raises:
        RecordError: what it says is no start.
    """
    told = record.provenance.get(KEY)
    if told is None:
        return None
    try:
        if not isinstance(told, Mapping):
            raise TypeError("no table")
        values = {str(n): float(v) for n, v in told.items()}
        load = {n: values.pop(n) for n in ("load_kg", "load_aft_m", "at_s") if n in values}
        changed = bool(values.pop("changed", 0.0))
        return Start(FlightCondition(**values), **load, changed=changed)
    except (TypeError, ValueError):
        raise RecordError(
            f"provenance '{KEY}' of a record must hold V_m_s and h_m, and may hold gamma_rad, load_kg, load_aft_m and "
            f"at_s, as numbers, got {told!r}"
        ) from None


@lru_cache(maxsize=128)
def record_key(record: FlightRecord) -> str:
    """Return what identifies a record: a digest of its times, channels, samples and validity.

    The noise of the sensors makes it another one when the same manoeuvre is flown again.
    """
    digest = blake2b("\0".join(record.channels).encode(), digest_size=16)
    for part in (record.t_s, record.data, record.valid):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def called(records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records each of which says what its manoeuvre is called: by its name, where it does not say yet."""
    return {
        name: record if _called(record) else replace(record, provenance={**record.provenance, "manoeuvre": name})
        for name, record in records.items()
    }


def manoeuvre_of(record: FlightRecord, number: int) -> str:
    """Return the name of the manoeuvre as the provenance has it, or else "record NUMBER"."""
    return _called(record) or f"record {number}"


def _called(record: FlightRecord) -> str:
    truth = record.provenance.get("truth")
    for source in (record.provenance, truth if isinstance(truth, Mapping) else {}):
        if isinstance(source.get("manoeuvre"), str):
            return str(source["manoeuvre"])
    return ""
