"""Blind test of aircraft that come with JSBSim, drawn anew: ``python -m studies.blind.stock_again``. Resumes.

Truths, sensors, aircraft and strata are those of :mod:`studies.blind.stock`, whose rows taught what was mended since.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.cases import Case, counts_of, draw
from studies.blind.flights import STOCK, manoeuvres
from studies.blind.rates import page_of, rates
from studies.blind.sealed_draw import Draw
from studies.blind.stock import HIDDEN

SEED = 20271128


def page(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (", ".join(manoeuvres("stock", "jsbsim:c172p", which)) for which in ("rich", "held_out"))
    models = ", ".join(name.removeprefix("jsbsim:") for name in STOCK)
    words = [
        "# Blind test of stock aircraft at three conditions, drawn anew",
        "",
        "Made by `python -m studies.blind.stock_again`, which resumes where it stopped; `--minutes 0` writes this page "
        f"anew. The aircraft are {models} as they come with JSBSim. {HIDDEN}",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "The third draw and the last. What the [second](../stock/README.md) missed was mended before its answers were "
        "sealed: throttle linkages and long airspeed lags were not in reach of the library, and several effects at "
        "once were said although others in other parts did as well. Rows 1 to 17 were made before a vane could be late "
        "by more than 0.5 s, which case 4 of the other form asks for; rows 1 to 52 before a second error of one sensor "
        "had to gain no more than an error elsewhere; rows 1 to 116 before it was tried whatever it promised. Cases 6 "
        "and 22 of the other form, bank angles of two stages, ask for these two, and are named with them.",
    ]
    return page_of(words, SEED, cases, rows)


DRAW = Draw("stock_again", SEED, lambda: draw(SEED, counts_of("stock")), rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
