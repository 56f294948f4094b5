"""The cases of the draw of stock aircraft: drawn from one seed, by stratum, and sealed before anything is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from studies.blind.stock_flights import FLOWN, fly_stock
from studies.blind.stock_truths import STOCK_KINDS
from studies.blind.stratum_case import StratumCase, draw_of

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.stock import STOCK
from testbench.questions.gap.sealed.cases import opened_as

TAKEN_OUT = "stock with the true effect taken out"
NOTHING = "stock nothing"
STRATA: Mapping[str, int] = {"stock library form": 36, "stock other form": 36, TAKEN_OUT: 36, NOTHING: 36}


@dataclass(frozen=True)
class StockCase(StratumCase):
    """A case of an aircraft that comes with JSBSim, flown from three conditions."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        return fly_stock(self.aircraft, self.truth(STOCK), which, self.seed_of(which))


def draw(
    seed: int, counts: Mapping[str, int] = STRATA, aircraft: Iterable[str] = tuple(FLOWN)
) -> tuple[StockCase, ...]:
    """Draw the cases: see :func:`studies.blind.stratum_case.draw_of`."""
    return draw_of(StockCase, STOCK_KINDS, aircraft, seed, counts)


def opened(text: str) -> tuple[StockCase, ...]:
    """Return the cases of a sealed text."""
    return opened_as(StockCase, text)
