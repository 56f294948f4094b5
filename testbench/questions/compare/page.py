"""The page of a comparison of sensor suites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.page import Page, source_of
from testbench.questions.compare.answer import compare_sentences
from testbench.questions.compare.figures import compare_plates
from testbench.questions.compare.tables import compare_tables, information_table

if TYPE_CHECKING:
    from testbench.questions.compare.result import CompareResult


def compare_page(result: CompareResult) -> Page:
    """Return the page of a comparison: what each sensor buys, by simulation and by information."""
    return Page(
        kicker=f"Comparison of sensor suites: {result.name}",
        title=result.scenario.title,
        question=result.scenario.question,
        answer=compare_sentences(result),
        tables=compare_tables(result),
        plates=compare_plates(result),
        template="questions/compare/page.html.j2",
        context={"result": result},
        provenance=[("seed", str(result.seed))],
        flown=result.tally if result.flights else None,
        source=source_of(result.scenario),
        terminal=[information_table(result)],
    )
