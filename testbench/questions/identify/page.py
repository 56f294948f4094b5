"""The page of an identification from recorded flights: that of a run, the derivatives first."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from testbench.page.page import Page
from testbench.questions.identify.answer import identify_answer
from testbench.questions.identify.tables import derivative_table
from testbench.questions.run.page import run_page

if TYPE_CHECKING:
    from testbench.questions.identify.result import Identified


def identify_page(found: Identified) -> Page:
    """Return the page: the answer and the table of derivatives, then what was recorded, figures, tables and models."""
    page = run_page(found)
    table = derivative_table(found)
    page = replace(page, answer=identify_answer(found))
    if table is None:
        return page
    return replace(
        page,
        more_tables=[table, *page.more_tables],
        terminal=[table.without("unit", "coefficient", "coefficient_value", "coefficient_std"), *page.terminal],
        template="questions/identify/page.html.j2",
        context={**page.context, "derivatives": table},
    )
