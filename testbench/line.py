"""The straight line: aircraft, trim, fly, measure, prepare, estimate, evaluate. Every question takes these steps here.

A simulated flight enters at :func:`fly_and_measure`; a recorded flight enters at :func:`identify_and_judge`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.advice import Advice, Advised, ranked
from testbench.core.bring import short
from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, Refusal, located
from testbench.core.named import Named, obtain_all
from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.scenario.base import Condition, FlownAt, FlownInAir, Preparation, Simulation
from testbench.estimators import estimate
from testbench.estimators.cells import FailedCell, aside_for, contained, need_numbers
from testbench.estimators.identification import Estimator, Identification, estimator_name
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.prepare import prepared
from testbench.evaluation import Evaluation, evaluate
from testbench.evaluation.truth import Truth, told_of
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import aborted
from testbench.sensors import SensorSuite

_DOUBLED = 100.0  # growth of a motion beyond which its own instability, not the input, ends a flight
RECORDED = "recorded"
"""What stands for a suite where flights were recorded, not simulated."""
Keep = Callable[[str, FlightRecord], None]
"""Called with a name and each record as soon as it exists, so that a later failure loses none of them."""
Report = Callable[[str], None]
"""Called with a few words as each stage begins."""


@dataclass(frozen=True, eq=False)
class Flight:
    """One manoeuvre: how its record is used, the truth (None for a recorded flight), and the record of each suite."""

    name: str
    use: str
    truth: FlightRecord | None
    measured: Mapping[str, FlightRecord]
    trim_s: float = 0.0

    @property
    def flown(self) -> FlightRecord:
        """The truth of a simulated flight."""
        assert self.truth is not None, "a recorded flight has no truth"
        return self.truth


@dataclass(frozen=True, eq=False)
class Case(Advised):
    """One suite and one estimator: the prepared records, the model and its evaluation."""

    suite: str
    estimator: Estimator
    identification: tuple[FlightRecord, ...]
    validation: tuple[FlightRecord, ...]
    model: IdentifiedModel
    evaluation: Evaluation

    @property
    def label(self) -> str:
        """Suite and estimator, in words; of recorded flights, which have no suite to tell apart, the estimator."""
        name = estimator_name(self.estimator)
        return name if self.suite == RECORDED else f"{self.suite}, {name}"

    @property
    def advice(self) -> tuple[Advice, ...]:  # type: ignore[override]
        """The model's advice, the worst first; where the truth is known that says what is wrong with the estimates.

        Residuals only suggest how far a cause has moved them.
        """
        told, wrong = ranked(self.model.advice), self.evaluation.wrong
        if wrong is None:
            return told
        from testbench.inference.causes import CAUSES

        told = tuple(Advice(a, "doubt", a.code) if a.severity == "wrong" and a.code in CAUSES else a for a in told)
        return ranked([*([Advice("; ".join(wrong), "wrong", "truth")] if wrong else []), *told])


class AsksToIdentify(Protocol):
    """A scenario whose records are prepared and identified; messages name its file."""

    @property
    def file(self) -> Path | None:
        """The file."""

    @property
    def preparation(self) -> Preparation:
        """What is done to records first."""

    @property
    def identification(self) -> Identification:
        """Inputs, outputs and estimators."""


def condition_of(condition: Condition) -> FlightCondition:
    """Return the flight condition that a scenario's table ``[condition]`` asks for."""
    return FlightCondition(condition.V_m_s, condition.h_m, condition.gamma_deg * DEG_RAD)


def trim_for(scenario: FlownAt, aircraft: Aircraft, seed: int = 0) -> TrimmedFlight:
    """Return ``aircraft`` trimmed at the condition, rate and steady wind of a scenario.

    Raises:
        TrimError: there is no equilibrium; with the scenario's file.
    """
    with located(scenario.file, "condition"):
        air = air_of(scenario.air, scenario.condition.h_m, seed) if isinstance(scenario, FlownInAir) else None
        return trim(aircraft, condition_of(scenario.condition), scenario.simulation.rate_hz, air)


def log_rate(simulation: Simulation, suites: Sequence[SensorSuite]) -> float:
    """Return the rate that flights are logged at, Hz: the scenario's own, else that of the fastest suite."""
    return simulation.log_rate_hz or max(s.rate_hz for s in suites)


