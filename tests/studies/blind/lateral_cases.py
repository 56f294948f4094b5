"""The cases of the lateral draw: drawn from one seed, by stratum, and sealed before anything is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from studies.blind.lateral_flights import fly_lateral
from studies.blind.lateral_truths import LATERAL_KINDS, parameter_errors
from studies.blind.stratum_case import StratumCase, chosen

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.lateral import LATERAL
from testbench.questions.gap.sealed.cases import first_that_flies, in_turn, opened_as

TAKEN_OUT = "lateral with the true effect taken out"
NOTHING = "lateral nothing"
STRATA: Mapping[str, int] = {"lateral library form": 36, "lateral other form": 36, TAKEN_OUT: 36, NOTHING: 36}


@dataclass(frozen=True)
class LateralCase(StratumCase):
    """A case in roll and yaw."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        return fly_lateral(self.aircraft, self.truth(LATERAL), which, self.seed_of(which))


def draw(seed: int, counts: Mapping[str, int] = STRATA) -> tuple[LateralCase, ...]:
    """Draw the cases of every stratum, in an order that begins with the first of each."""
    return in_turn(counts, lambda stratum, i: draw_case(stratum, i, seed))


def opened(text: str) -> tuple[LateralCase, ...]:
    """Return the cases of a sealed text."""
    return opened_as(LateralCase, text)


def draw_case(stratum: str, i: int, seed: int, kind: str = "") -> LateralCase:
    """Return case ``i`` of a stratum, or one of a given kind: the first of at most ten draws that flies all it must.

    Raises:
        LimitError: none of them does.
    """
    return first_that_flies(stratum, i, seed, lambda rng: _case(stratum, i, rng, kind))


def _case(stratum: str, i: int, rng: np.random.Generator, kind: str) -> LateralCase:
    kinds = (kind,) if kind else chosen(LATERAL_KINDS, stratum, i)
    return LateralCase(
        name=f"{stratum} {i + 1}",
        stratum=stratum,
        aircraft="eolo" if rng.random() < 0.5 else "taurus",
        kinds=kinds,
        sizes=tuple(LATERAL_KINDS[k].draw(rng) for k in kinds),
        factors=parameter_errors(rng),
        right=tuple(LATERAL_KINDS[k].names for k in kinds),
        seed=int(rng.integers(1, 2**31 - 10**7)),
    )
