"""What the report of a campaign is made from: its runs so far, summarised."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.shown import Shown
from testbench.questions.campaign.summary import Summary, summarise, truth_of

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.campaign.load import Campaign
    from testbench.questions.campaign.store import Counts, Store


@dataclass(frozen=True, eq=False)
class CampaignResult(Shown, page="testbench.questions.campaign.page:campaign_page"):
    """The data from which the report of a campaign is made.

    Attributes:
        campaign: what was asked for.
        counts: number of its runs in each state.
        summary: summary of the finished runs.
        stopped: number of runs after which the stopping rule was met, or None.
        seconds: processor time of all finished runs.
        size: of the store, bytes.
        records_size: of the time histories, bytes.
        folder: of the store; None if there is none.
    """

    campaign: Campaign
    counts: Counts
    summary: Summary
    stopped: int | None
    seconds: float
    size: int
    records_size: int = 0
    folder: Path | None = None


def read_campaign(campaign: Campaign, store: Store) -> CampaignResult:
    """Return what the store of a campaign holds, summarised."""
    seconds, size = store.seconds()
    with store.whole():  # rows are JSON, which may be damaged
        stopped = store.meta("stopped")
        return CampaignResult(
            campaign,
            store.counts(),
            summarise(store.rows()),
            None if stopped is None else int(stopped),
            seconds,
            size,
            sum(path.stat().st_size for path in store.path.parent.glob("records/*.nc")),
            store.path.parent,
        )


def errors(summary: Summary) -> dict[str, FloatArray]:
    """Return estimate -> (n,) estimate minus truth of every finished run, NaN where there is none."""
    return {
        a.name: summary.columns[a.name] - summary.columns[truth_of(a.name, summary.columns)] for a in summary.accuracies
    }
