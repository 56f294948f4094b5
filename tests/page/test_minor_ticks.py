"""Minor ticks that are drawn at once look like matplotlib's own."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.ticker import NullFormatter, NullLocator

from testbench.page.minor_ticks import MinorTicks
from testbench.page.plot import grid, new_figure, style

pytestmark = pytest.mark.drawn


def pixels(own: bool, with_ticks: bool = True) -> np.ndarray:
    """A panel with logarithmic axes, a second scale below it, and one behind it that shows no ticks."""
    with rc_context(style()):
        figure = new_figure(False, 3.0)
        axes = grid(figure, 0.4, [1.6])[0][0]
        w = np.logspace(-1.0, 2.5, 50)
        axes.loglog(w, 1.0 / (1.0 + w**2))
        below = axes.secondary_xaxis(-0.3, functions=(lambda x: x / 6.0, lambda x: 6.0 * x))
        behind = axes.twinx()
        behind.plot(w, w)
        for panel, which in ((axes, "x"), (axes, "y"), (below, "x"), (behind, "y")):
            getattr(panel, f"set_{which}scale")("log")
            axis = getattr(panel, f"{which}axis")
            axis.set_minor_formatter(NullFormatter())
            if own and with_ticks:
                panel.add_artist(MinorTicks(axis, axis.get_minor_locator()))
            if own or not with_ticks:
                axis.set_minor_locator(NullLocator())
        behind.tick_params(right=False, labelright=False, which="both")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba()).copy()


def test_they_are_the_same_pixels():
    ours = pixels(own=True)
    assert np.array_equal(ours, pixels(own=False))
    assert not np.array_equal(ours, pixels(own=False, with_ticks=False))


@pytest.mark.parametrize("hide", [lambda axes: axes.set_axis_off(), lambda axes: axes.xaxis.set_visible(False)])
def test_a_hidden_axis_has_none(hide):
    with rc_context(style()):
        figure = new_figure(False, 2.0)
        axes = grid(figure, 0.4, [1.0])[0][0]
        axes.set_xscale("log")
        axes.set_xlim(1.0, 100.0)
        hide(axes)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        before = np.asarray(canvas.buffer_rgba()).copy()
        axes.add_artist(MinorTicks(axes.xaxis, axes.xaxis.get_minor_locator()))
        canvas.draw()
        assert np.array_equal(np.asarray(canvas.buffer_rgba()), before)
