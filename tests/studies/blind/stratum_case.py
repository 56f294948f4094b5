"""Cases of draws with four strata each: library forms, other forms, the true effect taken out, and nothing.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from studies.blind.lateral_truths import parameter_errors

from testbench.questions.gap.hidden.entries import Make
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.cases import Case, first_that_flies, in_turn
from testbench.questions.gap.sealed.kinds import Kind

OTHER, TAKEN_OUT, NOTHING = "other form", "the true effect taken out", "nothing"
"""Ends of the names of strata; any other one is of library forms."""


@dataclass(frozen=True)
class StratumCase(Case):
    """A case of one of these strata."""

    def truth(self, made: Mapping[str, Make]) -> Truth:
        """Return what flies, ``made`` by the names of its kinds."""
        truth = Truth(factors=self.factors)
        for kind, sizes in zip(self.kinds, self.sizes, strict=True):
            truth = truth.with_(made[kind](sizes, self.aircraft))
        return truth

    def seed_of(self, which: str) -> int:
        """Return the seed of the noise of a set of manoeuvres ("rich" or "held_out")."""
        return self.seed + {"rich": 0, "held_out": 1_000_000}[which]

    @property
    def without(self) -> tuple[str, ...]:
        """The names that are taken out of the library before this case is named."""
        return tuple(n for names in self.right for n in names) if self.stratum.endswith(TAKEN_OUT) else ()


def chosen(kinds: Mapping[str, Kind], stratum: str, i: int) -> tuple[str, ...]:
    """Return the kind of case ``i`` of a stratum: all that suit it in turn, in an order of its own."""
    if stratum.endswith(NOTHING):
        return ()
    form = "other" if stratum.endswith(OTHER) else "library"
    names = [n for n, k in kinds.items() if k.form == form]
    order = np.random.default_rng(zlib.crc32(stratum.encode())).permutation(len(names))
    return (names[order[i % len(names)]],)


S = TypeVar("S", bound=StratumCase)


def draw_of(
    case: Callable[..., S], kinds: Mapping[str, Kind], aircraft: Iterable[str], seed: int, counts: Mapping[str, int]
) -> tuple[S, ...]:
    """Draw the cases of every stratum, in an order that begins with the first of each.

    Each is the first of at most ten draws that flies all it must.

    Raises:
        LimitError: none of them does.
    """
    planes = list(aircraft)

    def drawn(stratum: str, i: int, rng: np.random.Generator) -> S:
        names = chosen(kinds, stratum, i)
        return case(
            name=f"{stratum} {i + 1}",
            stratum=stratum,
            aircraft=str(rng.choice(planes)),
            kinds=names,
            sizes=tuple(kinds[k].draw(rng) for k in names),
            factors=parameter_errors(rng),
            right=tuple(kinds[k].names for k in names),
            seed=int(rng.integers(1, 2**31 - 10**7)),
        )

    return in_turn(counts, lambda stratum, i: first_that_flies(stratum, i, seed, lambda rng: drawn(stratum, i, rng)))
