"""The figures of a campaign: estimates over true values, distributions of errors, and how the means settle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.figure import (
    COLOURS,
    DASHED,
    INK,
    INTERVAL,
    Area,
    Chart,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Span,
    Words,
    band,
    bars,
    grid,
)
from testbench.questions.campaign.answer import most_biased
from testbench.questions.campaign.result import errors
from testbench.questions.campaign.summary import short_name, truth_of
from testbench.questions.side_by_side import CALIBRATION, calibration_panel, points

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.campaign.summary import Summary

_MOST, _TALL_IN = 6, 1.75
_FEWEST = 3  # runs whose means make a line
_ROUNDED = 1e-9  # of their size: values that differ by no more are drawn as one


def campaign_plates(summary: Summary) -> list[Plate]:
    """Return the figures for which the runs have data, of at most six estimates; if there are none, why runs failed."""
    chosen, done = _chosen(summary), summary.done
    found = errors(summary)
    of_errors = {name: found[name][done] for name in chosen}
    if not of_errors:
        named = [f.name for f in summary.figures if f.n > 1 and "MRSE" in f.name][:_MOST]
        of_errors = {name: summary.columns[name][done] for name in named}
    of_errors = {name: values[np.isfinite(values)] for name, values in of_errors.items()}
    of_errors = {name: values for name, values in of_errors.items() if values.size}
    if not of_errors:
        return [_failure_plate(summary)] if summary.causes else []
    what = "estimate minus truth" if chosen else "value"
    plates = []
    if chosen:
        of = [_scatter(short_name(n, chosen), summary.columns[truth_of(n, summary.columns)][done],
                       summary.columns[n][done]) for n in chosen]  # fmt: skip
        caption = "One point per run, for at most 2000 runs. On the line the estimate equals the truth."
        plates.append(Plate("estimates", "Estimates over true values", caption, grid(of, 3)))
    caption = (
        f"Number of runs over {'' if chosen else 'the '}{what}. Dashed: the mean, with its 95 % confidence interval "
        f"shaded.{' The estimate is biased if zero (full line) lies outside that interval.' if chosen else ''}"
    )
    title = "Distribution of the errors" if chosen else "Distribution of the prediction errors"
    of = [_histogram(short_name(n, list(of_errors)), values, what, bool(chosen)) for n, values in of_errors.items()]
    plates.append(Plate("distributions", title, caption, grid(of, 3)))
    settling = {name: values for name, values in of_errors.items() if values.size >= _FEWEST}
    if settling:
        caption = (
            f"Mean of {what} over the first runs, in the order of their numbers, with its 95 % confidence interval."
        )
        of = [_settling(short_name(n, list(settling)), values) for n, values in settling.items()]
        plates.append(Plate("convergence", "How the means settle", caption, grid(of, 3)))
    stated = [a.name for a in summary.accuracies if np.isfinite(a.stated) and a.n > 2]
    of_stated = [name for name in chosen if name in stated] or stated[:_MOST]
    if of_stated:
        of = [
            calibration_panel(short_name(n, of_stated), found[n][done], summary.columns[f"{n}, std"][done])
            for n in of_stated
        ]
        plates.append(Plate("calibration", "Errors over stated errors", CALIBRATION, grid(of, 3)))
    return plates


def _failure_plate(summary: Summary) -> Plate:
    """Return the reasons of failure by number of runs, for a campaign that identified nothing."""
    causes = summary.causes[:_MOST]
    draws: list[Drawn] = [bars(np.arange(len(causes)) + 0.2, 0.0, [c.count for c in causes], 0.35)]
    draws += [Words(x=0.0, y=i - 0.05, text=f"{c.count}: {c.example}", up="bottom") for i, c in enumerate(causes)]
    panel = Panel(
        draws=draws, x="runs, of those that are finished", x_range=(0.0, float(summary.runs.size)), whole="x",
        y_ticks=[], y_range=(len(causes) - 0.55, -0.45), tall_in=0.5 * len(causes),
    )  # fmt: skip
    caption = (
        "Number of runs for each of the most frequent reasons of failure; numbers in a reason are those of the first "
        "run."
    )
    return Plate("failures", "Why runs failed", caption, Chart([[panel]]))


def _chosen(summary: Summary) -> list[str]:
    """Return up to six estimates: the most biased ones, of which the answer speaks, then those whose errors the method
    states, then those found most often.
    """
    have = [a for a in summary.accuracies if a.n > 1]
    ranked = sorted(have, key=lambda a: (not np.isfinite(a.stated), a.missing))
    names = dict.fromkeys(a.name for a in (*most_biased(summary), *ranked))
    return sorted(list(names)[:_MOST])


def _scatter(name: str, true: FloatArray, found: FloatArray) -> Panel:
    have = np.isfinite(true) & np.isfinite(found)
    true, found = true[have], found[have]
    low, high = float(true.min()), float(true.max())
    margin = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    ends = (low - margin, high + margin)
    draws: list[Drawn] = [Curve(x=ends, y=ends, width=0.9), points(true, found)]
    return Panel(draws=draws, title=name, x="true value", y="estimate", x_range=ends, tall_in=_TALL_IN)


def _histogram(name: str, values: FloatArray, what: str, zero: bool) -> Panel:
    low, high = float(values.min()), float(values.max())
    size, count = max(abs(low), abs(high)), int(np.clip(round(2.0 * values.size ** (1.0 / 3.0)), 5, 60))  # Rice's rule
    if high - low <= _ROUNDED * size:  # no bins fit between values that rounding alone tells apart
        room = 0.05 * size or 0.5
        low, high, count = low - room, high + room, 1
    runs, edges = np.histogram(values, bins=count, range=(low, high))
    tall = [([a, b, b, a], [0.0, 0.0, n, n]) for a, b, n in zip(edges[:-1], edges[1:], runs, strict=True)]
    mean, half = float(np.mean(values)), _half(values)
    draws: list[Drawn] = [
        Area(outlines=tall),
        Span(low=mean - half, high=mean + half, colour=COLOURS[1], alpha=0.25),
        Rule(at=mean, colour=COLOURS[1], dash=DASHED, width=1.3),
        *([Rule(at=0.0, colour=INK)] if zero else []),
    ]
    ends = [low, high, mean - half, mean + half, *([0.0] if zero else [])]
    room = 0.06 * (max(ends) - min(ends))  # zero stands off the axis, where it could not be seen
    return Panel(
        draws=draws, title=name, x=what, y="runs", whole="y", tall_in=_TALL_IN,
        x_range=(min(ends) - room, max(ends) + room), y_range=(0.0, 1.05 * float(runs.max())),
    )  # fmt: skip


def _half(values: FloatArray) -> float:
    return float(INTERVAL * np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0


def _settling(name: str, values: FloatArray) -> Panel:
    n = np.arange(1, values.size + 1)
    shift = float(values[0])  # sums of squares about a value of their own size lose no digits
    mean = np.cumsum(values - shift) / n
    squares = np.maximum(np.cumsum((values - shift) ** 2) / n - mean**2, 0.0)
    half = INTERVAL * np.sqrt(squares / np.maximum(n - 1, 1))
    first = min(4, (n.size - 1) // 2)  # intervals of the first few runs would set the scale
    show = np.unique(np.linspace(first, n.size - 1, min(n.size, 400)).astype(int))
    draws: list[Drawn] = [
        band(n[show], (shift + mean - half)[show], (shift + mean + half)[show], alpha=0.5),
        Curve(x=n[show], y=(shift + mean)[show], colour=COLOURS[0]),
        Rule(at=shift + float(mean[-1]), of="y", width=0.7, dash=DASHED),
    ]
    return Panel(draws=draws, title=name, x="runs", y="mean", whole="x", tall_in=_TALL_IN)
