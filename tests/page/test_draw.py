"""The renderer of figures: what it places, shares and leaves out, whatever a figure shows."""

from typing import Any

import numpy as np
import pytest

from testbench.page.draw import styled
from testbench.page.figure import COLOURS, Area, Chart, Curve, Image, Panel, Rule, Span, bars, grid, recoloured, within

pytestmark = pytest.mark.drawn

X = np.linspace(1.0, 9.0, 30)


def panel(k: int = 0, **settings) -> Panel:
    return Panel(
        **{"draws": [Curve(x=X, y=10.0**k * X, name=f"line {k}")], "x": "t, s", "y": f"a long name {k}"} | settings
    )


def written(figure) -> list[tuple[str, Any]]:
    """Return what is written on a figure and where, in pixels."""
    figure.canvas.draw()
    texts = [t for axes in figure.axes for t in (axes.xaxis.label, axes.yaxis.label, axes._left_title)]
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        texts += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    texts += [t for legend in figure.legends for t in legend.get_texts()]
    return [(t.get_text(), t.get_window_extent()) for t in texts if t.get_visible() and t.get_text()]


@pytest.mark.parametrize("wide", [True, False])
@pytest.mark.parametrize("shared", [True, False])
def test_nothing_that_is_written_leaves_the_paper_or_lies_over_another(wide, shared):
    panels = [panel(k, title=f"the title of panel number {k}, which is longer than one line is") for k in range(6)]
    figure = styled(grid(panels, 3, share_x=shared), wide)
    found = written(figure)
    paper = figure.bbox
    assert [t for t, box in found if box.x0 < 0.0 or box.y0 < 0.0 or box.x1 > paper.x1 or box.y1 > paper.y1] == []
    small = [(t, box.shrunk(0.9, 0.9)) for t, box in found]
    assert [(t, other) for k, (t, box) in enumerate(small) for other, there in small[:k] if box.overlaps(there)] == []


def test_panels_that_share_their_axes_number_them_once():
    figure = styled(Chart([[panel(0), panel(0)], [panel(1), panel(1)]], share_x=True, share_y=True))
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "t, s", "t, s"]
    assert [bool(axes.get_ylabel()) for axes in figure.axes] == [True, False, True, False]
    assert figure.axes[0].get_ylim() == figure.axes[1].get_ylim()


def test_minor_ticks_of_a_logarithmic_axis_stand_between_the_decades():
    figure = styled(Chart([[panel(0, log_y=True, y_range=(0.5, 30.0))]]))
    (ticks,) = figure.artists
    wanted = [0.5, 0.6, 0.7, 0.8, 0.9, *range(2, 10), 20.0, 30.0]
    np.testing.assert_allclose(sorted(np.asarray(ticks.get_ydata(), float)), wanted)


def test_a_legend_names_each_look_once_and_colours_are_exchanged_everywhere():
    draws = [Curve(x=X, y=X, name="a", colour=COLOURS[0]), bars([1.0], 0.0, [2.0], 0.5, name="b", colour=COLOURS[0]),
             Rule(at=2.0, name="c", colour=COLOURS[0]), Span(low=1.0, high=2.0, colour=COLOURS[0])]  # fmt: skip
    chart = Chart([[Panel(draws=draws)], [Panel(draws=draws[:1])]])
    assert [d.name for d in chart.legend] == ["a", "b", "c"]
    swapped = recoloured(chart, {COLOURS[0]: "#ff0000"})
    assert {d.colour for p in swapped.panels for d in p.draws} == {"#ff0000"}
    assert {d.colour for p in chart.panels for d in p.draws} == {COLOURS[0]}


def test_what_is_not_a_number_is_neither_a_bar_nor_a_colour():
    assert len(bars([0.0, 1.0], 0.0, [1.0, np.nan], 0.5).outlines) == 1
    image = Image(values=np.array([[1.0, np.nan]]), low=1.0, high=100.0, log=True, title="e", ticks=[(1.0, "1")])
    figure = styled(Chart([[Panel(draws=[image, Area(outlines=[])])]]))
    assert np.ma.getmaskarray(np.ma.masked_invalid(figure.axes[0].images[0].get_array())).tolist() == [[False, True]]


def test_what_diverges_widens_an_axis_no_further_than_it_may():
    low, high = within(0.0, 1.0, [np.array([0.5, 1e9, np.inf]), np.array([-0.2])])
    assert low == pytest.approx(-0.2 - 0.08 * 1.8)
    assert high == pytest.approx(1.6 + 0.08 * 1.8)
