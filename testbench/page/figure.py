"""Figures as data: panels of curves, areas, bars, images and words, which one renderer draws and a page lets explore.

A figure says what is shown: numbers in the units of its axes, their names, and what belongs together. Where panels,
ticks, labels and the legend stand, and in which format, is for :mod:`testbench.page.draw` alone.
"""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.core.record import FlightRecord, FloatArray
    from testbench.page.explore import View

# Okabe and Ito, "Color Universal Design", 2008: told apart with any colour vision; each has its own dash, for print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
Dash = tuple[float, ...]
Numbers = NDArray[Any] | Sequence[float]
DASHES: tuple[Dash, ...] = ((), (6, 1.5), (3, 1.2), (6, 1.5, 1.2, 1.5), (1.2, 1.2), (9, 2))
MARKERS = "osD^vP"
DASHED: Dash = (4, 2)
DOTTED: Dash = (1, 1.65)
INK, QUIET, MEASURED, FAINT, BAND = "#202428", "#6b7280", "#a9b0b8", "#dfe3e8", "#eceff3"
AXIS, WARN = "#9aa1a9", "#b34700"
RIGID, ELASTIC = "#00664a", "#8a4f74"
"""Of modes."""
INTERVAL = 1.96
"""Standard errors on either side that hold 95 % of a normal distribution."""
PHASE_STEPS = (15, 30, 45, 90, 180, 360)
WIDE_IN, NARROW_IN = 8.6, 3.75  # of figures on a page
_OTHER_IN: ContextVar[float | None] = ContextVar("other width", default=None)
Item = TypeVar("Item")