def fly_and_measure(
    job: Job,
    suites: Sequence[Named[SensorSuite]] = (),
    seed: int = 0,
    use: str = "identification",
    settled: bool = False,
    keep: Keep | None = None,
    flown: FlightRecord | None = None,
) -> Flight:
    """Fly one manoeuvre from trim, if it has not been flown already, and measure it through every suite.

    Args:
        job: what is wanted: aircraft, trim, manoeuvre, rate of the log, channels and air.
        suites: each makes one measured record; none if the truth alone is wanted.
        seed: of the noise of every suite: sensors that two suites share have the same noise.
        use: what the record is for.
        settled: measured records begin where the inputs do.
        keep: gets the truth as NAME_truth (NAME_aborted if the flight ends early) and records as NAME_SUITE.
        flown: its truth, if it has been flown already, see :func:`testbench.flight.batch.fly.fly_many`.

    Raises:
        LimitError: a rate, a command or the air breaks its law.
        FlightAborted: the flight left the aircraft's limits; the error carries the record.

    Example:
        >>> import testbench as tb
        >>> spec = tb.load_scenario("taurus_doublet").manoeuvre[0]
        >>> aircraft = tb.load_aircraft("taurus")
        >>> trimmed = tb.trim(aircraft, tb.FlightCondition(12.0, 100.0))
        >>> doublet = tb.Manoeuvre.of(spec.name, spec.input, spec.duration_s, trimmed.rate_hz)
        >>> flight = tb.fly_and_measure(tb.Job(aircraft, trimmed, doublet, log_rate_hz=40.0), ["taurus_8hz"], seed=1)
        >>> flight.measured["taurus_8hz"].channels
        ('theta', 'q', 'u', 'h', 'de_cmd')
    """
    name, settle_s = job.manoeuvre.name, job.manoeuvre.settle_s
    try:
        flown = truth_of(job, flown)
    except FlightAborted as error:
        if keep is not None and error.record is not None and len(error.record):
            keep(f"{name}_aborted", error.record)
        raise
    if keep is not None:
        keep(f"{name}_truth", flown)
    seen = {}
    for suite in obtain_all(SensorSuite, suites):
        record = suite.measure(flown, seed)
        seen[suite.name] = record.between(settle_s, np.inf) if settled else record
        if keep is not None:
            keep(f"{name}_{suite.name}", seen[suite.name])
    return Flight(name, use, flown, seen, settle_s)


def truth_of(job: Job, flown: FlightRecord | Refusal | None = None) -> FlightRecord:
    """Return the truth of a flight that was completed: it is flown now, or was flown with others.

    Raises:
        FlightAborted: as of :func:`flown_already`.
        TestbenchError: why it was not flown.
    """
    which = job.aircraft, job.trimmed, job.manoeuvre.name
    if flown is not None:
        return flown_already(*which, job.log_rate_hz, flown)
    try:
        return job.flown_by_jsbsim()
    except FlightAborted as error:
        raise _with_instability(error, *which) from error


def flown_already(
    aircraft: Aircraft, trimmed: TrimmedFlight, name: str, log_rate_hz: float, flown: FlightRecord | Refusal
) -> FlightRecord:
    """Return the record of a flight of many that was completed.

    Raises:
        FlightAborted: it left the limits of the aircraft; with the time to double if that is unstable.
        TestbenchError: why it was not flown.
    """
    if isinstance(flown, Refusal):
        raise flown
    if flown.outcome == "aborted":
        raise _with_instability(aborted(flown, aircraft.name, name, log_rate_hz), aircraft, trimmed, name)
    return flown


