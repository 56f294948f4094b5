"""The one figure that shows a run's answer: how well each model predicts, and how well the input shows each mode."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.identification import estimator_name
from testbench.evaluation.excitation import EXCITED_DB
from testbench.page.labels import symbol
from testbench.page.plot import (
    COLOURS,
    FAINT,
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
)
from testbench.questions.run.labels import case_names, outputs_of
from testbench.questions.run.seeds_answer import words_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.questions.run.result import RunResult
    from testbench.questions.run.seeds import Repeats

_MOST_MODES, _ROW_IN, _TALLEST_IN, _LETTERS = 8, 0.3, 2.6, 24
_LETTERS_NARROW = 19  # of a mode's name in a line, beside the panel on a narrow screen
_RANGE_PERCENT = (0.1, 1000.0)  # a free run that diverges, or a copy of what was measured, is drawn at the edge


def answer_plates(result: RunResult) -> list[Plate]:
    """Return error per output and model and, if the truth is known, what the input shows of each mode; or nothing."""
    outputs, names = outputs_of(result.cases), case_names(result.cases)
    modes = [] if result.truth is None else sorted(result.truth.excitation, key=lambda e: abs(e.pole))[:_MOST_MODES]
    if not outputs:
        return []
    repeats = result.repeats
    rows_of = outputs if repeats is None else repeats.quantities
    if repeats is None:
        caption = (
            "Error of prediction on the validation data (MRSE): further left is better; 100 % (line) is no better than "
            "predicting zero. A point at the edge means 0.1 % or less, or 1000 % or more."
        )
    else:
        caption = (
            f"Mean error over {repeats.count} seeds with its 95 % interval (thick) and nine of ten seeds (thin): "
            "further left is better. Of a mode it is "
            "the distance of its pole from the true one, relative to that; a sign is missing where the mode was found "
            "in fewer than two seeds. The error of prediction is the MRSE on validation data."
        )
    if modes:
        caption += (
            " Modes: their response to the input over the noise of the sensor that shows them best, whose name is "
            f"given. Filled: excited, from {EXCITED_DB:g} dB (line) on."
        )

    def make(wide: bool) -> Figure:
        """Draw the two panels side by side or below each other."""
        rows = [len(rows_of), *([len(modes)] if modes else [])]
        tall = [min(_TALLEST_IN, 0.15 + r * row) for r, row in zip(rows, (_ROW_IN, 0.36), strict=False)]
        top = legend_in(names, wide) + 0.3
        if wide:
            tall = [max(tall)]
        figure = new_figure(wide, top + sum(tall) + 0.75 * (len(tall) - 1) + 0.5)
        columns = [1.0] * len(rows) if wide else [1.0]
        panels = grid(
            figure, top, tall, columns, gap_in=0.75, between_in=1.9, left_in=0.66 if wide and repeats is None else 1.35
        ).ravel()
        if repeats is None:
            _draw_errors(panels[0], result, outputs)
        else:
            _draw_intervals(panels[0], result, repeats, _LETTERS_NARROW)
        if modes:
            _draw_modes(panels[1], modes, _LETTERS if wide else _LETTERS_NARROW)
        legend(figure, _handles(names))
        return figure

    title = "Errors of the models" + (", and what the input shows of the modes" if modes else "")
    return [Plate("answer", title, caption, make)]


def _draw_errors(axes: Axes, result: RunResult, outputs: list[str]) -> None:
    """Draw one row per output, one sign per model, models of a row below each other."""
    count = len(result.cases)
    drawn = [200.0]
    for k, case in enumerate(result.cases):
        found = dict(zip(case.model.outputs, case.evaluation.validation.mrse_percent, strict=True))
        y = np.array([i + 0.6 * ((k + 0.5) / count - 0.5) for i, o in enumerate(outputs) if o in found])
        x = np.nan_to_num([float(found[o]) for o in outputs if o in found], nan=np.inf)
        colour, marker = marker_look(k)
        x = np.clip(x, *_RANGE_PERCENT)
        drawn += x.tolist()
        axes.plot(
            x, y, marker, color=colour, markersize=5.5, markerfacecolor="none",
            markeredgewidth=1.4, clip_on=False,
        )  # fmt: skip
    axes.set_xlim(10.0 ** np.floor(np.log10(min(drawn))), max(drawn))
    axes.axvline(100.0, color=QUIET, linewidth=1.0)
    log_axis(axes, "x", powers=False)
    _rows(axes, [symbol(o) for o in outputs])
    label(axes, "error, %", "", "Error in validation")


def _draw_intervals(axes: Axes, result: RunResult, repeats: Repeats, letters: int) -> None:
    """Draw one row per quantity: the mean error of each model over the seeds with its interval."""
    count, quantities, names = len(result.cases), repeats.quantities, case_names(result.cases)
    drawn: list[float] = []
    for k, case in enumerate(result.cases):
        colour, marker = marker_look(k)
        for i, quantity in enumerate(quantities):
            mean = repeats.mean((case.suite, estimator_name(case.estimator)), quantity)
            if mean is None:
                continue
            y, key = i + 0.6 * ((k + 0.5) / count - 0.5), (case.suite, estimator_name(case.estimator))
            for ends, width in ((repeats.most(key, quantity), 0.7), ((mean.low, mean.high), 2.4)):
                shown = np.clip(ends, *_RANGE_PERCENT)
                axes.plot(
                    shown, [y, y], color=colour, linewidth=width, solid_capstyle="butt", label=f"interval, {names[k]}"
                )
                drawn += shown.tolist()
            x = np.clip(mean.value, *_RANGE_PERCENT)
            axes.plot(x, y, marker, color=colour, markersize=5, markerfacecolor="white", markeredgewidth=1.4)
    axes.set_xlim(10.0 ** np.floor(np.log10(min(drawn))), 1.2 * max(drawn))
    log_axis(axes, "x", powers=False)
    words = (words_of(q).removeprefix("the ") for q in quantities)
    _rows(axes, [in_lines(w, letters) for w in words])
    label(axes, "error, %", "", f"Error over {repeats.count} seeds")


def _draw_modes(axes: Axes, modes: list[Any], letters: int) -> None:
    """Draw one row per mode: a line from the threshold to the response over noise of the sensor that shows it best."""
    best = [float(e.snr_db[e.best_sensor]) for e in modes]
    low, high = min(0.0, *best), max(2.0 * EXCITED_DB, *best)
    axes.set_xlim(low - 0.06 * (high - low), high + 0.2 * (high - low))
    for i, (e, value) in enumerate(zip(modes, best, strict=True)):
        axes.plot([EXCITED_DB, value], [i, i], color=COLOURS[0], linewidth=1.6, label=e.mode)
        inside = COLOURS[0] if e.excited else "white"
        axes.plot(value, i, "o", color=COLOURS[0], markersize=6, markerfacecolor=inside, label=e.mode)
        side = 1 if value >= EXCITED_DB else -1
        place = (value, i) if side > 0 else (EXCITED_DB, i)
        axes.annotate(symbol(e.best_sensor), place, (7, 0), textcoords="offset points", fontsize=8.0, va="center")
    axes.axvline(EXCITED_DB, color=QUIET, linewidth=1.0)
    _rows(axes, [in_lines(e.mode, letters) for e in modes])
    label(axes, "response over noise, dB", "", "Is the mode excited?")


def _rows(axes: Axes, names: list[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.45, -0.55)
    axes.grid(True, axis="y", color=FAINT)
    axes.tick_params(axis="y", length=0, labelcolor=INK)


def _handles(names: list[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    out = []
    for k, name in enumerate(names):
        colour, marker = marker_look(k)
        out.append(
            Line2D([], [], linestyle="none", marker=marker, color=colour, markersize=6, markerfacecolor="none",
                   markeredgewidth=1.4, label=name)
        )  # fmt: skip
    return out
