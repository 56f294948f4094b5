"""Where the cause sits, and how probable that is: where to look first, and what to check on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.effects import SERVOS
from testbench.page.words import listed
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.parts import Part, parts_of
from testbench.questions.gap.weighed import Weighed, percent


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


def verdict_of(naming: Naming, paths: Sequence[JudgedPath] = (), weighed: Weighed | None = None) -> Verdict | None:
    """Return where the cause sits; None if there is no gap, no effect came near, or a term was named.

    Where nothing is named and ``paths`` differ by themselves, it sits there. Probabilities are those of ``weighed``.
    """
    fits = {f.effect.name: f for f in naming.ranking}
    named = [fits[n].effect for n in naming.names]
    differ = [SERVOS["lag", p.control] for p in paths if p.outcome == "differs"]
    if naming.outcome == "unexplained" and differ:
        return Verdict(parts_of(differ), shown=True)
    if naming.outcome == "unexplained":
        named = [f.effect for f in naming.ranking if f.flown][:1]
    elif naming.open_set:
        return None
    if not named:
        return None
    parts = parts_of(named)
    sure = None if weighed is None else weighed.part([p.name for p in parts])
    if naming.outcome == "unexplained":
        return Verdict((), sure, nearest=listed([p.name for p in parts]))
    return Verdict(parts, sure, any=len(named) > 1)
