"""Fly many flights: those of one model together, by its program; where there is none, one by one by JSBSim."""

from __future__ import annotations

import math
import threading
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TypeVar, get_args

import numpy as np

from testbench.core.constants import FT_M
from testbench.core.errors import LimitError, Refusal, nearest
from testbench.core.processes import spread
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import Judged, difference, distrust, judged
from testbench.flight.batch.jobs import BATCH, BOTH, JSBSIM, Job, Simulator, Tally
from testbench.flight.batch.machine import Driven, Logged, Watched
from testbench.flight.batch.model import TOP_FT, BatchModel, filled, put, read, registers, states_at
from testbench.flight.batch.vector import LANES
from testbench.flight.executive import body_from_earth
from testbench.flight.recorder import limit_broken
from testbench.flight.simulate import checked, logged_of, provenance_of, truth_of
from testbench.flight.start import Beginning
from testbench.flight.trim import steady_wind

FEWEST = 8
"""Flights from which a batch is worth the judgement of a model that has not been judged: 50 ms, where one flight of
JSBSim takes 7 and one in a batch 3."""
AT_ONCE = 32 * LANES
"""Flights whose records are held together."""
_TRUSTED = 1e-6  # of a channel's range: more than a flight far from trim makes of what is agreed about trim
_GUSTS = [r.GUST, r.GUST + 1, r.GUST + 2]
T = TypeVar("T")


def fly_many(jobs: Sequence[Job], simulator: Simulator = "auto") -> list[FlightRecord]:
    """Fly many flights and return their truths, each as :func:`testbench.flight.fly` would.

    A flight that leaves its limits, or what its model has numbers for, ends alone: its record is short and has the
    outcome "aborted" with the reason.

    Args:
        jobs: flights, of any aircraft.
        simulator: "jsbsim" flies one by one; "batch" refuses what is not translated; "auto" takes the batch where the
            model has been found equal to JSBSim.

    Raises:
        LimitError: a rate, a command or the air breaks its law.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trimmed = tb.trim(taurus, tb.FlightCondition(12.0, 100.0))
        >>> t = np.arange(round(5.0 * trimmed.rate_hz)) / trimmed.rate_hz
        >>> pulses = [
        ...     tb.Manoeuvre(f"pulse {a}", tb.InputSignal(t, np.deg2rad(a) * (t < 1.0)[:, None], ("de",)))
        ...     for a in (1.0, 2.0)
        ... ]
        >>> jobs = [tb.Job(taurus, trimmed, pulse, log_rate_hz=60.0) for pulse in pulses]
        >>> [record.outcome for record in tb.fly_many(jobs)]
        ['completed', 'completed']
    """
    out = []
    for record in fly_jobs(jobs, simulator):
        if isinstance(record, Refusal):
            raise record
        out.append(record)
    return out


def fly_jobs(
    jobs: Sequence[Job], simulator: Simulator = "auto", flown: Tally | None = None, fewest: int = FEWEST
) -> list[FlightRecord | Refusal]:
    """Fly every job; one that breaks a law is its error.

    What JSBSim must fly is dealt to the processes that may be used (:func:`testbench.core.processes.processes`).

    Args:
        jobs: flights, of any aircraft.
        simulator: see :func:`fly_many`.
        flown: is told how many were flown by what.
        fewest: flights from which "auto" takes a batch.
    """
    if simulator not in get_args(Simulator):
        raise LimitError(
            f"a simulator must be one of {', '.join(get_args(Simulator))}, got '{simulator}'"
            f"{nearest(simulator, get_args(Simulator))}"
        )
    flown = flown or Tally()
    out: list[FlightRecord | Refusal | None] = [None] * len(jobs)
    groups: dict[object, list[tuple[int, _Ready]]] = {}
    verdicts: dict[tuple[int, int], Judged] = {}  # one for all flights of an aircraft from a trim
    one_by_one: dict[int, tuple[Job, str]] = {}
    for i, job in enumerate(jobs):
        reason, model = "it is wanted", None
        if simulator == "auto" and len(jobs) < fewest:
            reason = f"fewer than {fewest} flights at once are not worth a batch"
        elif simulator != "jsbsim":
            key = id(job.aircraft), id(job.trimmed)
            if key not in verdicts:
                try:
                    verdicts[key] = judged(job.aircraft, job.trimmed)
                except Refusal as error:
                    out[i] = error
                    continue
            found = verdicts[key]
            reason, model = found.reason, found.model
            if model is None and simulator == "batch":
                raise LimitError(f"{job.aircraft.name} cannot be flown in a batch: {reason}; let JSBSim fly it")
        if model is None:
            one_by_one[i] = job, reason
            continue
        try:
            ready = _Ready.of(job, model)
        except Refusal as error:
            out[i] = error
            continue
        groups.setdefault(ready.group, []).append((i, ready))
    _fly_one_by_one(one_by_one, flown, out)
    for group in groups.values():
        group.sort(key=lambda item: item[1].u.shape[0])
        for k in range(0, len(group), LANES):
            block = group[k : k + LANES]
            try:
                records = _fly_block([x for _, x in block], flown)
            except Refusal as error:  # JSBSim, which knows how engines begin, refuses to begin one of them
                _fly_one_by_one({i: (x.job, f"a flight beside it cannot begin: {error}") for i, x in block}, flown, out)
                continue
            for (i, _), record in zip(block, records, strict=True):
                out[i] = record
    for group in groups.values():
        for i, ready in group:
            flew = out[i]
            if isinstance(flew, FlightRecord) and _is_looked_at(ready):
                reason = _look_at(flew, ready, flown)
                if reason:
                    distrust(ready.model, reason)
                    flown.batch -= sum(_by_batch(out[k]) for k, _ in group)
                    _fly_one_by_one({k: (each.job, reason) for k, each in group}, flown, out)
                    break
    return [x for x in out if x is not None]


