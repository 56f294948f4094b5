"""Fly draws: trimmed, linearised and flown together, each by itself measured. What cannot fly is drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import DatasetError, Refusal
from testbench.core.record import FlightRecord
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, TrimmedFlight
from testbench.flight.air import Air
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.jobs import Job, Simulator
from testbench.flight.batch.linear import linearise_many
from testbench.flight.batch.trim import trim_many
from testbench.inputs import InputSignal, build
from testbench.questions.campaign.targets import change_aircraft, change_suites
from testbench.questions.dataset.draws import Draw, aircraft_of, draw
from testbench.questions.dataset.layout import Layout, label
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario
from testbench.questions.dataset.truths import true_figures
from testbench.questions.gap.hidden.entries import TRUTHS
from testbench.questions.gap.hidden.flights import as_issued_in, read_through, real_aircraft, sent, spoiled
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import SensorSuite, load_suite

MOST_ATTEMPTS = 20
"""Draws of one number, after which it is given up."""


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive flights: arrays by variable, and why draws were drawn again."""

    rows: dict[str, Any]
    draws: int
    again: dict[str, int]


@dataclass(frozen=True, eq=False)
class _Ready:
    """A draw with what flies and what measures."""

    drawn: Draw
    truth: Truth
    aircraft: Aircraft
    suite: SensorSuite


def fly_part(scenario: DatasetScenario, layout: Layout, first: int, last: int, simulator: Simulator = "auto") -> Part:
    """Fly the draws ``first`` to ``last``, the latter not included; no bit depends on which fly together.

    Raises:
        DatasetError: a draw could not fly in MOST_ATTEMPTS attempts.
    """
    done: dict[int, dict[str, Any]] = {}
    again: dict[str, int] = {}
    pending, why = dict.fromkeys(range(first, last), 0), dict.fromkeys(range(first, last), "")
    while pending:
        attempted = [draw(scenario, number, attempt) for number, attempt in pending.items()]
        for drawn, found in zip(attempted, _fly(scenario, layout, attempted, simulator), strict=True):
            if isinstance(found, dict):
                done[drawn.number] = found
                del pending[drawn.number]
                continue
            why[drawn.number] = found
            again[found] = again.get(found, 0) + 1
            pending[drawn.number] += 1
            if pending[drawn.number] >= MOST_ATTEMPTS:
                raise DatasetError(
                    f"a draw must fly within {MOST_ATTEMPTS} attempts, but number {drawn.number} of level "
                    f"'{drawn.level.name}' did not; the last time {found}. Narrow its speed_ratio, scale or vary"
                )
    count = min(last * layout.per_draw, layout.flights) - first * layout.per_draw
    rows = {name: np.concatenate([done[n][name] for n in range(first, last)])[:count] for name in done[first]}
    return Part(rows, last - first, again)


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
    trims = trim_many(
        [x.aircraft for _, x in ready],
        [FlightCondition(x.drawn.V_m_s, x.drawn.h_m) for _, x in ready],
        rate,
        None,
        simulator,
    )
    able: list[tuple[int, _Ready, TrimmedFlight]] = []
    for (i, x), at in zip(ready, trims, strict=True):
        if isinstance(at, Refusal):
            out[i] = _reason(at)
        else:
            able.append((i, x, at))
    models = linearise_many([x.aircraft for _, x, _ in able], [at for _, _, at in able], simulator)
    commands = [_commands(scenario, layout, x, at) for _, x, at in able]
    jobs = [job for of in commands for job, _ in of]
    flown = iter(fly_jobs(jobs, simulator, fewest=1))
    for (i, x, at), model, of in zip(able, models, commands, strict=True):
        records = [next(flown) for _ in of]
        out[i] = _rows(scenario, layout, x, at, model, records, [u for _, u in of])
    return out


def _prepared(scenario: DatasetScenario, drawn: Draw) -> _Ready:
    believed = change_aircraft(aircraft_of(drawn.aircraft, drawn.level.wings), drawn.values)
    truth = Truth()
    for kind, sizes in zip(drawn.kinds, drawn.sizes, strict=True):
        truth = truth.with_(TRUTHS[kind](sizes, drawn.aircraft))
    sensed = load_suite(str(scenario.suite))
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
    return _Ready(drawn, truth, real_aircraft(believed, truth), read_through(changed, truth))


