"""What the report of a campaign is made from: its runs so far, summarised."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.shown import Shown
from testbench.questions.campaign.summary import Summary, summarise, truth_of
from testbench.questions.side_by_side import Contest

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.campaign.load import Campaign
    from testbench.questions.campaign.store import Counts, Store


_PREDICTION = re.compile(r"validation MRSE of .*, %")
UNIT = re.compile(r", (%|rad/s)$")
_LEAST_POINTS = 5
"""Points of a grid from which on estimators are ranked over them; with fewer they are ranked over the runs."""


@dataclass(frozen=True, eq=False)
class CampaignResult(Shown, page="testbench.questions.campaign.page:campaign_page"):
    """The data from which the report of a campaign is made."""

    campaign: Campaign  # what was asked for
    counts: Counts  # number of its runs in each state
    summary: Summary  # summary of the finished runs
    stopped: int | None  # number of runs after which the stopping rule was met, or None
    seconds: float  # processor time of all finished runs
    size: int  # of the store, bytes
    records_size: int = 0  # of the time histories, bytes
    folder: Path | None = None  # of the store; None if there is none


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


# --- the estimators side by side --------------------------------------------------------------------------------------


def contests(result: CampaignResult) -> list[Contest]:
    """Return every error that two or more estimators of a suite give: of predictions, and of estimates with a truth."""
    summary, out = result.summary, []
    sized = {name: np.abs(e) for name, e in errors(summary).items()}
    sized |= {name: v for name, v in summary.columns.items() if _PREDICTION.fullmatch(name.partition(": ")[2])}
    for suite in result.campaign.suite_names:
        by_figure: dict[str, dict[str, FloatArray]] = {}
        for name, values in sized.items():
            case, _, figure = name.partition(": ")
            of, _, estimator = case.partition(", ")
            if of == suite:
                by_figure.setdefault(figure, {})[estimator] = values[summary.done]
        for figure, found in by_figure.items():
            if len(found) > 1:
                unit = UNIT.search(figure)
                table = np.column_stack(list(found.values()))
                out.append(Contest(suite, UNIT.sub("", figure), unit[1] if unit else "", tuple(found), table))
    return out


def ranked_contests(result: CampaignResult) -> tuple[list[Contest], str]:
    """Return the mean error of prediction by suite, over what estimators are ranked: points of the grid, or runs."""
    cells = result.campaign.spec.cells
    point = result.summary.runs[result.summary.done].astype(int) % cells
    by_points = cells >= _LEAST_POINTS
    groups = [point == c for c in np.unique(point)] if by_points else []
    out = []
    for suite in result.campaign.suite_names:
        means = {}
        for case in result.campaign.cases:
            of, _, estimator = case.partition(", ")
            found = _mean_prediction(result.summary, case) if of == suite else None
            if found is not None:
                means[estimator] = np.array([_mean(found[g]) for g in groups]) if by_points else found
        if len(means) > 1:
            table = np.column_stack(list(means.values()))
            out.append(Contest(suite, "prediction, mean over the outputs", "%", tuple(means), table))
    return out, "points of the grid" if by_points else "the runs"


def _mean_prediction(summary: Summary, case: str) -> FloatArray | None:
    values = summary.columns.get(f"{case}: validation MRSE, %")
    return None if values is None else values[summary.done]


def _mean(values: FloatArray) -> float:
    have = values[np.isfinite(values)]
    return float(np.mean(have)) if have.size else float("nan")
