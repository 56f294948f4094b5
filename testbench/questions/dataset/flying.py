"""Fly draws: trimmed, linearised and flown together, each by itself measured. What cannot fly is drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import DatasetError, Refusal
from testbench.core.record import FlightRecord
from testbench.effects import catalogue
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, TrimmedFlight
from testbench.flight.air import Air
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.jobs import Job, Simulator
from testbench.flight.batch.linear import linearise_many
from testbench.flight.batch.trim import trim_many
from testbench.inputs import InputSignal, build
from testbench.questions.campaign.draws import change_aircraft, change_suites
from testbench.questions.dataset.draws import Draw, aircraft_of, draw, true_figures
from testbench.questions.dataset.layout import Layout, label
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario
from testbench.questions.gap.starts import Start
from testbench.questions.hidden import Acting, Real
from testbench.sensors import SensorSuite, load_suite

MOST_ATTEMPTS = 20
"""Draws of one number, after which it is given up."""


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive flights: arrays by variable, and the attempts that could not fly, each with its ``why``."""

    rows: dict[str, Any]
    draws: int
    failed: list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class _Ready:
    """A draw with what flies and what measures."""

    drawn: Draw
    real: Real
    aircraft: Aircraft
    suite: SensorSuite
    condition: FlightCondition


def fly_part(scenario: DatasetScenario, layout: Layout, first: int, last: int, simulator: Simulator = "auto") -> Part:
    """Fly the draws ``first`` to ``last``, the latter not included; no bit depends on which fly together.

    Raises:
        DatasetError: a draw could not fly in MOST_ATTEMPTS attempts.
    """
    done: dict[int, dict[str, Any]] = {}
    failed: list[dict[str, Any]] = []
    pending, why = dict.fromkeys(range(first, last), 0), dict.fromkeys(range(first, last), "")
    while pending:
        attempted = [draw(scenario, number, attempt) for number, attempt in pending.items()]
        for drawn, found in zip(attempted, _fly(scenario, layout, attempted, simulator), strict=True):
            if isinstance(found, dict):
                done[drawn.number] = found
                del pending[drawn.number]
                continue
            why[drawn.number] = found
            failed.append(drawn.told() | {"why": found})
            pending[drawn.number] += 1
            if pending[drawn.number] >= MOST_ATTEMPTS:
                raise DatasetError(
                    f"a draw must fly within {MOST_ATTEMPTS} attempts, but number {drawn.number} of level "
                    f"'{drawn.level.name}' did not; the last time {found}. Narrow its speed_ratio, scale or vary"
                )
    count = min(last * layout.per_draw, layout.flights) - first * layout.per_draw
    rows = {name: np.concatenate([done[n][name] for n in range(first, last)])[:count] for name in done[first]}
    return Part(rows, last - first, failed)


def _fly(
    scenario: DatasetScenario, layout: Layout, draws: Sequence[Draw], simulator: Simulator
) -> list[dict[str, Any] | str]:
    """Return the rows of each draw, or why it cannot fly."""
    out: list[dict[str, Any] | str] = [""] * len(draws)
    ready: list[tuple[int, _Ready]] = []
    for i, drawn in enumerate(draws):
        try:
            ready.append((i, _prepared(scenario, drawn)))
        except Refusal as error:
            out[i] = _reason(error)
    rate = scenario.simulation.rate_hz
    trims = trim_many([x.aircraft for _, x in ready], [x.condition for _, x in ready], rate, None, simulator)
    able: list[tuple[int, _Ready, TrimmedFlight]] = []
    for (i, x), at in zip(ready, trims, strict=True):
        if isinstance(at, Refusal):
            out[i] = _reason(at)
        else:
            able.append((i, x, at))
    models = linearise_many([x.aircraft for _, x, _ in able], [at for _, _, at in able], simulator)
    jobs = [job for _, x, at in able for job in _jobs(scenario, layout, x, at)]
    flown = iter(fly_jobs(jobs, simulator, fewest=1))
    for (i, x, at), model in zip(able, models, strict=True):
        out[i] = _rows(scenario, layout, x, at, model, [next(flown) for _ in scenario.manoeuvre])
    return out


