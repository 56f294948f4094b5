"""Blind test of control paths with recorded surfaces: ``python -m studies.blind.paths``. Resumes, as the others do.

Truths are drawn from a seed of their own, sealed, and flown from three conditions with commands and surfaces recorded.
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

SEED = 20270412


def page(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (", ".join(manoeuvres("paths", "eolo", which)) for which in ("rich", "held_out"))
    words = [
        "# Blind test of control paths with recorded surfaces",
        "",
        "Made by `python -m studies.blind.paths`, which resumes where it stopped; `--minutes 0` writes this page anew. "
        "Hidden truths act between the command of elevator, aileron or rudder and its surface: servos, links, "
        "feedbacks, interconnects and holds, with every longitudinal and lateral coefficient of the belief off by its "
        "prior. Eolo and taurus fly rigid, each record from one of three conditions, slow, fast and high, which it "
        "tells. The suite is that of all axes at 50 Hz with commands, and surfaces with a noise of 0.001 rad. The hash "
        "of the answers was written before the first case was named.",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "Rows 1 to 56 were made before air density and airspeed flown were in the library, rows 1 to 66 before a "
        "coefficient that recorded surfaces clear was kept from being accused, which leaves case 12 of the true effect "
        "taken out without an accusation, and before re-tuning took flown tangents anew where old ones failed. All "
        "rows were made before an effect that was given up far from rest was tried again, and before a name had to "
        "hold where a surface that differs drives, which leaves cases 12, 27 and 32 of the true effect taken out "
        "unexplained, sent to the right path.",
    ]
    return page_of(words, SEED, cases, rows)


DRAW = Draw("paths", SEED, lambda: draw(SEED, counts_of("paths")), rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
