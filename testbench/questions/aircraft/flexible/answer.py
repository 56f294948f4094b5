"""A flexible aircraft in sentences: what was coupled, and from what speed on it flutters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.questions.aircraft.answer import onset_sentences

if TYPE_CHECKING:
    from testbench.questions.aircraft.flexible.ask import FlexibleAnswer


def flexible_answer(found: FlexibleAnswer) -> list[str]:
    """Return what was found, the most important first."""
    made, range_ = found.made, found.survey.range
    elastic = made.aircraft.elastic
    assert elastic is not None
    count = len(elastic)
    out = onset_sentences(found.survey.envelope)
    out.append(f"it trims from {range_.slowest:g} to {range_.fastest:g} m/s at {found.survey.envelope.h_m:g} m")
    matched = [c for c in made.strips.constants if c.source.startswith("the aircraft's own")]
    if matched:
        out.append(
            f"{len(matched)} constants of the strips are chosen so that they give the aircraft's own derivatives: "
            + ", ".join(c.source.removeprefix("the aircraft's own ") for c in matched)
        )
    evidence = found.test.content.evidence
    masses = dict.fromkeys(o.mass for o in made.origins)
    out.append(
        f"frequency, damping and shape of {'the mode' if count == 1 else f'all {count} modes'} are {evidence}; "
        f"generalised masses: {'; '.join(masses)}"
    )
    return [*out, *made.notes]