def fly_stream(
    jobs: Iterable[Job], simulator: Simulator = "auto", flown: Tally | None = None, at_once: int = AT_ONCE
) -> Iterator[FlightRecord | Refusal]:
    """Fly jobs one block after the other and yield what came of each, in their order.

    Jobs are taken as they are flown and records given away as they are made: memory does not grow with the number of
    flights. Records are those of :func:`fly_many`, bit for bit; where a later block shows that a model departs from
    JSBSim, those given away before stay as they are, and ``flown`` tells.

    Args:
        jobs: flights, of any aircraft; a generator makes them as they are wanted.
        simulator: see :func:`fly_many`.
        flown: is told how many were flown by what.
        at_once: flights of a block.

    Yields:
        For each job its record, short and "aborted" if it left its limits, or the error of a law that it breaks.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trimmed = tb.trim(taurus, tb.FlightCondition(12.0, 100.0))
        >>> t = np.arange(round(2.0 * trimmed.rate_hz)) / trimmed.rate_hz
        >>> pulses = (tb.InputSignal(t, a * (t < 1.0)[:, None], ("de",)) for a in np.linspace(0.0, 0.02, 100))
        >>> jobs = (tb.Job(taurus, trimmed, tb.Manoeuvre("pulse", u), 60.0, ("q",)) for u in pulses)
        >>> round(max(float(np.ptp(record["q"])) for record in tb.fly_stream(jobs)), 3)
        0.129
    """
    if at_once < 1:
        raise LimitError(f"at_once >= 1 must hold, got {at_once}")
    fewest, some = min(FEWEST, at_once), iter(jobs)
    while block := list(islice(some, at_once)):
        yield from fly_jobs(block, simulator, flown, fewest)
        fewest = 1  # of the last block: how many flights there are decides once


def _by_batch(record: FlightRecord | Refusal | None) -> bool:
    return isinstance(record, FlightRecord) and record.provenance.get("simulator") == BATCH


def _fly_one_by_one(
    jobs: Mapping[int, tuple[Job, str]], flown: Tally, out: list[FlightRecord | Refusal | None]
) -> None:
    """Let JSBSim fly jobs, each beside why it must; adds what comes of each to ``out``, at its place."""
    for i, record in zip(jobs, spread([partial(_by_jsbsim, *job) for job in jobs.values()]), strict=True):
        out[i] = record
    for _, reason in jobs.values():
        flown.by_jsbsim(reason)


def _by_jsbsim(job: Job, reason: str) -> FlightRecord | Refusal:
    try:
        record = job.flown_by_jsbsim()
    except FlightAborted as error:
        if error.record is None:
            return error
        record = error.record
    except Refusal as error:
        return error
    return replace(record, provenance={**record.provenance, "simulator": f"{JSBSIM}{reason}"})


