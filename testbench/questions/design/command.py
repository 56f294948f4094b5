"""The command ``testbench design``."""

from __future__ import annotations

from pathlib import Path

from testbench.page.terminal import console, stages
from testbench.questions.options import FlownBy, OutOption, ScenarioArgument, SeedOption, SimulatorOption


def command(
    scenario: ScenarioArgument,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Design the input that tells wanted parameters or modes through given sensors, inside given limits.

    The command screens every signal family, refines the best ones by information, flies them, ranks them and says what
    to fly. It writes the signals, and scenarios ready for `testbench run`. Example: `testbench design eolo_modes`.
    """
    from testbench.questions.design.ask import run_design
    from testbench.questions.design.page import design_page
    from testbench.questions.design.scenario import DesignScenario
    from testbench.questions.files import find

    loaded = DesignScenario.load(find(scenario, "design"))
    folder = out / f"design_{loaded.name}"
    with stages() as say:
        result = run_design(loaded, seed, say, simulator.value)
        say("write report")
        page = design_page(result)
        page.write(folder)
    page.show(console(), folder)