def line_look(k: int) -> dict[str, Any]:
    """Return colour and dash of the k-th model of a figure; no two of 36 look alike."""
    return {"colour": COLOURS[k % 6], "dash": DASHES[(k + k // 6) % 6]}


def marker_look(k: int) -> dict[str, Any]:
    """Return colour and marker of the k-th model of a figure; no two of 36 look alike."""
    return {"colour": COLOURS[k % 6], "marker": MARKERS[(k + k // 6) % 6]}


def shades(count: int) -> list[str]:
    """Return colours from dark to light."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colormaps["viridis"](x)) for x in np.linspace(0.0, 0.82, count)]


# --- what a panel shows -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One line, or signs."""

    # x, y: points (n,) in the units of the panel; NaN where the line is broken
    x: Numbers
    y: Numbers
    name: str = ""  # of the legend; curves of one name have one entry. "" for none.
    # colour, dash, width: of the line; lengths in points
    colour: str = INK
    dash: Dash = ()
    width: float = 1.3
    # "o", "s", "D", "^", "v", "P", "+", "|" or "."; signs take the place of the line unless ``joined``
    marker: str = ""
    size: float = 5.0  # of the signs, points
    hollow: bool | str = False  # only the outlines of the signs are drawn, or white is within them if it is "white"
    joined: bool = False
    steps: bool = False  # a value holds until the next one
    # x_error, y_error: half lengths of bars at every point
    x_error: float | FloatArray | None = None
    y_error: float | FloatArray | None = None
    alpha: float | None = None  # opacity
    order: float = 2.0  # what is higher lies above; 2 for lines, 0 below the grid
    clip: bool = True  # what lies beyond the axes is cut off


@dataclass(frozen=True, eq=False, kw_only=True)
class Area:
    """One or more filled outlines of one look, each (x, y); see :func:`band` and :func:`bars`."""

    outlines: Sequence[tuple[Numbers, Numbers]]
    name: str = ""
    colour: str = MEASURED
    edge: str = ""
    width: float = 0.8
    alpha: float | None = None
    order: float = 1.0
    clip: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Span:
    """All between two places of the axis ``of``, as far as the panel reaches."""

    low: float
    high: float
    of: str = "x"
    colour: str = BAND
    alpha: float | None = None
    name: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rule:
    """A line across the panel at a place of the axis ``of``, and what it is called above or within the panel."""

    at: float
    of: str = "x"
    text: str = ""
    name: str = ""
    colour: str = QUIET
    dash: Dash = ()
    width: float = 0.9
    order: float = 1.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Image:
    """Values (rows, columns) as colours from white to blue: cell (i, k) lies about x = k, y = i; NaN is grey."""

    values: FloatArray
    low: float
    high: float
    log: bool = False
    title: str = ""
    ticks: Sequence[tuple[float, str]] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Words:
    """A text at a place of the panel."""

    # x, y: the place; ``of_panel`` says that y, or both, are shares of the panel: "y" or "xy"
    x: float
    y: float
    text: str  # what is written, any number of lines
    shift: tuple[float, float] = (0.0, 0.0)  # to the right and up, points
    # across, up: which part of the text stands there: "left", "center", "right"; "bottom", "center", "top"
    across: str = "left"
    up: str = "center"
    colour: str = INK
    size: float = 8.0  # of the letters, points
    turn: float = 0.0  # counterclockwise, degrees
    # bold, on_white: how it looks
    bold: bool = False
    on_white: bool = False
    of_panel: str = ""
    order: float = 6.0


Drawn = Curve | Area | Span | Rule | Image | Words


def band(x: FloatArray, low: FloatArray, high: FloatArray, colour: str = MEASURED, **look: Any) -> Area:
    """Return the area between two curves over one x (n,); it lets through what lies behind it."""
    y = np.concatenate([low, high[::-1]])
    return Area(outlines=[(np.concatenate([x, x[::-1]]), y)], colour=colour, **{"alpha": 0.3} | look)


def bars(at: Iterable[float], begin: float | Iterable[float], end: Iterable[float], width: float, **look: Any) -> Area:
    """Return horizontal bars from ``begin`` to ``end`` about ``at``; nothing of those that are not finite."""
    rows = [(y, a, b) for y, a, b in np.broadcast(list(at), _list(begin), list(end)) if np.isfinite(b)]
    half = 0.5 * width
    return Area(
        outlines=[([a, b, b, a], [y - half, y - half, y + half, y + half]) for y, a, b in rows], **{"order": 2.0} | look
    )


def _list(values: float | Iterable[float]) -> Any:
    return list(values) if isinstance(values, Iterable) else values


# --- panels and figures -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """One pair of axes and what is drawn on them."""

    draws: Sequence[Drawn]  # what is drawn
    title: str = ""  # above its left corner
    # x, y: names and units of the axes
    x: str = ""
    y: str = ""
    # tall_in, broad: its height, in, and its width relative to that of its neighbours
    tall_in: float = 1.5
    broad: float = 1.0
    # log_x, log_y: logarithmic axes
    log_x: bool = False
    log_y: bool = False
    # x_range, y_range: what is shown; None shows all. Of a log axis an end that is None is that of the curves.
    x_range: tuple[float | None, float | None] | None = None
    y_range: tuple[float | None, float | None] | None = None
    # x_ticks, y_ticks: (place, text), in the place of numbers; an empty list leaves them out
    x_ticks: Sequence[tuple[float, str]] | None = None
    y_ticks: Sequence[tuple[float, str]] | None = None
    y_steps: Sequence[float] = ()  # apart of ticks that may be chosen, as multiples of 45 are for degrees
    whole: str = ""  # axes whose ticks are whole numbers: "x", "y" or "xy"
    notes: Sequence[tuple[str, str]] = ()  # (text, colour) above its right corner, if there is room
    # a second panel over the same x, its axis at the right; or behind the first, without an axis
    right: Panel | None = None
    behind: bool = False  # this one lies behind the other
    x_too: tuple[str, float] | None = None  # name of a second axis below the first, and the factor to its numbers
    y_colour: str = ""  # of the axis
    # plain, bare: without a grid; without axes, and both to one scale
    plain: bool = False
    bare: bool = False
    # left, top, width and height from the figure's upper left corner, in; in place of the grid
    box_in: tuple[float, float, float, float] | None = None
    name: str = ""  # of what a reader explores; the name of the y axis if ""
    hidden: bool = False  # explored only when asked for

    @property
    def curves(self) -> list[Curve]:
        """What is drawn as lines or signs."""
        return [d for d in self.draws if isinstance(d, Curve)]


@dataclass(frozen=True, eq=False)
class Chart:
    """Rows of panels under one legend of all names; see :func:`grid` for many panels of one kind."""

    # at least one panel each; side by side in the wide form, in ``narrow`` columns in the narrow one
    rows: Sequence[Sequence[Panel]]
    narrow: int = 1  # columns of the narrow form
    share: float = 1.0  # of a page's width that the wide form takes
    # share_x, share_y: panels of a column, or of a row, have one axis, named and numbered once
    share_x: bool = False
    share_y: bool = False
    keys: Sequence[Curve | Area] | None = None  # entries of the legend in the place of those of the panels
    size_in: tuple[float, float] | None = None  # width and height, in; for panels that have places of their own
    aligned: bool = False  # rows of fewer panels stand in the columns of the others, too

    @property
    def panels(self) -> list[Panel]:
        """All panels, row by row."""
        return [p for row in self.rows for p in row]

    @property
    def legend(self) -> list[Curve | Area | Span | Rule]:
        """What the legend names: in the order of the first of each name, with the look of the last."""
        drawn = self.keys if self.keys is not None else [d for p in self.panels for d in _of(p)]
        named: dict[str, Curve | Area | Span | Rule] = {}
        for d in drawn:
            if not isinstance(d, Image | Words) and d.name:
                named[d.name] = d
        return list(named.values())


def grid(panels: Sequence[Panel], columns: int, **settings: Any) -> Chart:
    """Return a chart of panels, so many in a row of its wide form."""
    return Chart([panels[k : k + columns] for k in range(0, len(panels), columns)], aligned=True, **settings)


def recoloured(item: Any, swap: Mapping[str, str]) -> Any:
    """Return a chart, or a part of one, with some colours in the place of others."""
    if isinstance(item, str):
        return swap.get(item, item)
    if is_dataclass(item) and not isinstance(item, type):
        return replace(item, **{f.name: recoloured(getattr(item, f.name), swap) for f in fields(item)})
    if isinstance(item, (list, tuple)):
        return type(item)(recoloured(part, swap) for part in item)
    return item


def _of(panel: Panel) -> list[Drawn]:
    return [*panel.draws, *(_of(panel.right) if panel.right is not None else ())]


@dataclass(frozen=True)
class Drawing:
    """One drawn figure in its two forms; ``png`` is empty if it was not asked for."""

    svg: str
    png: bytes


@dataclass(frozen=True)
class Plate:
    """A figure of a report."""

    name: str  # short, fit for a file name
    title: str  # what it shows
    caption: str  # what to look at
    chart: Chart | Callable[[bool], Chart]  # the figure, or what makes its wide (True) or narrow form
    views: Sequence[View] = ()  # what a reader of the page explores; none leaves the figure a drawing

    def chart_of(self, wide: bool) -> Chart:
        """Return the figure as data: side by side, or one panel below the other for narrow screens."""
        return self.chart if isinstance(self.chart, Chart) else self.chart(wide)

    def make(self, wide: bool = True) -> Figure:
        """Return the figure as matplotlib's, in the report's style, on a canvas that needs no screen."""
        from testbench.page.draw import styled

        return styled(self.chart_of(wide), wide)

    def draw(self, wide: bool = True, png: bool = True) -> Drawing:
        """Return the figure as SVG text and, unless ``png`` is False, PNG bytes; always the same for one plate."""
        from testbench.page.draw import drawing

        return drawing(self.chart_of(wide), wide, png)


def width_in(wide: bool) -> float:
    """Return the width of figures, in: of the page's wide or narrow ones, or what :func:`of_width` has set."""
    other = _OTHER_IN.get()
    return other if other is not None else WIDE_IN if wide else NARROW_IN


@contextlib.contextmanager
def of_width(width: float) -> Generator[None]:
    """Make figures ``width`` in wide within the block, whatever their layout."""
    token = _OTHER_IN.set(width)
    try:
        yield
    finally:
        _OTHER_IN.reset(token)


# --- what several figures show ----------------------------------------------------------------------------------------


def rows(names: Sequence[str], row_in: float = 0.3) -> dict[str, Any]:
    """Return the settings of a panel of rows, the first on top: row k lies about y = k."""
    return {
        "y_ticks": list(enumerate(names)),
        "y_range": (len(names) - 0.45, -0.55),
        "tall_in": row_in * len(names) + 0.15,
    }


def bode(
    title: str, unit: str, curves: Sequence[tuple[FloatArray, FloatArray, FloatArray, Mapping[str, Any]]], **more: Any
) -> tuple[Panel, Panel]:
    """Return magnitude and phase over frequency.

    Args:
        title: of what to what.
        unit: of the magnitude.
        curves: (frequency, rad/s; magnitude; phase, deg; look).
        more: settings of both panels; its ``draws`` lie behind the curves, and about the first are its ``bands``, those
            of the magnitude and of the phase, each (low, high).
    """
    behind = more.pop("draws", ())
    about = [[band(curves[0][0], low, high, COLOURS[0])] for low, high in more.pop("bands", ())] or [[], []]
    given: dict[str, Any] = {"x": "frequency, rad/s", "log_x": True, "tall_in": 1.25} | more
    w = np.concatenate([c[0] for c in curves])
    given.setdefault("x_range", (float(w.min()), float(w.max())))
    size = [*behind, *about[0], *(Curve(x=w, y=size, **look) for w, size, _, look in curves)]
    turn = [*behind, *about[1], *(Curve(x=w, y=phase, **look) for w, _, phase, look in curves)]
    return (
        Panel(draws=size, title=f"{title}, magnitude", y=unit, log_y=True, name=f"magnitude, {unit}", **given),
        Panel(draws=turn, title=f"{title}, phase", y="deg", y_steps=PHASE_STEPS, name="phase, deg", **given),
    )


def unwrapped(H: Any) -> FloatArray:
    """Return the phase of responses (n, ...) along their first axis, deg, without jumps."""
    return np.asarray(np.degrees(np.unwrap(np.angle(H), axis=0)), float)


def mode_marks(modes: Mapping[str, complex], elastic: Iterable[str], low: float, high: float) -> list[Drawn]:
    """Return the modes between two frequencies, rad/s, as named rules; rigid ones over their half-power bands."""
    from testbench.page.labels import number

    elastic, out = set(elastic), list[Drawn]()
    for name, pole in modes.items():
        wn = abs(pole)
        if not low < wn < high:
            continue
        colour = ELASTIC if name in elastic else RIGID
        out.append(Rule(at=wn, text=f"{name} {number(wn)} rad/s", colour=colour))
        if name not in elastic:
            zeta = min(abs(pole.real) / wn, 0.95)
            top = wn * (1.0 + zeta) if abs(pole.imag) > 1e-9 else wn  # a real root is a lag: its band ends at |s|
            out.append(Span(low=wn * (1.0 - zeta), high=top, colour=COLOURS[2], alpha=0.13))
    return out


def within(low: float, high: float, shown: Sequence[NDArray[Any]], reach: float = 0.6) -> tuple[float, float]:
    """Return a range that shows all of low to high, and of curves (n,) what lies within ``reach`` of it on each side.

    What diverges so does not squash what was measured.
    """
    room = reach * max(high - low, 1e-12)
    found = [y[np.isfinite(y)] for y in shown]
    least = [max(float(y.min(initial=low)), low - room) for y in found]
    most = [min(float(y.max(initial=high)), high + room) for y in found]
    low, high = min([low, *least]), max([high, *most])
    pad = 0.08 * (high - low or 1.0)
    return low - pad, high + pad


def rows_of(items: Sequence[Item], most: int) -> list[list[Item]]:
    """Return ``items`` in as few rows of at most ``most`` as possible, all about equally long."""
    count = max(1, -(-len(items) // most))
    per_row = max(1, -(-len(items) // count))
    return [list(items[k : k + per_row]) for k in range(0, len(items), per_row)]


def widths(records: Sequence[FlightRecord]) -> list[float]:
    """Return relative widths of panels for ``records``: by duration, none below 0.4 of the widest."""
    longest = max(r.duration_s for r in records)
    return [max(r.duration_s, 0.4 * longest) for r in records]


def in_lines(text: str, letters: int, lines: int = 2) -> str:
    """Return a text in ``lines`` lines of so many letters at most; what does not fit is left out and marked."""
    return "\n".join(textwrap.wrap(text, max(letters, 4), max_lines=lines, placeholder=" …"))
