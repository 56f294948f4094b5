"""The report on the compatibility of recorded data: which instruments err, by how much, and the records without it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.labels import axis_label, file_stem, shown_unit, symbol
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
from testbench.page.tables import Column, Table
from testbench.page.write import PAGE, write_file, write_plates, write_tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from testbench.core.record import FlightRecord
    from testbench.estimators.data_compatibility import DataCompatibility
    from testbench.questions.identify.scenario import RecordDescription

Records = Mapping[str, "FlightRecord"]
_PER_PLATE = 3


def compatibility_answer(result: DataCompatibility) -> list[str]:
    """Return what was found, in sentences."""
    out = []
    if result.errors:
        out.append("the instruments do not agree: " + "; ".join(e.words for e in result.errors))
    else:
        out.append("the instruments agree with each other: no error stands out of what noise alone would show")
    for e in result.errors:
        if e.alternatives:
            out.append(f"instead of '{e.words}' these data would bear as well: {'; '.join(e.alternatives)}")
    return [*out, *result.advice]


def compatibility_tables(result: DataCompatibility) -> list[Table]:
    """Return the errors that were tested, what the data do not tell, and the residuals before and after."""
    found = {e.name for e in result.errors}
    best = {e.name: e for e in (*result.tested, *result.errors)}
    errors = Table(
        "instrument_errors",
        "Errors of the instruments",
        "An instrument reads scale times the true value of delay seconds ago, plus bias; wind is where the air moves "
        "to. Significance: deviation from no error over its standard error. SI units and radians.",
        (
            Column("error", "error"),
            Column("estimate", "estimate", digits=4),
            Column("standard_error", "± std", digits=2),
            Column("significance", "significance", decimals=1),
            Column("named", "significant"),
            Column("words", "in words"),
        ),
        tuple((e.name, e.estimate, e.standard_error, e.significance, n in found, e.words) for n, e in best.items()),
        wide=True,
    )
    residuals = Table(
        "residuals",
        "Measured less rebuilt, root mean square",
        "Before: no error allowed for. After: with the significant ones. SI units and radians.",
        (Column("output", "output"), Column("before", "before", digits=3), Column("after", "after", digits=3)),
        tuple((symbol(o), result.residual_before[o], result.residual_after[o]) for o in result.structure.outputs),
    )
    lost = Table(
        "not_identifiable",
        "What these data do not tell",
        "Errors that were set aside: nothing is said about them.",
        (Column("error", "error"), Column("reason", "reason")),
        tuple(result.not_identifiable.items()),
        wide=True,
    )
    return [table for table in (errors, residuals, lost) if table.rows]


def write_compatibility(
    result: DataCompatibility, records: Records, description: RecordDescription, folder: Path | str
) -> list[Path]:
    """Write tables, figures, records/NAME_corrected.nc and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.estimators.data_compatibility import correct
    from testbench.page.html import render

    folder = Path(folder)
    tables = compatibility_tables(result)
    out = write_tables(tables, folder)
    for name, record in records.items():
        path = folder / "records" / f"{file_stem(name)}_corrected.nc"
        correct(record, result).save(path)
        out.append(path)
    paths, pictures = write_plates(_plates(result, records), folder)
    out += paths
    page = render(
        "analysis.html.j2",
        kicker=f"Data compatibility: {description.name}",
        title=description.title,
        answer=compatibility_answer(result),
        pictures=pictures,
        tables=tables,
        source_name=description.file.name if description.file else "as given",
        source_text=description.file.read_text(encoding="utf-8") if description.file else "",
    )
    out.append(write_file(folder / PAGE, page))
    return out


def print_compatibility(result: DataCompatibility, console: Console, folder: Path | str) -> None:
    """Print the answer, the errors, and where the files are."""
    from rich.table import Table as Grid
    from rich.text import Text

    answer = Grid.grid(padding=(0, 1))
    for k, sentence in enumerate(compatibility_answer(result)):
        answer.add_row("-", Text(sentence[:1].upper() + sentence[1:] + ".", style="bold" if k == 0 else "yellow"))
    console.print(answer)
    table = compatibility_tables(result)[0]
    grid_ = Grid(title=table.title, title_justify="left", title_style="", box=None, pad_edge=False)
    for column in table.columns[:5]:
        grid_.add_column(column.head, justify="left" if column.key in ("error", "named") else "right")
    for row in table.cells():
        grid_.add_row(*(Text(text) for text, _ in row[:5]))
    console.print()
    console.print(grid_)
    console.print()
    console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)


def _plates(result: DataCompatibility, records: Records) -> list[Plate]:
    chunks = rows_of(list(zip(records, result.reconstructed, strict=True)), _PER_PLATE)
    return [_plate(result, records, chunk, k if len(chunks) > 1 else 0) for k, chunk in enumerate(chunks, 1)]


def _plate(result: DataCompatibility, records: Records, parts: list[tuple[str, FlightRecord]], number: int) -> Plate:
    outputs = result.structure.outputs
    caption = (
        "Grey: measured. Blue: rebuilt from the corrected rates and accelerations by the kinematics alone, as a "
        "perfect instrument would have read it. What stands between them is the instrument's error, and noise."
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
