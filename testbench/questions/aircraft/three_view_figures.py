"""The three-view drawing of an aircraft: top, front and side to one scale, with its main dimensions and its CG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page import figure as fig

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.aircraft.outline import Outline, Surface
    from testbench.core.record import FloatArray
    from testbench.questions.aircraft.ask import Survey

_MARGIN_IN, _GAP_IN = 0.3, 0.75  # round the drawing, and between the views; dimension lines stand in both
_TALLEST_IN, _ROW_IN = 8.0, 0.18
_BELOW_IN = 0.62  # a view: dimension lines
_THICKNESS = 0.12  # of every section as drawn, in chords
_ALIKE = 0.02  # difference up to which drawn and reference mean chord count as the same
_BOLD = fig.COLOURS[0]
_CG_IN = 0.06  # radius of the mark of the centre of gravity
Points = list[tuple[float, float]]


def three_view_plates(survey: Survey) -> list[fig.Plate]:
    """Return the drawing of the surveyed aircraft, or nothing if its outline is not known."""
    return outline_plates(survey.envelope.aircraft)


def outline_plates(aircraft: Aircraft) -> list[fig.Plate]:
    """Return the drawing of an aircraft, or nothing if its outline is not known."""
    outline = aircraft.outline
    if outline is None:
        return []

    return [
        fig.Plate("three_view", "Three-view drawing", _caption(aircraft, outline), partial(_chart, aircraft, outline))
    ]


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
    """One view of the aircraft in metres, to be drawn on paper."""

    # x_in, y_in: of the aircraft's centre of gravity from the paper's lower left corner
    x_in: float
    y_in: float
    m_in: float  # how many metres an inch of paper is
    draws: list[fig.Drawn] = field(default_factory=list)  # what is drawn so far, in inches of paper

    def at(self, points: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
        """Return where points (n, 2), m, lie on the paper, in."""
        x, y = np.asarray(points, float).T / self.m_in
        return self.x_in + x, self.y_in + y

    def surface(self, outline: Points, order: float, colour: str = fig.FAINT, edge: str = fig.INK) -> None:
        """Draw a filled shape."""
        self.draws.append(fig.Area(outlines=[self.at(outline)], colour=colour, edge=edge, order=order, clip=False))

    def line(self, points: Points, **look: Any) -> None:
        """Draw a line through ``points``."""
        x, y = self.at(points)
        self.draws.append(fig.Curve(x=x, y=y, **{"width": 0.8, "clip": False} | look))

    def words(self, place: tuple[float, float], text: str, **look: Any) -> None:
        """Write a text."""
        (x,), (y,) = self.at([place])
        self.draws.append(fig.Words(x=float(x), y=float(y), text=text, **look))

    def dimension(self, begin: tuple[float, float], end: tuple[float, float], words: str, size_m: float) -> None:
        """Draw a level dimension line with arrows and its text on it, of a short one the last word, or beside it."""
        left, right = sorted((begin[0], end[0]))
        self.line([begin, end], colour=fig.QUIET, width=0.7, order=6.0)
        long, thick = min(0.085 * self.m_in, 0.4 * (right - left)), 0.022 * self.m_in
        for tip, way in ((left, 1.0), (right, -1.0)):
            head = [(tip, end[1]), (tip + way * long, end[1] + thick), (tip + way * long, end[1] - thick)]
            self.surface(head, 6.0, fig.QUIET, fig.QUIET)
        room, size = (right - left) / self.m_in, f"{_length(size_m)} m"
        text = next((t for t in (f"{words} {size}", f"{words.split()[-1]} {size}") if _wide_in(t) + 0.3 < room), "")
        look: dict[str, Any] = {"on_white": True, "order": 7.0}
        if text:
            self.words((0.5 * (left + right), end[1]), text, across="center", **look)
        else:
            self.words((right + 0.06 * self.m_in, end[1]), f"{words} {size}", **look)

    def extension(self, begin: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a thin line from the shape to a dimension line."""
        self.line([begin, end], colour=fig.QUIET, width=0.5, order=1.0)

    def centre_of_gravity(self) -> None:
        """Draw the quartered circle at the origin."""
        self.surface(_arc(0.0, 2.0 * np.pi, _CG_IN * self.m_in), 8.0, "white")
        for turn in (0.0, np.pi):
            quarter = [(0.0, 0.0), *_arc(turn, turn + 0.5 * np.pi, _CG_IN * self.m_in)]
            self.surface(quarter, 9.0, fig.INK)


def _arc(begin: float, end: float, radius: float, flat: float = 1.0) -> Points:
    """Return points of a circle, or of an ellipse ``flat`` times as high, between two angles, rad."""
    angle = np.linspace(begin, end, 48)
    return list(zip((radius * np.cos(angle)).tolist(), (flat * radius * np.sin(angle)).tolist(), strict=True))


