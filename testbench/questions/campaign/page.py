"""The page of a campaign: its tables and figures, and every run as CSV."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.aircraft.believed import KEY
from testbench.core.constants import PERCENT
from testbench.core.escape import csv_cell
from testbench.page import figure as fig
from testbench.page.flown import flown_table
from testbench.page.labels import number
from testbench.page.page import Page
from testbench.page.tables import Column, Table, Value
from testbench.questions.campaign.answer import campaign_answer, cost_sentence, most_biased
from testbench.questions.campaign.result import contests, errors, ranked_contests
from testbench.questions.campaign.scenario import Normal
from testbench.questions.campaign.summary import QUANTILES, short_name, truth_of
from testbench.questions.campaign.tidy import tidy_files
from testbench.questions.side_by_side import CALIBRATION, calibration_panel, pair_table, points, rank_plates, rank_table

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.campaign.result import CampaignResult
    from testbench.questions.campaign.summary import Summary


_MOST, _TALL_IN = 6, 1.75
_FEWEST = 3  # runs whose means make a line
_ROUNDED = 1e-9  # of their size: values that differ by no more are drawn as one


def campaign_page(result: CampaignResult) -> Page:
    """Return the page of a campaign, with tables/runs.csv: every finished run with all its figures."""
    spec, own, cost = result.campaign.spec, result.campaign.own, cost_sentence(result)
    return Page(
        kicker=f"Campaign: {spec.name}",
        title=spec.title,
        question=spec.question,
        answer=[*campaign_answer(result)],
        tables=campaign_tables(result),
        more_tables=[flown_table(result.summary.tally, "run")],
        plates=[*campaign_plates(result.summary), *rank_plates(*ranked_contests(result))],
        files={"tables/runs.csv": runs_csv(result.summary), **tidy_files(result.folder, result.counts.finished)},
        template="questions/campaign/page.html.j2",
        asked=[
            *((key, f"grid: {', '.join(map(str, values))}") for key, values in spec.grid.items()),
            *((key, _law(law)) for key, law in spec.vary.items() if key not in own),
            *([("coefficients", _own(result))] if own else []),
            ("cost", cost),
        ],
        provenance=[("seed", str(spec.seed))],
        source=(f"{spec.name}.toml", result.campaign.text),
        notes=[cost],
    )


def _own(result: CampaignResult) -> str:
    """Return in words what is drawn by the aircraft's own uncertainty."""
    laws = [(key, result.campaign.spec.vary[key]) for key in result.campaign.own]
    listed = ", ".join(
        f"{key.removeprefix(KEY)} {number(law.std / PERCENT)} %" for key, law in laws if isinstance(law, Normal)
    )
    return (
        "by the stated uncertainty of the aircraft, independently: factors on the a-priori values, normal about 1 "
        f"with the relative standard deviations {listed}"
    )


def _law(law: object) -> str:
    """Return a distribution in words."""
    fields = dict(law)  # type: ignore[call-overload]
    kind = fields.pop("kind")
    said = ", ".join(
        f"{k} {', '.join(map(str, v)) if isinstance(v, tuple) else v}" for k, v in fields.items() if v != ()
    )
    return f"{kind}: {said}"


# --- tables -----------------------------------------------------------------------------------------------------------


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
        "of the runs whose stated 95 % interval contains the truth, with the 95 % interval of that share (Wilson "
        "1927). A dash: the method states no errors." + _case_words(summary)
    )
    return Table.of("accuracy", "Estimates against the truth", caption, columns, summary.accuracies)


def _quantile(k: int) -> Column:
    q = QUANTILES[k]
    return Column(f"quantile {q:g}", f"{100 * q:g} %", group="quantiles", get=lambda f: f.quantiles[k])


