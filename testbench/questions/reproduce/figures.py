"""One form for all figures of the reproduction: panels of lines, points and marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.record import FloatArray
from testbench.page.plot import (
    COLOURS,
    DASHES,
    INK,
    MEASURED,
    QUIET,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    log_axis,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Line:
    """One curve or, with a ``marker``, one set of points; a ``label`` looks the same in every panel.

    ``colour`` is a number of the palette, or "ink", "measured" or "quiet".
    """

    x: FloatArray
    y: FloatArray
    label: str = ""
    colour: int | str = 0
    marker: str = ""
    joined: bool = True
    width: float = 1.3


@dataclass(frozen=True, eq=False)
class Panel:
    """One set of axes: ``marks`` are vertical lines at x with a word, ``levels`` horizontal ones; ``ticks`` name x."""

    title: str
    x: str
    y: str
    lines: tuple[Line, ...]
    log_x: bool = False
    log_y: bool = False
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    marks: tuple[tuple[float, str], ...] = ()
    levels: tuple[float, ...] = ()
    ticks: tuple[tuple[float, str], ...] = ()


def plate(
    name: str,
    title: str,
    caption: str,
    panels: Sequence[Panel],
    columns: int = 2,
    height_in: float = 1.7,
) -> Plate:
    """Return a figure of ``panels``, row by row in so many columns, under one legend of all labels."""

    def make(wide: bool) -> Figure:
        """Draw all panels."""
        across = min(columns, len(panels)) if wide else 1
        rows = -(-len(panels) // across)
        handles = _handles(panels)
        names = [str(h.get_label()) for h in handles]
        top = 0.3 + (legend_in(names, wide) if names else 0.0)
        figure = new_figure(wide, top + rows * height_in + (rows - 1) * 0.72 + 0.5)
        axes = grid(figure, top, [height_in] * rows, [1.0] * across, gap_in=0.72, between_in=0.72).ravel()
        for spare in axes[len(panels) :]:
            spare.set_axis_off()
        for place, panel in zip(axes, panels, strict=False):
            _draw(place, panel)
        if handles:
            legend(figure, handles)
        return figure

    return Plate(name, title, caption, make)


def _colour(line: Line) -> str:
    named = {"ink": INK, "measured": MEASURED, "quiet": QUIET}
    return named[line.colour] if isinstance(line.colour, str) else COLOURS[line.colour % 6]


def _look(line: Line) -> dict[str, Any]:
    dash = DASHES[line.colour % 6] if isinstance(line.colour, int) else "-"
    look: dict[str, Any] = {"color": _colour(line), "linewidth": line.width, "linestyle": dash if line.joined else ""}
    if line.marker:
        look |= {"marker": line.marker, "markersize": 4.0 if line.joined else 4.5}
        if not line.joined and line.marker in "osD^v":
            look["markerfacecolor"] = "none"
    return look


def _draw(axes: Axes, panel: Panel) -> None:
    for which, log in (("x", panel.log_x), ("y", panel.log_y)):
        if log:
            getattr(axes, f"set_{which}scale")("log")
    for level in panel.levels:
        axes.axhline(level, color=QUIET, linestyle=":", linewidth=0.9)
    for line in panel.lines:
        x, y = np.asarray(line.x, float), np.asarray(line.y, float)
        if line.joined and not line.marker and not panel.log_x and x.size > 1200 and np.all(np.diff(x) > 0.0):
            x, y = envelope(x, y, 400)
        axes.plot(x, y, **_look(line))
    if panel.x_range:
        axes.set_xlim(*panel.x_range)
    elif any(line.marker for line in panel.lines):
        axes.margins(x=0.05)
    if panel.y_range:
        axes.set_ylim(*panel.y_range)
    for which, log in (("x", panel.log_x), ("y", panel.log_y)):
        if log:
            log_axis(axes, which, powers=which == "y")
    for i, (at, word) in enumerate(panel.marks):
        axes.axvline(at, color=QUIET, linewidth=0.8, linestyle=":")
        place = axes.transAxes.inverted().transform(axes.transData.transform((at, 1.0)))[0]
        right = place > 0.8  # words near the right end would be cut off
        axes.annotate(
            word, (at, 1.0), (-2.0 if right else 2.0, -8.0 - 9.0 * (i % 3)), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7.0, color=QUIET, ha="right" if right else "left",
        )  # fmt: skip
    if panel.ticks:
        axes.set_xticks([at for at, _ in panel.ticks], [word for _, word in panel.ticks])
    label(axes, panel.x, panel.y, panel.title)


def _handles(panels: Sequence[Panel]) -> list[Any]:
    """Return one legend entry per label, in order of appearance."""
    from testbench.page.plot import line_handles

    known: dict[str, Line] = {}
    for panel in panels:
        for line in panel.lines:
            if line.label:
                known.setdefault(line.label, line)
    out = []
    for text, line in known.items():
        (handle,) = line_handles([], [(text, _colour(line))])
        look = _look(line)
        handle.set_linestyle(look["linestyle"] or "None")
        handle.set_linewidth(max(line.width, 1.3))
        if line.marker:
            handle.set_marker(line.marker)
            handle.set_markersize(4.5)
            handle.set_markerfacecolor(look.get("markerfacecolor", look["color"]))
        out.append(handle)
    return out
