"""The three-view drawing of an aircraft: top, front and side to one scale, with its main dimensions and its CG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.plot import COLOURS, FAINT, INK, QUIET, Plate, new_figure, width_in

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.aircraft import Aircraft
    from testbench.aircraft.outline import Outline, Surface
    from testbench.questions.aircraft.ask import Survey

_MARGIN_IN, _GAP_IN = 0.3, 0.75  # round the drawing, and between the views; dimension lines stand in both
_TALLEST_IN, _ROW_IN = 8.0, 0.18
_THICKNESS = 0.12  # of every section as drawn, in chords
_ALIKE = 0.02  # difference up to which drawn and reference mean chord count as the same
_BOLD = COLOURS[0]
Points = list[tuple[float, float]]


def three_view_plates(survey: Survey) -> list[Plate]:
    """Return the drawing of the surveyed aircraft, or nothing if its outline is not known."""
    return outline_plates(survey.envelope.aircraft)


def outline_plates(aircraft: Aircraft) -> list[Plate]:
    """Return the drawing of an aircraft, or nothing if its outline is not known."""
    outline = aircraft.outline
    if outline is None:
        return []

    def make(wide: bool) -> Figure:
        """Draw top view above front view, and the side view beside them if there is room, else below."""
        return _draw(aircraft, outline, wide)

    return [Plate("three_view", "Three-view drawing", _caption(aircraft, outline), make)]


def _caption(aircraft: Aircraft, outline: Outline) -> str:
    g, wing = aircraft.geometry, outline.wing
    out = f"All views to one scale, dimensions in m. {outline.note}"
    if not _alike(aircraft, outline):
        out += (
            f" The wing as drawn has a mean aerodynamic chord of {_length(wing.mean_chord_m)} m; the coefficients "
            f"refer to {_length(g.cbar_m)} m."
        )
    if _stations(aircraft, outline):
        out += (
            " Dots: stations at which the mode shapes are given, on the elastic axis (dashed), of the right wing only."
        )
    return out


def _alike(aircraft: Aircraft, outline: Outline) -> bool:
    """Say whether the wing as drawn has the mean chord that the coefficients refer to."""
    return abs(outline.wing.mean_chord_m / aircraft.geometry.cbar_m - 1.0) <= _ALIKE


def _stations(aircraft: Aircraft, outline: Outline) -> tuple[float, ...]:
    flown = aircraft.flown_modes()
    return flown.stations_m if flown is not None and outline.elastic_axis is not None else ()


def _length(x_m: float) -> str:
    """Return a length with three figures, those of a round number too: 4.00, 0.231, 44.3."""
    return f"{x_m:.{max(0, 2 - math.floor(math.log10(abs(x_m) * (1.0 + 1e-9))))}f}"


def _wide_in(text: str) -> float:
    return len(text) * 4.7 / 72.0  # of 8 point DejaVu Sans, on average


# --- layout -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _View:
    """One view: its axes, how many metres an inch of paper is, and the radius of the mark of the CG, in."""

    axes: Axes
    m_in: float
    marker_in: float

    def surface(self, outline: Points, order: float) -> None:
        """Draw a filled shape."""
        look: dict[str, Any] = {"facecolor": FAINT, "edgecolor": INK, "linewidth": 0.8, "clip_on": False}
        self.axes.fill(*zip(*outline, strict=True), zorder=order, **look)

    def line(self, points: Points, **look: Any) -> None:
        """Draw a line through ``points``."""
        plain: dict[str, Any] = {"color": INK, "linewidth": 0.8, "clip_on": False}
        self.axes.plot(*zip(*points, strict=True), **(plain | look))

    def dimension(self, begin: tuple[float, float], end: tuple[float, float], words: str, size_m: float) -> None:
        """Draw a dimension line with arrows at both ends and its text on it; if short, its last word, or beside it."""
        arrow = {
            "arrowstyle": "<|-|>",
            "color": QUIET,
            "linewidth": 0.7,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 7,
        }
        self.axes.annotate("", begin, end, arrowprops=arrow, zorder=6, annotation_clip=False)
        room = math.dist(begin, end) / self.m_in
        size = f"{_length(size_m)} m"
        text = next((t for t in (f"{words} {size}", f"{words.split()[-1]} {size}") if _wide_in(t) + 0.3 < room), "")
        x, y = 0.5 * (begin[0] + end[0]), 0.5 * (begin[1] + end[1])
        if not text:
            x, text = max(begin[0], end[0]) + 0.06 * self.m_in, f"{words} {size}"
        self.axes.text(
            x, y, text, ha="left" if x > max(begin[0], end[0]) else "center", va="center", fontsize=8.0, color=INK,
            zorder=7, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2},
        )  # fmt: skip

    def extension(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a thin line from the shape to a dimension line."""
        self.line([begin, end], color=QUIET, linewidth=0.5, zorder=1)

    def centre_of_gravity(self) -> None:
        """Draw the quartered circle at the origin."""
        from matplotlib.patches import Circle, Wedge

        radius = self.marker_in * self.m_in
        self.axes.add_patch(
            Circle((0.0, 0.0), radius, facecolor="white", edgecolor=INK, linewidth=0.8, zorder=8, clip_on=False)
        )
        for turn in (0.0, 180.0):
            self.axes.add_patch(
                Wedge((0.0, 0.0), radius, turn, turn + 90.0, facecolor=INK, linewidth=0, zorder=9, clip_on=False)
            )

    def title(self, text: str) -> None:
        """Write what view it is above its left corner."""
        self.axes.set_title(text, fontsize=8.5, color=QUIET, pad=2.0)