def figure_table(summary: Summary) -> Table:
    """Return mean, scatter and quantiles of every figure."""
    columns = (
        Column("figure", "figure", common=common_case(summary), get="name"),
        Column("n", "runs"),
        Column("missing", "missing"),
        Column("mean", "mean"),
        Column("mean half width", "± (95 %)", digits=2, get="mean_half"),
        Column("std", "scatter"),
        *map(_quantile, range(len(QUANTILES))),
    )
    caption = "Every figure over the runs that are done. Missing: runs in which it was not found, or was infinite."
    caption += _case_words(summary)
    return Table.of("figures", "Every figure over the runs", caption, columns, summary.figures)


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
    caption = "Reasons that differ only in numbers are counted together."
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
    caption = (
        "The other estimators of these runs are not affected. Reasons that differ only in numbers are counted together."
    )
    return Table.of("failed", "Estimators that gave no model", caption, columns, summary.cells, wide=True)


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


# --- figures ----------------------------------------------------------------------------------------------------------


def campaign_plates(summary: Summary) -> list[fig.Plate]:
    """Return the figures for which the runs have data, of at most six estimates; if there are none, why runs failed."""
    chosen, done = _chosen(summary), summary.done
    found = errors(summary)
    of_errors = {name: found[name][done] for name in chosen}
    if not of_errors:
        named = [f.name for f in summary.figures if f.n > 1 and "MRSE" in f.name][:_MOST]
        of_errors = {name: summary.columns[name][done] for name in named}
    of_errors = {name: values[np.isfinite(values)] for name, values in of_errors.items()}
    of_errors = {name: values for name, values in of_errors.items() if values.size}
    if not of_errors:
        return [_failure_plate(summary)] if summary.causes else []
    what = "estimate minus truth" if chosen else "value"
    plates = []
    if chosen:
        of = [_scatter(short_name(n, chosen), summary.columns[truth_of(n, summary.columns)][done],
                       summary.columns[n][done]) for n in chosen]  # fmt: skip
        caption = "One point per run, for at most 2000 runs. On the line the estimate equals the truth."
        plates.append(fig.Plate("estimates", "Estimates over true values", caption, fig.grid(of, 3)))
    caption = (
        f"Number of runs over {'' if chosen else 'the '}{what}. Dashed: the mean, with its 95 % confidence interval "
        f"shaded.{' The estimate is biased if zero (full line) lies outside that interval.' if chosen else ''}"
    )
    title = "Distribution of the errors" if chosen else "Distribution of the prediction errors"
    of = [_histogram(short_name(n, list(of_errors)), values, what, bool(chosen)) for n, values in of_errors.items()]
    plates.append(fig.Plate("distributions", title, caption, fig.grid(of, 3)))
    settling = {name: values for name, values in of_errors.items() if values.size >= _FEWEST}
    if settling:
        caption = (
            f"Mean of {what} over the first runs, in the order of their numbers, with its 95 % confidence interval."
        )
        of = [_settling(short_name(n, list(settling)), values) for n, values in settling.items()]
        plates.append(fig.Plate("convergence", "Convergence of the means", caption, fig.grid(of, 3)))
    stated = [a.name for a in summary.accuracies if np.isfinite(a.stated) and a.n > 2]
    of_stated = [name for name in chosen if name in stated] or stated[:_MOST]
    if of_stated:
        of = [
            calibration_panel(short_name(n, of_stated), found[n][done], summary.columns[f"{n}, std"][done])
            for n in of_stated
        ]
        plates.append(fig.Plate("calibration", "Errors over stated errors", CALIBRATION, fig.grid(of, 3)))
    return plates


def _failure_plate(summary: Summary) -> fig.Plate:
    """Return the reasons of failure by number of runs, for a campaign that identified nothing."""
    causes = summary.causes[:_MOST]
    draws: list[fig.Drawn] = [fig.bars(np.arange(len(causes)) + 0.2, 0.0, [c.count for c in causes], 0.35)]
    draws += [fig.Words(x=0.0, y=i - 0.05, text=f"{c.count}: {c.example}", up="bottom") for i, c in enumerate(causes)]
    panel = fig.Panel(
        draws=draws, x="runs, of those that are finished", x_range=(0.0, float(summary.runs.size)), whole="x",
        y_ticks=[], y_range=(len(causes) - 0.55, -0.45), tall_in=0.5 * len(causes),
    )  # fmt: skip
    caption = (
        "Number of runs for each of the most frequent reasons of failure; numbers in a reason are those of the first "
        "run."
    )
    return fig.Plate("failures", "Why runs failed", caption, fig.Chart([[panel]]))


