"""Gap scenarios: what is believed, and the measured records, real or made from a hidden truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.aircraft import load_aircraft
from testbench.constants import DEG_RAD
from testbench.errors import RecordError, ScenarioError, located
from testbench.flight import FlightCondition
from testbench.gap.believed import Believed
from testbench.gap.compared import not_compared
from testbench.gap.finding import GapFinding
from testbench.gap.hidden import Hidden, measure_hidden
from testbench.gap.records import Flights, check_records, check_speeds
from testbench.gap.workflow import find_gap
from testbench.paths import find_scenario
from testbench.record import FlightRecord, load_record
from testbench.scenario import AircraftName, Condition, Manoeuvre, Simulation, SuiteName
from testbench.schema import Strict, parse, read_toml
from testbench.sensors import load_suite

Keep = Callable[[str, FlightRecord], None]


class MeasuredFile(Strict):
    """A measured record on disk (NetCDF, as written by the testbench), relative to the scenario file."""

    name: str
    file: str
    use: Literal["naming", "held_out"]


class GapScenario(Strict):
    """A gap case. Either ``measured`` lists records, or ``manoeuvre`` and ``hidden`` make them.

    Of the manoeuvres, those for "identification" are used to name the effect, those for "validation" are held out.
    """

    title: Annotated[str, Field(min_length=1)]
    question: str = ""
    aircraft: AircraftName
    wings: Literal["flexible", "rigid"] = "flexible"
    suite: SuiteName
    seed: Annotated[int, Field(ge=0)] = 0
    condition: Condition
    simulation: Simulation = Simulation()
    manoeuvre: Annotated[tuple[Manoeuvre, ...], Field(strict=False)] = ()
    hidden: Hidden | None = None
    measured: Annotated[tuple[MeasuredFile, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_source_with_both_uses(self) -> GapScenario:
        made = bool(self.manoeuvre), self.hidden is not None
        if any(made) if self.measured else not all(made):
            raise ValueError(
                "either 'measured' must list records, or 'manoeuvre' and 'hidden' must say how to make them; got "
                + (", ".join(n for n in ("measured", "manoeuvre", "hidden") if getattr(self, n)) or "none of them")
            )
        uses = {m.use for m in self.measured} | {m.use for m in self.manoeuvre}
        if not (uses & {"naming", "identification"} and uses & {"held_out", "validation"}) or "split" in uses:
            raise ValueError("records must serve both naming (identification) and judging (validation, held out)")
        return self


@dataclass(frozen=True, eq=False)
class GapResult:
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


def load_gap(path: Path | str) -> tuple[Path, GapScenario]:
    """Read a gap scenario.

    Raises:
        ScenarioError: lists every fault with file, key, law and value.
    """
    file = find_scenario(path)
    scenario, faults = parse(GapScenario, read_toml(file), file)
    if scenario is None or faults:
        raise ScenarioError(faults)
    return file, scenario


def run_gap(
    path: Path | str,
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Callable[[str], None] | None = None,
    check: bool = False,
    controls: int = 0,
    control_file: Path | None = None,
) -> GapResult:
    """Read or make the measured records of a gap scenario and find what the believed model lacks.

    Args:
        path: gap scenario, a file or the name of a packaged one.
        seed: replaces the scenario's own.
        keep: called with a name and each record as soon as it exists.
        progress: called with a few words as each stage begins.
        check: check the instruments against each other first; takes about as long as the search itself.
        controls: number of control flights without any effect, each of which is searched, too.
        control_file: keeps each of them, so that none is flown twice.

    Raises:
        TestbenchError: with the file and key that it comes from.
    """
    file, scenario = load_gap(path)
    seed = scenario.seed if seed is None else seed
    keep = keep or (lambda name, record: None)
    with located(file, "suite"):
        suite = load_suite(scenario.suite)
    condition = FlightCondition(
        scenario.condition.V_m_s, scenario.condition.h_m, scenario.condition.gamma_deg * DEG_RAD
    )
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    with located(file, "suite"):
        believed = Believed(aircraft, suite, condition, scenario.simulation.rate_hz or aircraft.rate_hz)
    notes = not_compared(suite)
    if scenario.hidden is not None:
        with located(file, "manoeuvre"):
            records = measure_hidden(
                scenario.aircraft,
                scenario.wings,
                scenario.hidden,
                suite,
                condition,
                scenario.manoeuvre,
                seed,
                scenario.simulation.rate_hz,
                progress,
            )
        held = {m.name for m in scenario.manoeuvre if m.use == "validation"}
    else:
        with located(file, "measured"):
            records = {m.name: load_record(file.parent / m.file) for m in scenario.measured}
            if len(records) < len(scenario.measured):
                raise RecordError("names of measured records must differ")
            records = check_records(suite, records, notes)
            check_speeds(suite, records, condition.V_m_s)
        held = {m.name for m in scenario.measured if m.use == "held_out"}
    for name, record in records.items():
        keep(name, record)
    with located(file, "condition"):
        finding = find_gap(
            believed,
            {n: r for n, r in records.items() if n not in held},
            {n: r for n, r in records.items() if n in held},
            progress,
            check=check,
            controls=controls,
            control_file=control_file,
        )
    return GapResult(
        file.stem, scenario.title, scenario.question, scenario.aircraft, records, finding, seed, file, tuple(notes)
    )


def run_flights(
    aircraft: str,
    flights: Flights,
    progress: Callable[[str], None] | None = None,
    check: bool = True,
    controls: int = 0,
    control_file: Path | None = None,
) -> GapResult:
    """Find what the believed model of recorded flights lacks; see :func:`testbench.gap.records.load_flights`.

    ``progress``, ``check``, ``controls`` and ``control_file`` are those of :func:`run_gap`.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the measured commands.
        RecordError: a record cannot be used.
    """
    finding = find_gap(
        flights.believed,
        flights.naming,
        flights.held_out,
        progress,
        check=check,
        controls=controls,
        control_file=control_file,
    )
    return GapResult(
        name=aircraft,
        title=f"{flights.believed.aircraft.name}: does the simulation fly as the aircraft does?",
        question="",
        aircraft=aircraft,
        records={**flights.naming, **flights.held_out},
        finding=finding,
        notes=flights.notes,
    )
