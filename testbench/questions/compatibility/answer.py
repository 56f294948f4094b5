"""The compatibility of recorded data in sentences: which instruments err, by how much."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.words import Line

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility


def compatibility_answer(result: DataCompatibility) -> list[Line]:
    """Return what was found, in sentences."""
    lead = "the instruments agree with each other: no error stands out of what noise alone would show"
    if result.errors:
        lead = "the instruments do not agree: " + "; ".join(e.words for e in result.errors)
    doubts = [
        f"instead of '{e.words}' these data would bear as well: {'; '.join(e.alternatives)}"
        for e in result.errors
        if e.alternatives
    ]
    return [Line("lead", lead), *(Line("doubt", text) for text in (*doubts, *result.advice))]
