"""Figures of a comparison: errors with intervals suite by suite, what information predicts, stations on the wing."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from testbench.page.explore import Curve, Explorable, Panel, View
from testbench.page.labels import symbol
from testbench.page.plot import (
    COLOURS,
    INK,
    QUIET,
    Plate,
    grid,
    in_lines,
    label,
    legend,
    legend_in,
    log_axis,
    marker_look,
    new_figure,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.questions.compare.placement import Placed
    from testbench.questions.compare.result import CompareResult

_ROW_IN = 0.3
_DOT_IN = 0.13  # so that a count stands in the line of its own interval, clear of the next
_NOTE_ROOM = 0.55  # share of an axis' end beyond which a note stands above its interval
_ROOM = 0.6  # share of the smallest value that an axis begins at
_KINDS = ("prediction", "mode", "parameter")
_LETTERS, _FEW_LETTERS = 28, 20  # of a row's name in one line, in the wide and in the narrow form
_HUNDREDTHS = 100.0  # damping ratios are drawn in hundredths, beside percent


class Dot(NamedTuple):
    """One figure in a panel: which row and suite, its value and interval, whether it is predicted, and a word on it."""

    row: str
    suite: int
    value: float
    low: float
    high: float
    predicted: bool
    note: str = ""


def compare_plates(result: CompareResult) -> list[Plate]:
    """Return the figures: errors by simulation (if there are any), by information, and the placement."""
    suites = [s.name for s in result.suites]
    out = []
    if result.errors:
        out.append(
            Plate(
                "errors",
                "Errors through each suite",
                f"Root mean square over {result.scenario.seeds} repetitions with 95 % interval, percent; damping "
                "ratios in hundredths. Open signs: standard errors that information predicts for the estimator beside "
                'them. "sure": the difference to the first suite is beyond chance, over all questions of the '
                "comparison together. 9/12: found in 9 of 12 repetitions. Quantities that only one suite predicts, or "
                "whose true value is near zero, are in the table.",
                partial(_panels, _error_panels(result), suites),
            )
        )
    else:
        out.append(
            Plate(
                "information",
                "Standard errors by information",
                "Cramér-Rao bound through each suite, percent; damping ratios in hundredths. Nothing was flown. "
                "Quantities whose true value is near zero are in the table.",
                partial(_panels, _information_panels(result), suites),
            )
        )
    if result.placed is not None:
        out.append(
            Plate(
                "placement",
                "Where sensors along the wing tell most",
                "Left: the criterion that one added sensor reaches, over its station; lower is better, and filled "
                "signs are the stations of the best set. Right: the criterion as the sensors of the best set are added "
                "one by one.",
                partial(_placement, result.placed),
                partial(_stations, result.placed),
            )
        )
    return out


def _error_panels(result: CompareResult) -> dict[str, list[Dot]]:
    """Return title -> dots, one panel per input and estimator."""
    from testbench.questions.compare.scenario import BEST_CASE

    index = {s.name: k for k, s in enumerate(result.suites)}
    out: dict[str, list[Dot]] = {}
    sure = {(g.case, g.quantity) for g in result.gains if g.significant(result.scenario.level)}
    seen = {s.quantity: {o.case.suite for o in result.summaries if o.quantity == s.quantity} for s in result.summaries}
    least = min(2, len(result.suites))  # suites that a row compares
    kinds, order = _KINDS.index, list(dict.fromkeys(s.case.estimator for s in result.summaries))
    for s in sorted(result.summaries, key=lambda s: (order.index(s.case.estimator), kinds(s.quantity.kind))):
        if (s.quantity.kind == "prediction" and len(seen[s.quantity]) < least) or s.quantity.unit not in ("%", ""):
            continue
        title = f"{s.case.estimator}, {s.case.manoeuvre}" if len(result.manoeuvres) > 1 else s.case.estimator
        dots = out.setdefault(title, [])
        k, factor = index[s.case.suite], 1.0 if s.quantity.unit else _HUNDREDTHS
        name = f"prediction of {symbol(s.quantity.name)}" if s.quantity.kind == "prediction" else s.quantity.name
        if s.rms is not None:
            words = ["sure"] if (s.case, s.quantity) in sure else []
            words += [f"{s.found}/{s.of}"] if s.found < s.of else []
            low, high = factor * s.rms.low, factor * s.rms.high
            dots.append(Dot(name, k, factor * s.rms.value, low, high, False, " ".join(words)))
        else:
            dots.append(Dot(name, k, np.nan, np.nan, np.nan, False, f"{s.found}/{s.of}"))
        if s.case.estimator == BEST_CASE and s.predicted is not None and np.isfinite(s.predicted):
            dots.append(Dot(name, k, factor * s.predicted, factor * s.predicted, factor * s.predicted, True))
    return {title: dots for title, dots in out.items() if any(np.isfinite(d.value) for d in dots)}


def _information_panels(result: CompareResult) -> dict[str, list[Dot]]:
    out: dict[str, list[Dot]] = {}
    for (manoeuvre, suite), p in result.predictions.items():
        k = [s.name for s in result.suites].index(suite)
        for name, std, unit in zip(p.names, p.std.tolist(), p.units, strict=True):
            value = std * (1.0 if unit else _HUNDREDTHS)
            if np.isfinite(value) and unit in ("%", ""):
                out.setdefault(manoeuvre, []).append(Dot(name, k, value, value, value, True))
    return out


def _panels(panels: dict[str, list[Dot]], suites: Sequence[str], wide: bool) -> Figure:
    """Draw one panel per title: rows of quantities, a dot per suite."""
    titles = list(panels)
    across = min(2, len(titles)) if wide else 1
    rows = [titles[k : k + across] for k in range(0, len(titles), across)]
    names = {t: list(dict.fromkeys(d.row for d in panels[t])) for t in titles}
    row_in = max(_ROW_IN, _DOT_IN * len(suites) + 0.1)
    heights = [max(0.9, row_in * max(len(names[t]) for t in row) + 0.2) for row in rows]
    top = legend_in(suites, wide) + 0.35
    figure = new_figure(wide, top + sum(heights) + 0.62 * len(rows))
    left = 2.1 if wide else 1.55
    axes = grid(figure, top, heights, (1.0,) * across, gap_in=0.62, between_in=left, left_in=left, right_in=0.15)
    legend(figure, _handles(suites))
    for r, row in enumerate(rows):
        for c in range(across):
            if c < len(row):
                _dots(axes[r, c], panels[row[c]], names[row[c]], len(suites), _LETTERS if wide else _FEW_LETTERS)
                label(axes[r, c], "error, % (ζ: hundredths)" if r == len(rows) - 1 else "", "", row[c])
            else:
                axes[r, c].set_visible(False)
    return figure


def _handles(suites: Sequence[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], color=COLOURS[k % 6], marker=marker_look(k)[1], linestyle="", markersize=5, label=name)
        for k, name in enumerate(suites)
    ]


def _dots(axes: Axes, dots: Sequence[Dot], names: Sequence[str], suites: int, letters: int) -> None:
    drawn = [d for d in dots if np.isfinite(d.value)]
    floor = _ROOM * min(d.value for d in drawn)
    step = 0.7 / max(suites, 1)
    notes: list[tuple[float, float, str, str]] = []
    for d in dots:
        y = names.index(d.row) + step * (d.suite - 0.5 * (suites - 1)) + (0.12 * step if d.predicted else 0.0)
        colour, marker = COLOURS[d.suite % 6], marker_look(d.suite)[1]
        x = d.value
        if not np.isfinite(x):  # found too seldom for an error
            notes.append((floor, y, d.note, colour))
            continue
        if d.high > d.low:
            axes.plot([max(d.low, floor), max(d.high, floor)], [y, y], color=colour, linewidth=1.2)
        face = "white" if d.predicted else colour
        if d.note:
            notes.append((max(d.high, x), y, d.note, colour))
        axes.plot([x], [y], marker=marker, markersize=4.5, markerfacecolor=face, color=colour, linestyle="", zorder=3)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_yticks(range(len(names)), [_short(n, letters) for n in names])
    axes.grid(visible=False, axis="y")
    end = min(1.4 * max(d.high for d in drawn), 3.0 * max(d.value for d in drawn))
    axes.set_xlim(floor, end)
    for x, y, words, colour in notes:
        inside = x < _NOTE_ROOM * end
        axes.annotate(
            words,
            (min(x, end), y),
            xytext=(6, 0) if inside else (-4, 6),  # beside the marker, or above it
            ha="left" if inside else "right",
            textcoords="offset points",
            va="center",
            color=colour,
            fontsize=6.5,
        )
    log_axis(axes, "x", powers=False)


def _short(name: str, letters: int) -> str:
    """Return the name of a row in two lines at most."""
    text = name.replace("wn of ", "ωn ").replace("zeta of ", "ζ ").replace("symmetric", "symm.")
    return in_lines(text, letters)


def _stations(placed: Placed) -> Explorable:
    """Return the criterion over the station for each kind of sensor, and along the path to the best set."""
    curves = []
    for k, kind in enumerate(dict.fromkeys(s.kind for s in placed.candidates)):
        spots = sorted((s for s in placed.candidates if s.kind == kind), key=lambda s: s.y_m)
        y, cost = np.array([s.y_m for s in spots]), np.array([placed.candidates[s] for s in spots])
        curves.append(Curve(name=kind, x=y, y=cost, colour=COLOURS[k % 6]))
        curves.append(Curve(name=f"{kind}, stations", x=y, y=cost, colour=COLOURS[k % 6], marker=marker_look(k)[1]))
    path = Curve(name="best set", x=np.arange(len(placed.path), dtype=float), y=np.array(placed.path))
    one = Panel(title="criterion, one sensor alone", x="station y, m (right wing positive)", curves=curves, log_y=True)
    more = Panel(title="criterion, the best set one by one", x="sensors placed", curves=[path], log_y=True)
    return Explorable([View(name="one sensor", panels=[one]), View(name="the best set", panels=[more])])


def _placement(placed: Placed, wide: bool) -> Figure:
    """Draw the criterion over the span for each kind, and along the path to the best set."""
    kinds = list(dict.fromkeys(s.kind for s in placed.candidates))
    top = legend_in(kinds, wide) + 0.3
    figure = new_figure(wide, top + (2.3 if wide else 4.9) + 0.55)
    if wide:
        left, right = grid(figure, top, [2.3], (1.6, 1.0), left_in=0.75, between_in=0.9)[0]
    else:
        (left,), (right,) = grid(figure, top, [2.1, 2.1], gap_in=0.7, left_in=0.75)
    legend(figure, _handles([f"{k}, filled: chosen" for k in kinds]))
    for i, kind in enumerate(kinds):
        spots = sorted((s for s in placed.candidates if s.kind == kind), key=lambda s: s.y_m)
        y, cost = [s.y_m for s in spots], [placed.candidates[s] for s in spots]
        left.plot(y, cost, color=COLOURS[i], linewidth=1.0)
        for x, c, s in zip(y, cost, spots, strict=True):
            face = COLOURS[i] if s in placed.spots else "white"
            left.plot([x], [c], marker=marker_look(i)[1], color=COLOURS[i], markerfacecolor=face, markersize=5)
    left.set_xlim(min(s.y_m for s in placed.candidates) - 0.1, max(s.y_m for s in placed.candidates) + 0.1)
    log_axis(left, "y", powers=False)
    label(left, "station y, m (right wing positive)", "criterion", "one sensor alone")
    steps = np.arange(len(placed.path))
    finite = np.isfinite(placed.path)
    right.plot(steps[finite], np.array(placed.path)[finite], color=INK, marker="o", markersize=3.5)
    for k, spot in enumerate(placed.spots, 1):
        if np.isfinite(placed.path[k]):
            short = f"{'a' if spot.kind == 'accelerometer' else 's'} {spot.y_m:+.1f}".replace("-", "−")
            right.annotate(
                short,
                (k, placed.path[k]),
                textcoords="offset points",
                xytext=(2, 6 if k % 2 else -12),
                fontsize=7.5,
                color=QUIET,
            )
    right.set_xlim(-0.3, len(placed.path) + 0.2)
    right.set_xticks(steps)
    lowest = min(c for c in placed.path if np.isfinite(c))
    right.set_ylim(bottom=0.6 * lowest)
    log_axis(right, "y", powers=False)
    label(right, "sensors placed", "", "the best set, one by one")
    return figure