def _with_instability(error: FlightAborted, aircraft: Aircraft, trimmed: TrimmedFlight, name: str) -> FlightAborted:
    """Return the error of a flight that ended early, with the time to double if the aircraft is unstable.

    An unstable aircraft may be flown for as long as it stays inside its limits. If it leaves them after several times
    the time in which its motion doubles, no smaller input would help for long, and the message says so.
    """
    growth = float(linearise(aircraft, trimmed).poles().real.max())
    if not growth * error.time_s > math.log(_DOUBLED):
        return error
    return FlightAborted(
        f"{aircraft.name} is unstable without a pilot: its motion doubles in {math.log(2.0) / growth:.2g} s, and it "
        f"left its limits at t = {error.time_s:.2f} s of manoeuvre '{name}': {error.reason}; fly it with a "
        "[stabiliser] in its aircraft.toml, or a shorter manoeuvre",
        error.time_s,
        error.reason,
        error.record,
    )


def identify_and_judge(
    flights: Sequence[Flight],
    asked: AsksToIdentify,
    progress: Report | None = None,
    truth: Truth | None = None,
    noise: Mapping[str, Mapping[str, float]] | None = None,
    causes: bool = False,
    failed: list[FailedCell] | None = None,
) -> tuple[Case, ...]:
    """Prepare the records of every suite, run every estimator on them, and judge the models.

    Args:
        flights: simulated or recorded, all measured by the same suites.
        asked: what is done to the records first, and inputs, outputs and estimators.
        progress: called with a few words as each stage begins.
        truth: what estimates are compared with; None for recorded flights.
        noise: suite -> channel -> standard deviation, from which the error by noise alone follows.
        causes: look for what the residuals of each model come from, which takes time for each of them.
        failed: takes each suite and estimator without a model; the others go on. The first is an error if not given.

    Raises:
        TestbenchError: with file and key; with ``failed`` only if no estimator gives a model.
    """
    say, noise = progress or (lambda text: None), noise or {}
    where, identification, limit_s = asked.file, asked.identification, asked.identification.limit_s
    cases: list[Case] = []
    first: Refusal | None = None
    for suite in flights[0].measured:
        with located(where, "preparation"):
            parts = [(f.use, prepared(f.measured[suite], f.trim_s, asked.preparation)) for f in flights]
        fit, judge = _divide(parts, asked.preparation.identification_fraction)
        sensed = fit[0].channels
        outputs = tuple(n for n in (identification.outputs or sensed) if n in sensed and n not in identification.inputs)
        for k, spec in enumerate(identification.estimators):
            say(f"identify {suite} with {short(spec.method)}")
            aside = aside_for(spec)
            try:
                with located(where, f"identification.estimators[{k}]"), contained(spec.method, limit_s):
                    given = spec, fit, identification.inputs, outputs, judge
                    model = need_numbers(estimate(*given) if aside is None else aside.estimate(*given, limit_s=limit_s))
                    if causes:
                        from testbench.inference.causes import with_causes

                        model = with_causes(model, fit)
                    known = None if truth is None else told_of(truth, model, fit)
                    scores = evaluate(model, fit, judge, known, noise.get(suite))
                    if np.isnan(scores.identification.mrse_percent).all():
                        raise EstimationError(f"{model.method} must predict numbers, got NaN for every output")
            except Refusal as error:
                if failed is None:
                    raise
                first = first or error
                failed.append(FailedCell(suite, estimator_name(spec), error.message))
                continue
            cases.append(Case(suite, spec, tuple(fit), tuple(judge), model, scores))
    if failed and first is not None and not cases:
        raise first if len(failed) == 1 else _nothing_works(failed, first)
    return tuple(cases)


def _nothing_works(failed: Sequence[FailedCell], first: Refusal) -> EstimationError:
    """Return the error of a run without any model: every reason, with those that it holds for."""
    of: dict[str, list[str]] = {}
    for cell in failed:
        of.setdefault(cell.reason, []).append(cell.label)
    error = EstimationError("no estimator gave a model: " + "; ".join(f"{' and '.join(c)}: {r}" for r, c in of.items()))
    error.place = first.place if len(of) == 1 else None
    return error


def _divide(
    parts: Sequence[tuple[str, FlightRecord]], fraction: float
) -> tuple[list[FlightRecord], list[FlightRecord]]:
    """Return the records to identify on and those to judge on."""
    fit = [r for use, r in parts if use == "identification"]
    judge = [r for use, r in parts if use == "validation"]
    for use, record in parts:
        if use == "split":
            first, second = record.split(fraction)
            fit.append(first)
            judge.append(second)
    return fit, judge
