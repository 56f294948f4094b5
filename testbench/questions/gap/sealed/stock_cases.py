"""The cases of the draw of stock aircraft: drawn from one seed, by stratum, and sealed before anything is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.stock import STOCK
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.cases import Case, first_that_flies, in_turn, opened_as
from testbench.questions.gap.sealed.lateral_truths import parameter_errors
from testbench.questions.gap.sealed.stock_flights import FLOWN, fly_stock
from testbench.questions.gap.sealed.stock_truths import STOCK_KINDS

TAKEN_OUT = "stock with the true effect taken out"
NOTHING = "stock nothing"
STRATA: Mapping[str, int] = {"stock library form": 36, "stock other form": 36, TAKEN_OUT: 36, NOTHING: 36}


@dataclass(frozen=True)
class StockCase(Case):
    """A case of an aircraft that comes with JSBSim, flown from three conditions."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        truth = Truth(factors=self.factors)
        for kind, sizes in zip(self.kinds, self.sizes, strict=True):
            truth = truth.with_(STOCK[kind](sizes, self.aircraft))
        return fly_stock(self.aircraft, truth, which, self.seed + {"rich": 0, "held_out": 1_000_000}[which])

    @property
    def without(self) -> tuple[str, ...]:
        """The names that are taken out of the library before this case is named."""
        return tuple(n for names in self.right for n in names) if self.stratum == TAKEN_OUT else ()


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
    kinds = _chosen(stratum, i)
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


def _chosen(stratum: str, i: int) -> tuple[str, ...]:
    """Return the kind of case ``i`` of a stratum: all kinds in turn, in an order of its own."""
    if stratum == NOTHING:
        return ()
    form = "other" if stratum == "stock other form" else "library"
    names = [n for n, k in STOCK_KINDS.items() if k.form == form]
    order = np.random.default_rng(zlib.crc32(stratum.encode())).permutation(len(names))
    return (names[order[i % len(names)]],)