@dataclass(frozen=True, eq=False)
class _Ready:
    """A flight whose inputs have been found lawful."""

    job: Job  #: what is wanted
    model: BatchModel  #: of its aircraft
    u: FloatArray  #: (frames + 1, controls) absolute commands, SI
    wind: FloatArray | None  #: (frames + 1, 3) of the air, m/s, or None if it does not change
    logged: tuple[str, ...]  #: channels of the simulator that are logged
    wanted: tuple[str, ...] | None  #: channels that the record shall have; None for all
    step: int  #: frames per row

    @classmethod
    def of(cls, job: Job, model: BatchModel) -> _Ready:
        """Check a job as :func:`testbench.flight.fly` does.

        Raises:
            LimitError: a rate, a command or the air breaks its law.
            ChannelError: it has no such channel.
        """
        _ = job.beginning.placed
        step, u, wind = checked(job.aircraft, job.trimmed, job.manoeuvre, job.log_rate_hz, job.air)
        logged, wanted = logged_of(job.aircraft, model.channels, job.channels)
        return cls(job, model, u, wind, logged, wanted, step)

    @property
    def group(self) -> object:
        """What flights of one block must have in common."""
        return id(self.model.program), self.step, self.logged, self.job.log_rate_hz


def fly_block(jobs: Sequence[Job], models: Sequence[BatchModel], flown: Tally) -> list[FlightRecord | Refusal]:
    """Fly up to LANES flights of one program, each by the model given for it, whether judged or not."""
    return _fly_block([_Ready.of(job, model) for job, model in zip(jobs, models, strict=True)], flown)


