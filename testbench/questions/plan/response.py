"""The response to a planned manoeuvre: flown in the simulator against its limits, scaled if asked for, with a band."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, LimitError, Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.design.candidates import scaled
from testbench.design.ensemble import Flier
from testbench.design.limits import Limits, breaches
from testbench.estimators.parametric.response import Sampling, respond
from testbench.evaluation.modes import elastic_modes
from testbench.flight.air import Air, turbulence_rms
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre, aborted
from testbench.information.aircraft_structure import aircraft_structure, parameter_names
from testbench.inputs import InputSignal
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import PlanLimits, PlannedManoeuvre, PlanScenario, commanded
from testbench.sensors import SensorSuite

SHOWN = {"longitudinal": ("V", "alpha", "q", "az"), "lateral": ("beta", "p", "r", "phi")}
"""Channels of the expected response that a card shows."""
_COEFFICIENT_OF = {"X": "CD", "Z": "CL", "M": "Cm", "Y": "CY", "L": "Cl", "N": "Cn"}  # axis -> coefficient
LOGGED = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ay", "az", "h", "thrust", *CONTROLS)
_LOG_HZ = 100.0
_HALVINGS = 6
_LEAST_FACTOR = 0.05
_SIGMAS = 1.96  # 95 % of a normal deviate
Bands = dict[str, tuple[float, float]]  # channel -> (lowest, highest) absolute value


@dataclass(frozen=True, eq=False)
class Flown:
    """One simulated flight of a manoeuvre: the input, the record up to its end, and the limits that it breaks."""

    signal: InputSignal
    record: FlightRecord
    met: tuple[str, ...]


def limits_of(limits: PlanLimits, aircraft: Aircraft, onset_m_s: float | None) -> Limits:
    """Return the limits of a plan in SI; if no highest speed is given, the onset of instability is one.

    Raises:
        LimitError: a limit breaks its law.
    """
    fastest = [v for v in (limits.V_max_m_s, onset_m_s) if v is not None]
    return Limits.of(limits, aircraft.controls, {}, V_max_m_s=min(fastest, default=None), V_min_m_s=limits.V_min_m_s)


def bands_of(limits: Limits, point: Point, controls: Sequence[str]) -> Bands:
    """Return channel -> (lowest, highest) absolute value at a point, the deflections of the moved controls included.

    Raises:
        LimitError: trim itself lies outside a limit.
    """
    bands = limits.bands(dict(point.trimmed.state))
    for name in controls:
        bands[name] = limits.control_band(name)
    return bands


def log_rate_of(rate_hz: float) -> float:
    """Return the rate that expected responses are logged at: the highest that divides the simulator's, to 100 Hz."""
    return rate_hz / max(1, int(np.ceil(rate_hz / _LOG_HZ)))


@dataclass(frozen=True, eq=False)
class Task:
    """A manoeuvre at a point, inside limits; ``sources`` says of each limited channel where its limit comes from."""

    point: Point
    spec: PlannedManoeuvre
    limits: Limits
    sources: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Together:
    """What flies the cards of a plan: those of a round are flown at once where they are many."""

    aircraft: Aircraft  # what flies
    flier: Flier = field(default_factory=Flier)  # what flies it
    period_ms: int | None = None  # of the script that commands: each value is held as long; None for a pilot

    def signal(self, task: Task, factor: float) -> InputSignal:
        """Return what is commanded at a factor on the amplitude, as it is flown: drawn by hand, or sampled and held."""
        spec = task.spec
        return commanded(scaled(spec.input, factor), spec.duration_s, task.point.trimmed.rate_hz, self.period_ms)

    def job(self, task: Task, signal: InputSignal, channels: Sequence[str] = LOGGED, air: Air | None = None) -> Job:
        """Return the flight of a signal from the trim of a point, with the undisturbed flight that it begins with.

        Raises:
            LimitError: the signal breaks a law.
        """
        trimmed = task.point.trimmed
        manoeuvre = Manoeuvre(task.spec.name, signal, task.spec.settle_s)
        logged = tuple(c for c in channels if c in trimmed.state)  # a glider has no throttle
        return Job(self.aircraft, trimmed, manoeuvre, log_rate_of(trimmed.rate_hz), logged, air)


