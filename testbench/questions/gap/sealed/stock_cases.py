"""The cases of the draw of stock aircraft: drawn from one seed, by stratum, and sealed before anything is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.stock import STOCK
from testbench.questions.gap.sealed.cases import first_that_flies, in_turn, opened_as
from testbench.questions.gap.sealed.lateral_truths import parameter_errors
from testbench.questions.gap.sealed.stock_flights import FLOWN, fly_stock
from testbench.questions.gap.sealed.stock_truths import STOCK_KINDS
from testbench.questions.gap.sealed.strata import StratumCase, chosen

TAKEN_OUT = "stock with the true effect taken out"
NOTHING = "stock nothing"
STRATA: Mapping[str, int] = {"stock library form": 36, "stock other form": 36, TAKEN_OUT: 36, NOTHING: 36}


@dataclass(frozen=True)
class StockCase(StratumCase):
    """A case of an aircraft that comes with JSBSim, flown from three conditions."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        return fly_stock(self.aircraft, self.truth(STOCK), which, self.seed_of(which))


def draw(seed: int, counts: Mapping[str, int] = STRATA) -> tuple[StockCase, ...]:
    """Draw the cases of every stratum, in an order that begins with the first of each."""
    return in_turn(counts, lambda stratum, i: draw_case(stratum, i, seed))


def opened(text: str) -> tuple[StockCase, ...]:
    """Return the cases of a sealed text."""
    return opened_as(StockCase, text)


def draw_case(stratum: str, i: int, seed: int) -> StockCase:
    """Return case ``i`` of a stratum: the first of at most ten draws that flies all it must.

    Raises:
        LimitError: none of them does.
    """
    return first_that_flies(stratum, i, seed, lambda rng: _case(stratum, i, rng))


def _case(stratum: str, i: int, rng: np.random.Generator) -> StockCase:
    kinds = chosen(STOCK_KINDS, stratum, i)
    return StockCase(
        name=f"{stratum} {i + 1}",
        stratum=stratum,
        aircraft=str(rng.choice(list(FLOWN))),
        kinds=kinds,
        sizes=tuple(STOCK_KINDS[k].draw(rng) for k in kinds),
        factors=parameter_errors(rng),
        right=tuple(STOCK_KINDS[k].names for k in kinds),
        seed=int(rng.integers(1, 2**31 - 10**7)),
    )