def _fly_block(lanes: Sequence[_Ready], flown: Tally) -> list[FlightRecord | Refusal]:
    model, step, names = lanes[0].model, lanes[0].step, lanes[0].logged
    R = placed([x.model for x in lanes], [x.job.beginning for x in lanes])
    controls = tuple(dict.fromkeys(n for x in lanes for n in x.job.manoeuvre.signal.channels))
    blowing = any(x.wind is not None for x in lanes)
    rows = max((x.u.shape[0] - 1) // step for x in lanes)
    limits = limits_of([x.model for x in lanes])
    columns = [model.channels.index(n) for n in names]
    logged = np.array([model.program.logged[n] for n in names], np.int64)
    scale = filled(np.stack([x.model.factors[columns] for x in lanes], axis=1))
    data = _scratch("rows", (rows + 1, len(names), LANES))
    data[0] = read(model, R)[columns] * scale
    R[r.DT] = 1.0 / model.rate_hz
    model.program.machine.before(R)
    targets = np.array([model.commands[n] for n in controls] + _GUSTS[: 3 * blowing], np.int64)
    left, broken, value = model.program.machine.run(
        R,
        Driven(_inputs(lanes, controls, blowing, rows * step), targets),
        Logged(step, logged, scale, data[1:]),
        watched(limits),
        np.arange(LANES) >= len(lanes),
    )
    out: list[FlightRecord | Refusal | None] = [None] * len(lanes)
    beyond: dict[int, tuple[Job, str]] = {}
    for lane, ready in enumerate(lanes):
        count = (ready.u.shape[0] - 1) // step + 1
        ends, limit = left[lane] + 1, limits[broken[lane]]
        if not 0 < ends < count:
            out[lane] = _record(ready, data[:count, :, lane], "")
        elif limit.name:
            low, high = ready.job.aircraft.limits[limit.of]
            reason = limit_broken(limit.name, limit.factor, low, high, value[lane])
            out[lane] = _record(ready, data[:ends, :, lane], reason)
        else:
            beyond[lane] = ready.job, "it comes near the ground or leaves the atmosphere of the batch"
    flown.batch += len(lanes) - len(beyond)
    _fly_one_by_one(beyond, flown, out)
    return [x for x in out if x is not None]


def placed(models: Sequence[BatchModel], beginnings: Sequence[Beginning]) -> FloatArray:
    """Return the registers (registers, LANES) of flights of one program where they begin."""
    R = registers(models)
    columns = [column(x) for x in beginnings]
    places, wind = (np.stack([c[k] for c in columns], axis=1) for k in range(2))
    R[r.GUST : r.GUST + 3] = filled(wind) / FT_M
    controls = {n for x in beginnings for n in x.controls}
    commands = {n: np.array([x.controls[n] for x in beginnings]) for n in controls}
    put(models[0], R, places, commands, _engines(models, beginnings))
    return R


def _engines(models: Sequence[BatchModel], beginnings: Sequence[Beginning]) -> list[dict[str, float]]:
    """Return what the engines of flights hold where they begin; nothing if they have no states of their own."""
    if not models[0].settles:
        return []
    return [states_at(model, x) for model, x in zip(models, beginnings, strict=True)]


def column(beginning: Beginning) -> tuple[FloatArray, FloatArray]:
    """Return height, pitch, bank, velocity over the ground and rates in body axes (9,), and the wind (3,); SI."""
    at, wind = beginning.placed, np.array(steady_wind(beginning.trimmed))
    uvw = at.uvw_m_s + body_from_earth(at.theta, at.phi) @ wind if wind.any() else at.uvw_m_s
    return np.array([at.h_m, at.theta, at.phi, *uvw, *at.pqr]), wind


def _inputs(lanes: Sequence[_Ready], controls: Sequence[str], blowing: bool, frames: int) -> FloatArray:
    """Return what is written before each frame (frames, inputs, LANES), in JSBSim's units; the last is held."""
    out = _scratch("inputs", (frames, len(controls) + (3 if blowing else 0), LANES))
    for lane, x in enumerate(lanes):
        signal, n = x.job.manoeuvre.signal.channels, min(frames, x.u.shape[0] - 1)
        for k, name in enumerate(controls):
            absolute = x.u[1 : n + 1, signal.index(name)] if name in signal else x.job.trimmed.controls[name]
            out[:n, k, lane] = absolute / x.job.aircraft.controls[name].scale
        if blowing:
            wind = x.wind[1 : n + 1] if x.wind is not None else steady_wind(x.job.trimmed)
            out[:n, len(controls) :, lane] = np.asarray(wind) / FT_M
        out[n:, :, lane] = out[n - 1, :, lane]
    out[:, :, len(lanes) :] = out[:, :, len(lanes) - 1 :][:, :, :1]
    return out


@dataclass(frozen=True, eq=False)
class Limit:
    """A register that must stay between bounds (LANES,) in JSBSim's unit; no name if JSBSim flies on from there."""

    register: int
    low: FloatArray
    high: FloatArray
    name: str = ""
    of: str = ""
    factor: float = 1.0


def limits_of(models: Sequence[BatchModel]) -> list[Limit]:
    """Return what ends a flight, in the order in which JSBSim's flights are watched."""
    model, out = models[0], []
    for of in model.aircraft.limits:
        for name in [n for n in model.channels if n.startswith("eta_")] if of == "eta" else [of]:
            i = model.channels.index(name)
            factors = np.array([x.factors[i] for x in models])
            low, high = filled(np.array([x.aircraft.limits[of] for x in models]).T / factors)
            out.append(Limit(model.program.logged[name], low, high, name, of, float(factors[0])))
    one = np.ones(LANES)
    out.append(Limit(r.H_SL, -np.inf * one, TOP_FT * one))
    out.append(Limit(r.H_AGL, model.floor_ft * one, np.inf * one))
    return out


def watched(limits: Sequence[Limit]) -> Watched:
    """Return the registers of limits, and these, as a program watches them."""
    low, high = (np.stack([getattr(x, side) for x in limits]) for side in ("low", "high"))
    return Watched(np.array([x.register for x in limits], np.int64), low, high)


_ARRAYS: dict[tuple[str, int], FloatArray] = {}


def _scratch(use: str, shape: tuple[int, ...]) -> FloatArray:
    """Return an array whose memory this thread uses again for the next block: new pages cost more than flights do."""
    size, key = math.prod(shape), (use, threading.get_ident())
    if key not in _ARRAYS or _ARRAYS[key].size < size:
        _ARRAYS[key] = np.empty(size)
    return _ARRAYS[key][:size].reshape(shape)


def _record(ready: _Ready, data: FloatArray, reason: str) -> FlightRecord | Refusal:
    job = ready.job
    provenance = provenance_of(job.aircraft, job.trimmed, job.manoeuvre, job.air, job.start) | {"simulator": BATCH}
    try:
        return truth_of(job.aircraft, data, ready.logged, ready.wanted, job.log_rate_hz, provenance, reason)
    except FlightAborted as error:
        return error


def _is_looked_at(ready: _Ready) -> bool:
    """Return whether a flight is one of those flown by both; its own commands decide, whatever flies beside it."""
    return zlib.crc32(_told_apart(ready.job).encode(), zlib.crc32(np.ascontiguousarray(ready.u).data)) % BOTH == 0


def _told_apart(job: Job) -> str:
    return repr(job.trimmed.alpha) + ("" if job.start is None else repr(job.start))


def _look_at(record: FlightRecord, ready: _Ready, flown: Tally) -> str:
    """Fly a flight by JSBSim as well, and remember how far apart they are; return why it is not trusted, or ""."""
    other = _by_jsbsim(ready.job, "")
    flown.both += 1
    apart, name = math.inf, "length"
    if not isinstance(other, FlightRecord):
        name = str(other)
    elif abs(len(record) - len(other)) <= 1:
        apart, name = difference(record, other)
    flown.worst = max(flown.worst, float(apart))
    if apart <= _TRUSTED:
        return ""
    return f"a flight in a batch departed from JSBSim's by {apart:.1g} of the range of {name}"
