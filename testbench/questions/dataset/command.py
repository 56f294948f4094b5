"""The command ``testbench dataset``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, print_rows
from testbench.questions.options import ByDefault, FlownBy, ScenarioArgument, SeedOption, SimulatorOption

command = typer.Typer(
    no_args_is_help=True,
    cls=ByDefault.first("draw"),
    help="Draw flights with known truth into one store, and score answers about them.",
)

FolderArgument = Annotated[Path, typer.Argument(help="Folder of a data set.", show_default=False)]


@command.command("draw")
def draw(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the data set alone.", show_default=False)],
    runs: Annotated[int | None, typer.Option(min=1, help="Flights, instead of those of the scenario.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one per processor.")] = None,
    seed: SeedOption = None,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Draw a data set; the same command continues one that was interrupted.

    `testbench dataset SCENARIO` is `testbench dataset draw SCENARIO`. Example: `testbench dataset identification
    --out my_set --runs 200`.
    """
    from rich.console import Console

    from testbench.core.named import obtain
    from testbench.questions.campaign.progress import show_progress
    from testbench.questions.dataset.ask import draw_dataset
    from testbench.questions.dataset.scenario import DatasetScenario

    loaded = obtain(DatasetScenario, scenario)
    if seed is not None:
        loaded = loaded.changed(seed=seed)
    try:
        with show_progress(Console(stderr=True)) as progress:
            drawn = draw_dataset(loaded, out, runs=runs, workers=workers, progress=progress, simulator=simulator.value)
    except KeyboardInterrupt:
        print("finished results are kept; the same command continues", file=sys.stderr)
        raise
    layout, again = drawn.layout, sum(drawn.again.values())
    told = f"{drawn.flown} flown now" if drawn.flown else "all of it was there"
    console().print(
        f"{out}: {layout.flights} flights of {layout.draws} draws, {drawn.size_bytes / 1e6:.3g} MB, "
        f"{layout.row_bytes / 1e3:.3g} kB each; {told}, {again} draws drawn again; see {out}/README.md",
        highlight=False,
        soft_wrap=True,
    )


@command.command("score")
def score(
    folder: FolderArgument,
    predictions: Annotated[Path, typer.Argument(help="Table of answers (CSV).", show_default=False)],
    truth: Annotated[Path | None, typer.Option(help="Labels of the test split, if they do not lie in FOLDER.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the scores to this CSV file.")] = None,
) -> None:
    """Score answers about the test split of a data set.

    Columns for identification: draw, figure, value and, if errors are stated, std. For naming: draw, said, where said
    is "no gap", "unexplained", or names of effects with " | " between them. Example: `testbench dataset score my_set
    answers.csv`.
    """
    from testbench.core.store import write_beside
    from testbench.questions.dataset.score import score_predictions

    heads, rows, right = score_predictions(folder, predictions, truth)
    if out is not None:  # first: who reads what is printed may stop
        import csv
        import io

        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([heads, *rows])
        write_beside(out, text.getvalue())
    print_rows(console(), heads, rows, right)


@command.command("check")
def check(folder: FolderArgument) -> None:
    """Check the files of a data set against its checksums."""
    from testbench.core.errors import DatasetError
    from testbench.questions.dataset.store import damaged

    wrong = list(damaged(folder))
    if wrong:
        raise DatasetError(
            f"the files of a data set must agree with its checksums, but in '{folder}' {', '.join(wrong)} "
            f"{'does' if len(wrong) == 1 else 'do'} not; draw it again or get another copy"
        )
    console().print(f"{folder}: every file agrees with its checksum", highlight=False)
