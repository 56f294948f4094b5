"""The commands ``testbench gap`` and ``gap new``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.core.errors import RecordError, ScenarioError
from testbench.page.terminal import console, stages
from testbench.questions.options import (
    ByDefault,
    DrivenBy,
    FlownBy,
    OutOption,
    SeedOption,
    SimulatorOption,
    Wings,
    refuse,
    with_figures,
)

AGAIN, DRAWN = "again.jsonl", "drawn.jsonl"  # in a folder of results: flights, of which none is flown twice
SEARCH = "search.jsonl"  # fits of a search that is not at its end
FLIGHTS = ("sensors", "hold_out", "wings", "airspeed", "altitude", "data", "drive")  # what is said of measured records


command = typer.Typer(
    cls=ByDefault.first("show"),
    no_args_is_help=True,
    help="Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.",
)


@command.command()
@with_figures
def show(
    context: typer.Context,
    case: Annotated[
        str | None, typer.Argument(help="The a-priori model of the aircraft, or a gap case.", show_default=False)
    ] = None,
    records: Annotated[
        list[Path] | None,
        typer.Argument(help="Measured records (.nc) or descriptions of them (.toml).", show_default=False),
    ] = None,
    sensors: Annotated[
        str | None, typer.Option(help="Assumed sensor suite; if not given, that of the records.")
    ] = None,
    hold_out: Annotated[
        list[Path] | None, typer.Option("--hold-out", help="Held-out record, for validation only; may be repeated.")
    ] = None,
    wings: Annotated[
        Wings, typer.Option(help="Whether the elastic modes of the a-priori model move.")
    ] = Wings.flexible,
    airspeed: Annotated[float | None, typer.Option("--V", help="Airspeed at the start, m/s.")] = None,
    altitude: Annotated[float | None, typer.Option("--h", help="Altitude at the start, m.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the files that descriptions name.")] = None,
    drive: Annotated[
        DrivenBy,
        typer.Option(
            help="Inputs of the a-priori model: commands, recorded surfaces, or both: surfaces where no command is "
            "recorded."
        ),
    ] = DrivenBy.both,
    plan: Annotated[
        Path | None,
        typer.Option(
            help="Scenario: print the rate at which its manoeuvres would name each effect, and the manoeuvre to add."
        ),
    ] = None,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", help="Effect of your own to search with the library, FILE.py:NAME; may be repeated."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes; a second one checks the instruments. If not given, one for each core."),
    ] = None,
    simulator: SimulatorOption = FlownBy.auto,
    windows: Annotated[
        str | None,
        typer.Option(
            help="Cut records without quiet trim flight into windows with free initial states: auto, off, or a "
            "length, s, for all records.  [default: auto, or as the case says]",
            show_default=False,
        ),
    ] = None,
    again: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of repeated simulations of your flights, with truths drawn from the priors, to calibrate the "
            "stated probabilities. Each takes as long as the main search; 20 is a good number.",
        ),
    ] = 0,
    draws: Annotated[
        int,
        typer.Option(min=1, help="With --plan: number of flights drawn from the priors, each analysed to first order."),
    ] = 900,
) -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, validate the amended model.

    `testbench gap new` writes a case for your records. Measured manoeuvres are compared with the a-priori model and its
    sensors: `testbench gap eolo flown/*.nc --sensors eolo_gap --wings rigid --hold-out flown/doublets.nc`. A case may
    simulate its own flights with a hidden truth: `testbench gap flexible_wings`. The instruments are checked against
    each other first. The same command continues an interrupted search, with the same answer.

    Before the flight, `testbench gap --plan eolo_alpha` prints the rate at which the manoeuvres of a scenario would
    name each effect, and the effects with which they would confuse it.
    """
    from testbench.questions.files import find

    if plan is not None:
        refuse(
            context,
            "with --plan, whose scenario states all of it",
            *(*FLIGHTS, "case", "records", "seed", "workers", "again", "effect", "simulator", "windows"),
        )
        _plan_gap(find(plan, "run"), out, draws)
        return
    refuse(context, "with records or a case: flights are drawn by --plan", "draws")
    if case is None:
        raise RecordError("an aircraft must be given with its records, or a gap case, got nothing")
    from testbench.core.paths import STOCK
    from testbench.core.processes import cores, processes
    from testbench.core.store import ResultFolder, folder_in
    from testbench.page.page import record_keeper
    from testbench.questions.gap.ask import run_flights, run_gap
    from testbench.questions.gap.page import gap_page
    from testbench.questions.gap.records import Said, load_flights
    from testbench.questions.gap.scenario import windows_of
    from testbench.questions.gap.workflow import GapSearch

    measured = bool(records) or _is_aircraft(case)
    if measured:
        refuse(context, "with measured records, which contain the noise", "seed")
        name = Path(case.removeprefix(STOCK)).name  # of the folder, where a path is given
    else:
        refuse(context, "with a gap case, whose file states all of it; or give measured records as well", *FLIGHTS)
        file = find(Path(case), "gap")
        name = file.stem
    with ResultFolder(folder_in(out, f"gap_{name}")) as place, stages() as say, processes(workers or cores()):
        again_file = place.live(AGAIN) if again else None
        search = place.live(SEARCH)
        how = GapSearch(windows=windows_of(windows), check=True, again=again, again_file=again_file, search_file=search)
        if measured:
            say("read records")
            held = hold_out or ()
            said = Said(sensors, airspeed, altitude, drive.value)
            flights = load_flights(case, records or (), held, said, wings.value, data)
            result = run_flights(name, flights, say, how, more_effects=effect or (), simulator=simulator.value)
        else:
            keep, more = record_keeper(place), effect or ()
            result = run_gap(file, seed, keep, say, how, more_effects=more, simulator=simulator.value)
        say("write report")
        page = gap_page(result)
        page.write(place)
        search.unlink(missing_ok=True)  # at its end there is nothing to go on with
    page.show(console(), place.path)