def _draw(aircraft: Aircraft, outline: Outline, wide: bool) -> Figure:
    nose, end = outline.ends_m
    half = 0.5 * max(s.span_m for s in _flat(outline))
    low, high = _heights(outline)
    length, span, tall = nose - end, 2.0 * half, high - low
    paper = width_in(wide) - 2.0 * _MARGIN_IN
    across = (paper - _GAP_IN) / (span + length) if wide else paper / max(span, length)
    down = (_TALLEST_IN - 3.0 * _GAP_IN) / (length + tall * (1 if wide else 2))
    m_in = 1.0 / min(across, down)
    # Room for dimension lines: right of the top view and below the others.
    heights = [length / m_in, tall / m_in, tall / m_in]
    top, below = 0.25, 0.62
    rows = _particulars(aircraft, outline)
    narrow = 0.0 if wide else 0.3 + heights[2] + below + _ROW_IN * len(rows)
    total = top + heights[0] + 0.62 + heights[1] + below + narrow
    figure = new_figure(wide, total)
    width = width_in(wide)
    used = (span + length) / m_in + _GAP_IN if wide else max(span, length) / m_in
    left = 0.5 * (width - used)
    first = left if wide else 0.5 * (width - span / m_in)
    y_front = total - top - heights[0] - 0.62 - heights[1]
    x_side, y_side = (
        (left + span / m_in + _GAP_IN, y_front)
        if wide
        else (0.5 * (width - length / m_in), below + _ROW_IN * len(rows))
    )
    views = []
    for x, y, (x0, x1), (y0, y1) in (
        (first, total - top - heights[0], (-half, half), (end, nose)),
        (first, y_front, (-half, half), (low, high)),
        (x_side, y_side, (-nose, -end), (low, high)),
    ):
        size = ((x1 - x0) / m_in, (y1 - y0) / m_in)
        axes = figure.add_axes((x / width, y / total, size[0] / width, size[1] / total))
        axes.set_xlim(x0, x1)
        axes.set_ylim(y0, y1)
        axes.set_axis_off()
        views.append(_View(axes, m_in, 0.065 if wide else 0.05))
    _top_view(views[0], aircraft, outline)
    _front_view(views[1], outline, low)
    _side_view(views[2], outline, low)
    _write(figure, rows, x_side if wide else _MARGIN_IN, top if wide else total - _ROW_IN * len(rows))
    return figure


def _flat(outline: Outline) -> list[Surface]:
    """Return wing and tail, as far as there are any; the tail first, as it lies behind."""
    return [s for s in (outline.tail, outline.wing) if s is not None]


def _heights(outline: Outline) -> tuple[float, float]:
    heights = [z for _, _, low, high in outline.body_m for z in (low, high)]
    for s in _flat(outline):
        heights += [s.z_m, s.z_m + s.point(0.5 * s.span_m, 0.5 * s.span_m, 0.25)[1]]
    if outline.fin is not None:
        heights += [outline.fin.z_m, outline.fin.z_m + outline.fin.span_m]
    return min(heights), max(heights)


def _particulars(aircraft: Aircraft, outline: Outline) -> list[tuple[str, str]]:
    """Return areas, chords and the like that have no place in the views."""
    g, wing, mass = aircraft.geometry, outline.wing, aircraft.mass.mass_kg
    out = [
        ("mass", f"{mass:.4g} kg" if mass < 1e4 else f"{mass:,.0f} kg"),
        ("reference area S", f"{_length(g.S_m2)} m²"),
        ("mean chord c̄", f"{_length(g.cbar_m)} m"),
        ("aspect ratio b²/S", f"{g.b_m**2 / g.S_m2:.3g}"),
        ("root chord, as drawn", f"{_length(wing.root_chord_m)} m"),
        ("tip chord, as drawn", f"{_length(wing.tip_chord_m)} m"),
    ]
    if outline.tail is not None:
        out.append(("tail area, as drawn", f"{_length(outline.tail.area_m2)} m²"))
    if outline.fin is not None:
        pair = 2.0 if outline.fin.y_m else 1.0
        out.append(("fin area, as drawn", f"{_length(pair * outline.fin.area_m2)} m²"))
    if _alike(aircraft, outline):
        out.append(("CG, as drawn", f"{100.0 * (0.25 + _mean_quarter_chord(wing) / wing.mean_chord_m):.0f} % of c̄"))
    return out


