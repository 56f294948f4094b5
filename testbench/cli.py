"""The command line: parse, call one function, print. Everything heavy is imported inside the command that needs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from testbench.errors import RecordError, ScenarioError, TestbenchError

if TYPE_CHECKING:
    from testbench.campaign import Campaign

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="""Fly an identification experiment in simulation before the aircraft does.

A JSBSim aircraft is excited by an input, a sensor suite records it, estimators identify a model, and the report says
whether this input and these sensors would have been good enough. Turned round, with measured records, it finds what the
simulation lacks.

**Start here**

    testbench list scenarios
    testbench run eolo_alpha              # simulate, identify, report in results/eolo_alpha/report.html
    testbench check my_scenario.toml      # every fault of a file at once, without flying
    testbench identify my_records.toml    # the same line for recorded flights
    testbench import flight.ulg -o my_log # what a flight log holds, its manoeuvres as records
    testbench compatibility my_records.toml # do the instruments agree with each other?
    testbench response my_records.toml    # frequency responses with coherence and random error
    testbench gap flexible_wings          # find, name and add what the simulation lacks
    testbench design eolo_short_period    # which input tells what is wanted, inside the limits
    testbench compare eolo_alpha          # what each sensor buys, by simulation and by information
    testbench plan eolo_envelope          # a campaign with flight cards to print
    testbench campaign run taurus_scatter # a scenario many times, over distributions of anything in it
    testbench aircraft eolo               # trims, modes over speed, derivatives of an aircraft
    testbench studio                      # drag an input in a browser, see what it would tell
    testbench reproduce all               # the papers' tables and figures, printed and ours
    testbench exercise list               # teaching exercises, each student with an aircraft of their own

