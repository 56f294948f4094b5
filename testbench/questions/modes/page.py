"""The page of modes found without an input."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from testbench.estimators.operational.onset import CLEARANCE
from testbench.page.page import COMPUTED, FLOWN, Page
from testbench.page.write import json_text
from testbench.questions.modes.answer import modes_answer
from testbench.questions.modes.figures import modes_plates
from testbench.questions.modes.tables import modes_table, modes_tables

if TYPE_CHECKING:
    from testbench.questions.modes.result import ModesResult


def modes_page(result: ModesResult) -> Page:
    """Return the page of operational modes: of a flight in turbulence, or of records."""
    return Page(
        kicker=f"Operational modes: {result.name}",
        title=result.title,
        question=result.question,
        answer=modes_answer(result),
        tables=modes_tables(result),
        plates=modes_plates(result),
        files={"models/modes.json": json_text(result.found.to_dict()), **_clearance(result)},
        packages=FLOWN if result.true else COMPUTED,
        source=(f"{result.name}.toml", result.source) if result.source else ("records", "\n".join(result.records)),
        terminal=[modes_table(result).without("remarks")],
    )


def _clearance(result: ModesResult) -> dict[str, str]:
    """Return the file that `testbench plan --after` reads; none for records of one speed."""
    if not result.at:
        return {}
    told = [(p, result.onset.quantile(p)) for p in (0.01, 0.05, 0.5, 0.95)] if result.onset is not None else []
    found = {f"{p:g}": V for p, V in told if math.isfinite(V)}
    said = {"flown_m_s": list(result.at), "cleared_m_s": result.cleared_m_s, "risk": result.risk, "onset_m_s": found}
    return {CLEARANCE: json_text(said)}
