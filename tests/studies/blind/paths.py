"""Blind test of control paths with recorded surfaces: ``python -m studies.blind.paths``. Resumes, as the others do.

Truths are drawn from a seed of their own, sealed, and flown from three conditions with commands and surfaces recorded.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.lateral_run import named
from studies.blind.path_cases import STRATA, PathCase, draw, opened
from studies.blind.path_flights import FLOWN, suite
from studies.blind.sealed_draw import Draw
from studies.blind.stock_flights import manoeuvres
from studies.blind.stock_run import told_of
from studies.blind.strata import page_of, rates

from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.sealed.flights import RATE_HZ

SEED = 20270412


def believe(aircraft: str) -> Believed:
    """Return what is believed: rigid wings, the suite with surfaces, the first of three conditions."""
    return Believed(load_aircraft(aircraft, "rigid"), suite(), FLOWN[aircraft].conditions[0], RATE_HZ)


def run_case(case: PathCase) -> dict[str, Any]:
    """Return what the workflow says of one case, as JSON values."""
    records, held_out = (told_of(FLOWN[case.aircraft], which, case.fly(which)) for which in ("rich", "held_out"))
    return {"case": case.name, **named(believe(case.aircraft), records, held_out, case.without)}


def page(cases: Sequence[PathCase], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (", ".join(manoeuvres(FLOWN["eolo"], which)) for which in ("rich", "held_out"))
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


DRAW = Draw("paths", SEED, lambda: draw(SEED, STRATA), opened, run_case, rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
