"""The one renderer of figures: places panels, chooses ticks, writes labels and legends, and returns SVG, PNG or PDF.

matplotlib is used through its object interface (Figure, no pyplot), and its settings are left as they were. Panels are
placed in inches, once what is written beside them is known: automatic layouts draw every figure three times over.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import TICKDOWN, TICKLEFT
from matplotlib.offsetbox import AnchoredOffsetbox, HPacker, TextArea
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullFormatter, NullLocator

from testbench.core.record import FloatArray
from testbench.page.figure import (
    AXIS,
    FAINT,
    INK,
    QUIET,
    Area,
    Chart,
    Curve,
    Dash,
    Drawing,
    Drawn,
    Image,
    Panel,
    Rule,
    Span,
    Words,
    in_lines,
    width_in,
)
from testbench.page.labels import superscript

_PATH = re.compile(r' d="([^"]*)"')
_STEP = re.compile(r"([MLQCz])([^MLQCz]*)")
_PLACE = re.compile(r'(?:translate\(|\b[xy]=")[^)"]*')  # not a scale: its digits count
_NUMBER = re.compile(r"-?\d+\.\d\d\d+")
_NOISE = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_NAMES = re.compile(r'<g id="[^"]*"')
_BETWEEN = re.compile(r">\s+<")
_AT = re.compile(r' transform="translate\(([^ )]+) 0\)"(?=/>)')  # of a letter, which a place says shorter
_STYLE = re.compile(r' style="[^"]*"')
_LONG_LINE = 20  # points from which a line is told to a tenth of a point, not a hundredth
PNG_DPI = 144
_LETTER = 0.58  # width of a letter of DejaVu Sans over its size, on average
_LINE = 1.25  # height of a line over the size of its letters
_TICKS_PT, _LABEL_PT, _TITLE_PT, _LEGEND_PT = 8.0, 9.0, 9.0, 8.5
_BROAD_IN = 5.0  # a panel that has room for more ticks, and for names in larger letters
_EDGE_IN = 0.18  # right of the last panel
_ENOUGH = 1000  # points of all curves of a panel from which on each is drawn by its envelope
_FEWEST, _MOST = 200, 500  # stretches of an envelope
_SHARE_OF_NAMES = 0.36  # of a figure's width, that names of rows may take
_BAR_IN, _BAR_HEAD_IN = (1.8, 0.09), 0.52  # of the colours of an image


def style() -> Any:
    """Return the settings of all figures of the testbench: light, quiet, and the same at every run."""
    return {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same glyphs everywhere
        "font.size": 9.0,
        "axes.titlesize": _TITLE_PT,
        "axes.titlelocation": "left",
        "axes.labelsize": _LABEL_PT,
        "text.parse_math": False,  # a name with two dollar signs is a name
        "axes.labelcolor": INK,
        "axes.edgecolor": AXIS,
        "axes.linewidth": 0.7,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.unicode_minus": True,
        "axes.formatter.useoffset": False,
        "axes.xmargin": 0.0,
        "grid.color": "#e6e9ed",
        "grid.linewidth": 0.6,
        "text.color": INK,
        "xtick.color": "#4b5258",
        "ytick.color": "#4b5258",
        "xtick.labelsize": _TICKS_PT,
        "ytick.labelsize": _TICKS_PT,
        "xtick.major.width": 0.7,
        "ytick.major.width": 0.7,
        "xtick.minor.width": 0.4,
        "ytick.minor.width": 0.4,
        "lines.linewidth": 1.3,
        "lines.solid_capstyle": "round",
        "legend.frameon": False,
        "legend.fontsize": _LEGEND_PT,
        "legend.handlelength": 2.4,
        "legend.borderaxespad": 0.0,
        "legend.borderpad": 0.2,
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "path.simplify_threshold": 0.2,
        "pdf.fonttype": 42,  # journals refuse Type 3 fonts
        "svg.fonttype": "path",
        "svg.hashsalt": "testbench",
    }


def styled(chart: Chart, wide: bool = True, settings: Mapping[str, Any] | None = None) -> Figure:
    """Return a figure in the style of the testbench, or by other settings, on a canvas that needs no screen."""
    told: Any = style() if settings is None else settings  # matplotlib types its keys one by one
    with rc_context(told):
        figure = render(chart, wide)
        FigureCanvasAgg(figure)
    return figure


def drawing(chart: Chart, wide: bool, png: bool) -> Drawing:
    """Return a figure as SVG text and, if asked for, PNG bytes; always the same for one chart."""
    figure = styled(chart, wide)
    with rc_context(style()):
        svg, raster = io.StringIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        if png:
            figure.savefig(raster, format="png", dpi=PNG_DPI, metadata={"Software": None})
    return Drawing(small_svg(svg.getvalue()), raster.getvalue())


def pixels(chart: Chart, dpi: float) -> Any:
    """Return a figure as a picture (height, width, 3), 8 bits each."""
    figure = styled(chart)
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(dpi)
    with rc_context(style()):
        canvas.draw()
    return np.asarray(canvas.buffer_rgba(), np.uint8)[:, :, :3].copy()


def pdf_pages(figures: Sequence[Figure]) -> bytes:
    """Return figures from :func:`styled` as the pages of one PDF, always the same bytes."""
    out = io.BytesIO()
    told = {"CreationDate": None, "Creator": "flight-testbench", "Producer": None}
    with rc_context(style()), PdfPages(out, metadata=told) as file:
        for figure in figures:
            file.savefig(figure)
    return out.getvalue()


def render(chart: Chart, wide: bool = True) -> Figure:
    """Return a figure with matplotlib's settings as they are; see :func:`styled` for those of the testbench."""
    size = chart.size_in or (width_in(wide) * (chart.share if wide else 1.0), 4.0)
    figure = Figure(figsize=size)
    rows = [[_Placed(figure, panel) for panel in row] for row in chart.rows]
    for row in rows if chart.share_y else ():
        limits = np.array([p.axes.get_ylim() for p in row])
        for p in row:
            p.axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
    placed = [p for row in rows for p in row]
    for p in placed:
        p.finish()
    if chart.size_in is None:
        _lay_out(figure, chart, rows, wide)
    else:
        for p in placed:
            box = p.panel.box_in or (0.0, 0.0, *size)
            p.head_in(box[2])  # which breaks the title
            p.place(box)
    for p in placed:
        p.letter()
    every = [q for p in placed for q in (p, p.beside) if q is not None]
    figure.panels = [(p.panel, p.axes) for p in every]  # type: ignore[attr-defined]  # for what publishes their data
    return figure