def _is_aircraft(name: str) -> bool:
    """Return whether a name means an aircraft, so that records belong to it, and no gap case."""
    from testbench.core.paths import AIRCRAFT, resolve

    try:
        return not name.endswith(".toml") and bool(resolve(name, AIRCRAFT))
    except ScenarioError:
        return False


def _plan_gap(file: Path, out: Path, draws: int) -> None:
    from testbench.core.store import ResultFolder, folder_in
    from testbench.questions.gap.page import gap_plan_page
    from testbench.questions.gap.plan import plan_gap
    from testbench.questions.run.scenario import Scenario

    loaded = Scenario.load(file)
    with ResultFolder(folder_in(out, f"gap_plan_{loaded.name}")) as place, stages() as say:
        planned = plan_gap(loaded, say, draws, place.live(DRAWN))
        say("write report")
        page = gap_plan_page(planned)
        page.write(place)
    page.show(console(), place.path)
    if planned.interrupted:
        raise KeyboardInterrupt


@command.command()
def new(
    case: Annotated[Path, typer.Argument(help="Gap case to write, a new .toml file.", show_default=False)],
    records: Annotated[
        list[Path],
        typer.Argument(help="Measured records (.nc), or folders that testbench import wrote.", show_default=False),
    ],
    aircraft: Annotated[
        str,
        typer.Option(help="The a-priori model of the aircraft: packaged, or a folder of your own.", show_default=False),
    ],
    sensors: Annotated[
        str | None,
        typer.Option(
            help="Assumed sensor suite; if not given, that of the records, else one made from them.", show_default=False
        ),
    ] = None,
    wings: Annotated[
        Wings, typer.Option(help="Whether the elastic modes of the a-priori model move.")
    ] = Wings.flexible,
    airspeed: Annotated[float | None, typer.Option("--V", help="Airspeed at the start, m/s.")] = None,
    altitude: Annotated[float | None, typer.Option("--h", help="Altitude at the start, m.")] = None,
) -> None:
    """Write a complete commented gap case for an aircraft and its records, to edit and run.

    The condition is that of the quiet flight of the records. The record that differs most from the others is held out.
    A sensor suite with the noise of the records is written next to the case. Example: `testbench import flight.csv -o
    flown`, `testbench gap new mine.toml --aircraft eolo flown`, then `testbench gap mine.toml`.
    """
    from testbench.core.door import read_text
    from testbench.core.files import must_be_new, write_new
    from testbench.questions.gap.new import new_case, sensors_file

    if case.suffix != ".toml":
        raise RecordError(f"a new gap case must be a .toml file, got '{case}'")
    must_be_new(case, what := "a new gap case")
    with stages() as say:
        say("read records")
        made = new_case(case, aircraft, records, sensors, wings.value, airspeed, altitude)
    if made.sensors is not None:
        sensors_at = sensors_file(case)
        if not sensors_at.is_file() or read_text(sensors_at, "suite") != made.sensors:  # as another try has left them
            write_new(sensors_at, made.sensors, what)
        print(f"Sensors: {sensors_at}")
    print(f"Gap case: {write_new(case, made.text, what)}")
    for asked in made.questions:
        print(f"Question: {asked}")
    print(f"Held out: {made.held_out.sentence}")
    print(f"Next: check the lines with YOURS, then testbench check {case} and testbench gap {case}")
