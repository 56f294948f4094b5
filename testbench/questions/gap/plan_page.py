"""The report of `testbench gap --plan`: what planned manoeuvres could show of the effects, and what to add."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.plot import COLOURS, QUIET, Plate, grid, label, log_axis, new_figure
from testbench.page.tables import Column, Table
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.gap.plan import ALIKE, NEEDED

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from testbench.questions.gap.plan import GapPlan

_MOST_PAIRS = 40


def write_gap_plan(plan: GapPlan, folder: Path | str) -> list[Path]:
    """Write tables, figures and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render

    folder = Path(folder)
    tables = plan_tables(plan)
    out = write_tables(tables, folder)
    paths, pictures = write_plates(_plates(plan), folder)
    out += paths
    file = plan.scenario.file
    page = render(
        "analysis.html.j2",
        kicker=f"What could be found: {plan.scenario.name}",
        title=f"{plan.scenario.title}: which effects could these manoeuvres tell apart?",
        answer=list(plan.sentences),
        pictures=pictures,
        tables=tables,
        source_name=file.name if file else "as given",
        source_text=file.read_text(encoding="utf-8") if file else "",
    )
    out.append(write_file(folder / PAGE, page))
    return out


def plan_tables(plan: GapPlan) -> list[Table]:
    """Return what could be added, what would be confused, and how well each effect would show."""
    found = plan.planned
    confused = found.confused()
    shown = confused[:_MOST_PAIRS]
    more = f" The {_MOST_PAIRS} closest of {len(confused)} pairs." if len(confused) > _MOST_PAIRS else ""
    seen = zip(found.effects, found.noncentrality, strict=True)
    out = [
        Table(
            "additions",
            "What one more manoeuvre would change",
            "Best first. Seen: enough to be found at the usual size. Told apart: seen, and not to be taken for any "
            "other effect. Confusions: ordered pairs of which the first is seen and may be taken for the second."
            + "".join(f" Not flown: {words} ({why})." for words, why in plan.skipped.items()),
            (
                Column("manoeuvre", "manoeuvre"),
                Column("seen", "effects seen"),
                Column("nameable", "told apart"),
                Column("confused", "confusions"),
            ),
            tuple(
                (words, len(i.effects) - len(i.unseen), len(i.nameable), i.inseparable)
                for words, i in (("as planned", found), *((a.words, a.with_it) for a in plan.additions))
            ),
            wide=True,
        ),
        Table(
            "confused",
            "What would be taken for what",
            f"Told apart: noncentrality of the test between the two, which needs {NEEDED:.0f} to name the right one "
            f"with a probability of 0.9 at a false name in 1000. Pairs alike by more than {100 * ALIKE:.0f} % are "
            "listed even where that is reached: there the form of the effect decides, and no form is quite right."
            + more,
            (
                Column("effect", "effect"),
                Column("other", "taken for"),
                Column("share", "alike", "%", decimals=1),
                Column("left", "told apart", digits=3),
                Column("separated", "what separates the first"),
            ),
            tuple((a.title, b.title, 100.0 * share, left, a.separated_by) for a, b, share, left in shown),
            wide=True,
        ),
        Table(
            "visible",
            "How well each effect would show",
            f"At its usual size, in multiples of which the smallest to be found is given (noncentrality {NEEDED:.0f}, "
            "uncertain coefficients re-tuned).",
            (
                Column("effect", "effect"),
                Column("size", "usual size"),
                Column("noncentrality", "noncentrality", digits=3),
                Column("smallest", "smallest to be found", "of usual", digits=2),
            ),
            tuple(
                (
                    e.title,
                    ", ".join(
                        f"{p.name} = {p.starts[0]:g}" + (f" {p.unit}" if p.unit != "1" else "") for p in e.parameters
                    ),
                    float(n),
                    float(np.sqrt(NEEDED / n)) if n > 1e-6 else None,
                )
                for e, n in sorted(seen, key=lambda row: -row[1])
            ),
            wide=True,
        ),
    ]
    return [table for table in out if table.rows]


def _plates(plan: GapPlan) -> list[Plate]:
    return [_matrix_plate(plan), _visible_plate(plan)]


