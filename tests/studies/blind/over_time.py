"""Blind test of what grows with time: ``python -m studies.blind.over_time``. Resumes, as the others do.

Truths are drawn from a seed of their own, sealed, and flown at six times of a flight of half an hour.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.lateral_flights import suite
from studies.blind.lateral_run import named
from studies.blind.over_time_cases import STRATA, TimeCase, draw, opened
from studies.blind.over_time_flights import manoeuvres
from studies.blind.path_flights import FLOWN
from studies.blind.sealed_draw import Draw
from studies.blind.strata import page_of, rates

from testbench.core.record import FlightRecord
from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.sealed.flights import RATE_HZ
from testbench.questions.gap.starts import Start, marked

SEED = 20270513


def believe(aircraft: str) -> Believed:
    """Return what is believed: rigid wings, the suite of all axes, the condition of all records."""
    return Believed(load_aircraft(aircraft, "rigid"), suite(), FLOWN[aircraft].conditions[0], RATE_HZ)


def told(aircraft: str, which: str, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records that say when each was flown."""
    at = FLOWN[aircraft].conditions[0]
    return {n: marked(records[n], Start(at, at_s=t)) for n, (t, _) in manoeuvres(aircraft, which).items()}


def run_case(case: TimeCase) -> dict[str, Any]:
    """Return what the workflow says of one case, as JSON values."""
    records, held_out = (told(case.aircraft, which, case.fly(which)) for which in ("rich", "held_out"))
    return {"case": case.name, **named(believe(case.aircraft), records, held_out, case.without)}


def page(cases: Sequence[TimeCase], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (
        ", ".join(f"{name} ({t / 60.0:g} min)" for name, (t, _) in manoeuvres("eolo", which).items())
        for which in ("rich", "held_out")
    )
    words = [
        "# Blind test of what grows with time",
        "",
        "Made by `python -m studies.blind.over_time`, which resumes where it stopped; `--minutes 0` writes this page "
        "anew. A battery or tank that empties from record to record, or a gyro or airspeed that runs away within each, "
        "is hidden (`testbench/questions/gap/hidden/over_time.py`), with every longitudinal and lateral coefficient of "
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


DRAW = Draw("over_time", SEED, lambda: draw(SEED, STRATA), opened, run_case, rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
