"""Drawings of a flight card: control sequence and expected response, for a web page, on A4, and on A5 to fly by."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page import figure as fig
from testbench.page.labels import axis_label, shown_unit, symbol
from testbench.questions.plan.card_text import CONTROL_NAMES, CardText, card_text, card_title, in_units, levels
from testbench.questions.plan.response import SHOWN

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.plan.result import Card, Plan

_A4_IN, _A5_IN = (8.27, 11.69), (5.83, 8.27)
_LEFT, _RIGHT, _MIDDLE = 0.55, 7.75, 4.3
_GAP_IN = 0.44  # between plots, with title and ticks
_LINE_IN = 0.138
_ROW_IN = 0.118  # of the table of limits
_BINS = 400  # stretches of a band that are drawn
_MOST_LEVELS = 14  # whose sizes are written


def card_plate(card: Card, plan: Plan) -> fig.Plate:
    """Return control sequence and expected response of a card as a figure of a page."""
    controls, responses = _controls(card), _responses(card, plan)
    rows = [*([p] for p in controls), *(responses[k : k + 2] for k in range(0, len(responses), 2))]
    return fig.Plate(
        "card",
        "Control sequence and expected response",
        "t = 0 is the start of the input, after the settling time. Line: flight in the simulator; grey: 95 % band.",
        fig.Chart(rows),
    )


def _controls(card: Card) -> list[fig.Panel]:
    """Return what is commanded, with times and amplitudes of its steps."""
    signal, out = card.signal, list[fig.Panel]()
    for j, name in enumerate(signal.channels):
        factor, _ = shown_unit(name)
        u = factor * signal.u[:, j]
        peak = max(float(np.abs(u).max()), 1e-9)
        draws: list[fig.Drawn] = [
            fig.Curve(x=signal.t_s, y=u, colour=fig.COLOURS[0], steps=True, width=1.4),
            fig.Rule(at=0.0, of="y", width=0.6),
        ]
        held = levels(signal.t_s, signal.u[:, j])
        if held and len(held) <= _MOST_LEVELS:
            for begin, end, level in held:
                value, side = factor * level, 1 if level > 0.0 else -1
                look: dict[str, Any] = {
                    "shift": (0, 3 * side),
                    "across": "center",
                    "up": "bottom" if side > 0 else "top",
                }
                text = f"{value:+.3g}".replace("-", "−")
                draws.append(fig.Words(x=0.5 * (begin + end), y=value, text=text, size=7.0, **look))
            draws += _edges(held, card.spec.duration_s)
        out.append(
            fig.Panel(draws=draws, title=f"{CONTROL_NAMES[name]}, commanded, from trim", tall_in=1.25,
                  x="t, s" if j == len(signal.channels) - 1 else "", y=axis_label(name, deviation=True),
                  x_range=(0.0, card.spec.duration_s), y_range=(-2.4 * peak, 2.4 * peak))
        )  # fmt: skip
    return out


def _edges(held: Sequence[tuple[float, float, float]], width: float) -> list[fig.Drawn]:
    """Return the times of the edges along the lower border, without those that would overlap."""
    out, last = list[fig.Drawn](), -width
    for t in sorted({round(x, 3) for begin, end, _ in held for x in (begin, end)}):
        out.append(fig.Rule(at=t, colour="#c9ced4", width=0.6, dash=(2, 2), order=0.5))
        if t - last > 0.035 * width:
            look: dict[str, Any] = {"of_panel": "y", "shift": (1, 2), "up": "bottom", "size": 6.0, "colour": fig.QUIET}
            out.append(fig.Words(x=t, y=0.0, text=f"{t:.3g}", **look))
            last = t
    return out


def _responses(card: Card, plan: Plan) -> list[fig.Panel]:
    """Return the expected response of the shown channels with its band and the limits that lie near."""
    limits, out = {limit.channel: limit for limit in card.limits}, list[fig.Panel]()
    for name in SHOWN[card.spec.plane]:
        factor, unit = in_units(name, plan)
        y, half = factor * card.expected[name], factor * card.band[name]
        colour = fig.COLOURS[0] if card.status != "refused" else fig.WARN
        draws: list[fig.Drawn] = [
            fig.band(*_fewer(card.t_s, y - half, y + half), "#d5dae0", alpha=None),
            fig.Curve(x=card.t_s, y=y, colour=colour),
        ]
        low, high = float((y - half).min()), float((y + half).max())
        room = 0.12 * max(high - low, 1e-9)
        for edge in (factor * limits[name].low, factor * limits[name].high) if name in limits else ():
            if low - 0.6 * (high - low) <= edge <= high + 0.6 * (high - low):
                draws.append(fig.Rule(at=edge, of="y", colour=fig.WARN, width=1.0, dash=fig.DASHED))
                low, high = min(low, edge), max(high, edge)
        out.append(
            fig.Panel(draws=draws, title=f"{symbol(name)} expected", x="t, s", y=f"{symbol(name)}, {unit}", tall_in=1.3,
                  x_range=(-card.spec.settle_s, card.spec.duration_s), y_range=(low - room, high + room))
        )  # fmt: skip
    return out


def _fewer(t: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a band that looks the same with fewer points: the lowest and highest of each of some stretches."""
    n = -(-t.size // _BINS)
    if n < 2:
        return t, low, high
    count = t.size // n
    blocks = [x[: count * n].reshape(count, n) for x in (t, low, high)]
    parts = (blocks[0].mean(axis=1), blocks[1].min(axis=1), blocks[2].max(axis=1))
    t, low, high = (np.append(part, x[-1]) for part, x in zip(parts, (t, low, high), strict=True))
    return t, low, high


def card_page(card: Card, plan: Plan) -> fig.Chart:
    """Return the card as one page A4 portrait."""
    text, page = card_text(card, plan), _Page()
    page.write(_LEFT, 0.5, f"Flight card {card.number} of {len(plan.cards)}  ·  {plan.scenario.title}", 8.0, fig.QUIET)
    title = card_title(card, plan)
    page.write(_LEFT, 0.76, title[:1].upper() + title[1:], 14.0, bold=True)
    page.write(_LEFT, 1.0, text.status[:150], 8.5, "#00704a" if text.standing == "fly" else fig.WARN, bold=True)
    left = page.pairs(_LEFT, _MIDDLE - 0.2, 1.3, "Set-up", text.setup)
    right = page.lines(_MIDDLE, _RIGHT, 1.3, "Go or no-go", [*text.before, text.go], bullet=True)
    off = [*text.calls, *text.hazards, *text.emergency]
    right = page.lines(_MIDDLE, _RIGHT, right + 0.04, "Knock it off, hazards, emergency", off, bullet=True) - 0.16
    y = page.limits(_LEFT, _RIGHT, max(left, right) + 0.2, text) + 0.2
    y = page.lines(_LEFT, _RIGHT, y, "Control sequence", text.sequence)
    controls, responses = _controls(card), _responses(card, plan)
    tail = _tail_in(text)
    free = _A4_IN[1] - y - tail - 0.62
    rows = len(controls) + len(responses) // 2
    tall = min(1.45, max(0.26, free / rows - _GAP_IN))
    begin, wide = _LEFT + 0.5, _RIGHT - _LEFT - 0.5
    placed = [
        replace(p, x="", box_in=(begin, y + 0.1 + k * (tall + _GAP_IN), wide, tall)) for k, p in enumerate(controls)
    ]
    y += 0.1 + len(controls) * (tall + _GAP_IN)
    half = 0.5 * (wide - 0.75)
    for k, p in enumerate(responses):
        row, column = divmod(k, 2)
        box = (begin + column * (half + 0.75), y + row * (tall + _GAP_IN), half, tall)
        placed.append(replace(p, x="", title=f"{p.title}, t in s", box_in=box))
    _tail(page, text, _A4_IN[1] - tail - 0.3)
    return fig.Chart([[page.sheet(_A4_IN)], placed], keys=(), size_in=_A4_IN)


def kneeboard_page(card: Card, plan: Plan) -> fig.Chart:
    """Return what a card is flown by as one page A5 portrait: no figure, letters that are read at arm's length."""
    text, page, left, right = card_text(card, plan), _Page(8.6), 0.4, _A5_IN[0] - 0.35
    title, said = card_title(card, plan), dict(text.setup)
    page.write(left, 0.42, f"{card.number} / {len(plan.cards)}  ·  {plan.scenario.title}"[:78], 7.5, fig.QUIET)
    page.write(left, 0.7, title[:1].upper() + title[1:], 13.0, bold=True)
    good = text.standing == "fly"
    page.write(left, 0.93, text.standing.upper(), 9.5, "#00704a" if good else fig.WARN, bold=True)
    names = ("speed", "height", "configured", "mass, c.g.", "trim", "build-up", "runs", "script", "player", "switch")
    y = page.pairs(left, right, 1.2, "Set-up", [(n, said[n]) for n in names if n in said]) + 0.25
    y = page.lines(left, right, y, "Go", text.before) + 0.06
    y = page.lines(left, right, y, "Fly", text.sequence) + 0.06
    limits = "   ".join(f"{name} {span}" for name, span, _, _ in text.limits)
    y = page.lines(left, right, y, "Limits", [limits]) + 0.06
    off = [text.calls[0].removeprefix("KNOCK IT OFF: "), *text.hazards]
    y = page.lines(left, right, y, "Knock it off", off) + 0.06
    y = page.lines(left, right, y, "Emergency", text.emergency) + 0.06
    page.lines(left, right, y, "Next", [text.go])
    return fig.Chart([[page.sheet(_A5_IN)]], keys=(), size_in=_A5_IN)


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
    xs = (_LEFT, _LEFT + 0.7 * width, _LEFT + 0.85 * width, _LEFT + width)
    for x, head in zip(xs[1:], ("Hz", "ζ here", "ζ next"), strict=True):
        page.write(x, here, head, 6.5, fig.QUIET, across="right")
    for name, f, zeta, later in text.modes:
        here += _LINE_IN
        page.write(_LEFT, here, name, 6.2)
        for x, value in zip(xs[1:], (f.removesuffix(" Hz"), zeta, later), strict=True):
            page.write(x, here, value, 6.5, across="right")
    end = page.lines(_MIDDLE, _RIGHT, y, "Log", text.log, bullet=True)
    page.lines(_MIDDLE, _RIGHT, end + 0.04, "Notes", text.notes, bullet=True)


def _wrapped(text: str, width_in: float, size: float) -> list[str]:
    """Return ``text`` in lines that fit into a width at a size of letters, points."""
    return textwrap.wrap(text, max(10, int(width_in * 72.0 / (0.52 * size)))) or [""]


class _Page:
    """Text placed on a page in inches from its upper left corner, of one size of letters (points) below headings."""

    def __init__(self, size: float = 7.0) -> None:
        self.draws: list[fig.Drawn] = []
        self.size, self.line_in = size, _LINE_IN * size / 7.0

    def sheet(self, size_in: tuple[float, float]) -> fig.Panel:
        """Return the page as a panel of its size."""
        ranges: dict[str, Any] = {"x_range": (0.0, size_in[0]), "y_range": (size_in[1], 0.0)}
        return fig.Panel(draws=self.draws, bare=True, box_in=(0.0, 0.0, *size_in), **ranges)

    def write(self, x: float, y: float, text: str, size: float, colour: str = fig.INK, **other: Any) -> None:
        """Write one line with its base line at ``y``."""
        self.draws.append(fig.Words(x=x, y=y, text=text, size=size, colour=colour, up="baseline", **other))

    def head(self, left: float, right: float, y: float, text: str) -> None:
        """Write a heading over a rule."""
        self.write(left, y, text, self.size + 1.5, bold=True)
        self.draws.append(fig.Curve(x=[left, right], y=[y + 0.045, y + 0.045], colour=fig.AXIS, width=0.7))

    def pairs(self, left: float, right: float, y: float, title: str, rows: Sequence[tuple[str, str]]) -> float:
        """Write (what, value) rows; return where they end."""
        self.head(left, right, y, title)
        y += 0.06
        for what, value in rows:
            for k, line in enumerate(_wrapped(value, 0.92 * (right - left - 0.85), self.size + 0.4)):
                y += self.line_in
                if k == 0:
                    self.write(left, y, what, self.size + 0.4, fig.QUIET)
                self.write(left + 0.85, y, line, self.size + 0.4)
        return y

    def limits(self, left: float, right: float, y: float, text: CardText) -> float:
        """Write limits and what to do when one is met; return where they end."""
        self.head(left, right, y, "Limits, and the action when one is met")
        y += 0.06
        for name, span, what, who in text.limits:
            lines = _wrapped(what, 2.85, 6.4), _wrapped(who, right - left - 4.65, 6.0)
            self.write(left, y + _ROW_IN, name, 7.0, bold=True)
            self.write(left + 0.75, y + _ROW_IN, span, 6.8)
            for x, size, colour, part in ((1.75, 6.4, fig.INK, lines[0]), (4.65, 6.0, fig.QUIET, lines[1])):
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
            for k, line in enumerate(_wrapped(text, right - left - 0.1, self.size)):
                y += self.line_in
                self.write(left, y, ("· " if bullet and k == 0 else "  " if bullet else "") + line, self.size)
        return y + 0.16