Exit status: 0 done, 2 bad input, 3 the computation cannot be carried out (no trim, flight aborted, not identifiable).
""",
)

campaigns = typer.Typer(no_args_is_help=True, help="Fly a scenario many times over distributions of anything in it.")
app.add_typer(campaigns, name="campaign")
exercises = typer.Typer(no_args_is_help=True, help="Teaching exercises: records to study, answers to check.")
app.add_typer(exercises, name="exercise")

ScenarioArgument = Annotated[
    Path, typer.Argument(help="Scenario file, or the name of a packaged one.", show_default=False)
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder that gets one folder of results per scenario.")]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Replaces the seed of the scenario.")]


_UsageError: Any = typer.BadParameter.__base__  # click's, of whichever click typer brings
_INTERRUPTED = 130


class Kind(str, Enum):
    """What `testbench list` can list."""

    aircraft = "aircraft"
    inputs = "inputs"
    sensors = "sensors"
    estimators = "estimators"
    scenarios = "scenarios"
    effects = "effects"


class Wings(str, Enum):
    """Whether elastic modes move."""

    flexible = "flexible"
    rigid = "rigid"


class Export(str, Enum):
    """Formats that records and models are exported to."""

    control = "control"
    csv = "csv"
    json = "json"
    jsbsim = "jsbsim"
    mat = "mat"
    netcdf = "netcdf"
    parquet = "parquet"


@app.command()
def run(scenario: ScenarioArgument, out: OutOption = Path("results"), seed: SeedOption = None) -> None:
    """Fly a scenario, measure, identify, judge, and write records, tables, models and report.html.

    Example: `testbench run eolo_alpha` answers what an angle-of-attack vane buys.
    """
    from testbench.checks import find
    from testbench.pipeline import load_scenario
    from testbench.pipeline import run as run_pipeline
    from testbench.report import print_result, record_keeper, write_results

    loaded = load_scenario(find(scenario, "run"))
    folder = out / loaded.name
    with _stages() as say:
        result = run_pipeline(loaded, seed, record_keeper(folder), say)
        say("write report")
        write_results(result, folder)
    print_result(result, _console(), folder)


@app.command()
def identify(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
) -> None:
    """Run the same estimators, evaluation and report on recorded flights.

    The description says which file, which column is which channel in which unit, and which time segments to use;
    CSV, text, MAT, Parquet and NetCDF are read. Example: `testbench identify records/attas_short_period`.
    """
    from testbench.checks import find
    from testbench.logs import load_description
    from testbench.pipeline import identify as identify_records
    from testbench.report import print_result, record_keeper, write_results

    loaded = load_description(find(description, "identify"))
    folder = out / loaded.name
    with _stages() as say:
        result = identify_records(loaded, data, record_keeper(folder), say)
        say("write report")
        write_results(result, folder)
    print_result(result, _console(), folder)


@app.command("import")
def import_(
    log: Annotated[
        Path,
        typer.Argument(
            help="PX4 ULog, ArduPilot .bin or .log, SIDPAC MAT, a table, or the description of one (.toml).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the records and descriptions; else only look.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Rate of the records, Hz.")] = None,
    throw: Annotated[
        list[str] | None, typer.Option(help="Deflection at full command in deg, e.g. de=20; 25 if not given.")
    ] = None,
    lead: Annotated[float, typer.Option(help="Quiet flight to keep before each manoeuvre, s.")] = 2.0,
    tail: Annotated[float, typer.Option(help="Response to keep after each manoeuvre, s.")] = 5.0,
    describe: Annotated[
        Path | None,
        typer.Option(help="Write a description of a table to this new .toml file, to fill in.", show_default=False),
    ] = None,
    record: Annotated[
        str | None, typer.Option(help="Which record of a description that has several.", show_default=False)
    ] = None,
) -> None:
    """Show what a flight log holds, and with -o cut its manoeuvres into records ready for `testbench identify`.

    Channels, rates, gaps and manoeuvres are listed, each conversion and what it assumes is said. Example:
    `testbench import flight.ulg -o records --throw de=20`. A table whose columns have no names, or no times, must be
    described first: `testbench import flight.mat --describe flight.toml`, fill in, `testbench import flight.toml`.
    """
    if describe is not None:
        from testbench.logs.template import write_template

        path = write_template(log, describe)
        print(f"Written: {path}; fill it in, then: testbench import {path}")
        return
    from testbench.logs.importing import import_log, parse_throws, write_import
    from testbench.report.imported import print_import

    with _stages() as say:
        say("read the log")
        found = import_log(log, rate, parse_throws(throw or []), lead, tail, record)
        paths = write_import(found, out) if out is not None else []
    print_import(found, _console(), paths)


@app.command()
def export(
    file: Annotated[
        Path, typer.Argument(help="Record (NetCDF), or model (models/*.json of a run).", show_default=False)
    ],
    to: Annotated[Export, typer.Option(help="Format.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File; by default beside the one exported.")] = None,
) -> None:
    """Write a record (csv, mat, netcdf, parquet) or a model (these, control, json, jsbsim) for other programs.

    Samples of a record that were not taken are left empty. A model becomes its matrices, a Python module with a
    python-control system, or a system of filters for JSBSim. Examples:
    `testbench export results/eolo_alpha/records/x.nc --to csv`,
    `testbench export results/eolo_alpha/models/x.json --to jsbsim`.
    """
    if file.suffix.lower() == ".json":
        from testbench.report.export import SUFFIXES, export_model, load_matrices

        path = out or file.with_name(file.stem + SUFFIXES[to.value])
        print(f"Written: {export_model(load_matrices(file), to.value, path)}")
        return
    from testbench.report.export import export_record

    print(f"Written: {export_record(file, to.value, out)}")


@app.command()
def compatibility(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
    gravity: Annotated[float, typer.Option(help="Gravity where it was flown, m/s2.")] = 9.80665,
) -> None:
    """Ask whether the instruments of recorded flights agree with each other, and which of them err by how much.

    Rates and accelerations are integrated and compared with airspeed, flow angles, attitude and height; bias, scale,
    lag or delay are estimated where the data tell them. The corrected records are written. Example:
    `testbench compatibility records/attas_full`.
    """
    from testbench.checks import find
    from testbench.estimators import data_compatibility
    from testbench.logs import load_description, read_records
    from testbench.report.compatibility import print_compatibility, write_compatibility

    described = load_description(find(description, "identify"))
    folder = out / f"{described.name}_compatibility"
    with _stages() as say:
        say("read records")
        records = {name: record for name, _, record in read_records(described, data)}
        say("estimate the errors of the instruments")
        result = data_compatibility.estimate(list(records.values()), gravity_m_s2=gravity)
        say("write report")
        write_compatibility(result, records, described, folder)
    print_compatibility(result, _console(), folder)


@app.command()
def response(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    window: Annotated[
        list[float], typer.Option(help="Length of the windows, s; several are combined (composite windowing).")
    ] = [10.0],  # noqa: B006 (typer reads it, nothing changes it)
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
) -> None:
    """Estimate the frequency responses of recorded flights with coherence and random error.

    All records of the description are taken together, inputs and outputs as it names them. Sweeps and multisines are
    what it is for. Example: `testbench response records/attas_short_period --window 5 --window 12`.
    """
    from testbench.checks import find
    from testbench.logs import load_description, read_records
    from testbench.pipeline import frequency_responses
    from testbench.report.response import print_response, write_response

    described = load_description(find(description, "identify"))
    folder = out / f"{described.name}_response"
    with _stages() as say:
        say("read records")
        records = [record for _, _, record in read_records(described, data)]
        say("estimate frequency responses")
        found = frequency_responses(described, records, window)
        say("write report")
        write_response(found, described, folder)
    print_response(found, _console(), folder)


@app.command()
def gap(
    case: Annotated[
        str | None, typer.Argument(help="The aircraft that is believed, or a gap case.", show_default=False)
    ] = None,
    records: Annotated[
        list[Path] | None,
        typer.Argument(help="Measured records (.nc) or descriptions of them (.toml).", show_default=False),
    ] = None,
    sensors: Annotated[
        str | None, typer.Option(help="Believed sensor suite; that of the records if not given.")
    ] = None,
    hold_out: Annotated[
        list[Path] | None, typer.Option("--hold-out", help="Record to judge on and not to name with; may be repeated.")
    ] = None,
    wings: Annotated[Wings, typer.Option(help="Whether the believed aircraft's elastic modes move.")] = Wings.flexible,
    airspeed: Annotated[float | None, typer.Option("--V", help="Airspeed at the start, m/s.")] = None,
    altitude: Annotated[float | None, typer.Option("--h", help="Altitude at the start, m.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the files that descriptions name.")] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Scenario: which effects could its manoeuvres tell apart, and what to add?")
    ] = None,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
) -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    Measured manoeuvres are held against the believed aircraft and sensors: `testbench gap eolo flown/*.nc --sensors
    eolo_gap --wings rigid --hold-out flown/doublets.nc`. A case makes its own flights from a hidden truth: `testbench
    gap flexible_wings`. The instruments are checked against each other first. Before flight, `testbench gap --plan
    eolo_alpha` says which effects the manoeuvres of a scenario could not tell apart.
    """
    from testbench.checks import find

    if plan is not None:
        _plan_gap(find(plan, "run"), out)
        return
    if case is None:
        raise RecordError("the aircraft that is believed must be named, with its records, or a gap case, got nothing")
    from testbench.gap.case import run_flights, run_gap
    from testbench.gap.records import load_flights
    from testbench.paths import aircraft_names
    from testbench.report import record_keeper
    from testbench.report.gap import print_gap, write_gap

    with _stages() as say:
        if records or case in aircraft_names():
            say("read records")
            held = hold_out or ()
            flights = load_flights(case, records or (), held, sensors, wings.value, airspeed, altitude, data)
            folder = out / f"gap_{case}"
            result = run_flights(case, flights, say)
        else:
            file = find(Path(case), "gap")
            folder = out / f"gap_{file.stem}"
            result = run_gap(file, seed, record_keeper(folder), say, check=True)
        say("write report")
        write_gap(result, folder)
    print_gap(result, _console(), folder)


