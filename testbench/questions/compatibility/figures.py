"""Measured channels, and the same rebuilt from the corrected rates and accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from testbench.page.figure import COLOURS, MEASURED, Chart, Curve, Panel, Plate, rows_of, widths
from testbench.page.labels import axis_label, shown_unit

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord
    from testbench.estimators.data_compatibility import DataCompatibility

Records = Mapping[str, "FlightRecord"]
_PER_PLATE = 3


def compatibility_plates(result: DataCompatibility, records: Records) -> list[Plate]:
    """Return every channel of every record, measured and rebuilt; a few records to a figure."""
    chunks = rows_of(list(zip(records, result.reconstructed, strict=True)), _PER_PLATE)
    return [_plate(result, records, chunk, k if len(chunks) > 1 else 0) for k, chunk in enumerate(chunks, 1)]


def _plate(result: DataCompatibility, records: Records, parts: list[tuple[str, FlightRecord]], number: int) -> Plate:
    caption = (
        "Grey: measured. Blue: rebuilt from the corrected rates and accelerations by the kinematics alone, as a "
        "perfect instrument would have read it. The difference is the instrument's error and noise."
    )
    rows = [
        [
            _panel(output, name, records[name], rebuilt, wide)
            for (name, rebuilt), wide in zip(parts, widths([r for _, r in parts]), strict=True)
        ]
        for output in result.structure.outputs
    ]
    chart = Chart(rows, share_x=True, share_y=True)
    return Plate(f"rebuilt_{number}" if number else "rebuilt", "Measured and rebuilt by the kinematics", caption, chart)


def _panel(output: str, name: str, measured: FlightRecord, rebuilt: FlightRecord, broad: float) -> Panel:
    factor = shown_unit(output)[0]
    draws = [
        Curve(name="measured", x=measured.t_s, y=factor * measured[output], colour=MEASURED, width=1.2),
        Curve(name="rebuilt", x=rebuilt.t_s, y=factor * rebuilt[output], colour=COLOURS[0], width=1.1),
    ]
    return Panel(draws=draws, title=name, x="t, s", y=axis_label(output), tall_in=1.0, broad=broad)