def _chosen(summary: Summary) -> list[str]:
    """Return up to six estimates: the most biased ones, of which the answer speaks, then those whose errors the method
    states, then those found most often.
    """
    have = [a for a in summary.accuracies if a.n > 1]
    ranked = sorted(have, key=lambda a: (not np.isfinite(a.stated), a.missing))
    names = dict.fromkeys(a.name for a in (*most_biased(summary), *ranked))
    return sorted(list(names)[:_MOST])


def _scatter(name: str, true: FloatArray, found: FloatArray) -> fig.Panel:
    have = np.isfinite(true) & np.isfinite(found)
    true, found = true[have], found[have]
    low, high = float(true.min()), float(true.max())
    margin = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    ends = (low - margin, high + margin)
    draws: list[fig.Drawn] = [fig.Curve(x=ends, y=ends, width=0.9), points(true, found)]
    return fig.Panel(draws=draws, title=name, x="true value", y="estimate", x_range=ends, tall_in=_TALL_IN)


def _histogram(name: str, values: FloatArray, what: str, zero: bool) -> fig.Panel:
    low, high = float(values.min()), float(values.max())
    size, count = max(abs(low), abs(high)), int(np.clip(round(2.0 * values.size ** (1.0 / 3.0)), 5, 60))  # Rice's rule
    if high - low <= _ROUNDED * size:  # no bins fit between values that rounding alone tells apart
        room = 0.05 * size or 0.5
        low, high, count = low - room, high + room, 1
    runs, edges = np.histogram(values, bins=count, range=(low, high))
    tall = [([a, b, b, a], [0.0, 0.0, n, n]) for a, b, n in zip(edges[:-1], edges[1:], runs, strict=True)]
    mean, half = float(np.mean(values)), _half(values)
    draws: list[fig.Drawn] = [
        fig.Area(outlines=tall),
        fig.Span(low=mean - half, high=mean + half, colour=fig.COLOURS[1], alpha=0.25),
        fig.Rule(at=mean, colour=fig.COLOURS[1], dash=fig.DASHED, width=1.3),
        *([fig.Rule(at=0.0, colour=fig.INK)] if zero else []),
    ]
    ends = [low, high, mean - half, mean + half, *([0.0] if zero else [])]
    room = 0.06 * (max(ends) - min(ends))  # zero stands off the axis, where it could not be seen
    return fig.Panel(
        draws=draws, title=name, x=what, y="runs", whole="y", tall_in=_TALL_IN,
        x_range=(min(ends) - room, max(ends) + room), y_range=(0.0, 1.05 * float(runs.max())),
    )  # fmt: skip


def _half(values: FloatArray) -> float:
    return float(fig.INTERVAL * np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0


def _settling(name: str, values: FloatArray) -> fig.Panel:
    n = np.arange(1, values.size + 1)
    shift = float(values[0])  # sums of squares about a value of their own size lose no digits
    mean = np.cumsum(values - shift) / n
    squares = np.maximum(np.cumsum((values - shift) ** 2) / n - mean**2, 0.0)
    half = fig.INTERVAL * np.sqrt(squares / np.maximum(n - 1, 1))
    first = min(4, (n.size - 1) // 2)  # intervals of the first few runs would set the scale
    show = np.unique(np.linspace(first, n.size - 1, min(n.size, 400)).astype(int))
    draws: list[fig.Drawn] = [
        fig.band(n[show], (shift + mean - half)[show], (shift + mean + half)[show], alpha=0.5),
        fig.Curve(x=n[show], y=(shift + mean)[show], colour=fig.COLOURS[0]),
        fig.Rule(at=shift + float(mean[-1]), of="y", width=0.7, dash=fig.DASHED),
    ]
    return fig.Panel(draws=draws, title=name, x="runs", y="mean", whole="x", tall_in=_TALL_IN)
