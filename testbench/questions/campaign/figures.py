"""The figures of a campaign: estimates over true values, distributions of errors, and how the means settle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.plot import COLOURS, INK, MEASURED, QUIET, Plate, grid, label, new_figure
from testbench.questions.campaign.answer import most_biased
from testbench.questions.campaign.result import errors
from testbench.questions.campaign.summary import short_name
from testbench.questions.side_by_side import CALIBRATION, LEFT_IN, draw_calibration, panel_each, point_size

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FloatArray
    from testbench.questions.campaign.summary import Summary

_MOST, _POINTS = 6, 2000
_FEWEST = 3  # runs whose means make a line
_ROUNDED = 1e-9  # of their size: values that differ by no more are drawn as one


def campaign_plates(summary: Summary) -> list[Plate]:
    """Return the figures for which the runs have data, of at most six estimates; if there are none, why runs failed."""
    chosen = _chosen(summary)
    found = errors(summary)
    of_errors = {name: found[name][summary.done] for name in chosen}
    if not of_errors:
        named = [f.name for f in summary.figures if f.n > 1 and "MRSE" in f.name][:_MOST]
        of_errors = {name: summary.columns[name][summary.done] for name in named}
    of_errors = {name: values[np.isfinite(values)] for name, values in of_errors.items()}
    if not any(values.size for values in of_errors.values()):
        return [_failure_plate(summary)] if summary.causes else []
    of_errors = {name: values for name, values in of_errors.items() if values.size}
    what = "estimate minus truth" if chosen else "value"
    plates = [
        Plate(
            "distributions",
            "Distribution of the errors" if chosen else "Distribution of the prediction errors",
            "Number of runs over " + what + ". Dashed: the mean, with its 95 % confidence interval shaded. The "
            "estimate is biased if zero (full line) lies outside that interval."
            if chosen
            else "Number of runs over the value. Dashed: the mean, with its 95 % confidence interval shaded.",
            _panels(list(of_errors), lambda axes, name: _histogram(axes, of_errors[name], bool(chosen)), what, "runs"),
        ),
    ]
    settling = {name: values for name, values in of_errors.items() if values.size >= _FEWEST}
    if settling:
        plates.append(
            Plate(
                "convergence",
                "How the means settle",
                f"Mean of {what} over the first runs, in the order of their numbers, with its 95 % confidence "
                "interval.",
                _panels(list(settling), lambda axes, name: _settling(axes, settling[name]), "runs", "mean"),
            )
        )
    stated = [a.name for a in summary.accuracies if np.isfinite(a.stated) and a.n > 2]
    of_stated = [name for name in chosen if name in stated] or stated[:_MOST]
    if of_stated:
        plates.append(
            Plate(
                "calibration",
                "Errors over stated errors",
                CALIBRATION,
                _panels(of_stated, lambda axes, name: _calibration(axes, summary, name), "normal", "error / stated"),
            )
        )
    if chosen:
        plates.insert(
            0,
            Plate(
                "estimates",
                "Estimates over true values",
                f"One point per run, for at most {_POINTS} runs. On the line the estimate equals the truth.",
                _panels(chosen, lambda axes, name: _scatter(axes, summary, name), "true value", "estimate"),
            ),
        )
    return plates


def _failure_plate(summary: Summary) -> Plate:
    """Return the reasons of failure by number of runs, for a campaign that identified nothing."""
    causes = summary.causes[:_MOST]

    def make(wide: bool) -> Figure:
        """Draw one bar per reason, the reason above it."""
        from matplotlib.ticker import MaxNLocator

        figure = new_figure(wide, 0.3 + 0.5 * len(causes) + 0.5)
        axes = grid(figure, 0.2, [0.5 * len(causes)], left_in=0.2)[0, 0]
        letters = 110 if wide else 50
        for i, cause in enumerate(causes):
            axes.barh(i + 0.2, cause.count, height=0.35, color=MEASURED)
            text = f"{cause.count}: {cause.example}"
            text = text if len(text) <= letters else text[: letters - 1] + "…"
            axes.text(0.0, i - 0.05, text, fontsize=8, color=INK, va="bottom", parse_math=False)
        axes.set_yticks([])
        axes.set_ylim(len(causes) - 0.55, -0.45)
        axes.set_xlim(0.0, summary.runs.size)
        axes.grid(axis="y", visible=False)
        axes.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
        label(axes, "runs, of those that are finished")
        return figure

    caption = (
        "Number of runs for each of the most frequent reasons of failure; numbers in a reason are those of the first "
        "run."
    )
    return Plate("failures", "Why runs failed", caption, make)


def _chosen(summary: Summary) -> list[str]:
    """Return up to six estimates: the most biased ones, of which the answer speaks, then those whose errors the method
    states, then those found most often.
    """
    have = [a for a in summary.accuracies if a.n > 1]
    ranked = sorted(have, key=lambda a: (not np.isfinite(a.stated), a.missing))
    names = dict.fromkeys(a.name for a in (*most_biased(summary), *ranked))
    return sorted(list(names)[:_MOST])


def _panels(names: list[str], draw: Callable[[Axes, str], None], x: str, y: str) -> Callable[[bool], Figure]:
    def drawn(axes: Axes, name: str, first: bool) -> None:
        draw(axes, name)
        _few_ticks(axes, whole_x=x == "runs", whole_y=y == "runs")
        label(axes, x, y if first else "", short_name(name, names), lines=2, y_in=LEFT_IN - 0.16)

    return panel_each(names, drawn)


def _few_ticks(axes: Any, whole_x: bool, whole_y: bool) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=whole_x))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=whole_y))


def _scatter(axes: Axes, summary: Summary, name: str) -> None:
    from testbench.questions.campaign.summary import truth_of

    true = summary.columns[truth_of(name, summary.columns)][summary.done]
    found = summary.columns[name][summary.done]
    have = np.isfinite(true) & np.isfinite(found)
    true, found = true[have], found[have]
    every, size = max(1, true.size // _POINTS), point_size(true.size)
    low, high = float(true.min()), float(true.max())
    margin = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    axes.plot([low - margin, high + margin], [low - margin, high + margin], color=INK, linewidth=0.9)
    axes.plot(true[::every], found[::every], ".", color=COLOURS[0], markersize=size, alpha=0.6)
    axes.set_xlim(low - margin, high + margin)


def _calibration(axes: Axes, summary: Summary, name: str) -> None:
    draw_calibration(axes, errors(summary)[name][summary.done], summary.columns[f"{name}, std"][summary.done])


def _histogram(axes: Axes, values: FloatArray, zero: bool) -> None:
    low, high = float(values.min()), float(values.max())
    size, bins = max(abs(low), abs(high)), int(np.clip(round(2.0 * values.size ** (1.0 / 3.0)), 5, 60))  # Rice's rule
    if high - low <= _ROUNDED * size:  # no bins fit between values that rounding alone tells apart
        low, high, bins = low - 0.05 * size, high + 0.05 * size, 1
    axes.hist(values, bins=bins, range=(low, high), color=MEASURED)
    mean, half = float(np.mean(values)), _half(values)
    axes.axvspan(mean - half, mean + half, color=COLOURS[1], alpha=0.25, linewidth=0)
    axes.axvline(mean, color=COLOURS[1], linestyle=(0, (4, 2)), linewidth=1.3)
    if zero:
        axes.axvline(0.0, color=INK, linewidth=0.9)
        axes.margins(x=0.06)  # off the axis, where it could not be seen


def _half(values: FloatArray) -> float:
    return float(1.96 * np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0


def _settling(axes: Axes, values: FloatArray) -> None:
    n = np.arange(1, values.size + 1)
    shift = float(values[0])  # sums of squares about a value of their own size lose no digits
    mean = np.cumsum(values - shift) / n
    squares = np.maximum(np.cumsum((values - shift) ** 2) / n - mean**2, 0.0)
    half = 1.96 * np.sqrt(squares / np.maximum(n - 1, 1))
    first = min(4, (n.size - 1) // 2)  # intervals of the first few runs would set the scale
    show = np.unique(np.linspace(first, n.size - 1, min(n.size, 400)).astype(int))
    axes.fill_between(
        n[show], (shift + mean - half)[show], (shift + mean + half)[show], color=MEASURED, alpha=0.5, linewidth=0
    )
    axes.plot(n[show], (shift + mean)[show], color=COLOURS[0])
    axes.axhline(shift + float(mean[-1]), color=QUIET, linewidth=0.7, linestyle=(0, (4, 2)))
