"""The command line: parse, call one function, print. Everything heavy is imported inside the command that needs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from testbench.errors import ScenarioError, TestbenchError

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
    testbench gap flexible_wings          # find, name and add what the simulation lacks
    testbench aircraft eolo               # trims, modes over speed, derivatives of an aircraft

Exit status: 0 done, 2 bad input, 3 the computation cannot be carried out (no trim, flight aborted, not identifiable).
""",
)

ScenarioArgument = Annotated[
    Path, typer.Argument(help="Scenario file, or the name of a packaged one.", show_default=False)
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder that gets one folder of results per scenario.")]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Replaces the seed of the scenario.")]


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


@app.command()
def gap(scenario: ScenarioArgument, out: OutOption = Path("results"), seed: SeedOption = None) -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    Example: `testbench gap flexible_wings`: the model holds the wings rigid, the measured aircraft does not.
    """
    from testbench.checks import find
    from testbench.gap.case import run_gap
    from testbench.report import record_keeper
    from testbench.report.gap import print_gap, write_gap

    file = find(scenario, "gap")
    folder = out / f"gap_{file.stem}"
    with _stages() as say:
        result = run_gap(file, seed, record_keeper(folder), say)
        say("write report")
        write_gap(result, folder)
    print_gap(result, _console(), folder)


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
        app()
    except TestbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except OSError as error:
        print(f"error: cannot read or write {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(3)
    except KeyboardInterrupt:
        print("interrupted; what was written so far is kept", file=sys.stderr)
        sys.exit(130)
