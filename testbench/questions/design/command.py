"""The command ``testbench design``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.questions.options import (
    AircraftOption,
    FlownBy,
    OutOption,
    ScenarioArgument,
    SeedOption,
    SimulatorOption,
    answering,
    with_figures,
)

AfterOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--after",
        help="Previous flights: folder of plan close, identify or run, or a file of its models/; once or more.",
        show_default=False,
    ),
]


@with_figures
def command(
    scenario: ScenarioArgument,
    after: AfterOption = None,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    aircraft: AircraftOption = None,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Design the input that determines wanted parameters or modes with given sensors, within given limits.

    The command screens every signal family, refines the best ones by information, flies them, ranks them and recommends
    one. It writes the signals, and scenarios ready for `testbench run`. Example: `testbench design eolo_modes`. With
    --after the next input is designed for the parameters that earlier flights left uncertain: `testbench design
    mine.toml --after results/close_mine`. Another aircraft than the scenario's: `testbench design eolo_short_period
    --aircraft mine`.
    """
    from testbench.core.named import obtain
    from testbench.questions.design.ask import run_design
    from testbench.questions.design.known import AllKnown, known_after
    from testbench.questions.design.page import nothing_page
    from testbench.questions.design.scenario import DesignScenario

    loaded = obtain(DesignScenario, scenario)
    if aircraft is not None:
        loaded = loaded.with_aircraft(aircraft)
    name = f"design_{loaded.name}{f'_after_{len(after)}' if after else ''}"  # plans refer to the design before
    flown = known_after(after, loaded.condition.V_m_s) if after else None
    with answering(out, name) as a:
        try:
            a.found = run_design(loaded, seed, a.say, simulator.value, flown)
        except AllKnown as nothing:
            a.found = nothing_page(loaded, nothing)
