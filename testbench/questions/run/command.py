"""The command ``testbench run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import AircraftOption, OutOption, ScenarioArgument, SeedOption, with_figures

SeedsOption = Annotated[
    int | None, typer.Option("--seeds", min=1, max=1000, help="Repetitions, instead of those in the scenario.")
]


@with_figures
def command(
    scenario: ScenarioArgument,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    aircraft: AircraftOption = None,
    seeds: SeedsOption = None,
) -> None:
    """Fly a scenario, measure it, identify models and judge them; write records, tables, models and report.html.

    Example: `testbench run eolo_alpha` shows the gain of an angle-of-attack vane; `testbench run mine.toml --aircraft
    mine_amended` flies another aircraft.
    """
    from testbench.core.named import obtain
    from testbench.core.record import FlightAborted
    from testbench.core.store import ResultFolder, folder_in
    from testbench.page.page import Page, record_keeper
    from testbench.questions.run.ask import run
    from testbench.questions.run.page import run_page
    from testbench.questions.run.scenario import Scenario

    loaded = obtain(Scenario, scenario)
    if aircraft is not None:
        loaded = loaded.with_aircraft(aircraft)
    if seeds is not None:
        loaded = loaded.model_copy(update={"seeds": seeds}).at(loaded.file)
    with ResultFolder(folder_in(out, loaded.name)) as place, stages() as say:
        page: Page | FlightAborted
        try:
            result = run(loaded, seed, record_keeper(place), say)
        except FlightAborted as error:  # its records show why: they are the result
            page = error
        else:
            say("write report")
            page = run_page(result)
            page.write(place)
    if isinstance(page, FlightAborted):
        raise page
    page.show(console(), place.path)