def _write(figure: Figure, rows: Sequence[tuple[str, str]], x_in: float, top_in: float) -> None:
    width, height = (float(x) for x in figure.get_size_inches())
    for i, (name, value) in enumerate(rows):
        y = 1.0 - (top_in + _ROW_IN * i) / height
        figure.text(x_in / width, y, name, fontsize=8.0, color=QUIET, va="top")
        figure.text((x_in + 1.45) / width, y, value, fontsize=8.0, color=INK, va="top")


# --- views ------------------------------------------------------------------------------------------------------------


def _plan(surface: Surface) -> Points:
    """Return the outline of a wing or tail from above, (y, x)."""
    half = 0.5 * surface.span_m
    corners = [(s, surface.point(s, half, f)[0]) for s, f in ((0.0, 0.0), (half, 0.0), (half, 1.0), (0.0, 1.0))]
    return corners + [(-y, x) for y, x in reversed(corners)]


def _along(surface: Surface, fraction: float, stations: Sequence[float]) -> Points:
    return [(y, surface.point(abs(y), 0.5 * surface.span_m, fraction)[0]) for y in stations]


def _smooth(xs: Sequence[float], ys: Sequence[float]) -> tuple[Any, Any]:
    """Return a fuselage line through few sections, smooth and without overshoot."""
    from scipy.interpolate import PchipInterpolator

    order = np.argsort(xs)
    x, y = np.array(xs)[order], np.array(ys)[order]
    fine = np.unique(np.concatenate([np.linspace(a, b, 12) for a, b in pairwise(x)]))
    return fine, PchipInterpolator(x, y)(fine)


def _top_view(view: _View, aircraft: Aircraft, outline: Outline) -> None:
    wing, tail, fin = outline.wing, outline.tail, outline.fin
    x, w = _smooth([row[0] for row in outline.body_m], [row[1] for row in outline.body_m])
    body = [*zip(w, x, strict=True), *zip(-w[::-1], x[::-1], strict=True)]
    if tail is not None:
        view.surface(_plan(tail), 2.0)
    view.surface(_plan(wing), 4.0 if wing.z_m > 0.0 else 2.0)
    view.surface([(float(a), float(b)) for a, b in body], 3.0)
    if fin is not None:
        ends = [fin.point(s, fin.span_m, f)[0] for s, f in ((0.0, 0.0), (fin.span_m, 1.0))]
        for y in sorted({fin.y_m, -fin.y_m}):
            rear = min(ends[1], fin.point(0.0, fin.span_m, 1.0)[0])
            view.line([(y, ends[0]), (y, rear)], linewidth=1.6, zorder=5)
    half = 0.5 * wing.span_m
    g = aircraft.geometry
    if _alike(aircraft, outline) and wing.root_chord_m != wing.tip_chord_m:
        y = -half * (wing.root_chord_m - wing.mean_chord_m) / (wing.root_chord_m - wing.tip_chord_m)
        ends = [_along(wing, f, (y,))[0][1] for f in (0.0, 1.0)]
        view.line([(y, ends[0]), (y, ends[1])], color=_BOLD, linewidth=1.8, zorder=6)
        view.axes.text(
            y,
            max(ends) + 0.06 * view.m_in,
            f"c̄ {_length(g.cbar_m)} m",
            color=_BOLD,
            fontsize=8.0,
            ha="center",
            va="bottom",
        )
    stations = _stations(aircraft, outline)
    if stations and outline.elastic_axis is not None:
        both = sorted({*stations, *(-y for y in stations)})
        view.line(_along(wing, outline.elastic_axis, both), color=_BOLD, linewidth=0.7, linestyle=(0, (4, 2)), zorder=5)
        view.line(
            _along(wing, outline.elastic_axis, stations),
            color=_BOLD,
            linestyle="none",
            marker="o",
            markersize=2.4,
            zorder=6,
        )
    if tail is not None:
        tail_end = outline.ends_m[1] - 0.18 * view.m_in
        for y in (-0.5 * tail.span_m, 0.5 * tail.span_m):
            view.extension((y, _along(tail, 1.0, (y,))[0][1]), (y, tail_end))
        view.dimension((-0.5 * tail.span_m, tail_end), (0.5 * tail.span_m, tail_end), "tail span", tail.span_m)
    view.centre_of_gravity()
    view.title("top")


