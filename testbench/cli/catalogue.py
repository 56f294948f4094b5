"""What there is, and whether it is right: aircraft, check, list."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.app import OutOption, Wings, app, console, stages
from testbench.errors import ScenarioError, TestbenchError


class Kind(str, Enum):
    """What `testbench list` can list."""

    aircraft = "aircraft"
    inputs = "inputs"
    sensors = "sensors"
    estimators = "estimators"
    scenarios = "scenarios"
    effects = "effects"


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
    with stages() as say:
        say("trim and linearise over speed")
        found = survey(loaded, name)
        say("write report")
        write_aircraft(found, folder)
        exported = export_aircraft(found, export) if export is not None else []
    print_aircraft(found, console(), folder)
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
            console().print(f"{scenario}: a valid {kind}", highlight=False)
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
    console().print(table)
