"""Where the gap workflow flies: trims, linear models and flights of many models at once, each made once.

What is asked for together is made together: by the batch where it flies a model, by JSBSim otherwise, or wherever the
question says so. What one caller has flown the next one finds here.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, Start, TrimmedFlight
from testbench.flight.air import Air
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.jobs import Job, Simulator
from testbench.flight.batch.linear import linearise_flight, linearise_many
from testbench.flight.batch.trim import Near, trim_many
from testbench.flight.trim import slopes_at
from testbench.inputs.signal import InputSignal

BEYOND = 0.25  # share of the range between its limits by which a hypothesis may exceed them on either side
_MODELS, AT_ONCE = 512, 512  # that are kept; so many flights may be asked for at once
K = TypeVar("K", bound=Hashable)
S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class Flyer:
    """What trim, linearisation and flight depend on: hypotheses that differ in their sensors alone share them."""

    aircraft: Aircraft = field(compare=False)  # what flies
    contents: tuple[object, ...]  # all that makes it differ from another
    condition: FlightCondition  # of its trim
    rate_hz: float  # frame rate
    simulator: Simulator  # "jsbsim" flies nothing in batches

    def __hash__(self) -> int:
        return self._hash

    def __getstate__(self) -> dict[str, object]:  # texts have other hashes in another process
        return {k: v for k, v in self.__dict__.items() if k not in ("_hash", "beyond_limits")}

    @cached_property
    def _hash(self) -> int:  # asked for at every look-up
        return hash((self.contents, self.condition, self.rate_hz, self.simulator))

    @cached_property
    def beyond_limits(self) -> Aircraft:
        """The aircraft with limits of its flights that are wider by a share of what lies between them."""
        limits = {
            n: (low, high) if n == "h" else (low - BEYOND * (high - low), high + BEYOND * (high - low))
            for n, (low, high) in self.aircraft.limits.items()
        }
        return replace(self.aircraft, limits=limits)

    @classmethod
    def of(cls, aircraft: Aircraft, condition: FlightCondition, rate_hz: float, simulator: Simulator) -> Flyer:
        """Return the flyer of an aircraft."""
        limits = tuple(sorted(aircraft.limits.items()))
        changed = (repr(aircraft.adapter), repr(aircraft.elastic), repr(aircraft.amendments))
        contents = (aircraft.name, aircraft.xml, *changed, aircraft.mass, limits)
        return cls(aircraft, contents, condition, rate_hz, simulator)


@dataclass(frozen=True)
class Wanted:
    """One flight that is wanted."""

    flyer: Flyer  # what flies
    controls: tuple[str, ...]  # m that are commanded
    held: bytes  # bytes of an array (frames, m) of commands, as deviations from trim
    log_rate_hz: float  # of the record
    channels: tuple[str, ...] | None  # that are logged; all if None
    air: Air | None  # flown through; still if None
    start: Start | None = None  # how far from trim it begins; at trim if None

    def __hash__(self) -> int:
        return self._hash

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in self.__dict__.items() if k != "_hash"}

    @cached_property
    def _hash(self) -> int:
        return hash((self.flyer, self.controls, self.held, self.log_rate_hz, self.channels, self.air, self.start))

    def job(self, trimmed: TrimmedFlight) -> Job:
        """Return the flight from a trim.

        The trim of a hypothesis may lie where the commands would leave the range of a control: half the drag, say,
        trims with a throttle near idle. The control then stops at its end, so that a search can pass by. For the same
        reason a flight may exceed the limits of the aircraft by BEYOND, as one does that stalls too early.
        """
        aircraft = self.flyer.aircraft
        u = np.frombuffer(self.held).reshape(-1, len(self.controls))
        of = [(aircraft.controls[n], trimmed.controls[n]) for n in self.controls]
        within = np.clip(u, [c.low - at for c, at in of], [c.full - at for c, at in of])
        signal = InputSignal(np.arange(len(u)) / self.flyer.rate_hz, within, self.controls)
        manoeuvre = Manoeuvre("measured commands", signal, 0.0)
        return Job(self.flyer.beyond_limits, trimmed, manoeuvre, self.log_rate_hz, self.channels, self.air, self.start)


def trims(flyers: Sequence[Flyer]) -> list[TrimmedFlight | Refusal]:
    """Return the trim of each, or why it has none."""
    return _TRIMS.of(flyers, _trim)


def linear_models(flyers: Sequence[Flyer]) -> list[LinearModel | Refusal]:
    """Return the linear model of each about its trim, or why it has none."""
    return _LINEAR.of(flyers, _linearise)


def linear_along(
    flyer: Flyer, flown: FlightRecord, states: Sequence[str]
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the linear models about every sample of a flight, see :func:`testbench.flight.linearise_along`."""
    return linearise_flight(flyer.aircraft, made(trims([flyer])[0]), flown, states, flyer.simulator)


