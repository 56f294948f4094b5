"""The command ``testbench campaign``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.page.terminal import console
from testbench.questions.options import FlownBy, OutOption, SimulatorOption, with_figures

if TYPE_CHECKING:
    from testbench.questions.campaign.load import Campaign

command = typer.Typer(no_args_is_help=True, help="Fly a scenario many times with distributions of any of its values.")


CampaignArgument = Annotated[
    Path, typer.Argument(help="Campaign file, or the name of a packaged one.", show_default=False)
]
WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="Processes on this machine. Default: one per processor.")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(help="Fly on the workers of this dask scheduler (e.g. tcp://host:8786) instead of this machine."),
]


@command.command("run")
@with_figures
def campaign_run(
    campaign: CampaignArgument,
    out: OutOption = Path("results"),
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Fly a new campaign and write its store, tables, figures and report.html.

    Example: `testbench campaign run taurus_scatter --workers 2`. If it is interrupted, continue with `campaign resume`.
    """
    _fly_campaign(campaign, out, False, workers, scheduler, simulator)


@command.command("resume")
@with_figures
def campaign_resume(
    campaign: CampaignArgument,
    out: OutOption = Path("results"),
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    simulator: SimulatorOption = FlownBy.auto,
) -> None:
    """Continue a campaign that was interrupted or given more runs; finished runs are not flown again."""
    _fly_campaign(campaign, out, True, workers, scheduler, simulator)


@command.command("status")
def campaign_status(campaign: CampaignArgument, out: OutOption = Path("results")) -> None:
    """Print the progress of a campaign, its failures and the cost of a million such runs; also while it runs."""
    from testbench.questions.campaign.load import load_campaign
    from testbench.questions.campaign.page import campaign_page
    from testbench.questions.campaign.result import read_campaign
    from testbench.questions.campaign.store import Store

    loaded = load_campaign(campaign)
    with Store.read(out / f"campaign_{loaded.spec.name}") as store:
        campaign_page(read_campaign(loaded, store)).show(console())


@command.command("summarise")
@with_figures
def campaign_summarise(campaign: CampaignArgument, out: OutOption = Path("results")) -> None:
    """Write tables, figures and report.html from the finished runs, without flights."""
    from testbench.questions.campaign.load import load_campaign

    loaded = load_campaign(campaign)
    _report_campaign(loaded, out / f"campaign_{loaded.spec.name}")


def _fly_campaign(
    campaign: Path, out: Path, resume: bool, workers: int | None, scheduler: str | None, simulator: FlownBy
) -> None:
    from rich.console import Console

    from testbench.questions.campaign.ask import fly_campaign
    from testbench.questions.campaign.load import load_campaign
    from testbench.questions.campaign.progress import show_progress

    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give either --workers or --scheduler: a cluster brings its own workers")
    loaded = load_campaign(campaign)
    folder = out / f"campaign_{loaded.spec.name}"
    try:
        with show_progress(Console(stderr=True)) as progress:
            where = workers if scheduler is None else scheduler
            fly_campaign(loaded, folder, resume=resume, workers=where, progress=progress, simulator=simulator.value)
    except KeyboardInterrupt:
        print(
            f"finished runs are kept; continue with: testbench campaign resume {campaign} --out {out}", file=sys.stderr
        )
        raise
    _report_campaign(loaded, folder)


def _report_campaign(campaign: Campaign, folder: Path) -> None:
    from testbench.questions.campaign.page import campaign_page
    from testbench.questions.campaign.result import read_campaign
    from testbench.questions.campaign.store import Store

    with Store.read(folder) as store:
        page = campaign_page(read_campaign(campaign, store))
    page.write(folder)
    page.show(console(), folder)
