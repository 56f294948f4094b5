"""One case of the blind test, from what it hides to the row that is kept of it."""

from __future__ import annotations

from typing import Any

from testbench.errors import TestbenchError
from testbench.gap.blind.cases import SHORT, WITHOUT, Case
from testbench.gap.blind.run import name_case


def run_case(case: Case, variant: str = "") -> dict[str, Any]:
    """Return the row of a case: what was named, of the ``variant`` WITHOUT or SHORT, or of the case as it is."""
    true = [name for names in case.right for name in names] if variant == WITHOUT else []
    try:
        records = case.fly("short" if variant == SHORT else "rich")
        row = name_case(case.aircraft, records, case.fly("held_out"), true)
    except TestbenchError as error:
        row = {"outcome": "failed", "names": [], "why": str(error)}
    return {"case": case.name + variant, **row}
