"""The answer of an amendment in sentences: what changed, how the flight is followed, what was left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.channels import channel
from testbench.page.labels import number, shown_unit
from testbench.page.words import Line, counted, sentence, some
from testbench.questions.identify.amend.choose import by_reason

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Aim, Amended, Miss

_MOST = 4
_WORSE = 1.02
"""Factor by which a miss must grow to be told; judged."""


def amended_answer(amended: Amended) -> list[Line]:
    """Return what was written and what it brings, then doubts, then what was left."""
    lines = [Line("lead", sentence(f"'{amended.name}': {_changes(amended)}{_flown(amended)}"))]
    lines += [Line("doubt", sentence(f"doubt: {text}")) for text in _doubts(amended)]
    left = [a for a in amended.aims if a.aimed is None]
    if left:
        lines.append(Line("finding", sentence(f"left as they were: {by_reason({a.name: a.why for a in left})}")))
    if amended.rule:
        lines.append(Line("finding", sentence(amended.rule)))
    return [*lines, *(Line("note", sentence(text)) for text in amended.notes)]


def _changes(amended: Amended) -> str:
    most = sorted(amended.written, key=lambda a: -_share(a))
    servos = [
        f"lag of {s.control} {'none' if s.before_s is None else number(s.before_s)} → {number(s.lag_s)} s"
        for s in amended.servos
    ]
    return some([*(f"{a.name} {number(a.before)} → {number(a.aimed or 0.0)}" for a in most), *servos], _MOST, ", ")


def _share(a: Aim) -> float:
    aimed = a.aimed or 0.0
    return abs(aimed - a.before) / max(abs(a.before), abs(aimed), 1e-300)


def _flown(amended: Amended) -> str:
    for use, words in (("validation", "not"), ("identification", "")):
        misses = amended.misses(use)
        told = _told(misses)
        if told is None or told.before is None or told.after is None:
            continue
        factor, unit = shown_unit(told.channel)
        n = sum(r.use == use for r in amended.replays)
        did = "did not use" if words else "used"
        which = "the record that it" if n == 1 else f"the {n} records that it"
        return (
            f"; {channel(told.channel).description} rms residual {number(factor * told.before)} → "
            f"{number(factor * told.after)} {unit} on {which} {did}"
        )
    return ""


def _told(misses: tuple[Miss, ...]) -> Miss | None:
    """Return the miss that is told first: of the rate that the motion turns about."""
    by = {m.channel: m for m in misses}
    return next((by[n] for n in ("q", "p", "r") if n in by), misses[0] if misses else None)


def _doubts(amended: Amended) -> list[str]:
    out = list(amended.doubts)
    worse = [
        m.channel for m in amended.misses("validation")
        if m.before is not None and m.after is not None and m.after > _WORSE * m.before
    ]  # fmt: skip
    if worse:
        out.append(
            f"the prediction of records that were not used is worse than before in {', '.join(worse)}: look for "
            f"another difference ({counted(len(worse), 'output')} of {len(amended.misses('validation'))})"
        )
    if amended.replays and not amended.misses("validation"):
        out.append("no record was held out, so it is not known whether the amended aircraft is better elsewhere")
    unsure = [a.name for a in amended.written if "in doubt" in a.why]
    if unsure:
        out.append(
            f"{', '.join(unsure)} are written although in doubt: the residuals show missing terms of the model; rely "
            "on the records that were not used"
        )
    out += [text for r in amended.replays for text in r.notes]
    return list(dict.fromkeys(out))
