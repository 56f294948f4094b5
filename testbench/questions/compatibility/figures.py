"""Measured channels, and the same rebuilt from the corrected rates and accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from testbench.page.labels import axis_label, shown_unit
from testbench.page.plot import (
    COLOURS,
    INK,
    MEASURED,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    new_figure,
    rows_of,
    time_axis,
    widths,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.core.record import FlightRecord
    from testbench.estimators.data_compatibility import DataCompatibility

Records = Mapping[str, "FlightRecord"]
_PER_PLATE = 3


def compatibility_plates(result: DataCompatibility, records: Records) -> list[Plate]:
    """Return every channel of every record, measured and rebuilt; a few records to a figure."""
    chunks = rows_of(list(zip(records, result.reconstructed, strict=True)), _PER_PLATE)
    return [_plate(result, records, chunk, k if len(chunks) > 1 else 0) for k, chunk in enumerate(chunks, 1)]


def _plate(result: DataCompatibility, records: Records, parts: list[tuple[str, FlightRecord]], number: int) -> Plate:
    outputs = result.structure.outputs
    caption = (
        "Grey: measured. Blue: rebuilt from the corrected rates and accelerations by the kinematics alone, as a "
        "perfect instrument would have read it. The difference is the instrument's error and noise."
    )

    def make(wide: bool) -> Figure:
        """Draw one row of panels per output, one column per record."""
        names = [("measured", MEASURED), ("rebuilt", COLOURS[0])]
        top = legend_in([n for n, _ in names], wide) + 0.28
        tall = [1.0] * len(outputs) * (1 if wide else len(parts))
        gap = 0.26 if wide else 0.5
        figure = new_figure(wide, top + sum(tall) + gap * (len(tall) - 1) + 0.5)
        panels = grid(figure, top, tall, widths([r for _, r in parts]) if wide else (1.0,), gap_in=gap, between_in=0.4)
        panels = panels.reshape(len(outputs), len(parts))
        for r, output in enumerate(outputs):
            factor = shown_unit(output)[0]
            for c, (name, rebuilt) in enumerate(parts):
                axes, measured = panels[r, c], records[name]
                axes.plot(*envelope(measured.t_s, factor * measured[output]), color=MEASURED, linewidth=1.2)
                axes.plot(*envelope(rebuilt.t_s, factor * rebuilt[output]), color=COLOURS[0], linewidth=1.1)
                last = r == len(outputs) - 1 or not wide
                title = name if r == 0 or not wide else ""
                label(axes, "t, s" if last else "", axis_label(output, False) if c == 0 or not wide else "", title, INK)
                time_axis(axes)
        legend(figure, line_handles([], names))
        return figure

    suffix = f"_{number}" if number else ""
    return Plate(f"rebuilt{suffix}", "Measured and rebuilt by the kinematics", caption, make)
