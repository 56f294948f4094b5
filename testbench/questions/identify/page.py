"""The page of an identification from recorded flights: that of a run, the derivatives first."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from testbench.page.page import FLOWN, Page
from testbench.page.words import answer_lines
from testbench.questions.identify.answer import identify_answer
from testbench.questions.identify.tables import derivative_table
from testbench.questions.run.page import run_page

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Amended
    from testbench.questions.identify.result import Identified


def identify_page(found: Identified, amended: Amended | None = None) -> Page:
    """Return the page: the answer and the table of derivatives, then what was recorded, figures, tables and models.

    Args:
        found: what was identified.
        amended: the aircraft that it was written into, which gets a section of its own.
    """
    V_m_s = found.flown.V_m_s if found.flown is not None else None
    page = run_page(found, V_m_s, [_errors(found, i) for i in range(len(found.cases))])
    table = derivative_table(found)
    page = replace(page, answer=identify_answer(found))
    if table is None:
        return page
    page = replace(
        page,
        more_tables=[table, *page.more_tables],
        terminal=[table.without("unit", "coefficient", "coefficient_value", "coefficient_std"), *page.terminal],
        template="questions/identify/page.html.j2",
        context={**page.context, "derivatives": table},
    )
    return page if amended is None else _with_amendment(page, amended)


def _errors(found: Identified, index: int) -> dict[str, dict[str, float]]:
    """Return the errors of a model that simulated flights show, which `testbench design --after` counts."""
    errors = {d.name: d.std for d in found.derivatives if d.case == index and d.simulated}
    return {"flown_errors": errors} if errors else {}


def _with_amendment(page: Page, amended: Amended) -> Page:
    """Return the page with the amended aircraft: its answer first, its tables and the flight against both."""
    from testbench.questions.identify.amend.answer import amended_answer
    from testbench.questions.identify.amend.figures import amended_plates
    from testbench.questions.identify.amend.tables import amended_tables

    tables = amended_tables(amended)
    first, *more = amended_answer(amended)
    lines = answer_lines(page.answer)
    answer = [first, *(line._replace(kind="finding") if line.kind == "lead" else line for line in lines), *more]
    return replace(
        page,
        answer=answer,
        plates=[*amended_plates(amended), *page.plates],
        more_tables=[*page.more_tables, *tables],
        terminal=[
            *page.terminal,
            tables[0].without("unit", "std"),
            tables[-1].without("size", "theil_before", "theil_after"),
        ],
        context={**page.context, "amended": amended, "amended_tables": tables},
        packages=FLOWN,
        closing=[*page.closing, ("Aircraft", str(amended.folder)), ("Next", f"testbench check {amended.folder}")],
    )
