"""What a process of the blind test does: one case, from what it hides to the row that is kept of it.

Not in ``__main__``: a process that is spawned finds nothing there.
"""

import os
import threading
import time
from collections.abc import Sequence
from typing import Any

from studies.blind.cases import SHORT, WITHOUT, Case
from studies.blind.run import name_case

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.flight.batch.jobs import Simulator


def run_case(case: Case, variant: str = "", simulator: Simulator = "auto", only: Sequence[str] = ()) -> dict[str, Any]:
    """Return the row of a case: what was named, of the ``variant`` WITHOUT or SHORT, or of the case as it is.

    ``only`` are the effects that are searched, in place of the whole library.
    """
    try:
        records, held_out, out = _records(case, variant), case.fly("held_out"), _taken_out(case, variant)
        row = name_case(case.aircraft, records, held_out, out, simulator, only)
    except Refusal as error:
        row = {"outcome": "failed", "names": [], "why": str(error)}
    return {"case": case.name + variant, **row}


def _records(case: Case, variant: str) -> dict[str, FlightRecord]:
    return case.fly("short" if variant == SHORT else "rich")


def _taken_out(case: Case, variant: str) -> list[str]:
    return [name for names in case.right for name in names] if variant == WITHOUT else []


def leave_with(parent: int) -> None:
    """End this process once that of number ``parent`` has: a worker whose pool was killed would wait for it forever."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
