"""The figure of a plan after its flights: the error of every target, promised, realised in simulation, and flown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from testbench.core.constants import PERCENT
from testbench.page.plot import (
    COLOURS,
    INK,
    MEASURED,
    Plate,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    log_axis,
    new_figure,
)
from testbench.questions.plan.verdicts import Campaign, Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW_IN = 0.42
_LONGEST = 24  # letters of a target's name
_MOST = 14  # targets that one figure shows
_KINDS = (("promised", MEASURED), ("realised in simulation", COLOURS[0]), ("flown", COLOURS[1]))


def close_plates(campaign: Campaign) -> list[Plate]:
    """Return the figure of the errors; none where nothing was promised or found."""
    rows = [(c.card.number, t) for c in campaign.cards for t in c.targets if _percent(t, t.promised) is not None]
    if not rows:
        return []
    left = len(rows) - _MOST
    shown = sorted(sorted(rows, key=lambda row: -row[1].lack)[:_MOST], key=lambda row: row[0])
    caption = (
        "Standard errors of the runs that were flown, of cards that were not, those of the planned ones. Lines: 95 % "
        "interval of what was realised. Marks: what was wanted."
        + (f" {left} more stand in the table." if left > 0 else "")
    )

    def make(wide: bool) -> Figure:
        """Draw one row of bars per target."""
        from matplotlib.lines import Line2D

        key, tall = legend_in([*(name for name, _ in _KINDS), "wanted"], wide), _ROW_IN * len(shown)
        figure = new_figure(wide, key + 0.1 + tall + 0.5)
        axes = grid(figure, key + 0.1, [tall], left_in=1.5 if wide else 1.25, right_in=0.25)[0, 0]
        values = [v for _, t in shown for v in _bars(t) if v is not None]
        low = 0.5 * min(values)
        for i, (_, t) in enumerate(shown):
            _draw(axes, t, float(len(shown) - 1 - i), low)
        log_axis(axes, "x", powers=False)
        axes.set_xlim(low, 2.0 * max(values))
        axes.set_ylim(-0.6, len(shown) - 0.4)
        names = [f"{number}: {t.name}" for number, t in shown]
        axes.set_yticks(
            range(len(shown) - 1, -1, -1), [n if len(n) <= _LONGEST else n[: _LONGEST - 1] + "…" for n in names]
        )
        axes.grid(visible=False, axis="y")
        label(axes, "standard error, % of the believed value")
        legend(
            figure,
            [
                *line_handles([], list(_KINDS)),
                Line2D([], [], marker="|", markersize=11, ls="", color=INK, label="wanted"),
            ],
        )
        return figure

    return [Plate("errors", "Promised, realised, flown", caption, make)]


def _bars(t: Target) -> tuple[float | None, float | None, float | None]:
    """Return promised, realised and flown error, in percent of the believed value."""
    realised = math.nan if t.realised is None else t.realised[0]
    return _percent(t, t.promised), _percent(t, realised), _percent(t, t.error)


def _draw(axes: Axes, t: Target, y: float, low: float) -> None:
    for k, (value, (_, colour)) in enumerate(zip(_bars(t), _KINDS, strict=True)):
        if value is not None:
            axes.barh(y + 0.24 * (1 - k), value - low, left=low, height=0.2, color=colour)
    if t.realised is not None and t.believed:
        low_high = [end / abs(t.believed) / PERCENT for end in t.realised[1:]]
        axes.plot(low_high, [y, y], color=INK, linewidth=1.0)
    wanted = _percent(t, t.wanted)
    if wanted is not None:
        axes.plot([wanted, wanted], [y - 0.36, y + 0.36], color=INK, linewidth=1.6)


def _percent(t: Target, error: float) -> float | None:
    if not math.isfinite(error) or not t.believed or not math.isfinite(t.believed):
        return None
    return error / abs(t.believed) / PERCENT