def _prepared(scenario: DatasetScenario, drawn: Draw) -> _Ready:
    believed = change_aircraft(aircraft_of(drawn.aircraft, drawn.level.wings), drawn.values)
    believed = replace(believed, rate_hz=scenario.simulation.rate_hz or believed.rate_hz)
    sensed = load_suite(scenario.suite)
    known = catalogue(sensed) if drawn.kinds else {}
    acting = (Acting(known[kind], sizes) for kind, sizes in zip(drawn.kinds, drawn.sizes, strict=True))
    real = Real(believed, tuple(acting))
    f = drawn.level.noise
    sensors = tuple(
        replace(
            s,
            noise_std=f * s.noise_std,
            bias=f * s.bias,
            bias_walk=f * s.bias_walk,
            bias_rate=f * s.bias_rate,
            drift_std=f * s.drift_std,
            drift_time_s=s.drift_time_s if f * s.drift_std else None,
            quantum=f * s.quantum,
        )
        for s in sensed.sensors
    )
    sensed = replace(sensed, sensors=sensors, rate_hz=scenario.samples_hz or sensed.rate_hz)
    (changed,) = change_suites((sensed,), drawn.values)
    return _Ready(drawn, real, *real.from_(Start(FlightCondition(drawn.V_m_s, drawn.h_m)), changed))


def _jobs(scenario: DatasetScenario, layout: Layout, x: _Ready, at: TrimmedFlight) -> list[Job]:
    """Return the flights of a draw; each command is held to the next sample."""
    needed = tuple(dict.fromkeys(n for s in x.suite.sensors for n in s.needs))
    out = []
    for k, manoeuvre in enumerate(scenario.manoeuvre):
        issued = build(manoeuvre.input, manoeuvre.duration_s, layout.rate_hz)
        u = x.drawn.scale * np.repeat(issued.u, round(at.rate_hz / layout.rate_hz), axis=0)
        signal = InputSignal(np.arange(len(u)) / at.rate_hz, u, issued.channels)
        air = _air(x, k)
        flight = Manoeuvre(manoeuvre.name, signal, manoeuvre.settle_s)
        out.append(Job(x.aircraft, at, flight, layout.rate_hz, needed, air))
    return out


def _air(x: _Ready, k: int) -> Air | None:
    """Return the air of flight ``k`` of a draw; a hidden gust belongs to its first flight."""
    rms, gust = x.drawn.turbulence_rms_m_s, x.real.gust_in("", k == 0)
    return Air(turbulence_rms_m_s=(rms,) * 3, gust=gust, seed=x.drawn.seed + k) if rms or gust else None


def _rows(
    scenario: DatasetScenario,
    layout: Layout,
    x: _Ready,
    at: TrimmedFlight,
    model: LinearModel | Refusal,
    records: Sequence[FlightRecord | Refusal],
) -> dict[str, Any] | str:
    """Return the rows of a draw, or why it does not count."""
    if isinstance(model, Refusal):
        return _reason(model)
    out, d = layout.empty(len(records)), x.drawn
    for k, record in enumerate(records):
        if isinstance(record, Refusal):
            return _reason(record)
        if record.outcome == "aborted":
            return "the flight left the limits of the aircraft"
        measured = x.suite.measure(record, d.seed + k)
        n = len(measured)
        out["readings"][k, :n] = measured.data
        if layout.validity:
            out["valid"][k] = 0
            out["valid"][k, :n] = 1 if measured.valid is None else measured.valid
        out["samples"][k] = n
    try:
        figures = true_figures(x.aircraft, model, at)
    except Refusal as error:
        return _reason(error)
    # Nine figures: the last bits hang on how memory happens to lie, and the same set must have the same bytes.
    out["truth"][:] = [float(f"{figures.get(name, (np.nan, ''))[0]:.9g}") for name in layout.figures]
    out["draw"][:], out["split"][:] = d.number, SPLITS.index(scenario.split.of(d.share))
    out["level"][:], out["aircraft"][:] = layout.levels.index(d.level.name), layout.aircraft.index(label(d.aircraft))
    out["manoeuvre"][:] = np.arange(len(records))
    out["V_m_s"][:], out["h_m"][:], out["turbulence_rms_m_s"][:] = d.V_m_s, d.h_m, d.turbulence_rms_m_s
    out["scale"][:] = d.scale
    for key, value in d.values.items():
        out["drawn"][:, layout.keys.index(key)] = value
    for j, (kind, sizes) in enumerate(zip(d.kinds, d.sizes, strict=True)):
        out["effect"][:, j] = layout.effects.index(kind)
        for name, value in sizes.items():
            out["effect_size"][:, layout.sizes.index(f"{kind}: {name}")] = value
    return out


def _reason(error: Refusal) -> str:
    return f"{type(error).__name__}: {error.message}"
