"""Where the cause sits, and how probable that is: where to look first, and what to check on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.effects import SERVOS, Effect
from testbench.page.words import listed
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.explain import Naming, percent
from testbench.questions.gap.parts import Part, parts_of


@dataclass(frozen=True)
class Verdict:
    """Where the cause sits; what it is stands in the naming.

    Attributes:
        parts: where it may sit; none if nothing is called.
        probability: that all that is missing acts there; None if it is seen and not inferred, or was not weighed.
        any: True if it sits in one of the parts, and not in all of them.
        shown: True if a recorded surface shows it.
        nearest: part of the nearest effect, in words, where nothing is called.
    """

    parts: tuple[Part, ...]
    probability: float | None = None
    any: bool = False
    shown: bool = False
    nearest: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words: where, how probable, and what to check on the ground."""
        if not self.parts:
            sure = "" if self.probability is None else f", which is the right part with {percent(self.probability)}"
            return (f"where it sits is not known: the nearest effect acts in {self.nearest}{sure}",)
        checks = tuple(f"check on the ground, {p.name}: {p.ground_check}" for p in self.parts)
        if self.shown:
            where = listed([p.name for p in self.parts])
            return (
                f"where to look first: {where}, as the recorded surface shows; whether that is all is not known",
                *checks,
            )
        return (f"where to look: {self.where}{self._sure}", *checks)

    @property
    def where(self) -> str:
        """The parts in words."""
        names = [p.name for p in self.parts]
        return " or ".join(names) if self.any else listed(names)

    @property
    def _sure(self) -> str:
        return "" if self.probability is None else f"; probability that it sits there: {percent(self.probability)}"


def verdict_of(naming: Naming, paths: Sequence[JudgedPath] = ()) -> Verdict | None:
    """Return where the cause sits; None if there is no gap, no effect came near, or a term was named.

    Where nothing is named for certain and ``paths`` differ by themselves, it sits there.
    """
    fits = {f.effect.name: f for f in naming.ranking}
    named = [fits[n].effect for n in naming.names]
    differ = [SERVOS["lag", p.control] for p in paths if p.outcome == "differs"]
    if naming.outcome in ("partial", "unexplained"):
        if differ:
            return Verdict(parts_of(differ), shown=True)
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