def _front_view(view: _View, outline: Outline, low: float) -> None:
    from matplotlib.patches import Ellipse

    for surface in _flat(outline):
        order = 3.0 if surface is outline.wing else 2.0
        half = 0.5 * surface.span_m
        rise = surface.point(half, half, 0.25)[1]
        root, tip = (0.5 * _THICKNESS * c for c in (surface.root_chord_m, surface.tip_chord_m))
        z = surface.z_m
        right = [(half, z + rise + tip), (half, z + rise - tip)]
        shape = [(0.0, z + root), *right, (0.0, z - root), *((-y, h) for y, h in reversed(right))]
        view.surface(shape, order)
    fin = outline.fin
    if fin is not None:
        foot, tip = (0.5 * _THICKNESS * c for c in (fin.root_chord_m, fin.tip_chord_m))
        top = fin.z_m + fin.span_m
        for y in sorted({fin.y_m, -fin.y_m}):
            view.surface([(y - foot, fin.z_m), (y - tip, top), (y + tip, top), (y + foot, fin.z_m)], 1.8)
    _, width, bottom, roof = max(outline.body_m, key=lambda row: row[1] * (row[3] - row[2]))
    view.axes.add_patch(
        Ellipse(
            (0.0, 0.5 * (bottom + roof)), 2.0 * width, roof - bottom, facecolor=FAINT, edgecolor=INK, linewidth=0.8,
            zorder=3.5, clip_on=False,
        )
    )  # fmt: skip
    half, at = 0.5 * outline.wing.span_m, low - 0.22 * view.m_in
    tip_z = outline.wing.z_m + outline.wing.point(half, half, 0.25)[1]
    for y in (-half, half):
        view.extension((y, tip_z), (y, at))
    view.dimension((-half, at), (half, at), "span", outline.wing.span_m)
    view.centre_of_gravity()
    view.title("front")


def _side_view(view: _View, outline: Outline, low: float) -> None:
    sections = outline.body_m
    x, bottom = _smooth([row[0] for row in sections], [row[2] for row in sections])
    _, roof = _smooth([row[0] for row in sections], [row[3] for row in sections])
    fin = outline.fin
    if fin is not None:
        corners = ((0.0, 0.0), (fin.span_m, 0.0), (fin.span_m, 1.0), (0.0, 1.0))
        view.surface([(-fin.point(s, fin.span_m, f)[0], fin.z_m + s) for s, f in corners], 2.0)
    body = [*zip(-x, bottom, strict=True), *zip(-x[::-1], roof[::-1], strict=True)]
    view.surface([(float(a), float(b)) for a, b in body], 3.0)
    for surface in _flat(outline):
        _section(view, surface)
    nose, end = outline.ends_m
    arm, at = outline.tail, low - 0.22 * view.m_in
    if arm is not None:
        where = _mean_quarter_chord(arm)
        view.extension((0.0, 0.0), (0.0, at))
        view.extension((-where, arm.z_m), (-where, at))
        view.dimension((0.0, at), (-where, at), "tail arm", abs(where))
    further = at - 0.24 * view.m_in
    for place in (nose, end):
        view.extension((-place, 0.0), (-place, further))
    view.dimension((-nose, further), (-end, further), "length", nose - end)
    view.centre_of_gravity()
    view.title("side")


def _mean_quarter_chord(surface: Surface) -> float:
    """Return x of the quarter chord of the mean aerodynamic chord."""
    taper = surface.tip_chord_m / surface.root_chord_m
    half = 0.5 * surface.span_m
    return surface.point(half * (1.0 + 2.0 * taper) / (3.0 * (1.0 + taper)), half, 0.25)[0]


def _section(view: _View, surface: Surface) -> None:
    """Draw a wing or tail from the side: all between its sections at root and tip, and the one at the root."""
    from scipy.spatial import ConvexHull

    half = 0.5 * surface.span_m
    c = np.linspace(0.0, 1.0, 41) ** 2
    # Thickness of the NACA four-digit sections (I. H. Abbott, A. E. von Doenhoff, Theory of Wing Sections, eq. 6.2).
    t = 5.0 * _THICKNESS * (0.2969 * np.sqrt(c) - 0.126 * c - 0.3516 * c**2 + 0.2843 * c**3 - 0.1036 * c**4)
    sections: list[Points] = []
    for s in (0.0, half):
        chord = surface.chord_m(s, half)
        lead, rise = surface.point(s, half, 0.0)
        x, z = c * chord - lead, surface.z_m + rise
        edge = [*zip(x, z + chord * t, strict=True), *zip(x[::-1], (z - chord * t)[::-1], strict=True)]
        sections.append([(float(a), float(b)) for a, b in edge])
    both = np.array(sections[0] + sections[1])
    view.surface([(float(a), float(b)) for a, b in both[ConvexHull(both).vertices]], 3.5)
    view.line([*sections[0], sections[0][0]], linewidth=0.6, zorder=3.6)