def _plan_gap(file: Path, out: Path) -> None:
    from testbench.gap.plan import plan_gap
    from testbench.pipeline import load_scenario
    from testbench.report.gap_plan import print_gap_plan, write_gap_plan

    loaded = load_scenario(file)
    folder = out / f"gap_plan_{loaded.name}"
    with _stages() as say:
        planned = plan_gap(loaded, say)
        say("write report")
        write_gap_plan(planned, folder)
    print_gap_plan(planned, _console(), folder)


@app.command()
def design(scenario: ScenarioArgument, out: OutOption = Path("results"), seed: SeedOption = None) -> None:
    """Design the input that tells wanted parameters or modes through given sensors, inside given limits.

    Screens every signal family, refines the best by information, flies the winners, ranks them and says what to fly;
    writes scenarios ready for `testbench run` and the signals. Example: `testbench design eolo_modes`.
    """
    from testbench.checks import find
    from testbench.designer import load_design, run_design
    from testbench.report.design import print_design, write_design

    loaded = load_design(find(scenario, "design"))
    folder = out / f"design_{loaded.name}"
    with _stages() as say:
        result = run_design(loaded, seed, say)
        say("write report")
        write_design(result, folder)
    print_design(result, _console(), folder)


@app.command()
def compare(
    scenario: ScenarioArgument,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    information: Annotated[
        bool, typer.Option("--information", help="By Fisher information alone: nothing is flown.")
    ] = False,
) -> None:
    """Compare sensor suites over the same flights and noise: what each sensor buys, and what is more than chance.

    Says the same by information without simulation, and finds the best stations for sensors along the wing where the
    scenario has a `[placement]`. Examples: `testbench compare eolo_alpha`, `testbench compare eolo_wing`.
    """
    from testbench.checks import find
    from testbench.comparison.compare import compare as compare_suites
    from testbench.comparison.compare import load_compare
    from testbench.report.compare import print_compare, write_compare

    loaded = load_compare(find(scenario, "compare"))
    folder = out / f"compare_{loaded.name}"
    with _stages() as say:
        result = compare_suites(loaded, seed, not information, say)
        say("write report")
        write_compare(result, folder)
    print_compare(result, _console(), folder)


