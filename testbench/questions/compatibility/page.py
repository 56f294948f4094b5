"""The page on the compatibility of recorded data; the corrected records lie beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from testbench.page.figure import COLOURS, MEASURED, Chart, Curve, Panel, Plate, rows_of, widths
from testbench.page.labels import axis_label, file_stem, shown_unit, symbol
from testbench.page.page import COMPUTED, Page, source_of
from testbench.page.tables import Column, Table
from testbench.page.words import Line, sentence
from testbench.questions.compatibility.answer import compatibility_answer
from testbench.questions.identify.instruments import agreement_in_words

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord
    from testbench.estimators.data_compatibility import DataCompatibility
    from testbench.inference.instruments import Agreement
    from testbench.questions.identify.scenario import RecordDescription

Records = Mapping[str, "FlightRecord"]
_PER_PLATE = 3
_FEWEST = 5
_SHOWN = 0.01


def compatibility_page(
    result: DataCompatibility | None,
    records: Records,
    description: RecordDescription,
    questions: Sequence[str] = (),
    agreed: Agreement | None = None,
) -> Page:
    """Return the page of a check of the instruments, with records/NAME_corrected.nc.

    ``result`` is None where the records hold too few channels for every error to be estimated. ``questions`` are values
    of the records that are hardly meant, in words. ``agreed`` says which instrument to look at first.
    """
    from testbench.estimators.data_compatibility import correct

    tables = [
        *([] if agreed is None else [fault_table(agreed)]),
        *([] if result is None else compatibility_tables(result)),
    ]
    lines = [] if result is None else compatibility_answer(result)
    if agreed is not None:
        first = [Line("finding" if k else "lead", sentence(text)) for k, text in enumerate(agreement_in_words(agreed))]
        more = [line._replace(kind="finding") if line.kind == "lead" else line for line in lines]
        lines = [*first, *([] if agreed.contradicted else more)]  # errors that are all sought at once share a large one
    return Page(
        kicker=f"Data compatibility: {description.name}",
        title=description.title,
        answer=[*lines, *(("doubt", text) for text in questions)],
        tables=tables,
        plates=[] if result is None else compatibility_plates(result, records),
        files={}
        if result is None
        else {f"records/{file_stem(n)}_corrected.nc": correct(r, result).save for n, r in records.items()},
        packages=COMPUTED,
        source=source_of(description),
        terminal=[t.without("words") for t in tables[:1]],
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def fault_table(agreed: Agreement) -> Table:
    """Return the single errors that would explain how the instruments differ, the most probable first."""
    rows = [f for k, f in enumerate(agreed.faults) if k < _FEWEST or f.probability > _SHOWN]
    return Table(
        "instrument_faults",
        "Which instrument to look at",
        f"All agree: probability {agreed.p_agree:.3g}; no single error explains it: {agreed.p_unknown:.3g}. "
        "Estimate and its standard error hold if that error, and no other, is there. Scale: share read too much; late "
        "and lag in s, place in m ahead of the centre of gravity, turned in rad.",
        (
            Column("instrument", "instrument"),
            Column("error", "error"),
            Column("probability", "probability", digits=3),
            Column("estimate", "estimate", digits=3),
            Column("standard_error", "± std", digits=2),
        ),
        tuple((f.channel, f.kind, f.probability, f.estimate, f.std) for f in rows),
    )


def compatibility_tables(result: DataCompatibility) -> list[Table]:
    """Return the errors that were tested, what the data do not tell, and the residuals before and after."""
    found = {e.name for e in result.errors}
    best = {e.name: e for e in (*result.tested, *result.errors)}
    errors = Table(
        "instrument_errors",
        "Errors of the instruments",
        "Reading = scale times the true value, delay seconds late, plus bias. Wind: where the air moves to. "
        "Significance: deviation from no error over its standard error. SI units and radians.",
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
        "Before: without corrections. After: with the significant errors corrected. SI units and radians.",
        (Column("output", "output"), Column("before", "before", digits=3), Column("after", "after", digits=3)),
        tuple((symbol(o), result.residual_before[o], result.residual_after[o]) for o in result.structure.outputs),
    )
    lost = Table(
        "not_identifiable",
        "What these data do not tell",
        "Errors that these data cannot decide; they were left out of the search.",
        (Column("error", "error"), Column("reason", "reason")),
        tuple(result.not_identifiable.items()),
        wide=True,
    )
    return [table for table in (errors, residuals, lost) if table.rows]


# --- figures ----------------------------------------------------------------------------------------------------------


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
