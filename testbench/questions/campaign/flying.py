"""One run of a campaign, and batches of them as workers fly them. What runs share is made once per process."""

from __future__ import annotations

import json
import socket
import threading
import traceback
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.door import sha256
from testbench.core.errors import CampaignError, Refusal, ScenarioError, WriteError
from testbench.core.files import Scratch
from testbench.core.record import FlightRecord
from testbench.core.schema import parse
from testbench.estimators.cells import processor_s
from testbench.evaluation.truth import Truth, true_model
from testbench.flight import load_aircraft
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import BATCH, Simulator, Tally
from testbench.flight.batch.jobs import Job as FlightJob
from testbench.line import condition_of
from testbench.questions.campaign.draws import change_aircraft, change_suites, run_inputs, run_seed, set_keys
from testbench.questions.campaign.load import versions
from testbench.questions.campaign.scenario import CampaignSpec
from testbench.questions.campaign.summary import ALONE, TOGETHER
from testbench.questions.run.ask import Prepared, run, wanted_flights
from testbench.questions.run.result import found_of
from testbench.questions.run.scenario import Scenario
from testbench.sensors import SensorSuite, load_suite

_REMEMBERED = 256
Made = TypeVar("Made")


@dataclass(frozen=True)
class Job:
    """What a worker must know of a campaign; small, and sent with every batch.

    Attributes:
        spec: the campaign as JSON.
        content: the base scenario as JSON.
        versions: of the packages that the figures depend on.
        records: whether time histories come back.
        simulator: what flies; see :mod:`testbench.flight.batch.jobs`.
        files: (absolute path, SHA-256) of estimators and structures of the user's own.
    """

    spec: str
    content: str
    versions: tuple[tuple[str, str], ...]
    records: bool = False
    simulator: Simulator = "auto"
    files: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Outcome:
    """One finished run; ``reason`` empty unless it failed, ``seconds`` of processor, ``records`` as (name, NetCDF)."""

    index: int
    seed: int
    inputs: str
    results: str | None
    reason: str
    seconds: float
    records: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)