def _chart(aircraft: Aircraft, outline: Outline, wide: bool) -> fig.Chart:
    """Return top view above front view, and the side view beside them if there is room, else below."""
    nose, end = outline.ends_m
    span = max(s.span_m for s in _flat(outline))
    low, high = _heights(outline)
    length, tall = nose - end, high - low
    width = fig.width_in(wide)
    paper = width - 2.0 * _MARGIN_IN
    across = (paper - _GAP_IN) / (span + length) if wide else paper / max(span, length)
    down = (_TALLEST_IN - 3.0 * _GAP_IN) / (length + tall * (1 if wide else 2))
    m_in = 1.0 / min(across, down)
    facts = _particulars(aircraft, outline)
    top = 0.25
    front = _BELOW_IN + (0.0 if wide else 0.3 + tall / m_in + _BELOW_IN + _ROW_IN * len(facts))
    total = front + tall / m_in + _BELOW_IN + length / m_in + top
    used = (span + length) / m_in + _GAP_IN if wide else max(span, length) / m_in
    left = 0.5 * (width - (used if wide else span / m_in))
    x_side = left + span / m_in + _GAP_IN if wide else 0.5 * (width - length / m_in)
    y_side = front if wide else _BELOW_IN + _ROW_IN * len(facts)
    middle = left + 0.5 * span / m_in
    views = (
        _View(middle, total - top - nose / m_in, m_in),
        _View(middle, front - low / m_in, m_in),
        _View(x_side + nose / m_in, y_side - low / m_in, m_in),
    )
    _top_view(views[0], aircraft, outline)
    _front_view(views[1], outline, low)
    _side_view(views[2], outline, low)
    draws = [d for view in views for d in view.draws]
    for name, x, y in (
        ("top", left, total - top), ("front", left, front + tall / m_in), ("side", x_side, y_side + tall / m_in)
    ):  # fmt: skip
        draws.append(fig.Words(x=x, y=y + 0.05, text=name, colour=fig.QUIET, size=8.5, up="bottom"))
    x, y = (x_side, total - top) if wide else (_MARGIN_IN, _ROW_IN * len(facts))
    for k, pair in enumerate(facts):
        for text, shift, colour in zip(pair, (0.0, 1.45), (fig.QUIET, fig.INK), strict=True):
            draws.append(fig.Words(x=x + shift, y=y - _ROW_IN * k, text=text, colour=colour, up="top"))
    panel = fig.Panel(
        draws=draws, bare=True, x_range=(0.0, width), y_range=(0.0, total), box_in=(0.0, 0.0, width, total)
    )
    return fig.Chart([[panel]], keys=(), size_in=(width, total))


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
        cg = 0.25 + wing.mean_quarter_m(0.5 * wing.span_m) / wing.mean_chord_m
        out.append(("CG, as drawn", f"{100.0 * cg:.0f} % of c̄"))
    return out


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
            view.line([(y, ends[0]), (y, rear)], width=1.6, order=5)
    half = 0.5 * wing.span_m
    g = aircraft.geometry
    if _alike(aircraft, outline) and wing.root_chord_m != wing.tip_chord_m:
        y = -half * (wing.root_chord_m - wing.mean_chord_m) / (wing.root_chord_m - wing.tip_chord_m)
        ends = [_along(wing, f, (y,))[0][1] for f in (0.0, 1.0)]
        view.line([(y, ends[0]), (y, ends[1])], colour=_BOLD, width=1.8, order=6)
        place = (y, max(ends) + 0.06 * view.m_in)
        view.words(place, f"c̄ {_length(g.cbar_m)} m", colour=_BOLD, across="center", up="bottom")
    stations = _stations(aircraft, outline)
    if stations and outline.elastic_axis is not None:
        both = sorted({*stations, *(-y for y in stations)})
        view.line(_along(wing, outline.elastic_axis, both), colour=_BOLD, width=0.7, dash=fig.DASHED, order=5.0)
        view.line(_along(wing, outline.elastic_axis, stations), colour=_BOLD, marker="o", size=2.4, order=6.0)
    if tail is not None:
        tail_end = outline.ends_m[1] - 0.18 * view.m_in
        for y in (-0.5 * tail.span_m, 0.5 * tail.span_m):
            view.extension((y, _along(tail, 1.0, (y,))[0][1]), (y, tail_end))
        view.dimension((-0.5 * tail.span_m, tail_end), (0.5 * tail.span_m, tail_end), "tail span", tail.span_m)
    view.centre_of_gravity()


def _front_view(view: _View, outline: Outline, low: float) -> None:
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
    middle = 0.5 * (bottom + roof)
    view.surface([(y, middle + z) for y, z in _arc(0.0, 2.0 * np.pi, width, 0.5 * (roof - bottom) / width)], 3.5)
    half, at = 0.5 * outline.wing.span_m, low - 0.22 * view.m_in
    tip_z = outline.wing.z_m + outline.wing.point(half, half, 0.25)[1]
    for y in (-half, half):
        view.extension((y, tip_z), (y, at))
    view.dimension((-half, at), (half, at), "span", outline.wing.span_m)
    view.centre_of_gravity()


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
        where = arm.mean_quarter_m(0.5 * arm.span_m)
        view.extension((0.0, 0.0), (0.0, at))
        view.extension((-where, arm.z_m), (-where, at))
        view.dimension((0.0, at), (-where, at), "tail arm", abs(where))
    further = at - 0.24 * view.m_in
    for place in (nose, end):
        view.extension((-place, 0.0), (-place, further))
    view.dimension((-nose, further), (-end, further), "length", nose - end)
    view.centre_of_gravity()


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
    view.line([*sections[0], sections[0][0]], width=0.6, order=3.6)