# --- layout -----------------------------------------------------------------------------------------------------------


def _lay_out(figure: Figure, chart: Chart, rows: list[list[_Placed]], wide: bool) -> None:
    """Place rows of panels below the legend, and give the figure the height that they take."""
    width = float(figure.get_size_inches()[0])
    placed = [p for row in rows for p in row]
    stacked = not wide and max(map(len, rows)) > chart.narrow
    if stacked:
        rows = [placed[k : k + chart.narrow] for k in range(0, len(placed), chart.narrow)]
    for r, row in enumerate(rows):
        for c, p in enumerate(row):
            above = rows[r - 1][c] if r and len(rows[r - 1]) > c else None
            if chart.share_x and above is not None and above.panel.x == p.panel.x:
                above.x_named, above.x_shown = False, above.axes.get_xlim() != p.axes.get_xlim()
                p.titled = stacked or p.panel.title != above.panel.title
            p.y_shown = stacked or not chart.share_y or c == 0
    image = next((d for p in placed for d in p.panel.draws if isinstance(d, Image) and d.title), None)
    handles, columns, key_in = _keys(chart, width)
    y = key_in + (_BAR_HEAD_IN if image is not None else 0.0)
    boxes: list[tuple[_Placed, tuple[float, float, float, float]]] = []
    for row in rows:
        alike = [other for other in rows if chart.aligned or len(other) == len(row)]  # they stand in common columns
        lead = max(alike, key=len)
        left = [
            max(p.left_in(width / len(lead)) for other in alike for p in other[c : c + 1]) for c in range(len(lead))
        ]
        right = [max(p.right_in for other in alike for p in other[c : c + 1]) for c in range(len(lead))]
        broad = np.array([p.panel.broad for p in lead])
        free = width - sum(left) - sum(right[:-1]) - max(right[-1], _EDGE_IN)
        wides = (free * broad / broad.sum()).tolist()
        y += max(p.head_in(w) for p, w in zip(row, wides, strict=False))
        x, tall = 0.0, max(p.panel.tall_in for p in row)
        for c, p in enumerate(row):
            x += left[c]
            p.room_in = left[c]
            boxes.append((p, (x, y, wides[c], tall)))
            x += wides[c] + right[c]
        y += tall + max(p.foot_in(w) for p, w in zip(row, wides, strict=False))
    figure.set_size_inches(width, y)
    if handles:
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.005, 1.0 - 0.04 / y), ncols=columns)
    for p, box in boxes:
        p.place(box)
    if image is not None:
        first, box = boxes[0]
        _colour_bar(figure, placed, image, box[0], box[1] - first.head_in(box[2]))


