"""Blind test of what grows with time: ``python -m studies.blind.over_time``. Resumes, as the others do.

Truths are drawn from a seed of their own, sealed, and flown at six times of a flight of half an hour.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.cases import Case, counts_of, draw
from studies.blind.flights import manoeuvres
from studies.blind.rates import page_of, rates
from studies.blind.sealed_draw import Draw

SEED = 20270513


def page(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (
        ", ".join(
            f"{name} ({(at.at_s or 0.0) / 60.0:g} min)" for name, (at, _) in manoeuvres("time", "eolo", of).items()
        )
        for of in ("rich", "held_out")
    )
    words = [
        "# Blind test of what grows with time",
        "",
        "Made by `python -m studies.blind.over_time`, which resumes where it stopped; `--minutes 0` writes this page "
        "anew. A battery or tank that empties from record to record, or a gyro or airspeed that runs away within each, "
        "is hidden (`tests/studies/blind/truths.py`), with every longitudinal and lateral coefficient of "
        "the belief off by its prior. Eolo and taurus fly rigid; each record tells its time after take-off. The suite "
        "is that of all axes at 50 Hz, with commands and no surfaces. The hash of the answers was written before the "
        "first case was named.",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "Rows 1 to 74 were made before air density and airspeed flown were in the library, rows 1 to 85 before "
        "re-tuning took flown tangents anew where old ones failed, and before a drift was kept from being heard as "
        "turbulence, which leaves cases 13 and 20 of the true effect taken out unexplained. Rows 98 to 144 were made "
        "with all of that, and all rows before an effect that was given up far from rest was tried again.",
    ]
    return page_of(words, SEED, cases, rows)


DRAW = Draw("over_time", SEED, lambda: draw(SEED, counts_of("time")), rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
