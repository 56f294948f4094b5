"""Minor ticks of a logarithmic axis, all drawn at once.

matplotlib makes an object with three lines and two texts of each tick, label or none. A logarithmic panel has dozens,
and they took a quarter of the time that a report's figures take.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT, TICKRIGHT, TICKUP

_SIDES: dict[str, tuple[tuple[str, str, Any], ...]] = {
    "x": (("bottom", "tick1", TICKDOWN), ("top", "tick2", TICKUP)),
    "y": (("left", "tick1", TICKLEFT), ("right", "tick2", TICKRIGHT)),
}


class MinorTicks(Artist):
    """The minor ticks of one axis, outside the panel, on the sides where the axis has its own.

    Args:
        axis: an axis of a panel.
        locator: says where they are.
    """

    def __init__(self, axis: Any, locator: Any) -> None:
        super().__init__()
        self._axis, self._locator = axis, locator
        locator.set_axis(axis)
        self.set_zorder(2.01)  # that of ticks
        self.set_in_layout(False)

    def draw(self, renderer: Any) -> None:
        """Draw the ticks within the limits that the axis has now."""
        panel, name = self._axis.axes, self._axis.axis_name
        low, high = sorted(self._axis.get_view_interval())
        settings: Any = rcParams  # matplotlib types its keys one by one, these are put together here
        places = np.array([x for x in self._locator() if low <= x <= high])
        if not (panel.axison and self._axis.get_visible() and places.size):
            return
        shown, zeros = self._axis.get_tick_params(which="minor"), np.zeros(len(places))
        for side, which, marker in _SIDES[name]:
            if not shown.get(side, False):
                continue
            across = getattr(panel, f"get_{name}axis_transform")(which=which)
            line = Line2D(*((places, zeros) if name == "x" else (zeros, places)), linestyle="none", marker=marker)
            line.set(
                markersize=settings[f"{name}tick.minor.size"],
                markeredgewidth=settings[f"{name}tick.minor.width"],
                color=settings[f"{name}tick.color"],
                transform=across,
            )
            line.set_figure(panel.get_figure(root=True))
            line.draw(renderer)
