"""The command ``testbench aircraft``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import OutOption, ShowByDefault, Wings, refuse

command = typer.Typer(
    cls=ShowByDefault,
    no_args_is_help=True,
    help="Show an aircraft: any JSBSim model, packaged, your own, or one that ships with JSBSim.",
)


@command.command()
def show(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Packaged aircraft, or a folder of your own.", show_default=False)],
    wings: Annotated[
        Wings, typer.Option(help="Whether the elastic modes move (flexible) or are held (rigid).")
    ] = Wings.flexible,
    out: OutOption = Path("results"),
    export: Annotated[
        Path | None,
        typer.Option(help="Write only the model, as plain JSBSim XML for its design condition, into this folder."),
    ] = None,
) -> None:
    """Trim an aircraft over its speed range and show its modes, frequency responses and derivatives.

    Example: `testbench aircraft eolo --export root/aircraft` only writes a model that stock JSBSim loads from `root`.
    """
    from testbench.aircraft import load_aircraft
    from testbench.questions.aircraft.ask import survey
    from testbench.questions.aircraft.export import export_aircraft
    from testbench.questions.aircraft.page import aircraft_page, folder_name

    loaded = load_aircraft(name, wings.value)
    name = Path(name).name  # of the folder, where a path is given
    if export is not None:
        refuse(context, "with --export, which writes the model alone", "out")
        print(f"Model: {export_aircraft(loaded, name, export)[0]}")
        return
    folder = out / folder_name(loaded, name)
    with stages() as say:
        say("trim and linearise over speed")
        found = survey(loaded, name)
        say("write report")
        page = aircraft_page(found)
        page.write(folder)
    page.show(console(), folder)