class Remembered:
    """The last few results of slow functions of hashable keys, the same for every run of a process."""

    def __init__(self) -> None:
        self._made: OrderedDict[Hashable, Any] = OrderedDict()

    def has(self, key: Hashable) -> bool:
        """Return whether something is remembered for ``key``, which counts as use of it."""
        if key in self._made:
            self._made.move_to_end(key)
        return key in self._made

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what ``make`` returned for ``key``, calling it if it is not remembered."""
        if key not in self._made:
            self.put(key, make())
        return self.known(key)

    def put(self, key: Hashable, made: Any) -> None:
        """Remember something for ``key``."""
        self._made[key] = made
        if len(self._made) > _REMEMBERED:
            self._made.popitem(last=False)

    def known(self, key: Hashable) -> Any:
        """Return what is remembered for ``key``."""
        self._made.move_to_end(key)
        return self._made[key]


_TRIMS, _TRUTHS = Remembered(), Remembered()
_ONE_AT_A_TIME = threading.Lock()  # JSBSim's logger belongs to a thread, and threads of one process gain nothing here


@lru_cache(maxsize=16)
def _aircraft(name: str, wings: str) -> Aircraft:
    return load_aircraft(name, wings)


@lru_cache(maxsize=64)
def _suite(name: str) -> SensorSuite:
    return load_suite(name)


@lru_cache(maxsize=4)
def _parsed(job: Job) -> tuple[CampaignSpec, dict[str, Any]]:
    return CampaignSpec.model_validate_json(job.spec), json.loads(job.content)


def fly_batch(job: Job, indices: Sequence[int]) -> list[Outcome]:
    """Fly the runs ``indices`` one after the other and return what each found.

    Raises:
        CampaignError: this process has other versions of the packages that the figures depend on, or other files of
            the user's own.
    """
    here = versions()
    other = [f"{name} {here[name]} (campaign: {wanted})" for name, wanted in job.versions if here[name] != wanted]
    if other:
        raise CampaignError(f"workers must have the versions of the campaign, got {', '.join(other)}")
    for file, wanted in job.files:
        _need_same(file, wanted)
    with _ONE_AT_A_TIME, np.errstate(all="ignore"):
        # numpy's complaints about overflowing predictions of unstable models are figures here, not news
        return _fly(job, [_Run.of(job, index) for index in indices])


def _need_same(file: str, wanted: str) -> None:
    """Check that this process reads the same file of the user's as the one that handed out the batch.

    Raises:
        CampaignError: it has none, or another one; with both hashes.
    """
    place = f"worker at {socket.gethostname()}"
    if not Path(file).is_file():
        raise CampaignError(
            f"workers must have the estimator or structure '{file}' of the campaign (SHA-256 {wanted}), but the "
            f"{place} has no such file; put it there, or start workers where it is"
        )
    have = sha256(Path(file), "python")
    if have != wanted:
        raise CampaignError(
            f"workers must have the same '{file}' as the campaign, SHA-256 {wanted}, but that of the {place} has "
            f"{have}; copy it there, and go on with `testbench campaign resume`"
        )


@dataclass
class _Run:
    """One run on its way: what it flies, then what it found or why it failed."""

    index: int
    seed: int
    inputs: dict[str, Any]
    scenario: Scenario | None = None
    ready: Prepared | None = None
    flights: list[FlightJob] = field(default_factory=list)
    kept: list[tuple[str, FlightRecord]] = field(default_factory=list)
    results: str | None = None
    reason: str = ""
    seconds: float = 0.0

    @classmethod
    def of(cls, job: Job, index: int) -> _Run:
        """Draw the values of a run."""
        spec, _ = _parsed(job)
        return cls(index, run_seed(spec, index), run_inputs(spec, index))

    @contextmanager
    def attempt(self) -> Iterator[None]:
        """Take a failure inside as the outcome of this run, and the time as its own."""
        started = processor_s()
        try:
            yield
        except Refusal as error:
            self.reason = f"{type(error).__name__}: {error.message}"
        except WriteError:  # no run is at fault
            raise
        except (
            Exception
        ) as error:  # a fault of the program in one run of a million is a row of the table, with its place
            place = traceback.extract_tb(error.__traceback__)[-1]
            self.reason = (
                f"unexpected {type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
            )
        self.seconds += processor_s() - started

    def outcome(self) -> Outcome:
        """Return what is kept of the run."""
        return Outcome(
            self.index,
            self.seed,
            json.dumps(self.inputs, separators=(",", ":")),
            self.results,
            self.reason,
            self.seconds,
            tuple((name, _netcdf(record)) for name, record in self.kept),
        )


def _fly(job: Job, runs: Sequence[_Run]) -> list[Outcome]:
    """Fly runs together: all trims, then all flights, then each run by itself."""
    spec, content = _parsed(job)
    wanted: dict[Hashable, tuple[_Run, Aircraft]] = {}
    made: list[tuple[_Run, Hashable, Aircraft, tuple[SensorSuite, ...]]] = []
    for run_ in runs:
        with run_.attempt():
            key, aircraft, suites = _drawn(run_, content)
            made.append((run_, key, aircraft, suites))
            if not _TRIMS.has(key):
                wanted.setdefault(key, (run_, aircraft))
    with _shared([r for r, _ in wanted.values()]):
        _trim(job, wanted)
    for run_, key, aircraft, suites in made:
        with run_.attempt():
            _prepare(run_, spec, key, aircraft, suites)
    flying = [r for r in runs if not r.reason]
    with _shared(flying):
        why = _fly_together(job, flying)
    for run_ in flying:
        assert run_.scenario is not None
        with run_.attempt():
            keep = (lambda name, record, to=run_.kept: to.append((name, record))) if spec.records else None
            found = found_of(run(run_.scenario, run_.seed, keep, prepared=run_.ready, causes=False))
            flown = run_.ready.flown if run_.ready is not None else ()
            together = any(record.provenance.get("simulator") == BATCH for record in flown)
            found["flown"] = TOGETHER if together else f"{ALONE}{why}"
            run_.results = json.dumps(found, separators=(",", ":"))
    return [r.outcome() for r in runs]


@contextmanager
def _shared(runs: Sequence[_Run]) -> Iterator[None]:
    """Take the time inside as that of all runs, each its part."""
    started = processor_s()
    yield
    for run_ in runs:
        run_.seconds += (processor_s() - started) / len(runs)


def _drawn(run_: _Run, content: Mapping[str, Any]) -> tuple[Hashable, Aircraft, tuple[SensorSuite, ...]]:
    """Return what a run flies and measures with, and the key of its trim; its scenario is set."""
    inputs = run_.inputs
    changed = _with_pilots(set_keys(content, inputs), inputs, run_.seed)
    scenario, faults = parse(Scenario, changed, None)
    if scenario is None or faults:
        raise ScenarioError(faults)
    run_.scenario = scenario
    run_.seed = scenario.seed if "seed" in inputs else run_.seed
    aircraft = change_aircraft(_aircraft(scenario.aircraft, scenario.wings), inputs)
    suites = change_suites(tuple(_suite(name) for name in scenario.suites), inputs)
    c, air = scenario.condition, scenario.air
    key = (
        (scenario.aircraft, scenario.wings, repr((aircraft.adapter, aircraft.amendments)), c.V_m_s, c.h_m, c.gamma_deg),
        (scenario.simulation.rate_hz, air.wind_north_m_s, air.wind_east_m_s, air.wind_down_m_s),
    )
    return key, aircraft, suites


def _trim(job: Job, wanted: Mapping[Hashable, tuple[_Run, Aircraft]]) -> None:
    """Trim what has not been trimmed, and remember it: the trim, or why there is none."""
    from testbench.flight.batch.trim import trim_many

    rates: dict[float | None, list[Hashable]] = {}
    for key, (run_, _) in wanted.items():
        assert run_.scenario is not None
        rates.setdefault(run_.scenario.simulation.rate_hz, []).append(key)
    for rate, keys in rates.items():
        scenarios = [wanted[key][0].scenario for key in keys]
        airs = [air_of(s.air, s.condition.h_m, 0) for s in scenarios if s is not None]
        conditions = [condition_of(s.condition) for s in scenarios if s is not None]
        found = trim_many([wanted[key][1] for key in keys], conditions, rate, airs, job.simulator)
        for key, result in zip(keys, found, strict=True):
            _TRIMS.put(key, result)


def _prepare(
    run_: _Run, spec: CampaignSpec, key: Hashable, aircraft: Aircraft, suites: tuple[SensorSuite, ...]
) -> None:
    """Make what a run needs before it flies, and the flights that it wants."""
    assert run_.scenario is not None
    trimmed = _TRIMS.known(key)  # of this batch at the latest, which is smaller than what is remembered
    if isinstance(trimmed, Refusal):
        raise trimmed
    truth: Truth | None = None
    if spec.truth:
        driven = tuple(run_.scenario.identification.inputs)
        truth = _TRUTHS.get((key, driven), lambda: true_model(aircraft, trimmed, driven))
    needed = dict.fromkeys(name for suite in suites for sensor in suite.sensors for name in sensor.needs)
    channels = None if spec.records else tuple(needed)
    run_.ready = Prepared(aircraft, suites, trimmed, truth, channels)
    run_.flights = wanted_flights(run_.scenario, run_.ready, run_.seed)


def _fly_together(job: Job, runs: Sequence[_Run]) -> str:
    """Fly what all runs want, and give each its own; return why JSBSim flew some, as the end of a sentence."""
    if job.simulator == "jsbsim":
        return ", as it is wanted"
    from testbench.flight.batch.fly import fly_jobs

    told = Tally()
    flown = fly_jobs([f for r in runs for f in r.flights], job.simulator, told, fewest=1)
    at = 0
    for run_ in runs:
        mine, at = flown[at : at + len(run_.flights)], at + len(run_.flights)
        assert run_.ready is not None
        if all(isinstance(record, FlightRecord) for record in mine):
            run_.ready = replace(run_.ready, flown=tuple(record for record in mine if isinstance(record, FlightRecord)))
    return f", as {max(told.reasons, key=lambda r: told.reasons[r])}" if told.reasons else ""


def _with_pilots(content: dict[str, Any], inputs: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return the scenario with a seed of its own for every pilot that is not given one by the campaign."""
    for i, manoeuvre in enumerate(content["manoeuvre"]):
        for k, signal in enumerate(manoeuvre["input"]):
            place = f"manoeuvre.{i}.input.{k}.pilot"
            if isinstance(signal.get("pilot"), dict) and f"{place}.seed" not in inputs:
                sequence = np.random.SeedSequence([seed, zlib.crc32(place.encode())])
                signal["pilot"]["seed"] = int(sequence.generate_state(1)[0])
    return content


def _netcdf(record: FlightRecord) -> bytes:
    folder = Scratch()
    path = Path(folder.name) / "record.nc"
    record.save(path)
    return path.read_bytes()
