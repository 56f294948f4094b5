"""Drawings of a flight card: control sequence and expected response, for a web page and on one page A4."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.labels import axis_label, shown_unit, symbol
from testbench.page.plot import COLOURS, INK, QUIET, Plate, envelope, grid, label, new_figure, style, time_axis
from testbench.questions.plan.card_text import CONTROL_NAMES, CardText, card_text, levels
from testbench.questions.plan.response import SHOWN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FloatArray
    from testbench.questions.plan.result import Card, Plan

_A4_IN = (8.27, 11.69)
_LEFT, _RIGHT, _MIDDLE = 0.55, 7.75, 4.3
_LINE_IN = 0.138
_ROW_IN = 0.118  # of the table of limits
_BINS = 400  # stretches of a curve that are drawn
_WARN = "#b34700"


def card_plate(card: Card) -> Plate:
    """Return control sequence and expected response of a card as a figure of a page."""

    def make(wide: bool) -> Figure:
        """Draw controls over responses."""
        controls = len(card.signal.channels)
        rows = 2 if wide else 4
        figure = new_figure(wide, 0.35 + controls * 1.75 + rows * 1.85)
        heights = [1.25] * controls
        top = grid(figure, 0.3, heights, gap_in=0.5)
        draw_controls(top[:, 0].tolist(), card)
        below = grid(
            figure, 0.3 + controls * 1.75, [1.3] * rows, (1.0, 1.0) if wide else (1.0,), gap_in=0.55, between_in=0.75
        )
        draw_responses(below.ravel().tolist(), card)
        return figure

    return Plate(
        "card",
        "Control sequence and expected response",
        "t = 0 is the start of the input, after the settling time. Line: flight in the simulator; grey: 95 % band.",
        make,
    )


def draw_controls(panels: Sequence[Axes], card: Card) -> None:
    """Draw what is commanded, with times and amplitudes of its steps."""
    signal = card.signal
    for j, (axes, name) in enumerate(zip(panels, signal.channels, strict=True)):
        factor, _ = shown_unit(name)
        u = factor * signal.u[:, j]
        t, y = envelope(signal.t_s, u, _BINS)
        axes.plot(t, y, color=COLOURS[0], drawstyle="steps-post", linewidth=1.4)
        axes.axhline(0.0, color=QUIET, linewidth=0.6)
        peak = max(float(np.abs(u).max()), 1e-9)
        axes.set_ylim(-2.4 * peak, 2.4 * peak)
        axes.set_xlim(0.0, card.spec.duration_s)
        held = levels(signal.t_s, signal.u[:, j])
        width = card.spec.duration_s
        if held and len(held) <= 14:
            for begin, end, level in held:
                value = factor * level
                axes.annotate(
                    f"{value:+.3g}".replace("-", "−"),
                    (0.5 * (begin + end), value),
                    xytext=(0, 3 if value > 0.0 else -3),
                    textcoords="offset points",
                    ha="center",
                    va="bottom" if value > 0.0 else "top",
                    fontsize=7.0,
                )
            _edge_times(axes, held, width)
        title = f"{CONTROL_NAMES[name]}, commanded, from trim"
        label(axes, "t, s" if j == len(panels) - 1 else "", axis_label(name, deviation=True), title)


def _edge_times(axes: Axes, held: Sequence[tuple[float, float, float]], width: float) -> None:
    """Write the times of the edges along the lower border, leaving out those that would overlap."""
    last = -width
    for t in sorted({round(x, 3) for begin, end, _ in held for x in (begin, end)}):
        axes.axvline(t, color="#c9ced4", linewidth=0.6, linestyle=(0, (2, 2)), zorder=0)
        if t - last > 0.035 * width:
            axes.annotate(
                f"{t:.3g}", (t, 0.0), xycoords=("data", "axes fraction"), xytext=(1, 2), textcoords="offset points",
                fontsize=6.0, color=QUIET,
            )  # fmt: skip
            last = t


def draw_responses(panels: Sequence[Axes], card: Card) -> None:
    """Draw the expected response of the shown channels with its band and the limits that lie near."""
    limits = {limit.channel: limit for limit in card.limits}
    for axes, name in zip(panels, SHOWN[card.spec.plane], strict=True):
        factor, _ = shown_unit(name)
        y, t = factor * card.expected[name], card.t_s
        half = factor * card.band[name]
        axes.fill_between(*_band(t, y - half, y + half), color="#d5dae0", linewidth=0.0)
        axes.plot(*envelope(t, y, _BINS), color=COLOURS[0] if card.status != "refused" else _WARN)
        low, high = float((y - half).min()), float((y + half).max())
        room = 0.12 * max(high - low, 1e-9)
        if name in limits:
            for edge in (factor * limits[name].low, factor * limits[name].high):
                if low - 0.6 * (high - low) <= edge <= high + 0.6 * (high - low):
                    axes.axhline(edge, color=_WARN, linewidth=1.0, linestyle=(0, (5, 2)))
                    low, high = min(low, edge), max(high, edge)
        axes.set_ylim(low - room, high + room)
        axes.set_xlim(-card.spec.settle_s, card.spec.duration_s)
        time_axis(axes)
        label(axes, "t, s", axis_label(name), f"{symbol(name)} expected")


def _band(t: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a band that looks the same with fewer points: the lowest and highest of each of some stretches."""
    n = -(-t.size // _BINS)
    if n < 2:
        return t, low, high
    count = t.size // n
    blocks = [x[: count * n].reshape(count, n) for x in (t, low, high)]
    ends = (t[-1:], low[-1:], high[-1:])
    parts = (blocks[0].mean(axis=1), blocks[1].min(axis=1), blocks[2].max(axis=1))
    joined = [np.concatenate([part, end]) for part, end in zip(parts, ends, strict=True)]
    return joined[0], joined[1], joined[2]


def card_pdf_page(card: Card, plan: Plan) -> Figure:
    """Return the card as one page A4 portrait."""
    from matplotlib.figure import Figure

    text = card_text(card, plan)
    figure = Figure(figsize=_A4_IN)
    page = _Page(figure)
    page.write(_LEFT, 0.5, f"Flight card {card.number} of {len(plan.cards)}  ·  {plan.scenario.title}", 8.0, QUIET)
    page.write(_LEFT, 0.76, card.title[:1].upper() + card.title[1:], 14.0, INK, weight="bold")
    colour = "#00704a" if text.standing == "fly" else _WARN
    page.write(_LEFT, 1.0, text.status[:150], 8.5, colour, weight="bold")
    left = page.pairs(_LEFT, _MIDDLE - 0.2, 1.3, "Set-up", text.setup)
    right = page.lines(_MIDDLE, _RIGHT, 1.3, "Go or no-go", [*text.before, text.go], bullet=True) - 0.16
    y = page.limits(_LEFT, _RIGHT, max(left, right) + 0.2, text) + 0.2
    y = page.lines(_LEFT, _RIGHT, y, "Control sequence", text.sequence)
    controls = len(card.signal.channels)
    tail = _tail_in(text)
    free = _A4_IN[1] - y - tail - 0.55
    tall = min(1.45, max(0.33, (free - 0.62 * controls - 2 * 0.62) / (controls + 2)))
    panels = grid(figure, y + 0.12, [tall] * controls, gap_in=0.55, left_in=_LEFT + 0.5, right_in=_A4_IN[0] - _RIGHT)
    draw_controls(panels[:, 0].tolist(), card)
    y += 0.12 + controls * (tall + 0.6)
    panels = grid(
        figure, y, [tall] * 2, (1.0, 1.0), gap_in=0.55, between_in=0.75, left_in=_LEFT + 0.5,
        right_in=_A4_IN[0] - _RIGHT,
    )  # fmt: skip
    draw_responses(panels.ravel().tolist(), card)
    _tail(page, text, _A4_IN[1] - tail - 0.3)
    return figure


def _tail_in(text: CardText) -> float:
    """Return the height of what stands below the plots, in."""
    notes = sum(len(_wrapped(line, _RIGHT - _MIDDLE, 7.0)) for line in (*text.log, *text.notes))
    modes = len(text.modes)
    return 0.42 + _LINE_IN * max(notes + 2, modes + 1)


def _tail(page: _Page, text: CardText, y: float) -> None:
    """Write frequency and damping at the left, what to log and notes at the right."""
    page.head(_LEFT, _MIDDLE - 0.2, y, "Damping")
    here = y + 0.2
    width = _MIDDLE - 0.2 - _LEFT
    xs = (_LEFT, _LEFT + 0.64 * width, _LEFT + 0.76 * width, _LEFT + 0.88 * width, _LEFT + width)
    for x, head in zip(xs[1:], ("Hz", "ζ here", "ζ next", "go: ζ ≥"), strict=True):
        page.write(x, here, head, 6.5, QUIET, ha="right")
    for name, f, zeta, later, go in text.modes:
        here += _LINE_IN
        page.write(_LEFT, here, name, 6.2, INK)
        for x, value in zip(xs[1:], (f.removesuffix(" Hz"), zeta, later, go.removeprefix("≥ ")), strict=True):
            page.write(x, here, value, 6.5, INK, ha="right")
    end = page.lines(_MIDDLE, _RIGHT, y, "Log", text.log, bullet=True)
    page.lines(_MIDDLE, _RIGHT, end + 0.04, "Notes", text.notes, bullet=True)


def _wrapped(text: str, width_in: float, size: float) -> list[str]:
    """Return ``text`` in lines that fit into a width at a size of letters, points."""
    return textwrap.wrap(text, max(10, int(width_in * 72.0 / (0.52 * size)))) or [""]


class _Page:
    """Text placed on a page in inches from its upper left corner."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def write(self, x: float, y: float, text: str, size: float, colour: str, **other: Any) -> None:
        """Write one line with its base line at ``y``."""
        self.figure.text(x / _A4_IN[0], 1.0 - y / _A4_IN[1], text, fontsize=size, color=colour, **other)

    def head(self, left: float, right: float, y: float, text: str) -> None:
        """Write a heading over a rule."""
        from matplotlib.lines import Line2D

        self.write(left, y, text, 8.5, INK, weight="bold")
        level = 1.0 - (y + 0.045) / _A4_IN[1]
        self.figure.add_artist(
            Line2D([left / _A4_IN[0], right / _A4_IN[0]], [level, level], color="#9aa1a9", linewidth=0.7)
        )

    def pairs(self, left: float, right: float, y: float, title: str, rows: Sequence[tuple[str, str]]) -> float:
        """Write (what, value) rows; return where they end."""
        self.head(left, right, y, title)
        y += 0.06
        for what, value in rows:
            for k, line in enumerate(_wrapped(value, 0.92 * (right - left - 0.85), 7.4)):
                y += _LINE_IN
                if k == 0:
                    self.write(left, y, what, 7.4, QUIET)
                self.write(left + 0.85, y, line, 7.4, INK)
        return y

    def limits(self, left: float, right: float, y: float, text: CardText) -> float:
        """Write limits and what to do when one is met; return where they end."""
        self.head(left, right, y, "Limits, and what to do when one is met")
        y += 0.06
        for name, span, what, who in text.limits:
            lines = _wrapped(what, 2.85, 6.4), _wrapped(who, right - left - 4.65, 6.0)
            self.write(left, y + _ROW_IN, name, 7.0, INK, weight="bold")
            self.write(left + 0.75, y + _ROW_IN, span, 6.8, INK)
            for x, size, colour, part in ((1.75, 6.4, INK, lines[0]), (4.65, 6.0, QUIET, lines[1])):
                for k, line in enumerate(part, 1):
                    self.write(left + x, y + k * _ROW_IN, line, size, colour)
            y += max(map(len, lines)) * _ROW_IN + 0.015
        return y

    def lines(
        self, left: float, right: float, y: float, title: str, lines: Sequence[str], bullet: bool = False
    ) -> float:
        """Write lines under a heading; return where they end, with room for the next heading."""
        self.head(left, right, y, title)
        y += 0.06
        for text in lines:
            for k, line in enumerate(_wrapped(text, right - left - 0.1, 7.0)):
                y += _LINE_IN
                self.write(left, y, ("· " if bullet and k == 0 else "  " if bullet else "") + line, 7.0, INK)
        return y + 0.16


def pdf_bytes(pages: Sequence[Figure]) -> bytes:
    """Return pages as one PDF, always the same bytes."""
    from matplotlib.backends.backend_pdf import PdfPages

    out = io.BytesIO()
    with PdfPages(out, metadata={"CreationDate": None, "Creator": "flight-testbench", "Producer": None}) as file:
        for page in pages:
            file.savefig(page)
    return out.getvalue()


def draw_pages(cards: Sequence[Card], plan: Plan) -> list[tuple[Card, Figure]]:
    """Return every card with its page, drawn in the style of the reports."""
    from matplotlib import rc_context

    with rc_context({**style(), "pdf.fonttype": 42}):
        return [(card, card_pdf_page(card, plan)) for card in cards]
