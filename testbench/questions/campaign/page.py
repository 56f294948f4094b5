"""The report of a campaign: its table of runs, summaries, figures, page, and its answer in a terminal."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.tables import Column, Table, Value
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.campaign.answer import answer, cost_sentence

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.core.record import FloatArray
    from testbench.questions.campaign.execute import Progress
    from testbench.questions.campaign.load import Campaign
    from testbench.questions.campaign.store import Counts, Store
    from testbench.questions.campaign.summary import Summary


@dataclass(frozen=True, eq=False)
class CampaignResult:
    """What a campaign's report is made from.

    Attributes:
        campaign: what was asked for.
        counts: of its runs by state.
        summary: of the finished ones.
        stopped: number of runs after which the stopping rule was met, or None.
        seconds: processor time of all finished runs.
        size: of the store, bytes.
        records_size: of the time histories, bytes.
    """

    campaign: Campaign
    counts: Counts
    summary: Summary
    stopped: int | None
    seconds: float
    size: int
    records_size: int = 0


def read_campaign(campaign: Campaign, store: Store) -> CampaignResult:
    """Return what the store of a campaign holds, summarised."""
    from testbench.questions.campaign.summary import summarise

    stopped = store.meta("stopped")
    seconds, size = store.seconds()
    return CampaignResult(
        campaign,
        store.counts(),
        summarise(store.rows()),
        None if stopped is None else int(stopped),
        seconds,
        size,
        sum(path.stat().st_size for path in store.path.parent.glob("records/*.nc")),
    )


def write_campaign(result: CampaignResult, folder: Path | str) -> list[Path]:
    """Write tables/*.csv and *.json, tables/runs.csv, figures/*.png and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render
    from testbench.questions.campaign.figures import campaign_plates

    folder = Path(folder)
    tables = campaign_tables(result)
    out = [write_file(folder / "tables" / "runs.csv", runs_csv(result.summary)), *write_tables(tables, folder)]
    paths, pictures = write_plates(campaign_plates(result.summary), folder)
    out += paths
    spec = result.campaign.spec
    page = render(
        "questions/campaign/page.html.j2",
        spec=spec,
        answer=answer(result),
        tables=tables,
        pictures=pictures,
        cost=cost_sentence(result),
        laws=[(key, _law(law)) for key, law in spec.vary.items()],
        grid=[(key, ", ".join(map(str, values))) for key, values in spec.grid.items()],
        source_text=result.campaign.text,
    )
    out.append(write_file(folder / PAGE, page))
    return out


def campaign_tables(result: CampaignResult) -> list[Table]:
    """Return the tables that have rows: estimates against truth, all figures, points of the grid, failures."""
    made = [
        accuracy_table(result.summary),
        figure_table(result.summary),
        grid_table(result),
        cause_table(result.summary),
    ]
    return [table for table in made if table.rows]


def accuracy_table(summary: Summary) -> Table:
    """Return bias, scatter and coverage of every estimate that has a truth."""
    columns = (
        Column("estimate", "estimate"),
        Column("n", "runs"),
        Column("missing", "not found"),
        Column("true mean", "true, mean"),
        Column("bias", "bias"),
        Column("bias half width", "± (95 %)", digits=2),
        Column("scatter", "scatter"),
        Column("rms", "rms error"),
        Column("stated", "stated error"),
        Column("coverage percent", "coverage", "%", decimals=1),
        Column("coverage low percent", "from", "%", decimals=1),
        Column("coverage high percent", "to", "%", decimals=1),
    )
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (
            *(a.name, a.n, a.missing, a.true_mean, a.bias, a.bias_half, a.scatter, a.rms, a.stated),
            *(100.0 * a.coverage, 100.0 * a.coverage_low, 100.0 * a.coverage_high),
        )
        for a in summary.accuracies
    )
    caption = (
        "Estimate minus truth of the same run. Bias: mean, with its 95 % confidence interval; scatter: standard "
        "deviation. Stated error: what the estimator says of itself, root mean square; coverage: share of the runs "
        "whose stated 95 % interval holds the truth, with the 95 % interval of that share (Wilson 1927); a dash where "
        "the method states no errors."
    )
    return Table("accuracy", "Estimates against the truth", caption, columns, rows)


def figure_table(summary: Summary) -> Table:
    """Return mean, scatter and quantiles of every figure."""
    from testbench.questions.campaign.summary import QUANTILES

    columns = (
        Column("figure", "figure"),
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
    caption = "Every figure over the runs that are done; missing: it could not be found, or was infinite."
    return Table("figures", "Every figure over the runs", caption, columns, rows)


def grid_table(result: CampaignResult) -> Table:
    """Return the estimates' errors at every point of the grid; without a grid a table without rows."""
    spec, summary = result.campaign.spec, result.summary
    keys = tuple(spec.grid)
    columns = (
        *(Column(key, key, given=True) for key in keys),
        Column("estimate", "estimate"),
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
    return Table("grid", "Errors at every point of the grid", "As above, point by point.", columns, tuple(rows))


def errors(summary: Summary) -> dict[str, FloatArray]:
    """Return estimate -> (n,) estimate minus truth of every finished run, NaN where there is none."""
    from testbench.questions.campaign.summary import truth_of

    return {
        a.name: summary.columns[a.name] - summary.columns[truth_of(a.name, summary.columns)] for a in summary.accuracies
    }


def cause_table(summary: Summary) -> Table:
    """Return why runs failed, the most frequent reason first."""
    columns = (Column("runs", "runs"), Column("first", "first"), Column("reason", "reason, as the first run gives it"))
    rows = tuple((c.count, c.first, c.example) for c in summary.causes)
    caption = "Reasons that differ in numbers only are counted together."
    return Table("failures", "Why runs failed", caption, columns, rows, wide=True)


def runs_csv(summary: Summary) -> str:
    """Return one line per finished run: number, state, what was varied, every figure with all digits."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["run", "state", *summary.inputs, *summary.columns])
    figures = [values.tolist() for values in summary.columns.values()]
    inputs = list(summary.inputs.values())
    runs, done = summary.runs.astype(int).tolist(), summary.done.tolist()
    for i, run in enumerate(runs):
        found = ["" if (v := column[i]) != v else v for column in figures]  # NaN differs from itself
        writer.writerow([run, "done" if done[i] else "failed", *(column[i] for column in inputs), *found])
    return out.getvalue()


def _law(law: object) -> str:
    """Return a distribution in words."""
    fields = dict(law)  # type: ignore[call-overload]
    kind = fields.pop("kind")
    said = ", ".join(
        f"{k} {', '.join(map(str, v)) if isinstance(v, tuple) else v}" for k, v in fields.items() if v != ()
    )
    return f"{kind}: {said}"


def print_campaign(result: CampaignResult, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, the cost, and where the files are."""
    from rich.table import Table as RichTable
    from rich.text import Text

    styles = {"lead": "bold", "finding": "", "doubt": "yellow"}
    console.print(Text(result.campaign.spec.title, style="bold underline"))
    lines = RichTable.grid(padding=(0, 1))
    for kind, sentence in answer(result):
        lines.add_row("-", Text(sentence, style=styles[kind]))
    lines.add_row("-", Text(cost_sentence(result)))
    console.print(lines)
    if folder is not None:
        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)


@contextmanager
def show_progress(console: Console) -> Iterator[Callable[[Progress], None]]:
    """Give a function that shows how far a campaign is: a bar on a terminal, now and then a line elsewhere."""
    if not console.is_terminal:
        yield _lines(console)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    with Bar(
        TextColumn("fly"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), console=console
    ) as bar:
        task = bar.add_task("start workers", total=None)

        def show(p: Progress) -> None:
            """Move the bar."""
            bar.update(task, completed=p.counts.finished, total=p.counts.total, description=_words(p))

        yield show


def _lines(console: Console) -> Callable[[Progress], None]:
    said = [-math.inf]

    def show(p: Progress) -> None:
        """Print a line every ten seconds, and the last one."""
        if p.elapsed_s - said[0] >= 10.0 or p.counts.finished == p.counts.total:
            said[0] = p.elapsed_s
            console.print(f"... {p.counts.finished} of {p.counts.total} runs, {_words(p)}", highlight=False)

    return show


def _words(p: Progress) -> str:
    left = "" if p.left_s is None else f", {_clock(p.left_s)} left"
    workers = f"{p.workers} worker{'' if p.workers == 1 else 's'}"
    return f"{p.counts.failed} failed, {p.rate:.1f} runs/s on {workers}{left}"


def _clock(seconds: float) -> str:
    minutes, s = divmod(round(seconds), 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02d}:{s:02d}" if hours else f"{m}:{s:02d}"
