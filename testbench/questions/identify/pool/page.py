"""The page of a pooling."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from testbench.line import RECORDED
from testbench.page.page import COMPUTED, Page
from testbench.page.words import counted
from testbench.questions.identify.pool.answer import pool_answer
from testbench.questions.identify.pool.figures import pool_plates
from testbench.questions.identify.pool.tables import condition_table, pool_tables, pooled_table

if TYPE_CHECKING:
    from testbench.line import Flight
    from testbench.questions.identify.pool.ask import PooledFlights


def pool_page(flights: PooledFlights) -> Page:
    """Return the page: the answer, coefficients over the condition, tables, and pooled.json for a later prior."""
    found = flights.found
    aircraft = next((f.before.aircraft.name for f in found if f.before is not None), None)
    table = pooled_table(flights)
    return Page(
        kicker=f"Pooled from recorded flights: {', '.join(flights.names)}",
        title=f"Coefficients{f' of {aircraft}' if aircraft else ''} from {counted(len(found), 'log')}",
        question="What do the logs together say of the nondimensional derivatives, and what did they add?",
        answer=pool_answer(flights),
        tables=pool_tables(flights),
        plates=pool_plates(flights),
        files={"pooled.json": json.dumps(flights.pooled.written(), indent=1) + "\n"},
        packages=COMPUTED,
        provenance=[
            (f"log {name}", ", ".join(dict.fromkeys(_record(flight) for flight in f.flights)))
            for name, f in zip(flights.names, found, strict=True)
        ],
        terminal=[table.without("logs", "own_std", "bits"), condition_table(flights).without("Ixx", "Iyy", "Izz")],
    )


def _record(flight: Flight) -> str:
    provenance = flight.measured[RECORDED].provenance
    return f"{provenance['file']} ({str(provenance['sha256'])[:12]})"
