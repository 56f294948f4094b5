"""Commands that fly or read flights and identify: run, identify, reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.app import OutOption, ScenarioArgument, SeedOption, app, console, stages


@app.command()
def run(scenario: ScenarioArgument, out: OutOption = Path("results"), seed: SeedOption = None) -> None:
    """Fly a scenario, measure, identify, judge, and write records, tables, models and report.html.

    Example: `testbench run eolo_alpha` answers what an angle-of-attack vane buys.
    """
    from testbench.checks import find
    from testbench.pipeline import load_scenario
    from testbench.pipeline import run as run_pipeline
    from testbench.report import print_result, record_keeper, write_results

    loaded = load_scenario(find(scenario, "run"))
    folder = out / loaded.name
    with stages() as say:
        result = run_pipeline(loaded, seed, record_keeper(folder), say)
        say("write report")
        write_results(result, folder)
    print_result(result, console(), folder)


@app.command()
def identify(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
) -> None:
    """Run the same estimators, evaluation and report on recorded flights.

    The description says which file, which column is which channel in which unit, and which time segments to use;
    CSV, text, MAT, Parquet and NetCDF are read. Example: `testbench identify records/attas_short_period`.
    """
    from testbench.checks import find
    from testbench.logs import load_description
    from testbench.pipeline import identify as identify_records
    from testbench.report import print_result, record_keeper, write_results

    loaded = load_description(find(description, "identify"))
    folder = out / loaded.name
    with stages() as say:
        result = identify_records(loaded, data, record_keeper(folder), say)
        say("write report")
        write_results(result, folder)
    print_result(result, console(), folder)


@app.command()
def reproduce(
    what: Annotated[str, typer.Argument(help="taurus, eolo, b1 or all.")] = "all",
    out: OutOption = Path("results"),
) -> None:
    """Reproduce the papers' figures and tables, and set every printed number beside ours.

    Writes tables, figures and one page, index.html, into `reproduction`, or `reproduction_NAME` for one aircraft alone.
    Example: `testbench reproduce taurus`.
    """
    from testbench.reproduction.chapters import chosen
    from testbench.reproduction.chapters import reproduce as run_reproduction
    from testbench.reproduction.write import open_folder, print_reproduction, write_reproduction

    chosen(what)
    folder = open_folder(out / ("reproduction" if what == "all" else f"reproduction_{what}"))
    with stages() as say:
        chapters = run_reproduction(what, say)
        say("write page")
        write_reproduction(chapters, folder)
    print_reproduction(chapters, console(), folder)
