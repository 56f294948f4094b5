"""The command ``testbench global``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, with_figures


@with_figures
def command(
    flights: Annotated[
        list[Path],
        typer.Argument(
            help="Flights of one aircraft: descriptions of recorded flights (TOML), folders that import wrote, records "
            "(.nc), or logs.",
            show_default=False,
        ),
    ],
    aircraft: Annotated[
        str | None,
        typer.Option(
            help="Model of the aircraft that flew: mass, inertia, geometry, engines.", show_default="the descriptions'"
        ),
    ] = None,
    hold_out: Annotated[
        list[str] | None, typer.Option("--hold-out", help="Name of a flight for validation, which is not fitted.")
    ] = None,
    out: OutOption = Path("results"),
    data: DataOption = None,
    amend: Annotated[
        str | None,
        typer.Option(help="Write the functions, inside the flown domain, into a new aircraft, aircraft/NAME."),
    ] = None,
) -> None:
    """Identify the coefficients of an aircraft as functions of its state, from many flights over its envelope.

    Lift, drag, side force and three moments become functions of flow angles, rates, deflections and speed; they may be
    nonlinear in alpha. Terms are chosen by evidence and validated on held-out flights. Outside the flown domain there
    is no value. Example: `testbench global log*.nc --aircraft jsbsim:T38 --amend t38_flown`.
    """
    from testbench.core.errors import ScenarioError
    from testbench.core.store import ResultFolder, folder_in
    from testbench.flight import load_aircraft
    from testbench.questions.global_model.amend import amend as write_amended
    from testbench.questions.global_model.ask import flights_of, global_model
    from testbench.questions.global_model.page import global_page
    from testbench.questions.identify.amend.folder import folder_of

    read = [flights_of(path, data) for path in flights]
    described = [d for _, d in read if d is not None]
    named = list(dict.fromkeys(d.aircraft for d in described if d.aircraft)) if aircraft is None else [aircraft]
    if len(named) != 1:
        raise ScenarioError(
            f"a global model is that of one aircraft, got {', '.join(named) or 'none'}; say which with --aircraft"
        )
    if amend is not None:
        folder_of(amend, named[0])
    std = {n: s for d in described for n, s in d.instrument_std.items()}
    every = [flight for found, _ in read for flight in found]
    loaded = load_aircraft(named[0])
    with ResultFolder(folder_in(out, f"global_{loaded.name}")) as place, stages() as say:
        found = global_model(every, loaded, hold_out=hold_out or (), instrument_std=std, progress=say)
        if amend is not None:
            say("write the aircraft")
            found = write_amended(found, amend, named[0])
        say("write report")
        page = global_page(found)
        page.write(place)
    page.show(console(), place.path)
