"""What a process of the blind test does: one case, from what it hides to the row that is kept of it.

Not in ``__main__``: a process that is spawned finds nothing there.
"""

from __future__ import annotations

import os
import threading
import time
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


def leave_with(parent: int) -> None:
    """End this process once that of number ``parent`` has: a worker whose pool was killed would wait for it forever."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
