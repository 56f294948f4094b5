"""One case of the blind test, from what it hides to the row that is kept of it."""

from __future__ import annotations

from typing import Any

from testbench.errors import TestbenchError
from testbench.gap.blind.cases import Case
from testbench.gap.blind.report import WITHOUT
from testbench.gap.blind.run import name_case


def row_name(case: Case, without: bool) -> str:
    """Return the name of the row of a case; ``without`` the true effect in the library, if so."""
    return case.name + WITHOUT if without else case.name


def run_case(case: Case, without: bool = False) -> dict[str, Any]:
    """Return the row of a case: what was named; ``without`` the true effect in the library, if so."""
    true = [name for names in case.right for name in names] if without else []
    try:
        row = name_case(case.aircraft, case.fly("rich"), case.fly("held_out"), true)
    except TestbenchError as error:
        row = {"outcome": "failed", "names": [], "why": str(error)}
    return {"case": row_name(case, without), **row}
