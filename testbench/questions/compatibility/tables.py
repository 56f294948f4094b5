"""Tables on the compatibility of recorded data: errors tested, residuals before and after, what cannot be told."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.labels import symbol
from testbench.page.tables import Column, Table

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility
    from testbench.inference.instruments import Agreement


_FEWEST = 5
_SHOWN = 0.01


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
