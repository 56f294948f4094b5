"""The commands ``testbench plan``, ``plan new`` and ``plan close``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from testbench.core.errors import RecordError
from testbench.page.terminal import stages
from testbench.questions.options import (
    ByDefault,
    FlownBy,
    OutOption,
    SeedOption,
    SimulatorOption,
    UsageError,
    answering,
    with_figures,
)

command = typer.Typer(
    cls=ByDefault.first("show"),
    no_args_is_help=True,
    help="Turn test points and manoeuvres into a campaign: build-up, flight cards, repeats, times, energy, scripts.",
)
FromOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--from", help="Folder of a design (its best is used), or one file of its designs/; once or more.",
        show_default=False,
    ),
]  # fmt: skip
SuiteOption = Annotated[str | None, typer.Option(help="Sensors: a packaged suite, or a file.", show_default=False)]


class FlownWith(str, Enum):
    """Who flies the cards of a new plan."""

    ardupilot = "ardupilot"
    px4 = "px4"
    own = "own"
    pilot = "pilot"


AutopilotOption = Annotated[
    FlownWith | None, typer.Option(help="Who flies the cards. Default: as designed, or ardupilot.", show_default=False)
]


@command.command()
@with_figures
def show(
    scenario: Annotated[
        Path | None, typer.Argument(help="Plan file, or the name of a packaged one.", show_default=False)
    ] = None,
    designs: FromOption = None,
    out: OutOption = Path("results"),
    seed: SeedOption = None,
    simulator: SimulatorOption = FlownBy.auto,
    after: Annotated[
        Path | None,
        typer.Option(help="Folder of testbench modes: speeds cleared by flights of slower points.", show_default=False),
    ] = None,
) -> None:
    """Turn test points and manoeuvres into a campaign: build-up, flight cards, repeats, times, energy, scripts.

    Every card is flown in the simulator first. Example: `testbench plan eolo_envelope` plans 11 to 19 m/s towards
    flutter; with `--after results/x_modes` its cards state the speeds that records of slower flights cleared.
    `testbench plan --from results/design_x` uses a design: it writes the plan file and plans it.
    """
    from testbench.questions.files import find
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.plan.result import read_cleared
    from testbench.questions.plan.scenario import PlanScenario

    if (scenario is None) == (not designs):
        raise UsageError("give either a plan file or --from with a design")
    file = find(scenario, "plan") if scenario is not None else _taken_over(designs or [], out)
    loaded = PlanScenario.load(file)
    loaded = loaded if seed is None else loaded.model_copy(update={"seed": seed})
    with answering(out, f"plan_{loaded.name}", "write cards and report") as a:
        cleared = None if after is None else read_cleared(after)
        a.found = make_plan(loaded, progress=a.say, simulator=simulator.value, cleared=cleared)
    if scenario is None:
        print(f"Plan: {file}")


def _taken_over(designs: list[Path], out: Path) -> Path:
    """Write the plan of designs into the folder of results; return its path. A plan that lies there is kept."""
    from testbench.core.store import ResultFolder, folder_in

    first = designs[0].resolve()
    stem = (first if first.is_dir() else first.parent.parent).name.removeprefix("design_")
    folder = folder_in(out, f"plan_{stem}")
    file = folder / f"{stem}.toml"
    if file.exists():
        raise RecordError(
            f"a plan taken from a design must go to a new file, but '{file}' is there: edit it and run testbench plan "
            f"{file}, or give another folder with -o"
        )
    place = ResultFolder(folder)
    try:
        return _write(place.live(file.name), None, designs, None, None)  # live: it is the user's to edit from now on
    finally:
        place.leave()


def _write(
    file: Path, aircraft: str | None, designs: list[Path], autopilot: FlownWith | None, suite: str | None
) -> Path:
    """Write a new plan file and return its path."""
    from testbench.flight import load_aircraft
    from testbench.questions.files import write_to_edit
    from testbench.questions.plan.new import plan_text, take
    from testbench.sensors import load_suite

    taken = take(designs)
    if suite is not None:
        load_suite(suite)
    name = aircraft if aircraft is not None else taken[0].scenario.aircraft
    wings = taken[0].scenario.wings if taken else "flexible"
    if autopilot is None:
        by_hand = any(t.asked is not None and t.asked.by == "pilot" for t in taken)
        autopilot = FlownWith.pilot if by_hand else FlownWith.ardupilot
    text = plan_text(load_aircraft(name, wings), name, autopilot.value, suite, taken)
    return write_to_edit(file, text, "flight plan", "a new plan")


@command.command()
def new(
    aircraft: Annotated[
        str | None,
        typer.Argument(help="Packaged aircraft, or a folder of your own; that of the design if left out.",
                       show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; plan_NAME.toml if not given.")
    ] = None,
    designs: FromOption = None,
    autopilot: AutopilotOption = None,
    suite: SuiteOption = None,
) -> None:  # fmt: skip
    """Write a complete commented plan file for an aircraft, to edit and plan.

    Example: `testbench plan new taurus -o my_plan.toml`, then `testbench plan my_plan.toml`. With --from the manoeuvres
    are those of a design.
    """
    if aircraft is None and not designs:
        raise UsageError("give an aircraft, or --from with a design")
    stem = Path(aircraft).name if aircraft is not None else (designs or [Path()])[0].resolve().name
    file = out if out is not None else Path(f"plan_{stem.replace(':', '_').removeprefix('design_')}.toml")
    _write(file, aircraft, designs or [], autopilot, suite)
    print(f"Plan: {file}")
    print(f"Next: change the lines with YOURS, then testbench plan {file}")


@command.command()
def rehearse(
    scenario: Annotated[Path, typer.Argument(help="Plan file, or the name of a packaged one.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the logs.")] = Path("logs"),
    aircraft: Annotated[
        str | None,
        typer.Option(help="Aircraft that flies, instead of the plan's: one that differs from the a-priori model."),
    ] = None,
    seed: SeedOption = None,
    drawn: Annotated[
        int | None,
        typer.Option("--drawn", min=0, help="Draw the aircraft that flies from its uncertainty, with this seed."),
    ] = None,
) -> None:
    """Fly the runs of a plan in the simulator, in its turbulence and through its sensors, and write a log per flight.

    Example: `testbench plan rehearse my_plan.toml`, then `testbench plan close my_plan.toml logs/*.csv`.
    """
    from testbench.core.named import obtain
    from testbench.core.project import remember
    from testbench.core.store import ResultFolder
    from testbench.flight import load_aircraft
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.plan.rehearse import as_drawn
    from testbench.questions.plan.rehearse import rehearse as fly_all
    from testbench.questions.plan.scenario import PlanScenario

    loaded = obtain(PlanScenario, scenario)
    with stages() as say, ResultFolder(out, adds=f"{loaded.name}_flight_*.csv") as place:  # others may lie there, too
        plan = make_plan(loaded, progress=say)
        other = None if aircraft is None else load_aircraft(aircraft, loaded.wings)
        if drawn is not None:
            other = as_drawn(plan, other or plan.aircraft, drawn, say)
        logs = fly_all(plan, other, loaded.seed if seed is None else seed, say)
        files = [r.save_csv(place.new / f"{loaded.name}_flight_{k}.csv").name for k, r in logs.items()]
    for name in files:
        print(f"Log: {out / name}")
    remember(out, f"rehearsed: {', '.join(files)}")
    print(f"Next: testbench plan close {loaded.file} {out}/{loaded.name}_flight_*.csv")


@command.command()
@with_figures
def close(
    scenario: Annotated[Path, typer.Argument(help="Plan file, or the name of a packaged one.", show_default=False)],
    logs: Annotated[list[Path], typer.Argument(help="Logs of its flights.", show_default=False)],
    out: OutOption = Path("results"),
    throw: Annotated[
        list[str] | None, typer.Option(help="Deflection at full command, deg, e.g. de=20; the aircraft's if left out.")
    ] = None,
) -> None:
    """Compare a plan with the logs of its flights: promised, realised and flown errors, and the runs to repeat.

    Runs are found by the recorded commands and compared with the expected response of their cards. Those of a card are
    identified together, by the estimator of its design. Records are written to records/, descriptions for `testbench
    identify` to identify/. Example: `testbench plan close my_plan.toml flight_1.bin flight_2.bin`.
    """
    from testbench.core.named import obtain
    from testbench.questions.importing.ask import import_log, parse_throws
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.plan.close import close_plan
    from testbench.questions.plan.close_page import close_page
    from testbench.questions.plan.flown_card import identify_cards
    from testbench.questions.plan.scenario import PlanScenario
    from testbench.questions.plan.verdicts import judge, keep_errors

    loaded = obtain(PlanScenario, scenario)
    with answering(out, f"close_{loaded.name}") as a:
        plan = make_plan(loaded, progress=a.say)
        full = {c: control.full for c, control in plan.aircraft.controls.items() if c != "thr"}
        a.say("read the logs and find the runs")
        records = [(log.name, import_log(log, throw_rad={**full, **parse_throws(throw or [])}).record) for log in logs]
        closed = close_plan(plan, records)
        campaign = judge(closed, identify_cards(closed, a.place.new, a.say))
        keep_errors(campaign)
        a.found = close_page(campaign)