@app.command()
def plan(scenario: ScenarioArgument, out: OutOption = Path("results"), seed: SeedOption = None) -> None:
    """Turn test points and manoeuvres into a campaign: build-up, flight cards, repeats, times, energy, scripts.

    Every card is flown in the simulator first. Example: `testbench plan eolo_envelope`: 11 to 19 m/s towards flutter.
    """
    from testbench.checks import find
    from testbench.design.plan import load_plan, make_plan
    from testbench.evaluation.envelope import fly_envelope
    from testbench.report.plan import print_plan, write_plan

    loaded = load_plan(find(scenario, "plan"))
    loaded = loaded if seed is None else loaded.model_copy(update={"seed": seed})
    folder = out / f"plan_{loaded.name}"
    with _stages() as say:
        result = make_plan(loaded, fly_envelope, say)
        say("write cards and report")
        write_plan(result, folder)
    print_plan(result, _console(), folder)


@app.command()
def reproduce(
    what: Annotated[str, typer.Argument(help="taurus, eolo, b1 or all.")] = "all",
    out: OutOption = Path("results"),
) -> None:
    """Reproduce the papers' figures and tables, and set every printed number beside ours.

    Writes tables, figures and one page, index.html, into `reproduction`, or `reproduction_NAME` for one aircraft alone.
    Example: `testbench reproduce taurus`.
    """
    from testbench.reproduction.chapters import chosen
    from testbench.reproduction.chapters import reproduce as run_reproduction
    from testbench.reproduction.write import open_folder, print_reproduction, write_reproduction

    chosen(what)
    folder = open_folder(out / ("reproduction" if what == "all" else f"reproduction_{what}"))
    with _stages() as say:
        chapters = run_reproduction(what, say)
        say("write page")
        write_reproduction(chapters, folder)
    print_reproduction(chapters, _console(), folder)


@app.command()
def aircraft(
    name: Annotated[str, typer.Argument(help="Aircraft; see `testbench list aircraft`.", show_default=False)],
    wings: Annotated[Wings, typer.Option(help="Let the elastic modes move, or hold them.")] = Wings.flexible,
    out: OutOption = Path("results"),
    export: Annotated[
        Path | None, typer.Option(help="Write the model for its design condition here as plain JSBSim XML.")
    ] = None,
) -> None:
    """Trim an aircraft over its speed range and show its modes, frequency responses and derivatives.

    Example: `testbench aircraft eolo --export root/aircraft` also writes a model that stock JSBSim loads from `root`.
    """
    from testbench.aircraft import load_aircraft
    from testbench.evaluation.envelope import survey
    from testbench.report.aircraft import export_aircraft, folder_name, print_aircraft, write_aircraft

    loaded = load_aircraft(name, wings.value)
    folder = out / folder_name(loaded, name)
    with _stages() as say:
        say("trim and linearise over speed")
        found = survey(loaded, name)
        say("write report")
        write_aircraft(found, folder)
        exported = export_aircraft(found, export) if export is not None else []
    print_aircraft(found, _console(), folder)
    if exported:
        print(f"Model: {exported[0]}")


