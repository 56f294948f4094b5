"""Gap scenarios: what is believed, and the measured records, real or made from a hidden truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from testbench.core.blas import on_one_thread
from testbench.core.errors import RecordError, located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, load_record
from testbench.core.scenario.base import Condition
from testbench.effects import OTHER_SERVOS
from testbench.flight import FlightCondition, load_aircraft
from testbench.flight.batch.jobs import Simulator
from testbench.line import Keep, condition_of
from testbench.page.shown import Shown
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.brought import choose
from testbench.questions.gap.evidence.commanded import not_compared
from testbench.questions.gap.records import Flights, at_its_own, check_records, check_speeds, frame_rate
from testbench.questions.gap.result import GapFinding
from testbench.questions.gap.scenario import GapScenario, Loaded
from testbench.questions.gap.starts import Start, marked
from testbench.questions.gap.workflow import GapSearch, find_gap
from testbench.questions.hidden import fly_hidden, issued
from testbench.sensors import SensorSuite, load_suite


@dataclass(frozen=True, eq=False)
class GapResult(Shown, page="testbench.questions.gap.page:gap_page"):
    """Measured flights, what was believed of them, and what was found.

    Attributes:
        name: short, names the results.
        title, question: for people.
        aircraft: name of the believed aircraft.
        records: name -> measured record, those held out included.
        finding: what was found.
        seed: of the noise of a case made from a hidden truth; None for recorded flights.
        file: the scenario, or None.
        notes: what was assumed, in sentences.
    """

    name: str
    title: str
    question: str
    aircraft: str
    records: Mapping[str, FlightRecord]
    finding: GapFinding
    seed: int | None = None
    file: Path | None = None
    notes: tuple[str, ...] = ()


@on_one_thread
def run_gap(
    scenario: Named[GapScenario],
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Callable[[str], None] | None = None,
    how: GapSearch | None = None,
    more_effects: Sequence[str] = (),
    simulator: Simulator = "auto",
) -> GapResult:
    """Read or make the measured records of a gap scenario and find what the believed model lacks.

    Args:
        scenario: read, or its file, or the name of a packaged one.
        seed: replaces the scenario's own.
        keep: called with a name and each record as soon as it exists.
        progress: called with a few words as each stage begins.
        how: it is sought; effects, noise and what drives are the scenario's.
        more_effects: searched beside those of the scenario, ``FILE.py:NAME`` or names of the library.
        simulator: "jsbsim" flies nothing in batches.

    Raises:
        TestbenchError: with the file and key that it comes from.

    Example:
        >>> import testbench as tb
        >>> result = tb.run_gap(tb.load("gap/flexible_wings"))  # doctest: +SKIP
        >>> result.finding.sentences[0]  # doctest: +SKIP
    """
    scenario, how = obtain(GapScenario, scenario), how or GapSearch()
    file = scenario.file
    seed = scenario.seed if seed is None else seed
    keep = keep or (lambda name, record: None)
    with located(file, "suite"):
        suite = load_suite(scenario.suite)
    condition = condition_of(scenario.condition)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    notes = list(not_compared(suite))
    with located(file, "suite"):
        rate = scenario.simulation.rate_hz or (
            frame_rate(aircraft, suite, notes) if scenario.hidden is None else aircraft.rate_hz
        )
        believed = Believed(aircraft, suite, condition, rate, simulator=simulator)
    with located(file, "effects"):
        choice = choose(suite, scenario.effects, (*scenario.more_effects, *more_effects), file, aircraft)
    if scenario.hidden is not None:
        starts = {
            m.name: s
            for m in scenario.manoeuvre
            if (s := _start(m, m.condition, condition, m.settle_s + m.duration_s)) is not None
        }
        with located(file, "hidden"):
            real = scenario.hidden.real(scenario, suite)
        with located(file, "manoeuvre"):
            own = scenario.simulation.rate_hz
            records = fly_hidden(real, suite, issued(suite, condition, scenario.manoeuvre, seed, starts), own, progress)
            records = {n: marked(r, starts[n]) if n in starts else r for n, r in records.items()}
        held = {m.name for m in scenario.manoeuvre if m.use == "validation"}
    else:
        with located(file, "measured"):
            records = {m.name: load_record((file.parent if file else Path()) / m.file) for m in scenario.measured}
            if len(records) < len(scenario.measured):
                raise RecordError("names of measured records must differ")
            checked = check_records(suite, records, notes, scenario.drive != "command")
            records = _started(checked, scenario, suite, condition)
            check_speeds(suite, records, condition.V_m_s)
        held = {m.name for m in scenario.measured if m.use == "held_out"}
    for name, record in records.items():
        keep(name, record)
    with located(file, "condition"):
        finding = find_gap(
            believed,
            {n: r for n, r in records.items() if n not in held},
            {n: r for n, r in records.items() if n in held},
            replace(
                how,
                effects=choice.effects,
                further=OTHER_SERVOS if scenario.effects is None else None,
                noise="simulated" if scenario.hidden is not None and scenario.hidden.noise == 1.0 else "stated",
                drive=scenario.drive,
                windows=scenario.windows if how.windows is None else how.windows,
            ),
            progress,
        )
    notes += choice.notes
    return GapResult(
        scenario.name, scenario.title, scenario.question, scenario.aircraft, records, finding, seed, file, tuple(notes)
    )


def _start(
    loaded: Loaded, own: Condition | FlightCondition | None, general: FlightCondition, duration_s: float
) -> Start | None:
    """Return what a record of that duration was flown from, None if that is the ``general`` condition without more."""
    at = condition_of(own) if isinstance(own, Condition) else own or general
    at_s = None if loaded.flown_at_s is None else loaded.flown_at_s + 0.5 * duration_s
    start = Start(at, loaded.load_kg, loaded.load_aft_m, at_s)
    return None if start == Start(general) else start


def _started(
    records: Mapping[str, FlightRecord], scenario: GapScenario, suite: SensorSuite, general: FlightCondition
) -> dict[str, FlightRecord]:
    """Return the measured records of a scenario, with what it says of their starts; else they keep their own word."""
    out = dict(records)
    for spec in scenario.measured:
        with located(None, f"record '{spec.name}'"):
            record, own = records[spec.name], spec.condition
            at = at_its_own(suite, record, general.h_m) if own == "recorded" else own
            start = _start(spec, at, general, record.duration_s)
            if start is not None:
                out[spec.name] = marked(record, start)
    return out


def run_flights(
    aircraft: str,
    flights: Flights,
    progress: Callable[[str], None] | None = None,
    how: GapSearch | None = None,
    more_effects: Sequence[str] = (),
    simulator: Simulator = "auto",
) -> GapResult:
    """Find what the believed model of recorded flights lacks; see :func:`testbench.questions.gap.records.load_flights`.

    ``progress``, ``how``, ``more_effects`` and ``simulator`` are as in :func:`run_gap`; noise is as the suite states.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the measured commands.
        RecordError: a record cannot be used.
    """
    choice = choose(flights.believed.suite, None, more_effects, None, flights.believed.aircraft)
    finding = find_gap(
        replace(flights.believed, simulator=simulator),
        flights.naming,
        flights.held_out,
        replace(how or GapSearch(), effects=choice.effects, further=OTHER_SERVOS, noise="stated", drive=flights.drive),
        progress,
    )
    return GapResult(
        name=aircraft,
        title=f"{flights.believed.aircraft.name}: does the simulation fly as the aircraft does?",
        question="",
        aircraft=aircraft,
        records={**flights.naming, **flights.held_out},
        finding=finding,
        notes=(*flights.notes, *choice.notes),
    )
