"""The compatibility of recorded data in sentences: which instruments err, by how much."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.advice import ranked
from testbench.estimators.compatibility.take_out import INSTRUMENT_ERROR
from testbench.page.words import Line, advice_lines, some

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility

_NAMED = 3  # errors in the first sentence; the advice has one sentence for each


def compatibility_answer(result: DataCompatibility) -> list[Line]:
    """Return what was found, in sentences."""
    lead = "the instruments agree with each other: no error exceeds what noise alone would show"
    if result.errors:
        surest = sorted(result.errors, key=lambda e: -e.significance)
        lead = "the instruments do not agree: " + some((e.words for e in surest), _NAMED)
    advice = ranked(result.advice)
    found = [Line("finding", a) for a in advice if a.code == INSTRUMENT_ERROR]  # what was asked for, not a doubt of it
    return [Line("lead", lead), *found, *advice_lines(a for a in advice if a.code != INSTRUMENT_ERROR)]