def fly_at(together: Together, tasks: Sequence[Task], factors: Sequence[float]) -> list[Flown | Refusal]:
    """Fly manoeuvres at factors on their amplitudes in still air; times of limits count from the input's start.

    Returns:
        For each the flight, or why there is none: a LimitError if trim lies outside the limits or the commands cannot
        be given.
    """
    out: list[Flown | Refusal | None] = [None] * len(tasks)
    ready: list[tuple[int, InputSignal, Bands, Job]] = []
    for i, (task, factor) in enumerate(zip(tasks, factors, strict=True)):
        try:
            signal = together.signal(task, factor)
            ready.append((i, signal, bands_of(task.limits, task.point, task.spec.controls), together.job(task, signal)))
        except LimitError as error:
            out[i] = error
    for (i, signal, bands, job), found in zip(ready, together.flier.fly([job for *_, job in ready]), strict=True):
        out[i] = found if isinstance(found, Refusal) else _judged(tasks[i], signal, bands, job, found)
    return [x for x in out if x is not None]


def _judged(task: Task, signal: InputSignal, bands: Bands, job: Job, record: FlightRecord) -> Flown:
    spec, ends = task.spec, []
    if record.outcome == "aborted":
        ends = [f"the flight ends at t = {len(record) / job.log_rate_hz - spec.settle_s:.2f} s: {record.reason}"]
    found = [b._replace(t_s=b.t_s - spec.settle_s).sentence for b in breaches(record, bands)]
    return Flown(signal, record, (*found, *_too_fast(record, spec, task.limits), *ends))


def _too_fast(record: FlightRecord, spec: PlannedManoeuvre, limits: Limits) -> list[str]:
    """Return the deflection rates that pass their limit, in words; one log interval is the time they are taken over."""
    out = []
    for name in spec.controls:
        if name in limits.rate:
            rate = np.diff(record[name]) / record.dt_s
            over = np.abs(rate) > limits.rate[name]
            if over.any():
                at = record.t_s[int(np.argmax(over)) + 1] - spec.settle_s
                out.append(
                    f"the rate of {name} passes {limits.rate[name] / DEG_RAD:.3g} deg/s at t = {at:.2f} s "
                    f"(extreme {np.abs(rate).max() / DEG_RAD:.3g} deg/s)"
                )
    return out


class Within(NamedTuple):
    """The factor on an amplitude that keeps all limits, the flight at it, and the limits broken at factor 1."""

    factor: float
    flown: Flown
    met: tuple[str, ...]


def fly_within(together: Together, tasks: Sequence[Task], scale: bool) -> list[Within | Refusal]:
    """Return for each manoeuvre at which factor on its amplitude it keeps all limits, or why it cannot be flown.

    Bisection finds the factor to 1/64, that of all manoeuvres in rounds. It is 0 if the manoeuvre is refused, because
    it breaks a limit and may not be scaled, or breaks one even at a twentieth of its amplitude. The flight is then the
    one at factor 1, or that without any input if the commands cannot be given.
    """
    first = fly_at(together, tasks, [1.0] * len(tasks))
    failed = [i for i, x in enumerate(first) if isinstance(x, LimitError) or (isinstance(x, Flown) and x.met)]
    span = dict.fromkeys(failed, (0.0, 1.0))
    good: dict[int, tuple[float, Flown]] = {}
    for _ in range(_HALVINGS if scale else 0):
        middle = [0.5 * (span[i][0] + span[i][1]) for i in failed]
        for i, factor, found in zip(failed, middle, fly_at(together, [tasks[i] for i in failed], middle), strict=True):
            low, high = span[i]
            if isinstance(found, Flown) and not found.met:
                span[i], good[i] = (factor, high), (factor, found)
            elif isinstance(found, Flown | LimitError):
                span[i] = low, factor
            else:
                first[i] = found
    out: list[Within | Refusal] = []
    for i, (task, found) in enumerate(zip(tasks, first, strict=True)):
        if isinstance(found, Refusal) and not isinstance(found, LimitError):
            out.append(found)
        elif i not in failed:
            assert isinstance(found, Flown)
            out.append(Within(1.0, found, ()))
        else:
            met = found.met if isinstance(found, Flown) else (found.message,)
            if i in good and good[i][0] >= _LEAST_FACTOR:
                out.append(Within(*good[i], met))
            else:
                out.append(Within(0.0, found, met) if isinstance(found, Flown) else _still(together, task, met))
    return out


