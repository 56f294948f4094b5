"""The estimators of a campaign side by side: what each errs by on the same runs."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from testbench.questions.campaign.result import errors
from testbench.questions.side_by_side import Contest

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.campaign.result import CampaignResult
    from testbench.questions.campaign.summary import Summary

_PREDICTION = re.compile(r"validation MRSE of .*, %")
_UNIT = re.compile(r", (%|rad/s)$")
_LEAST_POINTS = 5
"""Points of a grid from which on estimators are ranked over them; with fewer they are ranked over the runs."""


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
                unit = _UNIT.search(figure)
                table = np.column_stack(list(found.values()))
                out.append(Contest(suite, _UNIT.sub("", figure), unit[1] if unit else "", tuple(found), table))
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
