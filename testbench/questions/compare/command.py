"""The command ``testbench compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.questions.compare.benchmark.command import benchmark
from testbench.questions.options import (
    ByDefault,
    FlownBy,
    OutOption,
    ScenarioArgument,
    SeedOption,
    SimulatorOption,
    answering,
    with_figures,
)

command = typer.Typer(
    no_args_is_help=True,
    cls=ByDefault.first("suites"),
    help="Compare sensor suites over the same flights and noise, or methods on a packaged benchmark.",
)


@command.command("suites")
@with_figures
def suites(
    scenario: ScenarioArgument,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    information: Annotated[
        bool, typer.Option("--information", help="Compare by Fisher information alone, without flights.")
    ] = False,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Compare sensor suites over the same flights and noise: the gain of each sensor, and whether it is significant.

    `testbench compare SCENARIO` is `testbench compare suites SCENARIO`. Fisher information answers the same
    question without simulation. If the scenario has a `[placement]`, the command also finds the best stations for
    sensors along the wing. Examples: `testbench compare eolo_alpha`, `testbench
    compare eolo_wing`.
    """
    from testbench.core.named import obtain
    from testbench.questions.compare.ask import compare
    from testbench.questions.compare.scenario import CompareScenario

    loaded = obtain(CompareScenario, scenario)
    with answering(out, f"compare_{loaded.name}") as a:
        a.found = compare(loaded, seed, not information, a.say, simulator.value)


command.command("benchmark")(benchmark)