@app.command()
def check(
    scenarios: Annotated[list[Path], typer.Argument(help="Scenario files or names.", show_default=False)],
) -> None:
    """Report every fault of scenario files at once, with file, key, law and value, without flying."""
    from testbench.checks import check_file

    faults: list[str] = []
    for scenario in scenarios:
        try:
            kind = check_file(scenario)
            _console().print(f"{scenario}: a valid {kind}", highlight=False)
        except ScenarioError as error:
            faults.extend(error.faults)
        except TestbenchError as error:
            faults.append(str(error))
    if faults:
        raise ScenarioError(faults)


@app.command()
def studio(
    aircraft: Annotated[list[str] | None, typer.Argument(help="Aircraft; all if none is named.")] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write the page to this file instead; it needs no server.", show_default=False)
    ] = None,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any that is free.")] = 8700,
) -> None:
    """Serve the interactive page: drag an input, see its spectrum, the response and what could be known from it.

    The page answers on 127.0.0.1 only, until Ctrl-C. Example: `testbench studio eolo`.
    """
    from testbench.studio.models import studio_models
    from testbench.studio.page import studio_page
    from testbench.studio.serve import HOST, serving

    with _stages() as say:
        page = studio_page(studio_models(aircraft or (), say))
    if write is not None:
        write.parent.mkdir(parents=True, exist_ok=True)
        write.write_text(page, encoding="utf-8")
        print(f"Written: {write}")
        return
    with serving(page, port) as server:
        print(f"Open http://{HOST}:{server.server_port}/ in a browser; Ctrl-C ends.", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("Ended.")


@app.command("list")
def list_(kind: Annotated[Kind, typer.Argument(help="What to list.", show_default=False)]) -> None:
    """List what a scenario may name: aircraft, inputs, sensors (suites), estimators, scenarios, effects."""
    from rich.table import Table

    from testbench.checks import describe

    table = Table(box=None, pad_edge=False)
    rows = describe(kind.value)
    for head in rows[0]:
        table.add_column(head, overflow="fold")
    for row in rows[1:]:
        table.add_row(*row)
    _console().print(table)


CampaignArgument = Annotated[
    Path, typer.Argument(help="Campaign file, or the name of a packaged one.", show_default=False)
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Processes on this machine; one per processor if not given.")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(help="Fly on the workers of this dask scheduler, e.g. tcp://host:8786, and not on this machine."),
]


@campaigns.command("run")
def campaign_run(
    campaign: CampaignArgument,
    out: OutOption = Path("results"),
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Fly a new campaign and write its store, tables, figures and report.html.

    Example: `testbench campaign run taurus_scatter --workers 2`. What is interrupted, `campaign resume` goes on with.
    """
    _fly_campaign(campaign, out, False, workers, scheduler)


@campaigns.command("resume")
def campaign_resume(
    campaign: CampaignArgument,
    out: OutOption = Path("results"),
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Go on with a campaign that was interrupted, or that has been given more runs; nothing finished is flown again."""
    _fly_campaign(campaign, out, True, workers, scheduler)


@campaigns.command("status")
def campaign_status(campaign: CampaignArgument, out: OutOption = Path("results")) -> None:
    """Say how far a campaign is, what failed, and what a million runs like it would cost; also while it flies."""
    from testbench.campaign import Store, load_campaign
    from testbench.checks import find
    from testbench.report.campaign import print_campaign, read_campaign

    loaded = load_campaign(find(campaign, "campaign"))
    with Store.read(out / f"campaign_{loaded.spec.name}") as store:
        print_campaign(read_campaign(loaded, store), _console())


@campaigns.command("summarise")
def campaign_summarise(campaign: CampaignArgument, out: OutOption = Path("results")) -> None:
    """Write tables, figures and report.html from the runs that are finished; nothing is flown."""
    from testbench.campaign import load_campaign
    from testbench.checks import find

    loaded = load_campaign(find(campaign, "campaign"))
    _report_campaign(loaded, out / f"campaign_{loaded.spec.name}")


def _fly_campaign(campaign: Path, out: Path, resume: bool, workers: int | None, scheduler: str | None) -> None:
    from rich.console import Console

    from testbench.campaign import fly_campaign, load_campaign
    from testbench.checks import find
    from testbench.report.campaign import show_progress

    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give either --workers or --scheduler: a cluster brings its own workers")
    loaded = load_campaign(find(campaign, "campaign"))
    folder = out / f"campaign_{loaded.spec.name}"
    try:
        with show_progress(Console(stderr=True)) as progress:
            fly_campaign(loaded, folder, resume=resume, workers=workers, scheduler=scheduler, progress=progress)
    except KeyboardInterrupt:
        print(f"finished runs are kept; go on with: testbench campaign resume {campaign} --out {out}", file=sys.stderr)
        raise
    _report_campaign(loaded, folder)


def _report_campaign(campaign: Campaign, folder: Path) -> None:
    from testbench.campaign import Store
    from testbench.report.campaign import print_campaign, read_campaign, write_campaign

    with Store.read(folder) as store:
        result = read_campaign(campaign, store)
    write_campaign(result, folder)
    print_campaign(result, _console(), folder)


KeyOption = Annotated[
    Path | None,
    typer.Option(
        help="File with the teacher's own key; else TESTBENCH_EXERCISE_KEY, else a public one.", dir_okay=False
    ),
]


@exercises.command("list")
def exercise_list() -> None:
    """List the exercises with level and time."""
    from testbench.exercises.show import print_list

    print_list(_console())


@exercises.command("start")
def exercise_start(
    name: Annotated[str, typer.Argument(help="Exercise; see `testbench exercise list`.", show_default=False)],
    student: Annotated[str, typer.Option(help="Name or number: each student gets another truth.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="New folder; NAME_STUDENT if not given.", show_default=False)
    ] = None,
    key_file: KeyOption = None,
) -> None:
    """Write a student's own version: text, records, and a template for the answers.

    Example: `testbench exercise start short_period --student anna`. With a key of the teacher's own (--key-file) only
    who has it can check or compute the truth.
    """
    from testbench.exercises.seal import read_key
    from testbench.exercises.show import print_started
    from testbench.exercises.start import start

    print_started(start(name, student, read_key(key_file), out), _console())


@exercises.command("check")
def exercise_check(
    folders: Annotated[list[Path], typer.Argument(help="Folder that `start` wrote; or several.", show_default=False)],
    key_file: KeyOption = None,
) -> None:
    """Judge answers.toml: what is right, what is off by how much, and why. Exit status 1 if not all answers are right.

    Of several folders, one line each is printed. Example: `testbench exercise check short_period_anna`.
    """
    from testbench.exercises.check import Result, check_class
    from testbench.exercises.check import check as check_answers
    from testbench.exercises.seal import read_key
    from testbench.exercises.show import print_class, print_result

    key = read_key(key_file)
    if len(folders) == 1:
        result = check_answers(folders[0], key)
        print_result(result, _console(), folders[0])
        passed = result.passed
    else:
        results = check_class(folders, key)
        print_class(results, _console())
        passed = all(isinstance(r, Result) and r.passed for r in results.values())
    if not passed:
        raise typer.Exit(1)


def _console() -> Any:
    from rich.console import Console

    return Console()


@contextmanager
def _stages() -> Iterator[Callable[[str], None]]:
    """Show the stage that is running: a spinner with the time elapsed on a terminal, plain lines elsewhere."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: print(f"... {text}", file=sys.stderr, flush=True)
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console, transient=True
    ) as progress:
        task = progress.add_task("start", total=None)
        yield lambda text: progress.update(task, description=text)


def main() -> None:
    """Run the command line; turn every error raised on purpose into one message and an exit status."""
    # Before numpy is imported: for matrices this small, threads cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        status = app(prog_name="testbench", standalone_mode=False)
    except _UsageError as error:
        _say_usage(error)
        sys.exit(2)
    except TestbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except OSError as error:
        print(f"error: cannot read or write {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(3)
    if status == _INTERRUPTED:
        print("interrupted; what was written so far is kept", file=sys.stderr)
    if status:
        sys.exit(status)


def _say_usage(error: Any) -> None:
    """Say in one line what is wrong with a command."""
    if type(error).__name__ == "NoArgsIsHelpError":  # nothing but a group's name: its help has been printed
        return
    command = error.ctx.command_path if error.ctx is not None else "testbench"
    message = " ".join(error.format_message().split()).replace("Value error, ", "").rstrip(".")
    print(f"error: {message}; see `{command} --help`", file=sys.stderr)