def flights(wanted: Sequence[Wanted]) -> list[FlightRecord | Refusal]:
    """Return the truth of each flight, one that ended early as aborted, or why it could not begin."""
    return _FLOWN.of(wanted, _fly)


def made(found: T | Refusal) -> T:
    """Return what was made."""
    if isinstance(found, Refusal):
        raise found.with_traceback(None)
    return found


class _Kept(Generic[K, T]):
    """The latest results, by what they were made from: ``most`` of them, or twice the largest request."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._of: OrderedDict[K, T] = OrderedDict()

    def of(self, keys: Sequence[K], make: Callable[[list[K]], Sequence[T]]) -> list[T]:
        """Return the result of each key; those that are missing are made together."""
        missing = [k for k in dict.fromkeys(keys) if k not in self._of]
        self._most = max(self._most, 2 * len(missing))  # what was made together is asked for one by one
        new = dict(zip(missing, make(missing), strict=True)) if missing else {}
        out = []
        for key in keys:
            value = new[key] if key in new else self._of.pop(key)
            self._of[key] = value
            out.append(value)
        while len(self._of) > self._most:
            self._of.popitem(last=False)
        return out


_TRIMS: _Kept[Flyer, TrimmedFlight | Refusal] = _Kept(_MODELS)
_NEAR: _Kept[Flyer, Near | None] = _Kept(_MODELS)
_LINEAR: _Kept[Flyer, LinearModel | Refusal] = _Kept(_MODELS)
_FLOWN: _Kept[Wanted, FlightRecord | Refusal] = _Kept(AT_ONCE)


def _trim(flyers: Sequence[Flyer]) -> list[TrimmedFlight | Refusal]:
    def by(some: Sequence[Flyer]) -> list[TrimmedFlight | Refusal]:
        conditions = [f.condition for f in some]
        near = lambda i: _near(some[i])  # noqa: E731
        return trim_many([f.aircraft for f in some], conditions, some[0].rate_hz, None, some[0].simulator, near)

    return _grouped(flyers, flyers, by)


def _near(flyer: Flyer) -> Near | None:
    """Return the trim of the aircraft as it was loaded; None if it has none, or is what is asked about.

    It is the same whatever was trimmed before, so that no result depends on that.
    """
    if not flyer.aircraft.amendments:
        return None
    plain = replace(flyer.aircraft, amendments=())
    return _NEAR.of([Flyer.of(plain, flyer.condition, flyer.rate_hz, flyer.simulator)], _trimmed_with_slopes)[0]


def _trimmed_with_slopes(flyers: Sequence[Flyer]) -> list[Near | None]:
    found = trims(flyers)
    return [
        None if isinstance(x, Refusal) else (x, slopes_at(f.aircraft, x)) for f, x in zip(flyers, found, strict=True)
    ]


def _linearise(flyers: Sequence[Flyer]) -> list[LinearModel | Refusal]:
    def by(some: Sequence[tuple[Flyer, TrimmedFlight]]) -> list[LinearModel | Refusal]:
        return linearise_many([f.aircraft for f, _ in some], [at for _, at in some], some[0][0].simulator)

    return _from_trims(flyers, flyers, by)


def _fly(wanted: Sequence[Wanted]) -> list[FlightRecord | Refusal]:
    def by(some: Sequence[tuple[Wanted, TrimmedFlight]]) -> list[FlightRecord | Refusal]:
        jobs, simulator = [w.job(at) for w, at in some], some[0][0].flyer.simulator
        return fly_jobs(jobs, simulator, fewest=1)

    return _from_trims(wanted, [w.flyer for w in wanted], by)


def _from_trims(
    keys: Sequence[K], flyers: Sequence[Flyer], make: Callable[[Sequence[tuple[K, TrimmedFlight]]], Sequence[T]]
) -> list[T | Refusal]:
    """Return what is made of each key from the trim of its flyer, or why that has none."""
    found = trims(flyers)
    able = [(k, f, x) for k, f, x in zip(keys, flyers, found, strict=True) if not isinstance(x, Refusal)]
    of = _grouped([(k, x) for k, _, x in able], [f for _, f, _ in able], make)
    made_of = dict(zip((k for k, _, _ in able), of, strict=True))
    return [x if isinstance(x, Refusal) else made_of[k] for k, x in zip(keys, found, strict=True)]


def _grouped(items: Sequence[S], flyers: Sequence[Flyer], make: Callable[[Sequence[S]], Sequence[T]]) -> list[T]:
    """Return what is made of each item: those of one rate and simulator together."""
    kinds = [(f.simulator, f.rate_hz) for f in flyers]
    out: dict[int, T] = {}
    for kind in dict.fromkeys(kinds):
        at = [i for i, k in enumerate(kinds) if k == kind]
        out |= dict(zip(at, make([items[i] for i in at]), strict=True))
    return [out[i] for i in range(len(items))]
