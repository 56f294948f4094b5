"""The cases of the draw of what grows with time: drawn from one seed, by stratum, and sealed before any is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from studies.blind.over_time_flights import fly_over_time
from studies.blind.over_time_truths import OVER_TIME_KINDS
from studies.blind.path_flights import FLOWN
from studies.blind.stratum_case import StratumCase, draw_of

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.over_time import OVER_TIME
from testbench.questions.gap.sealed.cases import opened_as

TAKEN_OUT = "time with the true effect taken out"
NOTHING = "time nothing"
STRATA: Mapping[str, int] = {"time library form": 36, "time other form": 36, TAKEN_OUT: 36, NOTHING: 36}


@dataclass(frozen=True)
class TimeCase(StratumCase):
    """A case of one flight of half an hour, whose records say when each was flown."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        return fly_over_time(self.aircraft, self.truth(OVER_TIME), which, self.seed_of(which))


def draw(seed: int, counts: Mapping[str, int] = STRATA) -> tuple[TimeCase, ...]:
    """Draw the cases: see :func:`studies.blind.stratum_case.draw_of`."""
    return draw_of(TimeCase, OVER_TIME_KINDS, FLOWN, seed, counts)


def opened(text: str) -> tuple[TimeCase, ...]:
    """Return the cases of a sealed text."""
    return opened_as(TimeCase, text)
