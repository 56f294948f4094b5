"""Estimated parameters with their 95 % intervals, model by model, and the truth where it is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from testbench.page.plot import INK, Plate, few_ticks, grid, label, legend, legend_in, marker_look, new_figure
from testbench.questions.run.labels import case_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.questions.run.result import RunResult

_INTERVAL = 1.96  # standard errors on either side hold 95 % of a normal distribution
_MOST = 24  # parameters drawn; more than that is for the table


def parameter_plates(result: RunResult) -> list[Plate]:
    """Return one panel per parameter with every model's estimate and 95 % interval; nothing without such models."""
    names = case_names(result.cases)
    models = [
        (name, k, {p.name: p for p in case.evaluation.parameters if p.free})
        for k, (name, case) in enumerate(zip(names, result.cases, strict=True))
    ]
    models = [m for m in models if m[2]]
    if not models:
        return []
    wanted = dict.fromkeys(p for _, _, found in models for p in found if not p.endswith("_0"))
    chosen = list(wanted)[:_MOST]
    known = any(p.true is not None for _, _, found in models for p in found.values())
    caption = (
        "Estimates with 95 % intervals, corrected for coloured residuals."
        f"{' Vertical line: true derivative of the linearised aircraft.' if known else ''} SI units and radians. "
        "Constants are in the table only."
    )

    def make(wide: bool) -> Figure:
        """Draw one panel per parameter, models below each other."""
        across = min(4 if wide else 2, len(chosen))
        rows = -(-len(chosen) // across)
        tall = 0.32 + 0.16 * len(models)
        handles = _handles(models, known)
        top = legend_in([str(h.get_label()) for h in handles], wide) + 0.3
        figure = new_figure(wide, top + rows * tall + (rows - 1) * 0.62 + 0.4)
        panels = grid(figure, top, [tall] * rows, [1.0] * across, gap_in=0.62)
        for i, axes in enumerate(panels.ravel()):
            if i >= len(chosen):
                axes.set_visible(False)
                continue
            for row, (_, k, found) in enumerate(models):
                p = found.get(chosen[i])
                if p is None:
                    continue
                colour, marker = marker_look(k)
                axes.errorbar(
                    p.value, -row, xerr=_INTERVAL * p.std, fmt=marker, color=colour, markersize=4.5, capsize=2.0,
                    elinewidth=1.3,
                )  # fmt: skip
                if p.true is not None:
                    axes.axvline(p.true, color=INK, linewidth=1.0, zorder=0)
            axes.margins(x=0.08)
            axes.set_yticks([])
            axes.set_ylim(-len(models) + 0.4, 0.6)
            few_ticks(axes)
            label(axes, "", "", chosen[i], lines=2)
        legend(figure, handles)
        return figure

    return [Plate("parameters", "Estimated parameters", caption, make)]


def _handles(models: list[tuple[str, int, dict[str, Any]]], known: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    rows = [Line2D([], [], color=INK, linewidth=1.0, label="true")] if known else []
    for name, k, _ in models:
        colour, marker = marker_look(k)
        rows.append(Line2D([], [], color=colour, marker=marker, markersize=4.5, linewidth=1.3, label=name))
    return rows
