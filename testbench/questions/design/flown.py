"""Designs flown in the nonlinear simulator, and scaled down or up to the limits."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import TrimmedFlight
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.line import manoeuvre_of
from testbench.questions.design.candidates import sampled
from testbench.questions.design.limits import Breach, Limits, breaches
from testbench.questions.design.problem import Design, Problem, rescaled

_FLIGHTS = 5  # per design
ABORTED = 0.6  # factor on the amplitude after a flight that ended before its time
_LOG_HZ = 200.0  # least rate at which flights are held against the limits
SHOWN = ("V", "alpha", "q", "theta", "h", "az")
_FULL = 0.97  # share of a limit from which it counts as used up
_MOST = 1.5  # factor by which the amplitude may grow over what the linearised aircraft allows


class Tightest(NamedTuple):
    """The limit that a flight uses up most: its name, the share of the distance from trim, and the time."""

    name: str
    share: float
    t_s: float


class Margin(NamedTuple):
    """What flights in turbulence say of a design's limits.

    Attributes:
        n: flights.
        probability: that the next one meets the limit, for which the amplitude is chosen.
        name: of the limit that comes nearest.
        mean, deviation: of the share of it that a flight's extreme uses.
        reach: the share that is met with that probability; more than 1 if no amplitude keeps it.
        met: flights that met some limit.
        lowered: amplitude over the one that still air allows.
    """

    n: int
    probability: float
    name: str
    mean: float
    deviation: float
    reach: float
    met: int
    lowered: float


class Flight(NamedTuple):
    """A flight of a design: its record, the limits that it breaks in words, and the one that it uses up most."""

    record: FlightRecord
    broken: list[str]
    tightest: Tightest


@dataclass(frozen=True, eq=False)
class Flown:
    """A design at the largest amplitude that keeps the limits in the simulator.

    Attributes:
        design: at that amplitude.
        record: of that flight.
        predicted: the design at the amplitude that the linearised aircraft allows.
        tightest: the limit that is used up most.
        breach: what broke at the predicted amplitude, with its moment; "" if nothing did.
        admissible: whether the flight kept all limits; False after several attempts that did not.
        margin: what flights in turbulence say; None where the air is still.
        curbed: amplitude over the one that the limits allow: a larger one would mislead the estimator.
        for_others: amplitude over that of the believed aircraft, so that others keep the limits in still air, too.
    """

    design: Design
    record: FlightRecord
    predicted: Design
    tightest: Tightest
    breach: str
    admissible: bool
    margin: Margin | None = None
    curbed: float = 1.0
    for_others: float = 1.0

    @property
    def factor(self) -> float:
        """Amplitude over the predicted one."""
        return float(self.design.peak.max() / self.predicted.peak.max())


@dataclass(frozen=True, eq=False)
class Envelope:
    """The limits of a design, in the form in which a flown record is compared with them.

    Attributes:
        bands: channel -> (lowest, highest), absolute; deflections included.
        rates: control -> (its servo's 1 / lag in 1/s, largest rate in rad/s).
        trim: channel -> value at trim.
    """

    bands: Mapping[str, tuple[float, float]]
    rates: Mapping[str, tuple[float, float]]
    trim: Mapping[str, float]

    @classmethod
    def of(cls, limits: Limits, problem: Problem) -> Envelope:
        """Return the envelope of a problem's limits at its trim."""
        prediction = problem.prediction
        model, trim = prediction.model, dict(prediction.trim)
        bands = limits.bands(trim)
        for name in prediction.controls:
            bands[name] = limits.control_band(name)
        rates = {}
        for name in prediction.controls:
            if name in limits.rate and f"servo_{name}" in model.states:
                row = model.states.index(f"servo_{name}")
                rates[name] = (-float(model.A[row, row]), limits.rate[name])
        return cls(bands, rates, trim)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the limits, those on rates behind the others."""
        return (*self.bands, *(f"rate of {name}" for name in self.rates))

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that a record must have to be held against the limits."""
        return (*self.bands, *(c for name in self.rates for c in (name, f"{name}_cmd")))

    def _used(self, record: FlightRecord) -> list[FloatArray]:
        """Return over time (n,) the share of the distance from trim to each limit, in the order of ``names``."""
        out = []
        for name, (low, high) in self.bands.items():
            x, at = record[name], self.trim.get(name, float(record[name][0]))
            out.append(np.where(x > at, (x - at) / (high - at), (at - x) / (at - low)))
        return [*out, *(self._rate(record, name, lag) / most for name, (lag, most) in self.rates.items())]

    def shares(self, record: FlightRecord) -> FloatArray:
        """Return the largest share that a record uses of each limit, in the order of ``names``."""
        return np.array([float(share.max()) for share in self._used(record)])

    def tightest(self, record: FlightRecord) -> Tightest:
        """Return the limit that a record uses up most."""
        used = self._used(record)
        i = max(range(len(used)), key=lambda i: float(used[i].max()))
        k = int(np.argmax(used[i]))
        return Tightest(self.names[i], float(used[i][k]), float(record.t_s[k]))

    def broken(self, record: FlightRecord) -> list[str]:
        """Return every limit that a record breaks, in words, in order of time."""
        found: list[tuple[float, str]] = [(b.t_s, _sentence(b)) for b in breaches(record, dict(self.bands))]
        for name, (lag, most) in self.rates.items():
            rate = self._rate(record, name, lag)
            if rate.max() > most:
                t = float(record.t_s[np.argmax(rate > most)])
                text = (
                    f"the rate of {name} passes {most / DEG_RAD:.3g} deg/s at t = {t:.2f} s "
                    f"(extreme {rate.max() / DEG_RAD:.3g} deg/s)"
                )
                found.append((t, text))
        return [text for _, text in sorted(found)]

    @staticmethod
    def _rate(record: FlightRecord, name: str, lag: float) -> FloatArray:
        """Return the rate of a first-order servo (n,), rad/s, from command and deflection."""
        return np.asarray(lag * np.abs(record[f"{name}_cmd"] - record[name]))


def _sentence(breach: Breach) -> str:
    if breach.channel == "az":
        n, limit = -breach.value / G0_M_S2, -breach.limit / G0_M_S2
        return f"the load factor passes {limit:.3g} at t = {breach.t_s:.2f} s (extreme {n:.3g})"
    return breach.sentence


def limit_words(name: str) -> str:
    """Return a limit's name in words."""
    for kind in ("rate of ", "command of "):
        if name.startswith(kind):
            return f"the {kind}{channel(name.removeprefix(kind)).description.split(',')[0]}"
    return "the load factor" if name == "az" else f"the {channel(name).description.split(',')[0]}"


def fly_designs(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    problem: Problem,
    designs: Sequence[Design],
    limits: Envelope,
    simulator: Simulator,
    tally: Tally,
) -> list[Flown]:
    """Fly designs and scale each to the largest amplitude that keeps the limits; those of a round are flown together.

    Args:
        aircraft: what is flown.
        trimmed: where the flights start.
        problem: the design problem.
        designs: at the amplitudes that the linearised aircraft allows.
        limits: the limits of the scenario.
        simulator: see :mod:`testbench.flight.batch.jobs`.
        tally: is told of every flight.

    Raises:
        TestbenchError: of the first that cannot be flown at all.
    """
    searches = [_scaled(problem, design, _command_room(problem, design, trimmed.rate_hz)) for design in designs]
    wanted = {i: next(search) for i, search in enumerate(searches)}
    out: dict[int, Flown] = {}
    while wanted:
        now = list(wanted.values())
        flights = fly_all(aircraft, trimmed, now, limits, simulator, tally)
        for i, flight in zip(list(wanted), flights, strict=True):
            try:
                wanted[i] = searches[i].send(flight)
            except StopIteration as found:
                out[i] = found.value
                del wanted[i]
    return [out[i] for i in range(len(designs))]


def _scaled(problem: Problem, design: Design, room: float) -> Generator[Design, Flight, Flown]:
    """Ask for flights of a design, one after the other, until an amplitude uses up the limits; return the best.

    The response is taken as proportional to the amplitude from one flight to the next. For deflections, commands and
    rates this is exact, because servos are linear; the amplitude never grows beyond what they allow.
    """
    top = min(_linear_room(problem, design), room)
    factor, low, high, said = min(1.0, top), 0.0, np.inf, ""
    tried = []
    for attempt in range(_FLIGHTS):
        now = rescaled(problem, design, factor, design.limit)
        record, broken, tight = yield now
        if attempt == 0 and broken:
            said = broken[0]
        tried.append((not broken, factor, now, record, tight))
        low, high = (low, min(high, factor)) if broken else (max(low, factor), high)
        if not broken and (tight.share >= _FULL or factor >= _FULL * min(high, top)):
            break
        wanted = factor * 0.99 / max(tight.share, 1e-6)
        if not low < wanted < high:
            wanted = 0.5 * (low + high) if low > 0.0 else 0.9 * high
        factor = min(wanted, top)
    good = [t for t in tried if t[0]]
    _, _, final, record, tight = max(good, key=lambda t: t[1]) if good else min(tried, key=lambda t: t[1])
    return Flown(replace(final, limit=tight.name or final.limit), record, design, tight, said, bool(good))


def fly_each(
    aircraft: Sequence[Aircraft],
    trimmed: Sequence[TrimmedFlight],
    designs: Sequence[Design],
    limits: Sequence[Envelope],
    simulator: Simulator,
    tally: Tally,
) -> list[Flight | Refusal]:
    """Fly designs once, each with its aircraft, all at once where they can be; one that cannot be flown is its error.

    A flight that ends before its time uses up more than all of a limit without a name.
    """
    from testbench.flight.batch.fly import FEWEST, fly_jobs

    jobs = [_flight(a, t, d, e) for a, t, d, e in zip(aircraft, trimmed, designs, limits, strict=True)]
    fewest = 1 if tally.batch else FEWEST  # a model that has been judged is worth it for few flights, too
    found = fly_jobs(jobs, simulator, tally, fewest)
    return [
        record if isinstance(record, Refusal) else _judged(record, job, envelope)
        for record, job, envelope in zip(found, jobs, limits, strict=True)
    ]


def fly_all(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    designs: Sequence[Design],
    limits: Envelope,
    simulator: Simulator,
    tally: Tally,
) -> list[Flight]:
    """Fly designs of one aircraft within the same limits, as :func:`fly_each` does.

    Raises:
        TestbenchError: of the first that cannot be flown at all.
    """
    out = []
    n = len(designs)
    for flight in fly_each([aircraft] * n, [trimmed] * n, designs, [limits] * n, simulator, tally):
        if isinstance(flight, Refusal):
            raise flight
        out.append(flight)
    return out


def _flight(aircraft: Aircraft, trimmed: TrimmedFlight, design: Design, limits: Envelope) -> Job:
    rate = trimmed.rate_hz
    commands = (f"{name}_cmd" for name in design.controls)
    names = tuple(dict.fromkeys([*limits.bands, *design.controls, *commands, *SHOWN]))
    manoeuvre = manoeuvre_of(design.family, design.specs, design.duration_s, 0.0, rate)
    return Job(aircraft, trimmed, manoeuvre, rate / max(1, int(rate // _LOG_HZ)), names)


def _judged(record: FlightRecord, job: Job, limits: Envelope) -> Flight:
    if record.outcome == "aborted":
        end_s = len(record) / job.log_rate_hz
        text = f"the flight leaves the aircraft's limits at t = {end_s:.2f} s: {record.reason}"
        return Flight(record, [text], Tightest("", 1.0 / ABORTED, end_s))
    return Flight(record, limits.broken(record), limits.tightest(record))


def _command_room(problem: Problem, design: Design, rate_hz: float) -> float:
    """Return by how much the amplitude may grow before a command meets its limit at the rate that it is flown at.

    Between the samples of the design a multisine or a sweep rises above them.
    """
    u, room = sampled(design.specs, problem.controls, design.duration_s, rate_hz), np.inf
    for j, name in enumerate(problem.controls):
        k = problem.prediction.names.index(f"command of {name}")
        top, bottom = max(float(u[:, j].max()), 1e-12), min(float(u[:, j].min()), -1e-12)
        room = min(room, problem.prediction.high[k] / top, problem.prediction.low[k] / bottom)
    return float(room) * (1.0 - 1e-5)  # amplitudes are rounded to 1e-6 deg


def _linear_room(problem: Problem, design: Design) -> float:
    """Return by how much the amplitude may grow before a deflection, a command or a rate reaches its limit."""
    prediction = problem.prediction
    y = prediction.response(design.u)
    room = _MOST
    for k, name in enumerate(prediction.names):
        if name in prediction.controls or name.startswith(("rate of", "command of")):
            top, bottom = max(float(y[:, k].max()), 1e-12), min(float(y[:, k].min()), -1e-12)
            room = min(room, prediction.high[k] / top, prediction.low[k] / bottom)
    return max(room, 1e-6)
