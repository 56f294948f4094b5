"""Run a scenario: load the aircraft and its sensors, trim, fly and measure, linearise, identify and judge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.errors import located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord
from testbench.estimators.cells import FailedCell
from testbench.estimators.identification import Identification
from testbench.evaluation.truth import Truth, excited, true_model
from testbench.flight import TrimmedFlight, load_aircraft
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.line import Flight, Keep, Report, fly_and_measure, identify_and_judge, log_rate, trim_for
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario
from testbench.questions.run.seeds import repeat
from testbench.sensors import SensorSuite, load_suite


@dataclass(frozen=True, eq=False)
class Prepared:
    """What a run needs before it flies; made once if many runs share it, or change it."""

    aircraft: Aircraft  #: it may differ from the one that the scenario names
    suites: tuple[SensorSuite, ...]  #: they may differ from those that the scenario names
    trimmed: TrimmedFlight  #: at the scenario's condition and steady wind
    truth: Truth | None = None  #: of this aircraft and trim, or None if estimates are not compared with the truth
    channels: tuple[str, ...] | None = None  #: of the truth to log; all if None
    #: truth of each manoeuvre, if they have been flown already; see :func:`wanted_flights`
    flown: tuple[FlightRecord, ...] = ()


@on_one_thread
def run(
    scenario: Named[Scenario],
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    prepared: Prepared | None = None,
    causes: bool = True,
) -> RunResult:
    """Fly, measure, identify and judge one scenario.

    Args:
        scenario: the scenario.
        seed: replaces the scenario's own.
        keep: called with a name and each record as soon as it exists, so that a later failure loses none of them.
        progress: called with a few words as each stage begins.
        prepared: takes the place of loading, trimming and linearising what the scenario names; who prepares repeats,
            and the scenario's ``seeds`` counts for nothing.
        causes: look for what the residuals of each model come from; see :func:`testbench.with_causes`.

    Raises:
        TestbenchError: with the file and key of the scenario that it comes from. A suite and an estimator that give no
            model are an entry of ``failed`` with their reason; only if none gives one it is an error.

    Example:
        >>> import testbench as tb
        >>> result = tb.run(tb.load_scenario("taurus_doublet"))
        >>> sorted(result.table.columns)
        ['data', 'estimator', 'fit_percent', 'mrse_percent', 'output', 'suite']
    """
    scenario = obtain(Scenario, scenario)
    seed, say = scenario.seed if seed is None else seed, progress or (lambda text: None)
    ready = prepared or _ready(scenario, seed, say)
    flights = fly_all(scenario, ready, seed, keep, say)
    known = ready.truth
    if prepared is None:
        say("linearise")
        known = _truth(ready, flights, scenario.identification)
    noise = {s.name: s.noise_std for s in ready.suites} if scenario.preparation.lowpass_hz is None else {}
    failed: list[FailedCell] = []
    cases = identify_and_judge(flights, scenario, say, known, noise, causes, failed)
    repeats = None
    if prepared is None and scenario.seeds > 1:
        flown = [f.truth for f in flights if f.truth is not None]
        repeats = repeat(scenario, replace(ready, truth=known), flown, seed, cases, say)
    return RunResult(
        *(scenario.name, scenario.title, scenario.question, scenario, seed, flights, cases, known, ready.suites),
        failed=tuple(failed),
        repeats=repeats,
    )


def load_scenario(path: Path | str) -> Scenario:
    """Read a scenario and check it against its aircraft and suites, without flying; see :meth:`Scenario.load`.

    Example:
        >>> import testbench as tb
        >>> tb.load_scenario("eolo_alpha").suites
        ('eolo_no_alpha', 'eolo_alpha')
    """
    return obtain(Scenario, path)


def _ready(scenario: Scenario, seed: int, say: Report) -> Prepared:
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    with located(scenario.file, "suites"):
        suites = tuple(load_suite(name) for name in scenario.suites)
    say(f"trim {aircraft.name}")
    return Prepared(aircraft, suites, trim_for(scenario, aircraft, seed))


def fly_all(scenario: Scenario, ready: Prepared, seed: int, keep: Keep | None, say: Report) -> tuple[Flight, ...]:
    """Fly and measure all manoeuvres of a scenario, or measure those that have been flown."""
    flights = []
    for i, (spec, job) in enumerate(zip(scenario.manoeuvre, wanted_flights(scenario, ready, seed), strict=True)):
        say(f"fly {spec.name}")
        with located(scenario.file, f"manoeuvre[{i}]"):
            flown = ready.flown[i] if ready.flown else None
            flights.append(fly_and_measure(job, ready.suites, seed + i, spec.use, keep=keep, flown=flown))
    return tuple(flights)


def wanted_flights(scenario: Scenario, ready: Prepared, seed: int) -> list[Job]:
    """Return the flights that a run will fly, in its order, so that they can be flown with those of other runs.

    Raises:
        LimitError: an input breaks its law; with the scenario's file.
    """
    rate, out = log_rate(scenario.simulation, ready.suites), []
    for i, spec in enumerate(scenario.manoeuvre):
        with located(scenario.file, f"manoeuvre[{i}]"):
            manoeuvre = Manoeuvre.of(spec.name, spec.input, spec.duration_s, ready.trimmed.rate_hz, spec.settle_s)
            air = air_of(scenario.air, scenario.condition.h_m, seed + i)
        out.append(Job(ready.aircraft, ready.trimmed, manoeuvre, rate, ready.channels, air))
    return out


def _truth(ready: Prepared, flights: tuple[Flight, ...], identification: Identification) -> Truth:
    flight = next(f for f in flights if f.use != "validation")
    known = true_model(ready.aircraft, ready.trimmed, identification.inputs)
    return excited(known, flight.flown, identification.inputs, ready.suites)
