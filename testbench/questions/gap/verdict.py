"""A verdict of two levels: where the cause sits, and what it is; each with how often such a call was right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.core.proportion import proportion_interval
from testbench.effects import SERVOS
from testbench.page.words import listed
from testbench.questions.gap.called import CALLED
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.parts import Part, parts_of

SHOWN = "recorded surface"
"""Call of a path whose recorded surface differs from what is believed: it is seen, not inferred."""


@dataclass(frozen=True)
class Verdict:
    """Where the cause sits; what it is stands in the naming.

    Attributes:
        call: kind of call, a key of CALLED, or SHOWN.
        parts: where it may sit; none if nothing is called.
        nearest: part of the nearest effect, in words, where nothing is called.
    """

    call: str
    parts: tuple[Part, ...]
    nearest: str = ""

    @property
    def right(self) -> tuple[int, int, int]:
        """Cases of the blind test in which such a call had the right part; the right effect, too; and all of them."""
        return CALLED.get(self.call, (0, 0, 0))

    @property
    def probability(self) -> float:
        """Share of the calls of this kind that had the right part."""
        part, _, cases = self.right
        return part / cases if cases else 0.0

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words: where, how sure, and what to check on the ground."""
        part, effect, cases = self.right
        if not self.parts:
            return (
                f"where it sits is not known: the nearest effect acts in {self.nearest}, but where nothing was named, "
                f"the nearest one had the right part in only {part} of {cases} cases of the blind test",
            )
        checks = tuple(f"check on the ground, {p.name}: {p.ground_check}" for p in self.parts)
        if self.call == SHOWN:
            where = listed([p.name for p in self.parts])
            return (
                f"where to look first: {where}, as the recorded surface shows; whether that is all is not known",
                *checks,
            )
        low, high = (100.0 * x for x in proportion_interval(part, cases))
        names = [p.name for p in self.parts]
        where = " or ".join(names) if self.call == "set" else listed(names)
        return (
            f"where to look: {where}; calls like this had the right part in {part} of {cases} cases of the blind test "
            f"({low:.0f} to {high:.0f} %), and the right effect in {effect}",
            *checks,
        )


def verdict_of(naming: Naming, paths: Sequence[JudgedPath] = ()) -> Verdict | None:
    """Return where the cause sits; None if there is no gap, no effect came near, or a term was named.

    Where nothing is named and ``paths`` differ by themselves, it sits there.

    Probabilities are those of the blind test (results/gap/parts.csv): shares of right parts among calls of one kind,
    over library and other forms, unseen effects, and cases whose true effect was taken out of the library.
    """
    fits = {f.effect.name: f for f in naming.ranking}
    named = [fits[n].effect for n in naming.names]
    differ = [SERVOS["lag", p.control] for p in paths if p.outcome == "differs"]
    if naming.outcome == "unexplained" and differ:
        return Verdict(SHOWN, parts_of(differ))
    if naming.outcome == "unexplained":
        nearest = next((f.effect for f in naming.ranking if f.flown), None)
        return None if nearest is None else Verdict("unexplained", (), listed([p.name for p in parts_of([nearest])]))
    if not named or naming.open_set:
        return None
    return Verdict(call_of([e.name for e in named]), parts_of(named))


def call_of(names: Sequence[str]) -> str:
    """Return the kind of call by what is named; several effects at once are one name, "A + B"."""
    if not names:
        return "unexplained"
    return "set" if len(names) > 1 else "two effects" if " + " in names[0] else "one effect"
