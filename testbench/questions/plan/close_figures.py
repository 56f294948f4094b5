"""The figure of a plan after its flights: the error of every target, promised, realised in simulation, and flown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import PERCENT
from testbench.page.figure import COLOURS, INK, MEASURED, Chart, Curve, Drawn, Panel, Plate, bars, rows

if TYPE_CHECKING:
    from testbench.questions.plan.verdicts import Campaign, Target

_MOST = 14  # targets that one figure shows
_KINDS = (("promised", MEASURED), ("realised in simulation", COLOURS[0]), ("flown", COLOURS[1]))


def close_plates(campaign: Campaign) -> list[Plate]:
    """Return the figure of the errors; none where nothing was promised or found."""
    targets = [(c.card.number, t) for c in campaign.cards for t in c.targets if _percent(t, t.promised) is not None]
    if not targets:
        return []
    left = len(targets) - _MOST
    shown = sorted(sorted(targets, key=lambda row: -row[1].lack)[:_MOST], key=lambda row: row[0])
    caption = (
        "Standard errors of the runs that were flown, of cards that were not, those of the planned ones. Lines: 95 % "
        "interval of what was realised. Marks: what was wanted."
        + (f" {left} more stand in the table." if left > 0 else "")
    )
    errors = np.array([[math.nan if v is None else v for v in _bars(t)] for _, t in shown])
    low, at = 0.5 * float(np.nanmin(errors)), np.arange(len(shown))
    draws: list[Drawn] = [
        bars(at + 0.24 * (k - 1), low, errors[:, k], 0.2, name=name, colour=colour)
        for k, (name, colour) in enumerate(_KINDS)
    ]
    for y, (_, t) in enumerate(shown):
        if t.realised is not None and t.believed:
            draws.append(Curve(x=[end / abs(t.believed) / PERCENT for end in t.realised[1:]], y=[y, y], width=1.0))
    wanted = [_percent(t, t.wanted) for _, t in shown]
    x = [math.nan if v is None else v for v in wanted]
    draws.append(Curve(x=x, y=at, name="wanted", marker="|", size=18.0, colour=INK, order=4.0))
    panel = Panel(
        draws=draws, x="standard error, % of the believed value", log_x=True,
        x_range=(low, 2.0 * float(np.nanmax(errors))), **rows([f"{number}: {t.name}" for number, t in shown], 0.42),
    )  # fmt: skip
    return [Plate("errors", "Promised, realised, flown", caption, Chart([[panel]]))]


def _bars(t: Target) -> tuple[float | None, float | None, float | None]:
    """Return promised, realised and flown error, in percent of the believed value."""
    realised = math.nan if t.realised is None else t.realised[0]
    return _percent(t, t.promised), _percent(t, realised), _percent(t, t.error)


def _percent(t: Target, error: float) -> float | None:
    if not math.isfinite(error) or not t.believed or not math.isfinite(t.believed):
        return None
    return error / abs(t.believed) / PERCENT
