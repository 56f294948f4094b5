"""The errors that simulated flights of a design show, in the description of its flown runs.

`testbench identify` reads the description again and knows neither the design nor its simulated flights: without these
errors it would state those of the estimator alone, which no mean error and no scatter between flights reach.
"""

from __future__ import annotations

import math

from testbench.core.door import read_text
from testbench.core.escape import table_lines
from testbench.core.files import write_file
from testbench.questions.plan.verdicts import Campaign, JudgedCard


def keep_errors(campaign: Campaign) -> None:
    """Write the errors of every card that exceed those of its estimator behind the description of its runs."""
    for card in campaign.cards:
        errors = _beyond(card)
        if errors and card.flown.file is not None:
            table = {"simulated_errors": {"source": _source(card), "flights": _flights(card), "errors": errors}}
            text = read_text(card.flown.file, "scenario")
            write_file(card.flown.file, "\n".join([text.rstrip("\n"), "", *table_lines(table), ""]))


def _beyond(card: JudgedCard) -> dict[str, float]:
    """Return derivative -> error of the runs: where flights of its design were simulated, else where it is larger."""
    derivatives = {} if card.flown.found is None else {d.name: d for d in card.flown.found.derivatives}
    return {
        t.name: t.error
        for t in card.targets
        if t.name in derivatives
        and math.isfinite(t.error)
        and (_flights(card) or t.error > derivatives[t.name].stated * (1.0 + 1e-9))
    }


def _flights(card: JudgedCard) -> int:
    promise = card.flown.promise
    return 0 if promise is None or promise.realised is None else promise.realised.found.n


def _source(card: JudgedCard) -> str:
    if not (n := _flights(card)):
        return "the estimator's own answer to the expected response, and the scatter of the runs"
    return f"{n} simulated flights of the design, and the scatter of the runs"
