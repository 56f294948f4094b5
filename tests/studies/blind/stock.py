"""Blind test of aircraft that come with JSBSim, at three conditions: ``python -m studies.blind.stock``. Resumes.

Truths are drawn from a seed of their own, sealed, and flown with sensors of all axes. What names them is told from
which condition each record was flown.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.cases import Case, counts_of, draw, seal
from studies.blind.flights import STOCK, manoeuvres
from studies.blind.rates import rates, results
from studies.blind.sealed_draw import Draw

SEED = 20270311
HIDDEN = (
    "Hidden truths act on commands and readings (`tests/studies/blind/lateral_truths.py`), with every longitudinal "
    "and lateral coefficient of the belief off by its prior. Each record starts from one of three conditions, slow, "
    "fast and high, which it tells. The suite is that of all axes at 50 Hz, with commands and no surfaces. The hash of "
    "the answers was written before the first case was named."
)
"""What pages say of what is hidden, and of what is told."""


def page(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    flown, held = (", ".join(manoeuvres("stock", "jsbsim:c172p", which)) for which in ("rich", "held_out"))
    models = ", ".join(name.removeprefix("jsbsim:") for name in STOCK)
    out = [
        "# Blind test of stock aircraft at three conditions",
        "",
        "Made by `python -m studies.blind.stock`, which resumes where it stopped; `--minutes 0` writes this page anew. "
        f"The aircraft are {models} as they come with JSBSim. {HIDDEN}",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "How answers are judged is said in the [draw in roll and yaw](../lateral/README.md).",
        "",
        "The first draw, seed 20270310, was opened after one case, which was right: lags and delays of its sizes, "
        "those of small aircraft, hardly showed in an airliner.",
        "",
        f"Seed {SEED}, the second draw. SHA-256 of answers.json without its last line break: "
        f"`{seal(tuple(cases))[1]}`.",
        "",
        "Rows 1 to 59 were made before a wrong effectiveness was told with its linkage, rows 1 to 76 before a name "
        "was refused that leaves a quarter of its gain in one band of one channel, which leaves cases 3 and 6 of the "
        "true effect taken out unexplained. The first 88 were made before a throttle linkage was in the library; "
        "stronger motors of these draws are such linkages, and were named or left unexplained as a scale of the "
        "thrust. The rows after them were made with that, and with air density and airspeed flown in the library; "
        "all before an effect that was given up far from rest was tried again; before ranges followed the size of the "
        "aircraft, which names the airspeed lags of cases 10 and 31 of the library form and the late vane of case 36 "
        "of the other form; and before company that may as well act elsewhere was no name, which leaves cases 8, 13 "
        "and 34 of the true effect taken out unexplained.",
        "",
    ]
    return "\n".join([*out, *results(cases, rows)]) + "\n"


DRAW = Draw("stock", SEED, lambda: draw(SEED, counts_of("stock")), rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
