"""The figure of a pooling: every log's coefficients with bars over the condition, the pooled band and the prior's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.plot import BAND, COLOURS, INK, MEASURED, Plate, grid, label, legend, legend_in, new_figure
from testbench.questions.identify.pool.answer import VARIABLES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.questions.identify.pool.ask import PooledFlights

_MOST = 24  # coefficients drawn; more than that is for the table
_INTERVAL = 1.96
_APART = 0.025  # of the range of the condition, between logs at one
_BESIDE = 0.08  # of the range of the condition, drawn on either side of the logs


def pool_plates(flights: PooledFlights) -> list[Plate]:
    """Return one panel per coefficient, logs over the variable of the trend, or over speed."""
    pooled = flights.pooled
    variable = pooled.trend.variable or ("V" if all("V" in log.at for log in pooled.logs) else "qbar")
    word, factor, unit = VARIABLES[variable]
    shown = pooled.coefficients[:_MOST]
    believed = any(c.prior is not None for c in shown)
    apart = pooled.disagreement.outlying if pooled.disagreement is not None else ""
    both = "data and prior together" if believed else "pooled"
    wide_band = " The wide pale band is the prior." if believed else ""
    caption = (
        f"Bars: every log with its 95 % interval, over {word}. "
        f"Line and band: {both}, 95 %.{wide_band} Logs at one condition are drawn side "
        "by side. A wide prior may reach beyond the vertical range."
    )

    def make(wide: bool) -> Figure:
        """Draw one panel per coefficient."""
        across = min(3 if wide else 1, len(shown))
        rows = -(-len(shown) // across)
        handles = _handles(believed, apart)
        top = legend_in([str(h.get_label()) for h in handles], wide) + 0.3
        tall, gap = 1.35, 0.62
        figure = new_figure(wide, top + rows * tall + (rows - 1) * gap + 0.5)
        panels = grid(figure, top, [tall] * rows, [1.0] * across, gap_in=gap)
        for i, axes in enumerate(panels.ravel()):
            if i >= len(shown):
                axes.set_visible(False)
                continue
            _draw(axes, flights, shown[i].name, variable, factor)
            label(axes, f"{word}, {unit}" if i + across >= len(shown) else "", "", shown[i].name)
        legend(figure, handles)
        return figure

    return [Plate("pooled", "Coefficients of every log, and pooled", caption, make)]


def _draw(axes: Axes, flights: PooledFlights, name: str, variable: str, factor: float) -> None:
    pooled = flights.pooled
    c = pooled.coefficient(name)
    held = [log for log in pooled.logs if name in log.names]
    every = np.array([log.at[variable] for log in pooled.logs])
    reach = float(np.ptp(every)) or 0.2 * abs(float(every[0])) or 0.1
    beside, shifts = _BESIDE * reach, _shifts(flights, variable, _APART * reach)
    x = np.linspace(every.min() - beside, every.max() + beside, 41)
    band = np.array([pooled.at(name, v) if c.slope is not None else (c.posterior, c.posterior_std) for v in x])
    low, high = band[:, 0] - _INTERVAL * band[:, 1], band[:, 0] + _INTERVAL * band[:, 1]
    seen = [*low, *high]
    if c.prior is not None and c.prior_std is not None:
        wide = _INTERVAL * c.prior_std
        axes.axhspan(c.prior - wide, c.prior + wide, color=BAND, zorder=0)
        axes.axhline(c.prior, color=MEASURED, linewidth=0.9, linestyle="--", zorder=1)
        seen.append(c.prior)
    axes.fill_between(x * factor, low, high, color=COLOURS[0], alpha=0.3, linewidth=0.0, zorder=2)
    axes.plot(x * factor, band[:, 0], color=COLOURS[0], zorder=3)
    for log in held:
        i = log.names.index(name)
        bar = _INTERVAL * float(log.covariance[i, i]) ** 0.5
        y = float(log.values[i])
        apart = flights.pooled.disagreement is not None and flights.pooled.disagreement.outlying == log.log
        x_drawn = (log.at[variable] + shifts[log.log]) * factor
        colour = COLOURS[1] if apart else INK
        axes.errorbar(
            x_drawn, y, yerr=bar, fmt="o", color=colour, markersize=4.0, capsize=2.0, elinewidth=1.2, zorder=4
        )
        seen += [y - bar, y + bar]
    margin = 0.08 * (max(seen) - min(seen) or 1.0)
    axes.set_xlim(x[0] * factor, x[-1] * factor)
    axes.set_ylim(min(seen) - margin, max(seen) + margin)
    axes.locator_params(axis="both", nbins=5)


def _shifts(flights: PooledFlights, variable: str, apart: float) -> dict[str, float]:
    """Return log -> by how much it is drawn beside its place, so that logs at one condition can be told apart."""
    out: dict[str, float] = {}
    near: list[tuple[float, str]] = []
    every = sorted((log.at[variable], log.log) for log in flights.pooled.logs)
    for place, name in [*every, (float("inf"), "")]:
        if near and place - near[-1][0] > apart:
            middle = 0.5 * (len(near) - 1)
            out |= {log: (k - middle) * apart for k, (_, log) in enumerate(near)}
            near = []
        near.append((place, name))
    return out


def _handles(believed: bool, apart: str) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    out: list[Any] = [
        Line2D([], [], color=INK, marker="o", markersize=4.0, linewidth=1.2, label="one log"),
        Line2D([], [], color=COLOURS[0], label="pooled with prior" if believed else "pooled"),
    ]
    if believed:
        out.append(Patch(facecolor=BAND, edgecolor=MEASURED, label="prior"))
    if apart:
        out.append(Line2D([], [], color=COLOURS[1], marker="o", markersize=4.0, linewidth=1.2, label=f"{apart}, apart"))
    return out
