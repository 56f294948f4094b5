"""Figures of what would be stated of planned manoeuvres: how often each effect is named, and what it is taken for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import PERCENT
from testbench.page.plot import COLOURS, QUIET, Plate, grid, label, new_figure

_MOST, _OTHERS, _SEEN = 24, 8, 0.05  # rows; columns beside them, of effects that are given so much

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.questions.gap.plan import GapPlan


def plan_plates(plan: GapPlan) -> list[Plate]:
    """Return how often each effect is named, and what those named least are taken for; none without flights."""
    return [_power_plate(plan), _confusion_plate(plan)] if plan.power else []


def _power_plate(plan: GapPlan) -> Plate:
    power = plan.power

    def make(wide: bool) -> Figure:
        """Draw one bar per effect, the most often named on top."""
        step = 0.17
        figure = new_figure(wide, 0.3 + step * len(power) + 0.55, share=0.75)
        axes = grid(figure, 0.2, [step * len(power)], left_in=1.75 if wide else 1.45)[0, 0]
        at = range(len(power))
        held, sure = ([100.0 * x for x in of] for of in zip(*((p.held, p.sure) for p in power.values()), strict=True))
        axes.barh(at, held, height=0.65, facecolor="none", edgecolor=COLOURS[0], linewidth=0.8)
        axes.barh(at, sure, height=0.65, color=COLOURS[0])
        axes.set_yticks(at, list(power), fontsize=7)
        axes.set_ylim(len(power) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(0.0, 100.0)
        label(axes, "flights, %")
        return figure

    caption = (
        "Flights with each effect in them, drawn from its prior. Filled: it is stated with 90 % or more. Outline: it "
        "is in the set that holds 95 %."
    )
    return Plate("power", "How often each effect would be named", caption, make)


def _confusion_plate(plan: GapPlan) -> Plate:
    power = plan.power
    truths = list(power)[-_MOST:]
    taken = {n: p for t in truths for n, p in power[t].given.items() if n not in truths and p >= _SEEN}
    others = sorted(taken.keys() - {"nothing", "unknown"}, key=lambda n: -taken[n])[:_OTHERS]
    names = [*truths, *others, "nothing", "unknown"]
    given = np.array([[power[t].given.get(n, 0.0) for n in names] for t in truths])

    def make(wide: bool) -> Figure:
        """Draw the matrix of mean probabilities."""
        cell = 0.168 if wide else 0.088
        left, top = (1.75, 1.85) if wide else (1.15, 1.5)
        size = 7 if wide else 4
        figure = new_figure(wide, top + cell * len(truths) + 0.75)
        width = float(figure.get_size_inches()[0])
        right = max(0.1, width - left - cell * len(names))
        axes = grid(figure, top, [cell * len(truths)], left_in=left, right_in=right)[0, 0]
        image = axes.imshow(given / PERCENT, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=size)
        axes.set_yticks(range(len(truths)), truths, fontsize=size)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        tall = float(figure.get_size_inches()[1])
        bar = figure.add_axes((left / width, 0.33 / tall, 1.8 / width, 0.09 / tall))
        colours = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=[0.0, 50.0, 100.0])
        colours.ax.set_title("mean probability that is given, %", fontsize=7, color=QUIET, loc="left")
        colours.outline.set_visible(False)
        return figure

    caption = (
        f"Row: an effect that is there; the {len(truths)} that are named least. Column: what it is taken for, by the "
        "mean probability over its flights. A right answer lies on the diagonal; the last two columns are nothing, and "
        "something that the library lacks."
    )
    return Plate("confusion", "What effects would be taken for", caption, make)