def _matrix_plate(plan: GapPlan) -> Plate:
    found = plan.planned
    index = [i for i, n in enumerate(found.noncentrality) if n >= NEEDED]
    # Neighbours in the figure are alike: the order of the leading vector of the symmetric part of the matrix.
    share = found.share[np.ix_(index, index)]
    if index:
        _, vectors = np.linalg.eigh(np.nan_to_num(share + share.T))
        order = np.argsort(vectors[:, -2] if len(index) > 1 else vectors[:, 0])
        index = [index[k] for k in order]
        share = found.share[np.ix_(index, index)]
    names = [found.effects[i].name for i in index]

    def make(wide: bool) -> Figure:
        """Draw the matrix of shares of the effects that would be seen."""
        k = max(len(names), 1)
        cell = 0.168 if wide else 0.088
        left, top = (1.75, 1.85) if wide else (1.15, 1.5)
        size = 7 if wide else 4
        figure = new_figure(wide, top + cell * k + 0.75)
        width = float(figure.get_size_inches()[0])
        axes = grid(figure, top, [cell * k], left_in=left, right_in=max(0.1, width - left - cell * k))[0, 0]
        image = axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=size)
        axes.set_yticks(range(len(names)), names, fontsize=size)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        rows, columns = np.nonzero((found.left[np.ix_(index, index)] < NEEDED) & ~np.eye(len(index), dtype=bool))
        axes.plot(columns, rows, "x", color=COLOURS[1], markersize=4.5 if wide else 2.6, markeredgewidth=1.1)
        tall = float(figure.get_size_inches()[1])
        bar = figure.add_axes((left / width, 0.33 / tall, 1.8 / width, 0.09 / tall))
        colours = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=[0.0, 0.5, 1.0])
        colours.ax.set_title(
            "share of the row's signature that the column imitates", fontsize=7, color=QUIET, loc="left"
        )
        colours.outline.set_visible(False)
        return figure

    caption = (
        "Row: the effect that is there. Column: what it may be taken for. Dark: the column imitates most of what the "
        "row changes, uncertain coefficients re-tuned. Cross: these manoeuvres do not hold enough to tell the two "
        "apart. Effects that would not show are left out."
    )
    return Plate("isolability", "Which effects look alike in these manoeuvres", caption, make)


def _visible_plate(plan: GapPlan) -> Plate:
    found = plan.planned
    order = np.argsort(-found.noncentrality)
    names = [found.effects[i].name for i in order]
    values = np.maximum(found.noncentrality[order], 1e-2)

    def make(wide: bool) -> Figure:
        """Draw one bar per effect, the most visible on top."""
        step = 0.17
        figure = new_figure(wide, 0.3 + step * len(names) + 0.55, share=0.75)
        axes = grid(figure, 0.2, [step * len(names)], left_in=1.75 if wide else 1.45)[0, 0]
        colours = [COLOURS[0] if v >= NEEDED else COLOURS[1] for v in values]
        axes.barh(range(len(names)), values - 1e-2, left=1e-2, height=0.65, color=colours)
        axes.axvline(NEEDED, color=QUIET, linewidth=1.0, linestyle=(0, (2, 2)))
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(1e-2, values.max() * 2.0)
        log_axis(axes, "x", powers=True)
        label(axes, "noncentrality at the usual size")
        return figure

    caption = (
        "How strongly each effect would show at its usual size, uncertain coefficients re-tuned. Orange: not enough to "
        "be found (dashed line)."
    )
    return Plate("visible", "Which effects these manoeuvres would show", caption, make)


def print_gap_plan(plan: GapPlan, console: Console, folder: Path | str) -> None:
    """Print the answer, what to add, and where the files are."""
    from rich.table import Table as Grid
    from rich.text import Text

    console.print(Text(plan.scenario.title, style="bold underline"))
    answer = Grid.grid(padding=(0, 1))
    for k, sentence in enumerate(plan.sentences):
        answer.add_row("-", Text(sentence[:1].upper() + sentence[1:] + ".", style="bold" if k == 0 else ""))
    console.print(answer)
    table = plan_tables(plan)[0]
    rows = Grid(box=None, pad_edge=False)
    for column in table.columns:
        rows.add_column(column.head, justify="left" if column.key == "manoeuvre" else "right", overflow="fold")
    for row in table.cells():
        rows.add_row(*(Text(text) for text, _ in row))
    console.print()
    console.print(rows)
    console.print()
    console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
