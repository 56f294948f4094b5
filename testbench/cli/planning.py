"""Commands before the flight: design, compare, plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.app import OutOption, ScenarioArgument, SeedOption, app, console, stages


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
    with stages() as say:
        result = run_design(loaded, seed, say)
        say("write report")
        write_design(result, folder)
    print_design(result, console(), folder)


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
    with stages() as say:
        result = compare_suites(loaded, seed, not information, say)
        say("write report")
        write_compare(result, folder)
    print_compare(result, console(), folder)


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
    with stages() as say:
        result = make_plan(loaded, fly_envelope, say)
        say("write cards and report")
        write_plan(result, folder)
    print_plan(result, console(), folder)
