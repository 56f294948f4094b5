"""The recorded flight against the aircraft as it was and as it is amended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.labels import axis_label, shown_unit
from testbench.page.plot import (
    COLOURS,
    INK,
    MEASURED,
    QUIET,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    new_figure,
    time_axis,
)
from testbench.questions.identify.amend.tables import USES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FloatArray
    from testbench.questions.identify.amend.result import Amended, Replay

_MOST = 3  # records drawn


def amended_plates(amended: Amended) -> list[Plate]:
    """Return the plate of the flights against both; none if no record was flown."""
    drawn = _drawn(amended)
    if not drawn:
        return []
    channels = drawn[0].channels
    looks: list[tuple[str, dict[str, Any]]] = [
        ("measured", {"color": MEASURED, "linewidth": 1.5}),
        (f"{amended.old.name}, as it was", {"color": COLOURS[1], "linewidth": 1.2, "linestyle": (0, (4, 1.5))}),
        (f"{amended.name}, amended", {"color": COLOURS[0], "linewidth": 1.3}),
    ]
    caption = (
        f"Grey: measured, prepared. Both aircraft are flown by JSBSim with the recorded inputs from trim in still air; "
        "the state that a record begins with and constants of inputs and outputs are fitted, of both alike. Records "
        f"that were not used took no part in making {amended.name}."
    )
    if len(drawn) < len(amended.replays):
        caption += f" Of {len(amended.replays)} records {len(drawn)} are drawn, those not used first."

    def make(wide: bool) -> Figure:
        """Draw one row of panels per output, one column per record."""
        from matplotlib.lines import Line2D

        top = legend_in([name for name, _ in looks], wide) + 0.28
        heights = [1.15] * (len(channels) * (1 if wide else len(drawn)))
        gap = 0.26 if wide else 0.52
        figure = new_figure(wide, top + sum(heights) + gap * (len(heights) - 1) + 0.5)
        across = [max(float(r.t_s[-1]), 1e-9) for r in drawn] if wide else [1.0]
        longest = max(across)
        panels = grid(
            figure, top, heights, [max(w, 0.35 * longest) for w in across], gap_in=gap, between_in=0.45
        ).reshape(len(channels), len(drawn))
        for i, name in enumerate(channels):
            factor, _ = shown_unit(name)
            for k, replay in enumerate(drawn):
                axes = panels[i, k]
                measured = np.where(replay.valid[:, i], factor * replay.measured[:, i], np.nan)
                for y, (_, look) in zip(
                    (measured, *(None if x is None else factor * x[:, i] for x in (replay.before, replay.after))),
                    looks,
                    strict=True,
                ):
                    if y is not None:
                        axes.plot(*envelope(replay.t_s, y), **look)
                _limit(axes, measured)
                title = f"{replay.name}, {USES[replay.use]}" if i == 0 else ""
                last = i == len(channels) - 1
                label(axes, "t, s" if last else "", axis_label(name, True) if k == 0 or not wide else "", title,
                      INK if i == 0 else QUIET)  # fmt: skip
                time_axis(axes)
        legend(figure, [Line2D([], [], label=name, **look) for name, look in looks])
        return figure

    return [Plate("amended", f"The flight against {amended.old.name} and {amended.name}", caption, make)]


def _drawn(amended: Amended) -> list[Replay]:
    order = sorted(amended.replays, key=lambda r: r.use != "validation")
    chosen = order[:_MOST]
    if len(order) > _MOST and all(r.use == "validation" for r in chosen):
        chosen[-1] = next((r for r in order if r.use != "validation"), chosen[-1])
    return chosen


def _limit(axes: Axes, measured: FloatArray) -> None:
    """Keep a flight that departs from hiding what was measured."""
    low, high = axes.get_ylim()
    least, most = float(np.nanmin(measured)), float(np.nanmax(measured))
    reach = 1.0 * max(most - least, 1e-9)
    axes.set_ylim(max(low, least - reach), min(high, most + reach))
