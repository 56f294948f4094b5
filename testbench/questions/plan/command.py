"""The command ``testbench plan``."""

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
    """Turn test points and manoeuvres into a campaign: build-up, flight cards, repeats, times, energy, scripts.

    Every card is flown in the simulator first. Example: `testbench plan eolo_envelope` plans 11 to 19 m/s towards
    flutter.
    """
    from testbench.questions.files import find
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.plan.page import plan_page
    from testbench.questions.plan.scenario import PlanScenario

    loaded = PlanScenario.load(find(scenario, "plan"))
    loaded = loaded if seed is None else loaded.model_copy(update={"seed": seed})
    folder = out / f"plan_{loaded.name}"
    with stages() as say:
        result = make_plan(loaded, progress=say, simulator=simulator.value)
        say("write cards and report")
        page = plan_page(result)
        page.write(folder)
    page.show(console(), folder)
