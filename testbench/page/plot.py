"""The drawing style, and Plate: a figure with its caption, drawn wide or narrow, as SVG and PNG, always the same bytes.

matplotlib is used through its object interface (Figure, no pyplot), and its settings are left as they were. Panels are
placed in inches: matplotlib's automatic layouts draw every figure three times over.
"""

from __future__ import annotations

import contextlib
import io
import textwrap
from collections.abc import Callable, Generator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from testbench.page.labels import superscript
from testbench.page.svg import small_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FlightRecord, FloatArray
    from testbench.page.explore import Explorable

# Okabe and Ito, "Color Universal Design", 2008: told apart with any colour vision; each has its own dash, for print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (3, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (1.2, 1.2)), (0, (9, 2)))
MARKERS = "osD^vP"

INK, QUIET, MEASURED, FAINT, BAND = "#202428", "#6b7280", "#a9b0b8", "#dfe3e8", "#eceff3"
WIDE_IN, NARROW_IN = 8.6, 3.75  # of figures on a page
_OTHER_IN: ContextVar[float | None] = ContextVar("other width", default=None)
PNG_DPI = 144
_POINTS_PER_LETTER = 5.2  # of 9 point DejaVu Sans, on average
Item = TypeVar("Item")


def line_look(k: int) -> dict[str, Any]:
    """Return colour and dashes of the k-th model of a figure; no two of 36 look alike."""
    return {"color": COLOURS[k % 6], "linestyle": DASHES[(k + k // 6) % 6]}


def marker_look(k: int) -> tuple[str, str]:
    """Return colour and marker of the k-th model of a figure; no two of 36 look alike."""
    return COLOURS[k % 6], MARKERS[(k + k // 6) % 6]


def style() -> Any:
    """Return the settings of all figures of the testbench: light, quiet, and the same at every run."""
    return {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same glyphs everywhere
        "font.size": 9.0,
        "axes.titlesize": 9.0,
        "axes.titlelocation": "left",
        "axes.labelsize": 9.0,
        "text.parse_math": False,  # a name with two dollar signs is a name
        "axes.labelcolor": INK,
        "axes.edgecolor": "#9aa1a9",
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
        "xtick.labelsize": 8.0,
        "ytick.labelsize": 8.0,
        "xtick.major.width": 0.7,
        "ytick.major.width": 0.7,
        "xtick.minor.width": 0.4,
        "ytick.minor.width": 0.4,
        "lines.linewidth": 1.3,
        "lines.solid_capstyle": "round",
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "legend.handlelength": 2.4,
        "legend.borderaxespad": 0.0,
        "legend.borderpad": 0.2,
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "path.simplify_threshold": 0.2,
        "svg.fonttype": "path",
        "svg.hashsalt": "testbench",
    }


@dataclass(frozen=True)
class Drawing:
    """One drawn figure in its two forms; ``png`` is empty if it was not asked for."""

    svg: str
    png: bytes


@dataclass(frozen=True)
class Plate:
    """A figure of a report.

    Attributes:
        name: short, fit for a file name.
        title: what it shows.
        caption: what to look at.
        make: draws it: side by side if True, else one panel below the other, for narrow screens.
        explore: returns its numbers, which the page then lets its reader explore; None leaves it a drawing.
    """

    name: str
    title: str
    caption: str
    make: Callable[[bool], Figure]
    explore: Callable[[], Explorable] | None = None

    def figure(self, wide: bool = True) -> Figure:
        """Return the figure as matplotlib's, in the report's style, on a canvas that needs no screen."""
        from matplotlib import rc_context
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        with rc_context(style()):
            figure = self.make(wide)
            FigureCanvasAgg(figure)
        return figure

    def draw(self, wide: bool = True, png: bool = True) -> Drawing:
        """Return the figure as SVG text and, unless ``png`` is False, PNG bytes; always the same for one plate."""
        from matplotlib import rc_context

        figure = self.figure(wide)
        with rc_context(style()):
            svg, raster = io.StringIO(), io.BytesIO()
            figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
            if png:
                figure.savefig(raster, format="png", dpi=PNG_DPI, metadata={"Software": None})
        return Drawing(small_svg(svg.getvalue()), raster.getvalue())


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


def new_figure(wide: bool, height_in: float, share: float = 1.0) -> Figure:
    """Return an empty figure of the report's narrow width, or of a ``share`` of its wide one."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in(wide) * (share if wide else 1.0), height_in))


def grid(
    figure: Figure,
    top_in: float,
    heights_in: Sequence[float],
    ratios: Sequence[float] = (1.0,),
    *,
    gap_in: float = 0.5,
    between_in: float = 0.65,
    left_in: float = 0.66,
    right_in: float = 0.12,
) -> NDArray[Any]:
    """Return panels (rows, columns) placed in ``figure``.

    Args:
        figure: from :func:`new_figure`.
        top_in: from the figure's upper edge to that of the first row, in.
        heights_in: of each row, in.
        ratios: relative widths of the columns.
        gap_in: between rows, in.
        between_in: between columns, in.
        left_in: from the figure's left edge to the first column, in; room for tick labels and axis label.
        right_in: from the last column to the figure's right edge, in.
    """
    width, height = figure.get_size_inches()
    free = width - left_in - right_in - between_in * (len(ratios) - 1)
    out = np.empty((len(heights_in), len(ratios)), dtype=object)
    y = height - top_in
    for r, tall in enumerate(heights_in):
        x = left_in
        for c, ratio in enumerate(ratios):
            wide = free * ratio / sum(ratios)
            out[r, c] = figure.add_axes((x / width, (y - tall) / height, wide / width, tall / height))
            x += wide + between_in
        y -= tall + gap_in
    return out


def in_lines(text: str, letters: int, lines: int = 2) -> str:
    """Return a text in ``lines`` lines of so many letters at most; what does not fit is left out and marked."""
    return "\n".join(textwrap.wrap(text, letters, max_lines=lines, placeholder=" …"))


def label(
    axes: Axes, x: str = "", y: str = "", title: str = "", colour: str = INK, lines: int = 1, y_in: float = 0.46
) -> None:
    """Write axis labels and title at fixed distances from the panel, so that those of neighbours line up.

    The label of the vertical axis stands ``y_in`` from the panel: 0.46 in leave room for tick labels of five letters.
    A title takes at most ``lines`` lines; what does not fit ends in an ellipsis.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    box, size = axes.get_position(), figure.bbox_inches.size
    width, height = float(box.width * size[0]), float(box.height * size[1])
    axes.xaxis.set_label_coords(0.5, -0.31 / height)
    axes.yaxis.set_label_coords(-y_in / width, 0.5)
    most = max(8, int(width * 72.0 / _POINTS_PER_LETTER))
    if len(title) > most and lines > 1:
        title = in_lines(title, most, lines)
    elif len(title) > most:
        title = title[: most - 1] + "…"
    axes.set_title(title, y=1.0, pad=4.0, color=colour)
    if x:
        axes.set_xlabel(x)
    if y:
        axes.set_ylabel(y)


def log_axis(axes: Any, which: str, powers: bool) -> None:
    """Make the "x" or "y" axis logarithmic, labelled 10⁻² 10⁻¹ 1 10 10² if ``powers``, else 0.01 0.1 1 10 100.

    Where what is drawn spans less than two decades, 2 and 5 are labelled too.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    from testbench.page.minor_ticks import MinorTicks

    def text(value: float, _: int) -> str:
        """Return the label of the tick at ``value``."""
        exponent = round(float(np.log10(value)))
        return f"10{superscript(exponent)}" if powers and not close and exponent not in (0, 1) else f"{value:g}"

    getattr(axes, f"set_{which}scale")("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    close = 0.0 < low < high < 70.0 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if close else (1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(NullFormatter())
    axes.add_artist(MinorTicks(axis, axis.get_minor_locator()))
    axis.set_minor_locator(NullLocator())


def time_axis(axes: Axes) -> None:
    """Give the time axis few and round ticks."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))


def few_ticks(axes: Axes, most: int = 4) -> None:
    """Give the horizontal axis as many round ticks as their labels leave room for, ``most`` at most."""
    from matplotlib.ticker import MaxNLocator

    figure = axes.get_figure(root=True)
    assert figure is not None
    room = 72.0 * float(axes.get_position().width * figure.bbox_inches.size[0])
    low, high = axes.get_xlim()
    for count in range(most, 0, -1):
        locator = MaxNLocator(nbins=count, steps=[1, 2, 2.5, 5, 10])
        axes.xaxis.set_major_locator(locator)
        shown = [x for x in locator.tick_values(low, high) if low <= x <= high]
        texts = axes.xaxis.get_major_formatter().format_ticks(shown)
        apart = room * (shown[1] - shown[0]) / (high - low) if len(shown) > 1 else room
        if max((len(text) for text in texts), default=0) * _POINTS_PER_LETTER + 4.0 <= apart:
            return


def notes(axes: Axes, parts: Sequence[tuple[str, str]]) -> None:
    """Write (text, colour) parts side by side above the right end of ``axes``, if there is room for all of them."""
    from matplotlib.offsetbox import AnchoredOffsetbox, HPacker, TextArea

    figure = axes.get_figure(root=True)
    assert figure is not None
    room = 72.0 * float(axes.get_position().width * figure.bbox_inches.size[0])
    if sum(len(text) * _POINTS_PER_LETTER + 7.0 for text, _ in parts) > room:
        return
    areas: list[Any] = [TextArea(text, textprops={"color": colour, "fontsize": 8.0}) for text, colour in parts]
    packed = HPacker(children=areas, pad=0, sep=7, align="baseline")
    axes.add_artist(
        AnchoredOffsetbox(
            "lower right", child=packed, pad=0, borderpad=0.25, frameon=False, bbox_to_anchor=(1.0, 1.0),
            bbox_transform=axes.transAxes,
        )
    )  # fmt: skip


def envelope(t: FloatArray, y: FloatArray, bins: int = 500) -> tuple[FloatArray, FloatArray]:
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


def rows_of(items: Sequence[Item], most: int) -> list[list[Item]]:
    """Return ``items`` in as few rows of at most ``most`` as possible, all about equally long."""
    rows = max(1, -(-len(items) // most))
    per_row = max(1, -(-len(items) // rows))
    return [list(items[k : k + per_row]) for k in range(0, len(items), per_row)]


def widths(records: Sequence[FlightRecord]) -> list[float]:
    """Return relative widths of panels for ``records``: by duration, none below 0.4 of the widest."""
    longest = max(r.duration_s for r in records)
    return [max(r.duration_s, 0.4 * longest) for r in records]


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Write a legend at the figure's upper left corner, in as many columns as fit."""
    width, height = (float(x) for x in figure.get_size_inches())
    figure.legend(
        handles=list(handles),
        loc="upper left",
        bbox_to_anchor=(0.005, 1.0 - 0.04 / height),
        ncols=_legend_columns([str(h.get_label()) for h in handles], width),
    )


def legend_in(names: Sequence[str], wide: bool, share: float = 1.0) -> float:
    """Return the height, in, that a legend of ``names`` takes in a figure from :func:`new_figure`."""
    width = width_in(wide) * (share if wide else 1.0)
    return 0.08 + 0.18 * -(-len(names) // _legend_columns(names, width))


def _legend_columns(names: Sequence[str], width_in: float) -> int:
    """Return how many columns of the widest name, with its line before it, fit side by side; at least one."""
    widest = (max(len(name) for name in names) * _POINTS_PER_LETTER + 45.0) / 72.0
    return max(1, min(len(names), int(width_in / widest)))


def line_handles(names: Sequence[str], extra: Sequence[tuple[str, str] | tuple[str, str, Any]] = ()) -> list[Any]:
    """Return legend handles: (label, colour[, dash]) lines of ``extra``, then one line per case, colour and dash."""
    from matplotlib.lines import Line2D

    first = [
        Line2D([], [], color=colour, linewidth=2.0, linestyle=dash[0] if dash else "-", label=text)
        for text, colour, *dash in extra
    ]
    return first + [Line2D([], [], **line_look(k), label=name) for k, name in enumerate(names)]


def name_lines(
    axes: Axes,
    lines: Sequence[tuple[float, str, str, str]],
    width: int,
    size: float,
    per_line: float,
    gap: float = 0.3,
    linewidth: float = 0.9,
) -> None:
    """Draw vertical lines into a panel over a logarithmic axis and name each above it, no name over another.

    Args:
        axes: the panel, its limits set.
        lines: (x, text, dash, colour), in the order of x.
        width: letters in a line of text.
        size: of the letters, points.
        per_line: width that a line of text takes, as a share of the panel's.
        gap: between two texts, in lines.
        linewidth: of the vertical lines, points.
    """
    low, high = axes.get_xlim()
    texts = [textwrap.wrap(text, width) for _, text, _, _ in lines]
    places = [float(np.log(x / low) / np.log(high / low)) for x, _, _, _ in lines]
    shifted = spread(places, [per_line * (len(t) + gap) for t in texts])
    for x, place, text, (_, _, dash, colour) in zip(places, shifted, texts, lines, strict=True):
        axes.plot([x, x], [0.0, 1.0], transform=axes.transAxes, color=colour, linestyle=dash, linewidth=linewidth)
        kink: dict[str, Any] = {"transform": axes.transAxes, "color": colour, "linewidth": 0.6, "clip_on": False}
        axes.plot([x, place], [1.0, 1.035], **kink)
        axes.text(
            place, 1.05, "\n".join(text), transform=axes.transAxes, rotation=90, ha="center", va="bottom",
            fontsize=size, color=colour, linespacing=1.15, multialignment="left",
        )  # fmt: skip


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