def _keys(chart: Chart, width: float) -> tuple[list[Any], int, float]:
    """Return the entries of the legend, in how many columns they fit, and the height that they take, in."""
    handles = [_handle(d) for d in chart.legend]
    if not handles:
        return [], 1, 0.04
    letters = max(8, int((width * 72.0 - 40.0) / (_LETTER * _LEGEND_PT)))
    for h in handles:
        text = str(h.get_label())
        h.set_label(text if len(text) <= letters else text[: letters - 1] + "…")
    widest = max(_text_in(str(h.get_label()), _LEGEND_PT) for h in handles) + 0.6
    columns = max(1, min(len(handles), int(width / widest)))
    return handles, columns, 0.08 + 0.18 * -(-len(handles) // columns)


def _handle(d: Any) -> Any:
    if isinstance(d, Curve):
        errors = d.x_error is not None or d.y_error is not None
        look = _look(d) | ({"linestyle": "-"} if errors else {})
        look |= {"linewidth": max(d.width, 1.3), "alpha": None, "clip_on": True}
        look |= {"markersize": 7.0 if d.marker == "." else min(max(d.size, 5.0), 9.0)} if d.marker else {}
        return Line2D([], [], label=d.name, **look)
    if isinstance(d, Rule):
        return Line2D([], [], label=d.name, color=d.colour, linewidth=max(d.width, 1.0), linestyle=_dash(d.dash))
    return Patch(facecolor=d.colour, edgecolor=getattr(d, "edge", "") or "none", alpha=d.alpha, label=d.name)


def _colour_bar(figure: Figure, placed: Sequence[_Placed], image: Image, x: float, y: float) -> None:
    width, tall = (float(v) for v in figure.get_size_inches())
    wide, high = _BAR_IN
    axes = figure.add_axes((x / width, 1.0 - (y - 0.22) / tall, wide / width, high / tall), label="<colorbar>")
    drawn = next(p.axes.images[0] for p in placed if p.axes.images)
    colours = figure.colorbar(drawn, cax=axes, orientation="horizontal", ticks=[at for at, _ in image.ticks])
    colours.ax.set_xticks([at for at, _ in image.ticks], [text for _, text in image.ticks])
    colours.ax.minorticks_off()
    colours.ax.set_title(image.title, fontsize=_TICKS_PT, color=QUIET, loc="left")
    colours.outline.set_visible(False)


def _text_in(text: str, points: float) -> float:
    """Return about the width of the longest line of a text, in."""
    return max((len(line) for line in text.split("\n")), default=0) * _LETTER * points / 72.0


def _dash(dash: Dash) -> Any:
    return (0, dash) if dash else "-"


# --- one panel --------------------------------------------------------------------------------------------------------


class Artist(NamedTuple):
    """What is drawn for a part of a panel: a method of matplotlib's Axes, what it takes, and the name it has."""

    how: str
    x: FloatArray
    y: FloatArray
    look: dict[str, Any]
    name: str = ""


def artists(panel: Panel, limits: tuple[Sequence[float], Sequence[float]], kinds: Any = Drawn) -> Iterator[Artist]:
    """Yield what a panel shows as data, of some kinds of it, within limits of x and y; images and words are not."""
    joined = [c for c in panel.curves if not c.marker]
    points = sum(np.size(c.x) for c in joined)
    stretches = min(_MOST, max(_FEWEST, _ENOUGH // max(len(joined), 1))) if points > _ENOUGH else 0
    for d in panel.draws:
        if isinstance(d, kinds):
            yield from _artists(d, panel, stretches, limits)


def _artists(d: Drawn, panel: Panel, stretches: int, limits: Any) -> Iterator[Artist]:
    if isinstance(d, Curve):
        x, y = np.atleast_1d(np.asarray(d.x, float)), np.atleast_1d(np.asarray(d.y, float))
        if panel.y_range and None not in panel.y_range and not panel.log_y and not d.marker:
            low, high = sorted(v for v in panel.y_range if v is not None)
            y = np.clip(y, 5.0 * low - 4.0 * high, 5.0 * high - 4.0 * low)  # of what diverges
        if stretches and not d.marker and not panel.log_x and np.all(np.diff(x) > 0.0):
            x, y = envelope(x, y, stretches)
        for error, cap, across in ((d.x_error, "|", True), (d.y_error, "_", False)):
            if error is not None:
                half = np.broadcast_to(np.asarray(error, float), x.shape)
                base, other = (x, y) if across else (y, x)
                ends = np.column_stack([base - half, base + half, np.full_like(half, np.nan)]).ravel()
                look = {"color": d.colour, "linewidth": 1.2, "marker": cap, "markersize": 4.0, "zorder": d.order}
                yield _along("plot", across, ends, np.repeat(other, 3), look)
        yield Artist("plot", x, y, _look(d), d.name)
    elif isinstance(d, Area):
        look = {"facecolor": d.colour, "edgecolor": d.edge or "none", "linewidth": d.width if d.edge else 0.0}
        look |= {"alpha": d.alpha, "zorder": d.order, "clip_on": d.clip}
        for outline in d.outlines:
            yield Artist("fill", np.asarray(outline[0], float), np.asarray(outline[1], float), look, d.name)
    elif isinstance(d, Span):
        ends, (low, high) = np.array([d.low, d.high, d.high, d.low]), limits[d.of == "x"]
        other = np.array([low, low, high, high])
        look = {"facecolor": d.colour, "linewidth": 0.0, "alpha": d.alpha, "zorder": 0.5}
        yield _along("fill", d.of == "x", ends, other, look, d.name)
    elif isinstance(d, Rule):
        place, other = np.full(2, d.at), np.asarray(limits[d.of == "x"], float)
        look = {"color": d.colour, "linewidth": d.width, "linestyle": _dash(d.dash), "zorder": d.order}
        yield _along("plot", d.of == "x", place, other, look, d.name)


def _along(how: str, x: bool, at: FloatArray, other: FloatArray, look: dict[str, Any], name: str = "") -> Artist:
    """Return what lies ``at`` places of the x axis, or of the y axis."""
    return Artist(how, at, other, look, name) if x else Artist(how, other, at, look, name)


def _look(c: Curve) -> dict[str, Any]:
    out: dict[str, Any] = {"color": c.colour, "linewidth": c.width, "zorder": c.order, "alpha": c.alpha}
    out |= {"linestyle": _dash(c.dash) if c.joined or not c.marker else "none", "clip_on": c.clip}
    if c.steps:
        out["drawstyle"] = "steps-post"
    if c.marker:
        inside = "none" if c.hollow is True else c.hollow or c.colour
        edge = 1.4 if c.hollow or c.marker in "+|x" else 0.5 if c.marker == "." else 1.0
        out |= {"marker": c.marker, "markersize": c.size, "markerfacecolor": inside, "markeredgewidth": edge}
    return out


def envelope(t: FloatArray, y: FloatArray, bins: int = _MOST) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest sample of each of ``bins`` stretches, in order of time; it looks the same.

    A signal of two samples per stretch or fewer is returned as it is.
    """
    n = -(-t.size // bins)
    if n < 3:
        return t, y
    count = t.size // n
    blocks = y[: count * n].reshape(count, n)
    ends = np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1) + n * np.arange(count)[:, None]
    rows = np.unique(np.concatenate([[0], ends.ravel(), np.arange(count * n, t.size), [t.size - 1]]))
    return t[rows], y[rows]


class _Placed:
    """A panel and its axes: its data are drawn, what stands round it is measured, it is placed, then it is lettered."""

    def __init__(self, figure: Figure, panel: Panel, over: Axes | None = None) -> None:
        """Draw the panel's data somewhere; its height is right."""
        self.figure, self.panel = figure, panel
        self.x_shown = self.x_named = self.y_shown = self.titled = True
        self.title, self.room_in = "", 0.0
        tall = (panel.box_in[3] if panel.box_in else panel.tall_in) / float(figure.get_size_inches()[1])
        self.axes = axes = figure.add_axes((0.1, 0.1, 0.5, tall)) if over is None else over.twinx()
        for which, log in (("x", panel.log_x), ("y", panel.log_y)):
            if log:
                getattr(axes, f"set_{which}scale")("log")
        self._draw(Curve | Area)
        for d in panel.draws:
            if isinstance(d, Rule) and not d.text:  # what it marks is seen
                axes.update_datalim([(d.at, d.at)], updatex=d.of == "x", updatey=d.of == "y")
            elif isinstance(d, Image):
                self._draw_image(d)
        axes.margins(x=0.05 if any(c.marker for c in panel.curves) else 0.0)
        axes.autoscale_view()
        if panel.x_range:
            axes.set_xlim(*panel.x_range)
        if panel.y_range:
            axes.set_ylim(*panel.y_range)
        self.beside = None if panel.right is None else _Placed(figure, panel.right, axes)

    def _draw(self, kinds: Any) -> None:
        limits = self.axes.get_xlim(), self.axes.get_ylim()
        for a in artists(self.panel, limits, kinds):
            getattr(self.axes, a.how)(a.x, a.y, label=a.name or None, **a.look)

    def _draw_image(self, d: Image) -> None:
        norm: dict[str, Any] = {"norm": LogNorm(d.low, d.high)} if d.log else {"vmin": d.low, "vmax": d.high}
        self.axes.imshow(np.clip(d.values, d.low, d.high), cmap="Blues", aspect="auto", **norm)
        self.axes.set_facecolor(FAINT)  # what is not a number shows it
        self.axes.tick_params(length=0)

    def finish(self) -> None:
        """Draw what reaches to the limits, now that these are known, and choose the ticks of the vertical axis."""
        panel, axes = self.panel, self.axes
        axes.set_autoscale_on(False)
        self._draw(Rule | Span)
        axes.grid(not panel.plain and not any(isinstance(d, Image) for d in panel.draws))
        if panel.bare:
            axes.set_axis_off()
            if panel.box_in is None:
                axes.set_aspect("equal")
        if panel.y_ticks is not None:
            axes.set_yticks([at for at, _ in panel.y_ticks], [text for _, text in panel.y_ticks])
            axes.grid(False, axis="y")
            axes.tick_params(axis="y", length=0, labelcolor=INK)
        elif panel.log_y:
            self._log("y")
        elif panel.y_steps:
            span = float(np.ptp(axes.get_ylim()))
            axes.yaxis.set_major_locator(
                MultipleLocator(next((s for s in panel.y_steps if span <= 5 * s), 2 * panel.y_steps[-1]))
            )
        else:
            few = max(3, min(8, int(3.6 * self._tall)))
            axes.yaxis.set_major_locator(MaxNLocator(few, integer="y" in panel.whole, steps=[1, 2, 2.5, 5, 10]))
        if self.beside is not None:
            self.beside.finish()
            self.beside.axes.grid(False)
            self.beside.axes.spines["right"].set_visible(False)
            if self.beside.panel.behind:
                self.beside.axes.tick_params(right=False, labelright=False, which="both")
                self.beside.axes.set_zorder(0)
                axes.set_zorder(1)
                axes.patch.set_visible(False)

    @property
    def _tall(self) -> float:
        return self.panel.box_in[3] if self.panel.box_in else self.panel.tall_in

    def _numbers_in(self, axis: Any) -> float:
        low, high = sorted(axis.get_view_interval())
        shown = [at for at in axis.get_majorticklocs() if low <= at <= high]
        texts = [str(t) for t in axis.get_major_formatter().format_ticks(shown)] if shown else []
        return max((_text_in(t, _TICKS_PT) * (1.1 if t[-1:].isdigit() else 1.0) for t in texts), default=0.0)

    def left_in(self, width: float) -> float:
        """Return the room that numbers, names and the label at the left take, in; long names are set in two lines."""
        panel = self.panel
        if panel.bare or not self.y_shown:
            return 0.14
        if panel.y_ticks:
            letters = int(_SHARE_OF_NAMES * width * 72.0 / (_LETTER * _TICKS_PT))
            lines = max(1, int(self._tall / len(panel.y_ticks) * 72.0 / (_LINE * _TICKS_PT)))
            self.axes.set_yticks(
                [at for at, _ in panel.y_ticks], [in_lines(text, letters, lines) for _, text in panel.y_ticks]
            )
        return max(0.2, self._numbers_in(self.axes.yaxis) + 0.1 + (0.27 if panel.y else 0.0))

    @property
    def right_in(self) -> float:
        """Return the room that a second axis takes, in."""
        if self.beside is None or self.beside.panel.behind:
            return 0.1
        return self._numbers_in(self.beside.axes.yaxis) + 0.36

    @property
    def _named(self) -> list[Rule]:
        """Return the rules whose names stand above the panel, in their order."""
        named = [d for d in self.panel.draws if isinstance(d, Rule) and d.text and d.of == "x"]
        return [] if self.panel.title else sorted(named, key=lambda d: d.at)

    def head_in(self, wide: float) -> float:
        """Return the room above a panel so wide, in: of its title, or of the names of its rules."""
        notes = self._notes_in if self._notes_in < wide else 0.0
        letters = int((wide - notes) * 72.0 / (_LETTER * _TITLE_PT))
        title = self.panel.title if self.titled else ""
        self.title = title[: letters - 1] + "…" if notes and len(title) > letters else in_lines(title, letters)
        if self._named:
            size, texts = self._names(wide)
            return 0.15 + max(_text_in(text, size) for text in texts)
        if not self.title and not self.panel.notes:
            return 0.12
        return 0.09 + 0.16 * (self.title.count("\n") + 1)

    def foot_in(self, wide: float) -> float:
        """Return the room below a panel so wide, in."""
        panel = self.panel
        if panel.bare or not self.x_shown:
            return 0.06
        numbers = 0.24
        if panel.x_ticks:
            room = sum(_text_in(text, _TICKS_PT) + 0.06 for _, text in panel.x_ticks)
            if room > 1.05 * wide:
                numbers = 0.12 + max(_text_in(text, _TICKS_PT - 1.0) for _, text in panel.x_ticks)
        self.turned = numbers > 0.24
        return numbers + (0.2 if panel.x and self.x_named else 0.0) + (0.5 if panel.x_too else 0.04)

    turned = False

    def place(self, box: tuple[float, float, float, float]) -> None:
        """Place the panel: left, top, width and height from the figure's upper left corner, in."""
        width, tall = (float(v) for v in self.figure.get_size_inches())
        x, y, wide, high = self.box = box
        self.axes.set_position((x / width, 1.0 - (y + high) / tall, wide / width, high / tall))

    def letter(self) -> None:
        """Choose the ticks of the horizontal axis, and write all that stands on the panel and round it."""
        panel, axes = self.panel, self.axes
        _, _, wide, high = self.box
        if panel.x_ticks is not None:
            axes.set_xticks([at for at, _ in panel.x_ticks], [text for _, text in panel.x_ticks])
            if self.turned:
                axes.tick_params(axis="x", labelrotation=90, labelsize=_TICKS_PT - 1.0)
        elif panel.log_x:
            self._log("x")
        elif not panel.bare:
            self._few_ticks(wide)
        axes.set_title(self.title, y=1.0, pad=4.0, color=QUIET if panel.bare else INK)
        axes.tick_params(labelbottom=self.x_shown, labelleft=self.y_shown)
        if panel.x and self.x_shown and self.x_named:
            below = 0.37 if not self.turned else self.foot_in(wide) - 0.12
            axes.set_xlabel(panel.x)
            axes.xaxis.set_label_coords(0.5, -(below - 0.06) / high)
        if panel.y and self.y_shown:
            axes.set_ylabel(in_lines(panel.y, int((high + 0.5) * 72.0 / (_LETTER * _LABEL_PT))))
            axes.yaxis.set_label_coords(0.18 / wide - (self.room_in or self.left_in(0.0)) / wide, 0.5)
        if panel.y_colour:
            axes.tick_params(axis="y", colors=panel.y_colour)
            axes.yaxis.label.set_color(panel.y_colour)
        if panel.x_too is not None:
            name, factor = panel.x_too
            there_and_back: Any = (lambda x: x * factor, lambda x: x / factor)
            other: Any = axes.secondary_xaxis(-0.5 / high, functions=there_and_back)
            other.set_xlabel(name, labelpad=1)
            if panel.log_x:
                low, top = (factor * v for v in axes.get_xlim())
                self._log_ticks(other.xaxis, low, top)
        if self.beside is not None and not self.beside.panel.behind:
            right = self.beside
            right.axes.set_ylabel(right.panel.y, color=right.panel.y_colour or INK)
            right.axes.yaxis.set_label_coords(1.0 + (self.right_in - 0.24) / wide, 0.5)
            right.axes.tick_params(axis="y", colors=right.panel.y_colour or INK)
        self._notes(wide)
        self._name_rules(wide)
        for d in panel.draws:
            if isinstance(d, Words):
                self._words(d)

    def _words(self, d: Words) -> None:
        where: Any = {"": "data", "y": ("data", "axes fraction"), "xy": "axes fraction"}[d.of_panel]
        box: dict[str, Any] = {"bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.2}} if d.on_white else {}
        self.axes.annotate(
            d.text, (d.x, d.y), xytext=d.shift, textcoords="offset points", xycoords=where, ha=d.across, va=d.up,
            fontsize=d.size, color=d.colour, rotation=d.turn, weight="bold" if d.bold else "normal", zorder=d.order,
            annotation_clip=False, **box,
        )  # fmt: skip

    def _few_ticks(self, wide: float) -> None:
        """Give the horizontal axis as many round ticks as their labels leave room for."""
        low, high = sorted(self.axes.get_xlim())
        for count in range(8 if wide > _BROAD_IN else 6, 0, -1):
            locator = MaxNLocator(count, steps=[1, 2, 2.5, 5, 10] if count < 4 else [1, 2, 5, 10],
                                  integer="x" in self.panel.whole)  # fmt: skip
            self.axes.xaxis.set_major_locator(locator)
            shown = [x for x in locator.tick_values(low, high) if low <= x <= high]
            apart = wide * (shown[1] - shown[0]) / (high - low) if len(shown) > 1 else wide
            if self._numbers_in(self.axes.xaxis) + 0.12 <= apart:
                return

    def _log(self, which: str) -> None:
        axis, limits = (getattr(self.axes, f"{which}axis"), sorted(getattr(self.axes, f"get_{which}lim")()))
        self._log_ticks(axis, *limits)
        decades = np.arange(np.floor(np.log10(limits[0])), np.ceil(np.log10(limits[1])))
        places = np.ravel(10.0 ** decades[:, None] * np.arange(2, 10))
        places = places[(limits[0] <= places) & (places <= limits[1])]
        if len(decades) > 9 or self.panel.behind:
            return
        zeros, marker = np.zeros_like(places), cast(Any, TICKDOWN if which == "x" else TICKLEFT)
        # matplotlib makes an object with three lines and two texts of each minor tick; here they are one line.
        self.figure.add_artist(
            Line2D(
                *((places, zeros) if which == "x" else (zeros, places)), linestyle="none", markersize=2.0,
                clip_on=False, marker=marker, markeredgewidth=0.4, color="#4b5258",
                transform=getattr(self.axes, f"get_{which}axis_transform")(which="grid"),
            )
        )  # fmt: skip

    @staticmethod
    def _log_ticks(axis: Any, low: float, high: float) -> None:
        """Label 10⁻² 10⁻¹ 1 10 10² where the axis is long, else 0.01 0.1 1 10 100, and 2 and 5 where it is short."""
        close, powers = high < 70.0 * low, low < 1e-3 or high > 2e4

        def text(value: float, _: int) -> str:
            """Return the label of the tick at ``value``."""
            exponent = round(float(np.log10(value)))
            return f"10{superscript(exponent)}" if powers and not close and exponent not in (0, 1) else f"{value:g}"

        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if close else (1.0,), numticks=8))
        axis.set_major_formatter(FuncFormatter(text))
        axis.set_minor_formatter(NullFormatter())
        axis.set_minor_locator(NullLocator())

    @property
    def _notes_in(self) -> float:
        return sum(_text_in(text, _TICKS_PT) + 0.1 for text, _ in self.panel.notes)

    def _notes(self, wide: float) -> None:
        """Write notes side by side above the right end, if there is room for all of them beside the title."""
        size = _TICKS_PT
        if not self.panel.notes or self._notes_in > wide:
            return
        areas: list[Any] = [
            TextArea(text, textprops={"color": colour, "fontsize": size}) for text, colour in self.panel.notes
        ]
        self.axes.add_artist(
            AnchoredOffsetbox(
                "lower right", child=HPacker(children=areas, pad=0, sep=7, align="baseline"), pad=0, borderpad=0.25,
                frameon=False, bbox_to_anchor=(1.0, 1.0), bbox_transform=self.axes.transAxes,
            )
        )  # fmt: skip

    def _names(self, wide: float) -> tuple[float, list[str]]:
        """Return size, points, and texts of rules that are named above a panel so wide."""
        size = 7.4 if wide > _BROAD_IN else 6.4
        return size, [in_lines(d.text, 26, 3) for d in self._named]

    def _name_rules(self, wide: float) -> None:
        """Name rules: above the panel, no name over another; or where a title stands there, within it."""
        inside = [d for d in self.panel.draws if isinstance(d, Rule) and d.text and d not in self._named]
        for k, d in enumerate(inside):
            place = self._share(d.at)
            right = place > 0.8  # words near the right end would be cut off
            self._words(Words(x=d.at, y=1.0, text=d.text, of_panel="y", size=7.0, colour=d.colour, up="baseline",
                              shift=(-2.0 if right else 2.0, -8.0 - 9.0 * (k % 3)),
                              across="right" if right else "left"))  # fmt: skip
        if not self._named:
            return
        size, texts = self._names(wide)
        line = _LINE * size / 72.0 / wide
        places = [self._share(d.at) for d in self._named]
        shifted = spread(places, [line * (t.count("\n") + 1.3) for t in texts])
        for d, x, place, text in zip(self._named, places, shifted, texts, strict=True):
            self.axes.plot([x, place], [1.0, 1.0 + 0.07 / self.box[3]], transform=self.axes.transAxes, color=d.colour,
                           linewidth=0.6, clip_on=False)  # fmt: skip
            self.axes.annotate(
                text, (place, 1.0 + 0.1 / self.box[3]), xycoords="axes fraction", rotation=90, ha="center", va="bottom",
                fontsize=size, color=d.colour, linespacing=1.15, multialignment="left", annotation_clip=False,
            )  # fmt: skip

    def _share(self, x: float) -> float:
        """Return where x lies between the ends of the horizontal axis, from 0 to 1."""
        low, high = self.axes.get_xlim()
        if self.panel.log_x:
            return float(np.log(x / low) / np.log(high / low))
        return (x - low) / (high - low)


def spread(positions: Sequence[float], sizes: Sequence[float], low: float = 0.0, high: float = 1.0) -> list[float]:
    """Return centres near the sorted ``positions`` for labels of ``sizes`` so that none overlap, within [low, high]."""
    out: list[float] = []
    edge = low
    for x, size in zip(positions, sizes, strict=True):
        out.append(max(x, edge + 0.5 * size))
        edge = out[-1] + 0.5 * size
    edge = high
    for i in range(len(out) - 1, -1, -1):
        out[i] = min(out[i], edge - 0.5 * sizes[i])
        edge = out[i] - 0.5 * sizes[i]
    return out


# --- small SVG --------------------------------------------------------------------------------------------------------


def small_svg(svg: str) -> str:
    """Return ``svg`` as it looks, in about a third of the letters: relative coordinates, cut to what can be seen.

    Points are rounded where they stand, so that no error adds up along a line.
    """
    svg = _NAMES.sub("<g", _NOISE.sub("", svg))
    svg = _BETWEEN.sub("><", svg).replace("DejaVuSans", "f").strip()
    svg = _AT.sub(r' x="\1"', svg).replace("xlink:href", "href")
    svg = _STYLE.sub(lambda style: style[0].replace(": ", ":").replace("; ", ";"), svg)
    svg = _PATH.sub(lambda path: f' d="{_relative(path[1])}"', svg)
    return _PLACE.sub(lambda place: _NUMBER.sub(lambda number: _short(float(number[0]), 2), place[0]), svg)


def _relative(path: str) -> str:
    """Return path data with relative steps after the first point."""
    steps = [(letter, [float(x) for x in rest.split()]) for letter, rest in _STEP.findall(path)]
    curved = any(letter in "QC" for letter, _ in steps)
    digits = 1 if len(steps) > _LONG_LINE and not curved else 2
    scale, out, before = 10**digits, [], ""
    x = y = start_x = start_y = 0
    for letter, values in steps:
        if letter == "z":
            out.append("z")
            x, y, before = start_x, start_y, "z"
            continue
        points = [round(v * scale) for v in values]
        moved = [p - (y if k % 2 else x) for k, p in enumerate(points)]
        if letter == "M":
            start_x, start_y = points[0], points[1]
        command = letter.lower()
        out.append(_joined(command if command != before or command == "m" else "", moved, scale, digits))
        x, y, before = points[-2], points[-1], command
    return "".join(out)


def _joined(command: str, values: list[int], scale: int, digits: int) -> str:
    texts = [_short(v / scale, digits) for v in values]
    out = command + texts[0] if command else texts[0] if texts[0].startswith("-") else " " + texts[0]
    return out + "".join(text if text.startswith("-") else " " + text for text in texts[1:])


def _short(value: float, digits: int) -> str:
    """Return a number without trailing zeros or a zero before the point."""
    text = f"{value:.{digits}f}"
    text = (text.rstrip("0").rstrip(".") if "." in text else text).replace("-0.", "-.")
    text = text[1:] if text.startswith("0.") else text
    return "0" if text in ("-0", "", "-") else text
