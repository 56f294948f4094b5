"""Blind test of the F-16 that comes with JSBSim, at three conditions: ``python -m studies.blind.fighter``. Resumes.

It is hardly stable in pitch. Truths, sensors and strata are those of the draw of stock aircraft.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.cases import Case, counts_of, draw
from studies.blind.flights import FIGHTER, manoeuvres
from studies.blind.rates import page_of, rates
from studies.blind.sealed_draw import Draw
from studies.blind.stock import HIDDEN

SEED = 20270614
COUNTS = dict.fromkeys(counts_of("stock"), 12)


def page(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    (plane,) = FIGHTER
    flown, held = (", ".join(manoeuvres("stock", plane, which)) for which in ("rich", "held_out"))
    words = [
        "# Blind test of the F-16 at three conditions",
        "",
        "Made by `python -m studies.blind.fighter`, which resumes where it stopped; `--minutes 0` writes this page "
        f"anew. The F-16 of JSBSim is hardly stable in pitch. {HIDDEN}",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "Case 4 of the other form met an error in the regression of forces and moments, which was mended; it was run "
        "again. Rows 1 to 13 were made before a drift was kept from being heard as turbulence, rows 14 to 28 before "
        "that had to have one slope in every record, and before quiet flight ended where a surface begins to move. All "
        "rows were made before an effect that was given up far from rest was tried again, which names case 2 of the "
        "library form right, and before ranges followed the size of the aircraft, which names the airspeed lag of case "
        "10 of the library form.",
    ]
    return page_of(words, SEED, cases, rows)


DRAW = Draw("fighter", SEED, lambda: draw(SEED, COUNTS, FIGHTER), rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
