"""The figure of a pooling: every log's coefficients with bars over the condition, the pooled band and the prior's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.figure import (
    BAND,
    COLOURS,
    DASHED,
    INK,
    INTERVAL,
    MEASURED,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Span,
    band,
    grid,
)
from testbench.questions.identify.pool.answer import VARIABLES

if TYPE_CHECKING:
    from testbench.questions.identify.pool.ask import PooledFlights

_MOST = 24  # coefficients drawn; more than that is for the table
_APART = 0.025  # of the range of the condition, between logs at one
_BESIDE = 0.08  # of the range of the condition, drawn on either side of the logs


def pool_plates(flights: PooledFlights) -> list[Plate]:
    """Return one panel per coefficient, logs over the variable of the trend, or over speed."""
    pooled = flights.pooled
    variable = pooled.trend.variable or ("V" if all("V" in log.at for log in pooled.logs) else "qbar")
    shown = pooled.coefficients[:_MOST]
    believed = any(c.prior is not None for c in shown)
    both = "data and prior together" if believed else "pooled"
    wide_band = " The wide pale band is the prior." if believed else ""
    caption = (
        f"Bars: every log with its 95 % interval, over {VARIABLES[variable][0]}. "
        f"Line and band: {both}, 95 %.{wide_band} Logs at one condition are drawn side "
        "by side. A wide prior may reach beyond the vertical range."
    )
    panels = [_panel(flights, c.name, variable, "pooled with prior" if believed else "pooled") for c in shown]
    return [Plate("pooled", "Coefficients of every log, and pooled", caption, grid(panels, 3, share_x=True))]


def _panel(flights: PooledFlights, name: str, variable: str, said: str) -> Panel:
    pooled, (word, factor, unit) = flights.pooled, VARIABLES[variable]
    c, outlying = pooled.coefficient(name), pooled.disagreement.outlying if pooled.disagreement is not None else ""
    every = np.array([log.at[variable] for log in pooled.logs])
    reach = float(np.ptp(every)) or 0.2 * abs(float(every[0])) or 0.1
    beside, shifts = _BESIDE * reach, _shifts(flights, variable, _APART * reach)
    x = np.linspace(every.min() - beside, every.max() + beside, 41)
    value, std = np.array([pooled.at(name, v) if c.slope is not None else (c.posterior, c.posterior_std) for v in x]).T
    low, high = value - INTERVAL * std, value + INTERVAL * std
    seen, draws = [*low, *high], list[Drawn]()
    if c.prior is not None and c.prior_std is not None:
        wide = INTERVAL * c.prior_std
        draws += [Span(low=c.prior - wide, high=c.prior + wide, of="y", name="prior", colour=BAND),
                  Rule(at=c.prior, of="y", colour=MEASURED, dash=DASHED)]  # fmt: skip
        seen.append(c.prior)
    for log in pooled.logs:
        if name not in log.names:
            continue
        i = log.names.index(name)
        bar, y = INTERVAL * float(log.covariance[i, i]) ** 0.5, float(log.values[i])
        apart = outlying == log.log
        draws.append(
            Curve(x=[(log.at[variable] + shifts[log.log]) * factor], y=[y], y_error=bar, marker="o", size=4.0,
                  colour=COLOURS[1] if apart else INK, name=f"{outlying}, apart" if apart else "one log", order=4.0)
        )  # fmt: skip
        seen += [y - bar, y + bar]
    draws += [
        band(x * factor, low, high, COLOURS[0]), Curve(x=x * factor, y=value, colour=COLOURS[0], name=said, order=3.0)
    ]  # fmt: skip
    margin = 0.08 * (max(seen) - min(seen) or 1.0)
    return Panel(
        draws=draws, title=name, x=f"{word}, {unit}", x_range=(x[0] * factor, x[-1] * factor), tall_in=1.35,
        y_range=(min(seen) - margin, max(seen) + margin),
    )  # fmt: skip


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
