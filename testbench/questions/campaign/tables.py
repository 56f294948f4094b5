"""Tables of a campaign: estimates against the truth, all figures, points of the grid, failures; and every run."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.escape import csv_cell
from testbench.flight.batch.jobs import Tally
from testbench.page.tables import Column, Table, Value
from testbench.questions.campaign.methods import contests, ranked_contests
from testbench.questions.campaign.result import errors
from testbench.questions.campaign.summary import ALONE, QUANTILES, TOGETHER
from testbench.questions.side_by_side import pair_table, rank_table

if TYPE_CHECKING:
    from testbench.questions.campaign.result import CampaignResult
    from testbench.questions.campaign.summary import Summary


def campaign_tables(result: CampaignResult) -> list[Table]:
    """Return the tables that have rows: estimates against truth, all figures, points of the grid, failures."""
    made = [
        accuracy_table(result.summary),
        figure_table(result.summary),
        grid_table(result),
        cause_table(result.summary),
        cell_table(result.summary),
        pair_table(contests(result)),
        rank_table(*ranked_contests(result)),
    ]
    return [table for table in made if table.rows]


def common_case(summary: Summary) -> str:
    """Return the suite and estimator with which the names of all figures begin, or "" if there are several."""
    cases = {f.name.partition(": ")[0] for f in summary.figures}
    return f"{cases.pop()}: " if len(cases) == 1 else ""


def _case_words(summary: Summary) -> str:
    suite, _, estimator = common_case(summary).removesuffix(": ").partition(", ")
    return f" Suite {suite}, estimator {estimator}." if estimator else ""


def accuracy_table(summary: Summary) -> Table:
    """Return bias, scatter and coverage of every estimate that has a truth."""
    columns = (
        Column("estimate", "estimate", common=common_case(summary), get="name"),
        Column("n", "runs"),
        Column("missing", "not found"),
        Column("true mean", "true, mean", get="true_mean"),
        Column("bias", "bias"),
        Column("bias half width", "± (95 %)", digits=2, get="bias_half"),
        Column("scatter", "scatter"),
        Column("rms", "rms error"),
        Column("stated", "stated error"),
        Column("coverage percent", "coverage", "%", decimals=1, get=lambda a: 100.0 * a.coverage),
        Column("coverage low percent", "from", "%", decimals=1, get=lambda a: 100.0 * a.coverage_low),
        Column("coverage high percent", "to", "%", decimals=1, get=lambda a: 100.0 * a.coverage_high),
    )
    caption = (
        "Estimate minus truth of the same run. Bias: mean, with its 95 % confidence interval. Scatter: standard "
        "deviation. Stated error: root mean square of the standard errors that the estimator states. Coverage: share "
        "of the runs whose stated 95 % interval holds the truth, with the 95 % interval of that share (Wilson 1927). A "
        "dash: the method states no errors." + _case_words(summary)
    )
    return Table.of("accuracy", "Estimates against the truth", caption, columns, summary.accuracies)


def figure_table(summary: Summary) -> Table:
    """Return mean, scatter and quantiles of every figure."""
    columns = (
        Column("figure", "figure", common=common_case(summary)),
        Column("n", "runs"),
        Column("missing", "missing"),
        Column("mean", "mean"),
        Column("mean half width", "± (95 %)", digits=2),
        Column("std", "scatter"),
        *(Column(f"quantile {q:g}", f"{100 * q:g} %", group="quantiles") for q in QUANTILES),
    )
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (f.name, f.n, f.missing, f.mean, f.mean_half, f.std, *f.quantiles) for f in summary.figures
    )
    caption = "Every figure over the runs that are done. Missing: runs in which it was not found, or was infinite."
    caption += _case_words(summary)
    return Table("figures", "Every figure over the runs", caption, columns, rows)


def grid_table(result: CampaignResult) -> Table:
    """Return the estimates' errors at every point of the grid; without a grid a table without rows."""
    spec, summary = result.campaign.spec, result.summary
    keys = tuple(spec.grid)
    columns = (
        *(Column(key, key, given=True) for key in keys),
        Column("estimate", "estimate", common=common_case(summary)),
        Column("n", "runs"),
        Column("failed", "failed runs"),
        Column("bias", "bias"),
        Column("bias half width", "± (95 %)", digits=2),
        Column("scatter", "scatter"),
    )
    rows: list[tuple[Value, ...]] = []
    cell = summary.runs.astype(int) % spec.cells if keys else np.zeros(0, int)
    for point in np.unique(cell):
        here = cell == point
        at = int(np.argmax(here))
        values: list[Value] = [summary.inputs[key][at] for key in keys]
        failed = int(np.count_nonzero(here & ~summary.done))
        for name, error in errors(summary).items():
            e = error[here & summary.done]
            e = e[np.isfinite(e)]
            mean = float(np.mean(e)) if e.size else math.nan
            std = float(np.std(e, ddof=1)) if e.size > 1 else math.nan
            half = 1.96 * std / math.sqrt(e.size) if e.size else math.nan
            rows.append((*values, name, int(e.size), failed, mean, half, std))
    caption = "Estimate minus truth of the same run, at each point of the grid." + _case_words(summary)
    return Table("grid", "Errors at every point of the grid", caption, columns, tuple(rows))


def cause_table(summary: Summary) -> Table:
    """Return why runs failed, the most frequent reason first."""
    caption = "Reasons that differ in numbers only are counted together."
    return Table.of("failures", "Why runs failed", caption, _CAUSE, summary.causes, wide=True)


_CAUSE = (
    Column("runs", "runs", get="count"),
    Column("first", "first"),
    Column("reason", "reason, as the first run gives it", get="example"),
)


def cell_table(summary: Summary) -> Table:
    """Return which suites and estimators gave no model in runs that are done, and why."""
    columns = (
        Column("case", "suite, estimator"),
        *(replace(column, get=f"cause.{column.get or column.key}") for column in _CAUSE),
    )
    caption = "The other estimators of these runs are not touched. Reasons that differ in numbers only count together."
    return Table.of("failed", "Estimators that gave no model", caption, columns, summary.cells, wide=True)


def tally_of(summary: Summary) -> Tally:
    """Return how many finished runs were flown by what; stores of earlier versions do not say."""
    tally = Tally(batch=summary.simulators.get(TOGETHER, 0))
    for what, n in summary.simulators.items():
        if what != TOGETHER:
            tally.by_jsbsim(what.removeprefix(ALONE).removeprefix(", as "), n)
    return tally


def runs_csv(summary: Summary) -> str:
    """Return one line per finished run: number, state, what was varied, every figure with all digits."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["run", "state", *(csv_cell(name) for name in (*summary.inputs, *summary.columns))])
    figures = [values.tolist() for values in summary.columns.values()]
    inputs = list(summary.inputs.values())
    runs, done = summary.runs.astype(int).tolist(), summary.done.tolist()
    for i, run in enumerate(runs):
        found = ["" if (v := column[i]) != v else v for column in figures]  # NaN differs from itself
        writer.writerow(
            [
                run,
                "done" if done[i] else "failed",
                *(csv_cell(v) if isinstance(v := column[i], str) else v for column in inputs),
                *found,
            ]
        )
    return out.getvalue()
