"""The compatibility of recorded data in sentences: which instruments err, by how much."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.words import Line, some

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility

_NAMED = 3  # errors in the first sentence; the advice has one sentence for each


def compatibility_answer(result: DataCompatibility) -> list[Line]:
    """Return what was found, in sentences."""
    lead = "the instruments agree with each other: no error exceeds what noise alone would show"
    if result.errors:
        surest = sorted(result.errors, key=lambda e: -e.significance)
        lead = "the instruments do not agree: " + some((e.words for e in surest), _NAMED)
    return [Line("lead", lead), *(Line("doubt", text) for text in result.advice)]
