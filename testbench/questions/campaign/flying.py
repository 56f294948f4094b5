"""One run of a campaign, and batches of them as workers fly them. What runs share is made once per process."""

from __future__ import annotations

import json
import math
import threading
import time
import traceback
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import CampaignError, ScenarioError, TestbenchError
from testbench.core.record import FlightRecord
from testbench.core.schema import parse
from testbench.core.scratch import Scratch
from testbench.evaluation.truth import Truth, true_model
from testbench.flight import TrimmedFlight, load_aircraft
from testbench.line import Case, trim_for
from testbench.questions.campaign.draws import run_inputs, run_seed
from testbench.questions.campaign.load import versions
from testbench.questions.campaign.scenario import CampaignSpec
from testbench.questions.campaign.targets import change_aircraft, change_suites, set_keys
from testbench.questions.run.ask import Prepared, run
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario
from testbench.sensors import SensorSuite, load_suite

_REMEMBERED = 64
Made = TypeVar("Made")


@dataclass(frozen=True)
class Job:
    """What a worker must know of a campaign; small, and sent with every batch.

    Attributes:
        spec: the campaign as JSON.
        content: the base scenario as JSON.
        versions: of the packages that the figures depend on.
        records: whether time histories come back.
    """

    spec: str
    content: str
    versions: tuple[tuple[str, str], ...]
    records: bool = False


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

    def __init__(self, most: int = _REMEMBERED) -> None:
        self._most = most
        self._made: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what ``make`` returned for ``key``, calling it if it is not remembered."""
        if key not in self._made:
            self._made[key] = make()
            if len(self._made) > self._most:
                self._made.popitem(last=False)
        self._made.move_to_end(key)
        return self._made[key]


_TRIMS, _TRUTHS = Remembered(), Remembered()
_ONE_AT_A_TIME = threading.Lock()  # JSBSim's logger belongs to a thread, and threads of one process gain nothing here


def _damping(pole: complex) -> float:
    return -pole.real / abs(pole) if pole != 0.0 else math.nan


OF_MODES: tuple[tuple[str, Callable[[complex], float]], ...] = (("wn, rad/s", abs), ("zeta", _damping))


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
        CampaignError: this process has other versions of the packages that the figures depend on.
    """
    here = versions()
    other = [f"{name} {here[name]} (campaign: {wanted})" for name, wanted in job.versions if here[name] != wanted]
    if other:
        raise CampaignError(f"workers must have the versions of the campaign, got {', '.join(other)}")
    with _ONE_AT_A_TIME:
        return [fly_one(job, index) for index in indices]


def fly_one(job: Job, index: int) -> Outcome:
    """Fly run ``index``; a failure is an outcome with its reason."""
    spec, content = _parsed(job)
    started = time.thread_time()
    seed, inputs = run_seed(spec, index), run_inputs(spec, index)
    kept: list[tuple[str, FlightRecord]] = []
    results, reason = None, ""
    try:
        # numpy's complaints about overflowing predictions of unstable models are figures here, not news
        with np.errstate(all="ignore"):
            results = _found(_run(spec, content, inputs, seed, kept if job.records else None))
    except TestbenchError as error:
        reason = f"{type(error).__name__}: {error.message}"
    except Exception as error:  # a fault of the program in one run of a million is a row of the table, with its place
        place = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"unexpected {type(error).__name__}: {error} ({Path(place.filename).name}, line {place.lineno})"
    return Outcome(
        index,
        seed,
        json.dumps(inputs, separators=(",", ":")),
        None if results is None else json.dumps(results, separators=(",", ":")),
        reason,
        time.thread_time() - started,
        tuple((name, _netcdf(record)) for name, record in kept),
    )


