"""The page on the compatibility of recorded data; the corrected records lie beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from testbench.page.figure import COLOURS, MEASURED, Chart, Curve, Panel, Plate, rows_of
from testbench.page.labels import axis_label, file_stem, shown_unit, symbol
from testbench.page.page import COMPUTED, Page, source_of
from testbench.page.tables import Column, Table
from testbench.questions.compatibility.answer import compatibility_answer, with_rivals
from testbench.questions.compatibility.ask import Compared

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord
    from testbench.inference.instruments import Agreement, EveryError, Foretold
    from testbench.questions.identify.scenario import RecordDescription

Records = Mapping[str, "FlightRecord"]
_PER_PLATE = 3
_FEWEST = 5
_SHOWN = 0.01


def compatibility_page(
    found: Compared, records: Records, description: RecordDescription, questions: Sequence[str] = ()
) -> Page:
    """Return the page of a check of the instruments, with records/NAME_corrected.nc.

    ``questions`` are implausible values of the records, in words.
    """
    tables = [fault_table(found.agreed), *([] if found.every is None else error_tables(found.every))]
    return Page(
        kicker=f"Data compatibility: {description.name}",
        title=description.title,
        answer=[*compatibility_answer(found), *(("doubt", text) for text in questions)],
        tables=tables,
        plates=[] if found.every is None else foretold_plates(found.every, list(records)),
        files={f"records/{file_stem(n)}_corrected.nc": r.save for n, r in zip(records, found.corrected, strict=True)},
        packages=COMPUTED,
        source=source_of(description),
        terminal=tables[:1],
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def fault_table(agreed: Agreement) -> Table:
    """Return the single errors that would explain how the instruments differ, the most probable first."""
    rows = [f for k, f in enumerate(agreed.faults) if k < _FEWEST or f.probability > _SHOWN]
    return Table(
        "instrument_faults",
        "Which instrument to check",
        f"All agree: probability {agreed.p_agree:.3g}; no single error explains it: {agreed.p_unknown:.3g}. Estimate "
        "and its standard error are valid if there is that error and no other. Scale: relative excess of the reading; "
        "late and lag in s, place in m ahead of the centre of gravity, turned in rad.",
        (
            Column("instrument", "instrument"),
            Column("error", "error"),
            Column("probability", "probability", digits=3),
            Column("estimate", "estimate", digits=3),
            Column("standard_error", "± std", digits=2),
        ),
        tuple((f.channel, f.kind, f.probability, f.estimate, f.std) for f in rows),
    )


def error_tables(every: EveryError) -> list[Table]:
    """Return what each error is if all are sought at once, what the records do not tell, and what is left."""
    errors = Table(
        "instrument_errors",
        "Errors of the instruments, all estimated at once",
        "Scale: relative excess of the reading; late in s, biases in SI units; wind, north and east: where the air "
        "moves to, down first. Significance: size over its standard error. Significant ones are estimated as if all "
        "others were zero, those below included, and removed from the corrected records.",
        (
            Column("error", "error"),
            Column("estimate", "estimate", digits=4),
            Column("standard_error", "± std", digits=2),
            Column("significance", "significance", decimals=1),
            Column("named", "significant"),
            Column("words", "in words"),
        ),
        tuple(
            (n, x, s, abs(x) / s, n in every.found, with_rivals(every, n, x, s))
            for n, (x, s) in {**every.told, **every.found}.items()
        ),
        wide=True,
    )
    lost = Table(
        "not_identifiable",
        "Errors that these data do not determine",
        "Errors that the records do not distinguish from others, or do not determine to a third of their prior.",
        (Column("error", "error"), Column("standard_error", "± std", digits=2), Column("before", "before", digits=2)),
        tuple((n, *size) for n, size in every.lost.items()),
    )
    residuals = Table(
        "residuals",
        "Measured less predicted, root mean square",
        "Before: without corrections. After: with the significant errors. SI units and radians.",
        (Column("output", "output"), Column("before", "before", digits=3), Column("after", "after", digits=3)),
        tuple((symbol(c), *every.rms(c)) for c in every.foretold[0].measured),
    )
    return [table for table in (errors, residuals, lost) if table.rows]


# --- figures ----------------------------------------------------------------------------------------------------------


def foretold_plates(every: EveryError, names: Sequence[str]) -> list[Plate]:
    """Return every channel that others foretell, of every record; a few records to a figure."""
    chunks = rows_of(list(zip(names, every.foretold, strict=False)), _PER_PLATE)
    caption = (
        "Grey: measured. Blue: predicted by kinematics alone from the other instruments, with the errors that were "
        "found, about the mean of the measurement. The difference is noise, gusts, and errors that were not found."
    )
    out = []
    for k, parts in enumerate(chunks, 1):
        rows = [[_panel(c, name, told) for name, told in parts] for c in every.foretold[0].measured]
        name = f"rebuilt_{k}" if len(chunks) > 1 else "rebuilt"
        out.append(
            Plate(name, "Measured and predicted by kinematics", caption, Chart(rows, share_x=True, share_y=True))
        )
    return out


def _panel(channel: str, name: str, told: Foretold) -> Panel:
    factor = shown_unit(channel)[0]
    draws = [
        Curve(name="measured", x=told.t_s, y=factor * told.measured[channel], colour=MEASURED, width=1.2),
        Curve(name="foretold", x=told.t_s, y=factor * told.after[channel], colour=COLOURS[0], width=1.1),
    ]
    return Panel(
        draws=draws, title=name, x="t, s", y=axis_label(channel), tall_in=1.0, broad=max(float(told.t_s[-1]), 1.0)
    )