def _commands(scenario: DatasetScenario, layout: Layout, x: _Ready, at: TrimmedFlight) -> list[tuple[Job, Any]]:
    """Return the flights of a draw, each with its commands per frame as they are issued, deviations from trim."""
    needed = tuple(dict.fromkeys(n for s in x.suite.sensors for n in s.needs))
    out = []
    for k, manoeuvre in enumerate(scenario.manoeuvre):
        issued = build(manoeuvre.input, manoeuvre.duration_s, layout.rate_hz)
        u = x.drawn.scale * np.repeat(issued.u, round(at.rate_hz / layout.rate_hz), axis=0)
        real = sent(x.truth, u, issued.channels, 1.0 / at.rate_hz)
        signal = InputSignal(np.arange(len(u)) / at.rate_hz, real, issued.channels)
        air = _air(x, k)
        flight = Manoeuvre(manoeuvre.name, signal, manoeuvre.settle_s)
        out.append((Job(x.aircraft, at, flight, layout.rate_hz, needed, air), u))
    return out


def _air(x: _Ready, k: int) -> Air | None:
    """Return the air of flight ``k`` of a draw; a hidden gust belongs to its first flight."""
    rms, gust = x.drawn.turbulence_rms_m_s, x.truth.gust if k == 0 else None
    return Air(turbulence_rms_m_s=(rms,) * 3, gust=gust, seed=x.drawn.seed + k) if rms or gust else None


def _rows(
    scenario: DatasetScenario,
    layout: Layout,
    x: _Ready,
    at: TrimmedFlight,
    model: LinearModel | Refusal,
    records: Sequence[FlightRecord | Refusal],
    commands: Sequence[Any],
) -> dict[str, Any] | str:
    """Return the rows of a draw, or why it does not count."""
    if isinstance(model, Refusal):
        return _reason(model)
    out, d = layout.empty(len(records)), x.drawn
    for k, (record, u) in enumerate(zip(records, commands, strict=True)):
        if isinstance(record, Refusal):
            return _reason(record)
        if record.outcome == "aborted":
            return "the flight left the limits of the aircraft"
        measured = _measured(scenario, x, at, record, u, k)
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
    fill(out, layout, d.number, d.level.name, label(d.aircraft), scenario.split.of(d.share))
    out["manoeuvre"][:] = np.arange(len(records))
    out["V_m_s"][:], out["h_m"][:], out["turbulence_rms_m_s"][:] = d.V_m_s, d.h_m, d.turbulence_rms_m_s
    hide(out, layout, d.kinds, d.sizes)
    return out


def fill(out: dict[str, Any], layout: Layout, number: int, level: str, aircraft: str, split: str) -> None:
    """Write into rows what all flights of a draw share."""
    out["draw"][:], out["split"][:] = number, SPLITS.index(split)
    out["level"][:], out["aircraft"][:] = layout.levels.index(level), layout.aircraft.index(aircraft)


def hide(out: dict[str, Any], layout: Layout, kinds: Sequence[str], sizes: Sequence[Any]) -> None:
    """Write into rows the hidden effects and their sizes."""
    for j, (kind, of) in enumerate(zip(kinds, sizes, strict=True)):
        out["effect"][:, j] = layout.effects.index(kind)
        for name, value in of.items():
            out["effect_size"][:, layout.sizes.index(f"{kind}: {name}")] = value


def _measured(
    scenario: DatasetScenario, x: _Ready, at: TrimmedFlight, record: FlightRecord, u: Any, k: int
) -> FlightRecord:
    measured = x.suite.measure(record, x.drawn.seed + k)
    manoeuvre = scenario.manoeuvre[k]
    controls = tuple(
        dict.fromkeys(n for n in ("de", "da", "dr", "thr") if any(s.control == n for s in manoeuvre.input))
    )
    controls_logged = [n for n in controls if f"{n}_cmd" in measured]
    if (x.truth.elevator is not None or x.truth.throttle is not None or x.truth.fed_back) and controls_logged:
        columns = [controls.index(n) for n in controls_logged]
        measured = as_issued_in(measured, u[:, columns], controls_logged, at, manoeuvre.settle_s)
    return measured if x.truth.spoil is None else spoiled(measured, x.truth)


def _reason(error: Refusal) -> str:
    """Return why a draw cannot fly, without the numbers of the draw, so that reasons can be counted."""
    return f"{type(error).__name__}: {error.message.split(', got')[0]}"
