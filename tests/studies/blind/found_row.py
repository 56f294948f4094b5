"""What a finding of the workflow is as the row of a blind case; the answer is not looked at."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from clock import since

from testbench.core.errors import Refusal
from testbench.questions.gap.result import GapFinding


def found_row(find: Callable[[], GapFinding]) -> dict[str, Any]:
    """Return what the workflow says, as JSON values, and the processor time that it took."""
    began = time.process_time()
    try:
        found = find()
    except Refusal as error:
        return {"outcome": "failed", "names": [], "accused": [], "why": str(error)}
    naming = found.naming
    first = naming.best or next(iter(naming.ranking), None)
    return {
        "outcome": naming.outcome,
        "names": list(naming.names),
        "best": first.effect.name if first else "",
        "values": {k: float(v) for k, v in first.values.items()} if first else {},
        "gain": float(first.gain) if first else 0.0,
        "accused": [
            [p.name, float(p.factor), float(p.error), [f.effect.name for f in p.rivals]] for p in found.parameters
        ],
        "seconds": since(began),
    }
