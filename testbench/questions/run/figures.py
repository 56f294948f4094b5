"""The figures of a run: input and spectrum, time histories, singular values, Bode plots, pole maps.

Each function returns Plates; nothing is drawn before :meth:`testbench.page.plot.Plate.draw`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.evaluation.metrics import mrse_mean
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.plot import (
    COLOURS,
    FAINT,
    INK,
    MEASURED,
    QUIET,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    line_look,
    log_axis,
    new_figure,
    notes,
    rows_of,
    style,
    time_axis,
    widths,
)
from testbench.questions.run.answer_figures import answer_plates
from testbench.questions.run.explored import histories
from testbench.questions.run.frequency_figures import bode_plates, input_plates
from testbench.questions.run.labels import case_names, outputs_of
from testbench.questions.run.parameter_figures import parameter_plates
from testbench.questions.run.pole_figures import pole_plates

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.line import Case
    from testbench.questions.run.result import RunResult

__all__ = ["bode_plates", "history_plates", "input_plates", "plates", "pole_plates", "singular_value_plates", "style"]

_PER_PLATE = 3  # records side by side in one figure of time histories
_MOST_DRAWN = 9  # records of one use; a second for each would keep the reader of an hour's flight waiting
_STRETCHES = 200  # of a record in one panel: two points each are finer than print; the page explores the rest
_PANEL_STRETCHES = 1000  # of all curves in one panel
_REACH = 0.6  # a diverging prediction may widen the axis by this much of the measured range, on either side


def plates(result: RunResult) -> list[Plate]:
    """Return every figure for which ``result`` has data, in the order of the report."""
    return [
        *answer_plates(result),
        *input_plates(result),
        *history_plates(result),
        *parameter_plates(result),
        *singular_value_plates(result),
        *bode_plates(result),
        *pole_plates(result),
    ]


def history_plates(result: RunResult) -> list[Plate]:
    """Return measured and predicted outputs over time, identification beside validation, all cases overlaid."""
    if not result.cases:
        return []
    first = result.cases[0]
    kept = {use: _worst(first, use) for use in ("identification", "validation")}
    parts = [(use, i) for use, chosen in kept.items() for i in chosen]
    total = len(first.identification) + len(first.validation)
    chunks = rows_of(parts, _PER_PLATE)
    return [
        _history_plate(result, chunk, k if len(chunks) > 1 else 0, len(parts), total)
        for k, chunk in enumerate(chunks, 1)
    ]


def _worst(case: Case, use: str) -> list[int]:
    """Return which records of one use to draw, in their order: all, or of many those that are predicted worst."""
    records = getattr(case, use)
    if len(records) <= _MOST_DRAWN:
        return list(range(len(records)))
    names = list(case.model.outputs)
    predictions = getattr(case.evaluation, use).predictions
    errors = [mrse_mean(np.column_stack([r[n] for n in names]), y) for r, y in zip(records, predictions, strict=True)]
    return sorted(np.argsort(np.nan_to_num(errors, nan=np.inf))[-_MOST_DRAWN:].tolist())


def _history_plate(result: RunResult, parts: Sequence[tuple[str, int]], part: int, drawn: int, total: int) -> Plate:
    channels = [*result.cases[0].model.inputs, *outputs_of(result.cases)]
    records = [getattr(result.cases[0], use)[i] for use, i in parts]
    caption = (
        "Grey: measured, prepared for identification. Coloured: what each model predicts from the input alone, with "
        "its initial state fitted. The numbers above a panel are the MRSE over that data set, in the order of the "
        "legend: 0 % is perfect, 100 % is no better than predicting zero. The validation records took no part in the "
        "identification."
    )
    if drawn < total:
        caption += (
            f" Of {total} records {drawn} are drawn: of each use the {_MOST_DRAWN} that the first model predicts worst."
        )

    def make(wide: bool) -> Figure:
        """Draw one row of panels per channel, one column per record."""
        tall = [0.62 if name in result.cases[0].model.inputs else 1.05 for name in channels]
        names = [("measured", MEASURED)]
        top = legend_in(["measured", *case_names(result.cases)], wide) + 0.28
        gap = 0.26 if wide else 0.52
        heights = tall if wide else [h for h in tall for _ in parts]
        figure = new_figure(wide, top + sum(heights) + gap * (len(heights) - 1) + 0.5)
        panels = grid(figure, top, heights, widths(records) if wide else (1.0,), gap_in=gap, between_in=0.3)
        panels = panels.reshape(len(channels), len(parts))
        for r, name in enumerate(channels):
            last = r == len(channels) - 1
            for c, (use, i) in enumerate(parts):
                axes = panels[r, c]
                _draw_history(axes, result, name, use, i)
                title = _part_title(result, use, i) if r == 0 else "" if wide else use
                y = axis_label(name, result.source.preparation.bias != "none") if c == 0 or not wide else ""
                label(
                    axes, "t, s" if last and (wide or c == len(parts) - 1) else "", y, title, INK if r == 0 else QUIET
                )
                time_axis(axes)
                if wide and not last:
                    axes.tick_params(labelbottom=False)
                if wide and c > 0:
                    axes.tick_params(labelleft=False)
            _share_y(panels[r])
        legend(figure, line_handles(case_names(result.cases), names))
        return figure

    title = "Measured and predicted outputs" + (f", part {part}" if part else "")
    titles = [_part_title(result, use, i) for use, i in parts]
    explore = partial(histories, result, parts, channels, _REACH, titles)
    return Plate(f"time_histories_{part}" if part else "time_histories", title, caption, make, explore)


def _share_y(row: Iterable[Axes]) -> None:
    row = list(row)
    limits = np.array([axes.get_ylim() for axes in row])
    for axes in row:
        axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def _part_title(result: RunResult, use: str, i: int) -> str:
    flights = [f for f in result.flights if f.use == use] + [f for f in result.flights if f.use == "split"]
    return f"{use}: {flights[i].name}" if i < len(flights) else use


def _draw_history(axes: Axes, result: RunResult, name: str, use: str, i: int) -> None:
    """Draw one channel of one record: measured in grey, each case's prediction in its colour."""
    factor = shown_unit(name)[0]
    record: FlightRecord = next(getattr(c, use)[i] for c in result.cases if name in getattr(c, use)[i])
    measured = factor * record[name]
    low, high = float(measured.min()), float(measured.max())
    given = name in result.cases[0].model.inputs
    axes.plot(
        *envelope(record.t_s, measured, _STRETCHES), color=INK if given else MEASURED, linewidth=0.8 if given else 1.2
    )
    stretches = min(_STRETCHES, _PANEL_STRETCHES // (len(result.cases) + 1))
    shown = [low, high]
    texts: list[tuple[str, str]] = []
    reach = _REACH * max(high - low, 1e-12)
    for k, case in enumerate(result.cases):
        if name not in case.model.outputs:
            continue
        column = case.model.outputs.index(name)
        y = factor * getattr(case.evaluation, use).predictions[i][:, column]
        y = np.clip(y, low - 4.0 * reach, high + 4.0 * reach)  # of one that diverges, what leaves the panel is enough
        axes.plot(*envelope(getattr(case, use)[i].t_s, y, stretches), **line_look(k), linewidth=1.2)
        finite = y[np.isfinite(y)]
        shown += [max(float(finite.min(initial=low)), low - reach), min(float(finite.max(initial=high)), high + reach)]
        if i == 0:  # the figures are over all records of that use, so once
            texts.append((number(float(getattr(case.evaluation, use).mrse_percent[column])), COLOURS[k % 6]))
    pad = 0.08 * (max(shown) - min(shown) or 1.0)
    axes.set_ylim(min(shown) - pad, max(shown) + pad)
    if texts:
        notes(axes, [("MRSE, %", QUIET), *texts])


def singular_value_plates(result: RunResult) -> list[Plate]:
    """Return the singular values of every case that has them, with the chosen order."""
    found = [
        (k, name, np.asarray(case.model.diagnostics["singular_values"], float), case.model.diagnostics.get("order"))
        for k, (name, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True))
        if case.model.diagnostics.get("singular_values") is not None
    ]
    if not found:
        return []
    caption = (
        "Singular values from which the model order was chosen. Filled: kept; hollow: left out. Look for the step down "
        "to the noise floor at 1 (dotted). Values near that floor carry no information; hollow ones well above it say "
        "that the data hold more than the model."
    )

    def make(wide: bool) -> Figure:
        """Draw one panel per case."""
        columns = min(len(found), 3) if wide else 1
        rows = -(-len(found) // columns)
        figure = new_figure(wide, 0.42 + rows * 2.0 + (rows - 1) * 0.8 + 0.5)
        panels = grid(figure, 0.42, [2.0] * rows, [1.0] * columns, gap_in=0.8, between_in=0.25).ravel()
        for axes in panels[len(found) :]:
            axes.set_axis_off()
        for i, (axes, (k, name, values, order)) in enumerate(zip(panels, found, strict=False)):
            _draw_singular_values(axes, values[:20], int(order or 0), COLOURS[k % 6])
            y = "size over the noise floor" if i % columns == 0 else ""
            label(axes, "number of the singular value", y, f"{name}: order {order}" if order else name, lines=2)
            axes.tick_params(labelleft=i % columns == 0)
        _share_y(panels[: len(found)])
        return figure

    return [Plate("singular_values", "Singular values and model order", caption, make)]


def _draw_singular_values(axes: Axes, values: FloatArray, order: int, colour: str) -> None:
    from matplotlib.ticker import MaxNLocator

    values = values[values > 0.0]
    n = np.arange(1, values.size + 1)
    log_axis(axes, "y", powers=True)
    axes.vlines(n, 1e-3 * values.min(), values, color=FAINT, linewidth=0.8)
    for part, face in ((n <= order, colour), (n > order, "white")):
        axes.plot(n[part], values[part], "o", color=colour, markersize=5.5, markerfacecolor=face)
    axes.axhline(1.0, color=QUIET, linestyle=":", linewidth=1.0)
    axes.set_xlim(0.3, values.size + 0.7)
    axes.set_ylim(min(0.5, 0.5 * values.min()), 2.5 * values.max())
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7, integer=True, min_n_ticks=3))