def _still(together: Together, task: Task, met: tuple[str, ...]) -> Within | Refusal:
    """Return a manoeuvre whose commands cannot be given, with the flight without any."""
    (record,) = together.flier.fly([together.job(task, together.signal(task, 0.0))])
    if isinstance(record, Refusal):
        return record
    return Within(0.0, Flown(together.signal(task, 1.0), record, met), met)


def expected_band(
    scenario: PlanScenario,
    aircraft: Aircraft,
    suite: SensorSuite,
    point: Point,
    spec: PlannedManoeuvre,
    flown: Flown,
    rough: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Return channel -> (n,) half width of the 95 % band about the expected response, for the channels of SHOWN.

    The half width is 1.96 times the root of the sum of three variances. One is the sensor's noise and rounding, if the
    suite has the channel. One is that of the derivatives, each uncertain by ``uncertainty_percent`` and independent of
    the others, through the sensitivities of the linearised aircraft; where the aircraft has a deviation of its own for
    the coefficient that a derivative hangs on, that one counts. One is that of turbulence, see :func:`roughness`.

    Raises:
        EstimationError: the linearised aircraft diverges over the manoeuvre.
    """
    plane, shown, modes = spec.plane, SHOWN[spec.plane], elastic_modes(aircraft, spec.plane)
    names = parameter_names(spec.controls, plane, ())
    commands = point.model.commands(spec.controls)
    structure = aircraft_structure(point.model, point.trimmed, plane, modes, commands, shown, names)
    record = flown.record
    u = flown.signal.at(record.t_s - spec.settle_s, spec.controls)
    held = np.ones(len(commands), bool)
    start = np.zeros(len(structure.states))
    r = respond(structure, structure.true, range(len(names)), u, Sampling(record.dt_s, held), start)
    spread = relative_spread(names, aircraft, scenario.uncertainty_percent / 100.0) * np.abs(structure.true)
    variance = np.sum((r.dparams * spread) ** 2, axis=2)
    if not np.all(np.isfinite(variance)):
        raise EstimationError("the linearised aircraft diverges over this manoeuvre; shorten it")
    noise = suite.noise_std
    return {
        name: _SIGMAS * np.sqrt(variance[:, i] + noise.get(name, 0.0) ** 2 + rough.get(name, 0.0) ** 2)
        for i, name in enumerate(shown)
    }


def relative_spread(names: Sequence[str], aircraft: Aircraft, general: float) -> FloatArray:
    """Return the relative standard deviation (k,) of derivatives such as "M_alpha".

    That of the coefficient behind it ("Cm_alpha"), if the aircraft has one of its own, else the general one.
    """
    out = []
    for name in names:
        axis, variable = name.split("_", 1)
        out.append(aircraft.uncertainty.get(f"{_COEFFICIENT_OF[axis]}_{variable}", general))
    return np.array(out)


def roughness(together: Together, scenario: PlanScenario, tasks: Sequence[Task]) -> list[dict[str, float] | Refusal]:
    """Return channel -> rms deviation from trim of flights without input through the turbulence of the plan."""
    if scenario.turbulence_rms_m_s == 0.0:
        return [{} for _ in tasks]
    jobs = []
    for task in tasks:
        above = task.point.h_m - scenario.timing.field_m
        seed = scenario.seed + zlib.crc32(f"{task.point.label}, {task.spec.name}".encode()) % 2**31
        rms = turbulence_rms(scenario.turbulence_rms_m_s, above)
        air = Air(turbulence_rms_m_s=rms, height_m=above, seed=seed)
        jobs.append(together.job(task, together.signal(task, 0.0), SHOWN[task.spec.plane], air))
    out: list[dict[str, float] | Refusal] = []
    for task, record in zip(tasks, together.flier.fly(jobs), strict=True):
        if isinstance(record, FlightRecord) and len(record) < 2:
            record = aborted(record, together.aircraft.name, task.spec.name, log_rate_of(task.point.trimmed.rate_hz))
        if isinstance(record, Refusal):
            out.append(record)
            continue
        state = task.point.trimmed.state
        out.append({n: float(np.sqrt(np.mean((record[n] - state[n]) ** 2))) for n in SHOWN[task.spec.plane]})
    return out
