"""The cases of the draw of control paths with recorded surfaces: drawn from one seed, sealed before any is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from studies.blind.lateral_truths import LATERAL_KINDS
from studies.blind.path_flights import FLOWN, fly_paths
from studies.blind.stratum_case import StratumCase, draw_of

from testbench.core.record import FlightRecord
from testbench.questions.gap.hidden.entries import TRUTHS, Make
from testbench.questions.gap.hidden.lateral import LATERAL
from testbench.questions.gap.sealed.cases import opened_as
from testbench.questions.gap.sealed.kinds import Kind
from testbench.questions.gap.sealed.truths import KINDS

TAKEN_OUT = "paths with the true effect taken out"
NOTHING = "paths nothing"
STRATA: Mapping[str, int] = {"paths library form": 36, "paths other form": 36, TAKEN_OUT: 36, NOTHING: 36}
_ELEVATOR = (
    "slow servo", "slew limit", "late link", "play", "linkage ratio", "rate feedback", "damper with washout",
    "servo of two stages", "soft slew limit", "link with jitter", "soft play", "linkage that loses",
    "damper that filters",
)  # fmt: skip
_LATERAL = (
    "slow aileron servo", "slow rudder servo", "late aileron link", "late rudder link", "aileron linkage ratio",
    "rudder linkage ratio", "roll-rate feedback", "roll damper that filters", "yaw-rate feedback", "interconnect",
    "bank hold", "weak bank hold", "heading hold", "aileron servo of two stages", "rudder servo of two stages",
    "soft aileron slew limit", "soft rudder slew limit", "aileron link with jitter", "rudder link with jitter",
    "aileron linkage that loses", "rudder linkage that loses", "yaw damper that filters", "springy interconnect",
)  # fmt: skip
PATHS: Mapping[str, Make] = {**{n: TRUTHS[n] for n in _ELEVATOR}, **{n: LATERAL[n] for n in _LATERAL}}
PATH_KINDS: Mapping[str, Kind] = {**{n: KINDS[n] for n in _ELEVATOR}, **{n: LATERAL_KINDS[n] for n in _LATERAL}}


@dataclass(frozen=True)
class PathCase(StratumCase):
    """A case that acts in the path of one control, flown from three conditions with its surfaces recorded."""

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich" or "held_out")."""
        return fly_paths(self.aircraft, self.truth(PATHS), which, self.seed_of(which))


def draw(seed: int, counts: Mapping[str, int] = STRATA) -> tuple[PathCase, ...]:
    """Draw the cases: see :func:`studies.blind.stratum_case.draw_of`."""
    return draw_of(PathCase, PATH_KINDS, FLOWN, seed, counts)


def opened(text: str) -> tuple[PathCase, ...]:
    """Return the cases of a sealed text."""
    return opened_as(PathCase, text)
