"""Figures of a comparison: errors with intervals suite by suite, what information predicts, stations on the wing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from testbench.page.explore import View
from testbench.page.figure import QUIET, Chart, Curve, Drawn, Panel, Plate, Words, grid, marker_look, rows
from testbench.page.labels import symbol

if TYPE_CHECKING:
    from testbench.questions.compare.placement import Placed
    from testbench.questions.compare.result import CompareResult

_ROW_IN = 0.3
_DOT_IN = 0.13  # so that a count stands in the line of its own interval, clear of the next
_NOTE_ROOM = 0.55  # share of an axis' end beyond which a note stands above its interval
_ROOM = 0.6  # share of the smallest value that an axis begins at
_KINDS = ("prediction", "mode", "parameter")
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
                _chart(_error_panels(result), suites),
            )
        )
    else:
        out.append(
            Plate(
                "information",
                "Standard errors by information",
                "Cramér-Rao bound through each suite, percent; damping ratios in hundredths. Nothing was flown. "
                "Quantities whose true value is near zero are in the table.",
                _chart(_information_panels(result), suites),
            )
        )
    if result.placed is not None:
        panels = _placement(result.placed)
        out.append(
            Plate(
                "placement",
                "Where sensors along the wing tell most",
                "Left: the criterion that one added sensor reaches, over its station; lower is better, and filled "
                "signs are the stations of the best set. Right: the criterion as the sensors of the best set are added "
                "one by one.",
                Chart([panels]),
                lambda: [View(name=p.title, panels=[p]) for p in panels],
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


def _chart(panels: dict[str, list[Dot]], suites: Sequence[str]) -> Chart:
    """Return one panel per title: rows of quantities, a sign per suite."""
    return grid([_dots(title, dots, suites) for title, dots in panels.items()], min(2, len(panels)))


def _dots(title: str, dots: Sequence[Dot], suites: Sequence[str]) -> Panel:
    names = list(dict.fromkeys(d.row for d in dots))
    drawn = [d for d in dots if np.isfinite(d.value)]
    floor = _ROOM * min(d.value for d in drawn)
    end = min(1.4 * max(d.high for d in drawn), 3.0 * max(d.value for d in drawn))
    step = 0.7 / max(len(suites), 1)
    draws: list[Drawn] = []
    for d in dots:
        y = names.index(d.row) + step * (d.suite - 0.5 * (len(suites) - 1)) + (0.12 * step if d.predicted else 0.0)
        look = marker_look(d.suite)
        x = d.value if np.isfinite(d.value) else floor  # found too seldom for an error
        if d.high > d.low:
            draws.append(Curve(x=[max(d.low, floor), d.high], y=[y, y], colour=look["colour"], width=1.2))
        if np.isfinite(d.value):
            hollow = "white" if d.predicted else False
            name = suites[d.suite] if not d.predicted or all(e.predicted for e in dots) else ""
            draws.append(Curve(x=[x], y=[y], name=name, **look, size=4.5, hollow=hollow, order=3.0))
        if d.note:
            at = min(max(d.high, x) if np.isfinite(d.value) else floor, end)
            beside = at < _NOTE_ROOM * end  # the marker, else above it
            draws.append(Words(x=at, y=y, text=d.note, shift=(6, 0) if beside else (-4, 6), size=6.5,
                               across="left" if beside else "right", colour=look["colour"]))  # fmt: skip
    row_in = max(_ROW_IN, _DOT_IN * len(suites) + 0.1)
    short = [n.replace("wn of ", "ωn ").replace("zeta of ", "ζ ").replace("symmetric", "symm.") for n in names]
    return Panel(
        draws=draws, title=title, x="error, % (ζ: hundredths)", log_x=True, x_range=(floor, end), **rows(short, row_in)
    )


def _placement(placed: Placed) -> list[Panel]:
    """Return the criterion over the span for each kind, and along the path to the best set."""
    draws: list[Drawn] = []
    for k, kind in enumerate(dict.fromkeys(s.kind for s in placed.candidates)):
        spots = sorted((s for s in placed.candidates if s.kind == kind), key=lambda s: s.y_m)
        y, cost = np.array([s.y_m for s in spots]), np.array([placed.candidates[s] for s in spots])
        best, look = np.array([s in placed.spots for s in spots]), marker_look(k)
        draws.append(Curve(x=y, y=cost, name=kind, colour=look["colour"], width=1.0))
        for these, name, hollow in ((best, f"{kind}, chosen", False), (~best, f"{kind}, stations", "white")):
            draws.append(Curve(x=y[these], y=cost[these], name=name, **look, hollow=hollow, order=3.0))
    finite = np.isfinite(placed.path)
    steps, path = np.arange(len(placed.path)), np.array(placed.path)
    way: list[Drawn] = [Curve(x=steps[finite], y=path[finite], marker="o", size=3.5, joined=True)]
    for k, spot in enumerate(placed.spots, 1):
        if finite[k]:
            short = f"{'a' if spot.kind == 'accelerometer' else 's'} {spot.y_m:+.1f}".replace("-", "−")
            way.append(Words(x=k, y=path[k], text=short, shift=(2, 6 if k % 2 else -12), size=7.5, colour=QUIET))
    stations = [s.y_m for s in placed.candidates]
    return [
        Panel(
            draws=draws, title="one sensor alone", x="station y, m (right wing positive)", y="criterion", log_y=True,
            x_range=(min(stations) - 0.1, max(stations) + 0.1), tall_in=2.3, broad=1.6,
        ),
        Panel(
            draws=way, title="the best set, one by one", x="sensors placed", name="criterion", log_y=True, whole="x",
            x_range=(-0.3, len(placed.path) + 0.2), y_range=(0.6 * float(path[finite].min()), None), tall_in=2.3,
        ),
    ]  # fmt: skip