def _run(
    spec: CampaignSpec,
    content: Mapping[str, Any],
    inputs: Mapping[str, Any],
    seed: int,
    kept: list[tuple[str, FlightRecord]] | None,
) -> RunResult:
    changed = _with_pilots(set_keys(content, inputs), inputs, seed)
    scenario, faults = parse(Scenario, changed, None)
    if scenario is None or faults:
        raise ScenarioError(faults)
    seed = scenario.seed if "seed" in inputs else seed
    aircraft = change_aircraft(_aircraft(scenario.aircraft, scenario.wings), inputs)
    suites = change_suites(tuple(_suite(name) for name in scenario.suites), inputs)
    c, air = scenario.condition, scenario.air
    key = (
        (scenario.aircraft, scenario.wings, repr((aircraft.adapter, aircraft.amendments)), c.V_m_s, c.h_m, c.gamma_deg),
        (scenario.simulation.rate_hz, air.wind_north_m_s, air.wind_east_m_s, air.wind_down_m_s),
    )
    trimmed: TrimmedFlight = _TRIMS.get(key, lambda: trim_for(scenario, aircraft))
    truth: Truth | None = _TRUTHS.get(key, lambda: true_model(aircraft, trimmed)) if spec.truth else None
    needed = dict.fromkeys(name for suite in suites for sensor in suite.sensors for name in sensor.needs)
    channels = None if kept is not None else tuple(needed)
    keep = None if kept is None else lambda name, record: kept.append((name, record))
    return run(scenario, seed, keep, prepared=Prepared(aircraft, suites, trimmed, truth, channels))


def _with_pilots(content: dict[str, Any], inputs: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return the scenario with a seed of its own for every pilot that is not given one by the campaign."""
    for i, manoeuvre in enumerate(content["manoeuvre"]):
        for k, signal in enumerate(manoeuvre["input"]):
            place = f"manoeuvre.{i}.input.{k}.pilot"
            if isinstance(signal.get("pilot"), dict) and f"{place}.seed" not in inputs:
                sequence = np.random.SeedSequence([seed, zlib.crc32(place.encode())])
                signal["pilot"]["seed"] = int(sequence.generate_state(1)[0])
    return content


def _found(result: RunResult) -> dict[str, Any]:
    """Return what a run found, a number that is not finite as None.

    ``figures``: case -> name -> number; ``poles``: case -> outputs -> [real, imaginary], rad/s, upper half plane;
    ``true``: name -> number, of the modes of the aircraft, if the truth is asked for.
    """
    out: dict[str, Any] = {"figures": {}, "poles": {}}
    for case in result.cases:
        out["figures"][case.label] = {name: _finite(value) for name, value in _figures(case).items()}
        out["poles"][case.label] = {
            outputs: [
                [p.real, p.imag] for p in sorted(poles[poles.imag >= 0.0].tolist(), key=lambda p: (abs(p), p.real))
            ]
            for outputs, poles in case.model.poles().items()
        }
    if result.truth is not None:
        modes = result.truth.modes.items()
        out["true"] = {f"{mode} {name}": _finite(value(s)) for mode, s in modes for name, value in OF_MODES}
    return out


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _figures(case: Case) -> dict[str, float | None]:
    """Return the scalars of one case: prediction, modes and parameters, these with standard error and truth beside."""
    e = case.evaluation
    out: dict[str, float | None] = {"warning": float(case.model.status == "warning")}
    for k, output in enumerate(case.model.outputs):
        out[f"validation MRSE of {output}, %"] = float(e.validation.mrse_percent[k])
        out[f"validation fit of {output}, %"] = float(e.validation.fit_percent[k])
    out["validation MRSE, %"] = e.validation.mrse_mean
    out["identification MRSE, %"] = e.identification.mrse_mean
    sets = len({match.outputs for match in e.poles})
    for match in e.poles:
        of = f" ({match.outputs})" if sets > 1 else ""
        for name, value in OF_MODES:
            out[f"{match.name}{of} {name}"] = None if match.found is None else value(match.found)
    for p in e.parameters:
        if p.free:
            out[p.name], out[f"{p.name}, std"] = p.value, p.std
            if p.true is not None:
                out[f"{p.name}, true"] = p.true
    return out


def _netcdf(record: FlightRecord) -> bytes:
    folder = Scratch()
    path = Path(folder.name) / "record.nc"
    record.save(path)
    return path.read_bytes()
