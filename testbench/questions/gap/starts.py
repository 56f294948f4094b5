"""What a record says of itself: which one it is, and what it was flown from where that is not what the others were.

The start of a window of a record, which does not begin at trim, is a nuisance of that window alone. With r residuals in
units of the noise, G what the start parameters change in them per standard deviation of their priors, and z how far
they lie from the centres,

    min over z of |r - G z|^2 + |z|^2 = r' Q r,   Q = I - G (G'G + I)^-1 G',

so that Q^(1/2) r are the residuals of a window whose start is unknown. They lack trace(I - Q) degrees of freedom.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import blake2b
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from testbench.aircraft import Aircraft
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects.mass import with_load
from testbench.flight import FlightCondition
from testbench.flight import Start as Beginning
from testbench.sensors import SensorSuite

CUT = "cut_from_record_s"  # of the provenance of a record that was cut from a log: beginning and end there
KEY = "flown_from"
"""Of a record's provenance, under which its start stands: what is cut out of a record or made of it keeps it."""
APART_S = 60.0
"""Records show what grows over a flight only if they lie so far apart: batteries and fuel last for many minutes."""


@dataclass(frozen=True)
class Start:
    """The condition that a record starts from, and what the aircraft carried beyond what is believed of it."""

    condition: FlightCondition  # that is trimmed
    load_kg: float = 0.0  # more than the believed mass; negative if less was carried, fuel that was burnt for one
    load_aft_m: float = 0.0  # place of the load behind the believed centre of gravity, on the centre line
    at_s: float | None = None  # time since take-off in the middle of the record; None where that is not known
    changed: bool = False  # whether what begins in flight (:mod:`.onset`) has begun

    def loaded(self, aircraft: Aircraft, suite: SensorSuite) -> tuple[Aircraft, SensorSuite]:
        """Return an aircraft that carries the load, and its sensors, whose places count from the centre of gravity."""
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


MOST = 4.0  # prior standard deviations that a start parameter may lie from the centre
FARTHEST = 5.0  # prior standard deviations that a start is moved at once
STATES = ("V_m_s", "alpha", "beta", "p", "q", "r", "phi", "theta", "h_m")
"""Of a start, in the order of :class:`testbench.flight.Start`; what else a start has are offsets of commands, and where
surfaces and engines began."""
BEGAN = "_began"
"""End of the names of the latter: by how much the command that held a surface or an engine where it begins differs from
the first one recorded. A slow servo is not where it is commanded, and its record may begin while it moves."""


@dataclass(frozen=True, eq=False)
class FreeStart:
    """The start of one window: k parameters with Gaussian priors."""

    # of STATES (deviations from trim), controls whose commands are off by a constant, and controls that begin
    # elsewhere, with BEGAN
    names: tuple[str, ...]
    centre: FloatArray  # (k,) of their priors, SI
    std: FloatArray  # (k,) standard deviations of the priors, SI
    origin: FloatArray  # (k,) values at which ``columns`` were taken, SI; the start of the believed model
    columns: FloatArray  # (n, outputs, k) change of the readings per ``std`` of each, SI
    known: dict[object, Directions] = field(default_factory=dict, repr=False)

    def start(self, x: FloatArray) -> Beginning:
        """Return where a flight with parameters ``x`` (k,) begins."""
        return Beginning(**{n: v for n, v in zip(self.names, x.tolist(), strict=True) if n in STATES})

    def offsets(self, x: FloatArray) -> dict[str, float]:
        """Return control -> constant that its commands are off by."""
        own = zip(self.names, x.tolist(), strict=True)
        return {n: v for n, v in own if n not in STATES and not n.endswith(BEGAN)}

    def began(self, x: FloatArray) -> dict[str, float]:
        """Return control -> by how much the command that held it as the flight began differs from the first one."""
        own = zip(self.names, x.tolist(), strict=True)
        return {n.removesuffix(BEGAN): v for n, v in own if n.endswith(BEGAN)}

    def shift(self, x: FloatArray) -> FloatArray:
        """Return what readings (n, outputs) from ``x`` (k,) have more than from the centre, to first order, SI."""
        return np.asarray(self.columns @ ((x - self.centre) / self.std))

    def moved(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """Return the parameters (k,) that lie ``z`` (k,) from the centre, or on the way from ``x``, FARTHEST off."""
        step = self.centre + self.std * z - x
        return np.asarray(x + step * min(1.0, FARTHEST / max(float(np.max(np.abs(step / self.std))), 1e-12)))

    def directions(self, whitened: Callable[[FloatArray], FloatArray], key: tuple[object, Any]) -> Directions:
        """Return what the start does to residuals that are ``whitened`` (n, outputs), kept by ``key``."""
        if key not in self.known:
            G = np.stack([whitened(c) for c in np.moveaxis(self.columns, 2, 0)], axis=-1)
            U, s, Vt = np.linalg.svd(G.reshape(-1, G.shape[-1]), full_matrices=False)
            self.known[key] = Directions(U, s, Vt)
        return self.known[key]


@dataclass(frozen=True, eq=False)
class Directions:
    """What a start changes in residuals: G = U s V', U (samples, k), s (k,), Vt (k, k)."""

    U: FloatArray
    s: FloatArray
    Vt: FloatArray

    @cached_property
    def lost(self) -> float:
        """Degrees of freedom that the start takes: trace(I - Q)."""
        return float(np.sum(self.s**2 / (1.0 + self.s**2)))

    def taken_out(self, r: FloatArray) -> FloatArray:
        """Return Q^(1/2) r of residuals (n, outputs)."""
        flat = r.ravel()
        share = 1.0 - 1.0 / np.sqrt(1.0 + self.s**2)
        return np.asarray(flat - self.U @ (share * (self.U.T @ flat))).reshape(r.shape)

    def best(self, r: FloatArray) -> FloatArray:
        """Return the z (k,) that fits residuals r (n, outputs) from the centre best: (G'G + I)^-1 G' r.

        No entry is larger than MOST: a model that fits badly is not to be flown from where nobody believes it began.
        """
        onto = self.U.T @ r.ravel()
        z = self.Vt.T @ (self.s / (1.0 + self.s**2) * onto)
        if np.max(np.abs(z), initial=0.0) > MOST:
            A = np.vstack([self.s[:, None] * self.Vt, np.eye(self.s.size)])
            z = lsq_linear(A, np.concatenate([onto, np.zeros(self.s.size)]), (-MOST, MOST), method="bvls").x
        return np.asarray(z)
