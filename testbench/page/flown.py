"""What flew the flights of an answer, batches or JSBSim, and why: one sentence and one table for all questions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.labels import number
from testbench.page.tables import Column, Table
from testbench.page.words import counted

if TYPE_CHECKING:
    from testbench.flight.batch.jobs import Tally


def flown_words(tally: Tally, one: str = "flight") -> str:
    """Return what flew, and why where JSBSim flew one by one; "" if nothing was flown.

    Args:
        tally: number of flights by what flew them.
        one: what is counted, "flight" or "run".
    """
    from testbench.flight.batch.jobs import BOTH  # help imports pages, and nothing that takes time

    parts = []
    if tally.batch:
        both = f"one flight in {BOTH} is flown by both"
        if tally.both:
            both += f", here {tally.both}, which differ by at most {number(tally.worst, 2)} of the range of a channel"
        parts.append(
            f"{counted(tally.batch, one)} flown in batches, by a translation of the model that agrees with JSBSim "
            f"({both})"
        )
    for reason, n in sorted(tally.reasons.items()):
        parts.append(f"{counted(n, one)} flown by JSBSim one by one" + (f", as {reason}" if reason else ""))
    return "; ".join(parts)


def flown_table(tally: Tally, one: str = "flight") -> Table:
    """Return the same as a table."""
    from testbench.flight.batch.jobs import BOTH

    columns = (Column("by", "flown by"), Column("count", f"{one}s"), Column("why", "why"))
    rows = [("batch", tally.batch, "the translated model agrees with JSBSim")] if tally.batch else []
    rows += [("JSBSim", n, reason) for reason, n in sorted(tally.reasons.items())]
    caption = f"One flight of a batch in {BOTH} is flown by both."
    if tally.both:
        caption += f" Here {tally.both}, which differ by at most {number(tally.worst, 2)} of the range of a channel."
    return Table("flown", "What flew", caption, columns, tuple(rows), wide=True)
