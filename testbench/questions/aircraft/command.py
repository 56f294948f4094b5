"""The command ``testbench aircraft``."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.aircraft.flexible.command import flexible
from testbench.questions.aircraft.new import new
from testbench.questions.options import ByDefault, OutOption, Wings, answering, with_figures

command = typer.Typer(
    cls=ByDefault.first("show"),
    no_args_is_help=True,
    help="Show an aircraft: any JSBSim model, packaged, your own, or one that ships with JSBSim.",
)


class Point(StrEnum):
    """Where commands enter an aircraft."""

    stick = "stick"
    surface = "surface"


CommandedAtOption = Annotated[
    Point | None,
    typer.Option(
        "--commanded-at",
        help="Where commands enter: at the stick, with the model's own control law, or at the surface, without it.",
        show_default=False,
    ),
]
command.command("flexible")(flexible)

command.command("new")(new)


@command.command()
@with_figures
def show(
    name: Annotated[
        str,
        typer.Argument(
            help="Packaged aircraft, a JSBSim model (XML file, folder, or one that comes with JSBSim: jsbsim:c172p), "
            "or a folder of your own.",
            show_default=False,
        ),
    ],
    wings: Annotated[
        Wings, typer.Option(help="Whether the elastic modes move (flexible) or are held (rigid).")
    ] = Wings.flexible,
    speed: Annotated[
        float | None,
        typer.Option("--speed", min=0.1, help="Speed of modes and derivatives, m/s; the design speed if not given."),
    ] = None,
    commanded_at: CommandedAtOption = None,
    out: OutOption = Path("results"),
) -> None:
    """Trim an aircraft over its speed range and show its modes, frequency responses and derivatives."""
    from testbench.flight import FlightCondition, load_aircraft, trim
    from testbench.questions.aircraft.ask import survey
    from testbench.questions.aircraft.page import folder_name

    loaded = load_aircraft(name, wings.value, commanded_at=None if commanded_at is None else commanded_at.value)
    name = loaded.name.removesuffix(", rigid wings")
    with answering(out, folder_name(loaded, name)) as a:
        a.say("trim and linearise over speed")
        if speed is not None:
            trim(loaded, FlightCondition(speed, loaded.design_h_m))  # or says why it cannot be flown
            loaded = replace(loaded, design_V_m_s=speed)
        a.found = survey(loaded, name)


@command.command("adopt")
@with_figures
def adopt_command(
    path: Annotated[
        str, typer.Argument(help="JSBSim model: XML file, folder, or one that comes with JSBSim.", show_default=False)
    ],
    folder: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the aircraft; aircraft/NAME if not given.")
    ] = None,
    speed: Annotated[float | None, typer.Option("--speed", min=0.1, help="Design speed, m/s.")] = None,
    height: Annotated[float | None, typer.Option("--height", help="Design altitude above sea level, m.")] = None,
    commanded_at: CommandedAtOption = Point.stick,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair", help="Repair faults that JSBSim refuses: functions of one name, missing files of systems."
        ),
    ] = False,
    report: Annotated[Path, typer.Option("--report", help="Folder for the page.")] = Path("results"),
) -> None:
    """Make a JSBSim model your own: probe its controls, find its trims, and write these to an aircraft.toml.

    Example: `testbench aircraft adopt models/plane.xml -o aircraft/plane`, then `aircraft = "plane"` in any scenario.
    """
    from testbench.core.paths import STOCK, stock_names, stock_root
    from testbench.core.store import folder_in
    from testbench.flight import load_aircraft
    from testbench.flight.load import adopted_at, by_stick
    from testbench.questions.aircraft.adopt import write_adopted
    from testbench.questions.aircraft.ask import survey
    from testbench.questions.aircraft.page import adopted_page

    model, root = Path(path), stock_root()
    if not model.exists() and root is not None and path.removeprefix(STOCK) in stock_names():
        model = root / "aircraft" / path.removeprefix(STOCK)
    with stages() as say:
        say("start the model and probe its controls")
        found = adopted_at(model, speed, height, repair)
        if commanded_at == Point.stick:
            found = by_stick(found)
        place = folder if folder is not None else Path("aircraft") / found.aircraft.name
        write_adopted(found, place)
        say("trim and linearise over speed")
        loaded = load_aircraft(str(place))
        page = adopted_page(found, survey(loaded, loaded.name), place)
        say("write report")
        where = folder_in(report, f"aircraft_{loaded.name}")
        page.write(where)
    page.show(console(), where)
