"""Figures of what planned manoeuvres could show: which effects look alike, and which would be seen at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.plot import COLOURS, QUIET, Plate, grid, label, log_axis, new_figure
from testbench.questions.gap.plan import NEEDED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.questions.gap.plan import GapPlan


def plan_plates(plan: GapPlan) -> list[Plate]:
    """Return the matrix of likeness, and how strongly each effect would show."""
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
        "Row: the effect that is there. Column: what it may be taken for. Full blue: the column imitates most of what "
        "the row changes, uncertain coefficients re-tuned. Cross: these manoeuvres do not hold enough to tell the two "
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
