"""Where the cause sits, and how probable that is: where to look first, and what to check on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.effects import Effect
from testbench.page.words import listed
from testbench.questions.gap.explain import Naming, percent
from testbench.questions.gap.parts import Part, parts_of


@dataclass(frozen=True)
class Verdict:
    """Where the cause sits; what it is stands in the naming.

    Attributes:
        parts: where it may sit; none if nothing is called.
        probability: that all that is missing acts there.
        any: True if it sits in one of the parts, and not in all of them.
        nearest: part of the nearest effect, in words, where nothing is called.
    """

    parts: tuple[Part, ...]
    probability: float
    any: bool = False
    nearest: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words: where, how probable, and what to check on the ground."""
        sure = percent(self.probability)
        if not self.parts:
            near = f"the nearest effect acts in {self.nearest}, which is the right part with {sure}"
            return (f"where it sits is not known: {near}",)
        checks = tuple(f"check on the ground, {p.name}: {p.ground_check}" for p in self.parts)
        return (f"where to look: {self.where}; probability that it sits there: {sure}", *checks)

    @property
    def where(self) -> str:
        """The parts in words."""
        names = [p.name for p in self.parts]
        return " or ".join(names) if self.any else listed(names)


def verdict_of(naming: Naming) -> Verdict | None:
    """Return where the cause sits; None if there is no gap, no effect came near, or a term was named."""
    fits = {f.effect.name: f for f in naming.ranking}
    named = [fits[n].effect for n in naming.names]
    if naming.outcome in ("partial", "unexplained"):
        near = [f.effect for f in naming.ranking if not _open(naming, f.effect)][:1]
        if not near:
            return None
        return Verdict((), _sure(naming, near), nearest=listed([p.name for p in parts_of(near)]))
    if not named or any(_open(naming, e) for e in named):
        return None
    return Verdict(parts_of(named), _sure(naming, named), any=len(named) > 1 and len(parts_of(named)) > 1)


def _open(naming: Naming, effect: Effect) -> bool:
    return effect.name in naming.weighed.terms


def _sure(naming: Naming, effects: Sequence[Effect]) -> float:
    return naming.weighed.part([p.name for p in parts_of(effects)])
