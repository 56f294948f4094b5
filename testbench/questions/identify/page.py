"""The page of an identification from recorded flights: that of a run, the derivatives first."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from testbench.page.page import FLOWN, Page
from testbench.page.tables import Column, Table
from testbench.page.words import answer_lines
from testbench.questions.identify.answer import identify_answer
from testbench.questions.identify.derivatives import scaling_of
from testbench.questions.run.labels import case_names
from testbench.questions.run.page import run_page

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Amended
    from testbench.questions.identify.result import Identified


_NONE: tuple[None, None, None] = (None, None, None)
_READ = (
    "X, Y and Z are specific forces, L, M and N angular accelerations (products of inertia included), per rad, rad/s "
    "or m/s. Standard errors are corrected for residuals that are correlated in time."
)
_BELIEVED = (
    "Determined: by the data. Weak: the error is more than half of the value. Correlated: only a combination with "
    "another one is known. At bound: determined by the bound, not by the data. In doubt: the residuals show missing "
    "terms of the model, whose influence the standard error may not include."
)


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
    from testbench.questions.identify.amend.page import amended_plates, amended_tables

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


# --- tables -----------------------------------------------------------------------------------------------------------


def derivative_table(found: Identified) -> Table | None:
    """Return the derivatives of all models, one row each; None if no model has some."""
    if not found.derivatives:
        return None
    several = len({d.case for d in found.derivatives}) > 1
    known = any(d.before is not None for d in found.derivatives)
    scaled = any(d.coefficient is not None for d in found.derivatives)
    names = case_names(found.cases)
    columns = [
        *([Column("model", "model", get=lambda d: names[d.case])] if several else []),
        Column("derivative", "derivative", get="name"),
        Column("value", "value", digits=4),
        Column("std", "± std", digits=2, get=lambda d: d.std if d.std > 0.0 else None),
        Column("unit", "unit", get=lambda d: d.unit or None),
    ]
    if known:
        columns += [Column("before", "before", digits=4)]
    if scaled:
        columns += [
            Column("coefficient", "coefficient", get=lambda d: (d.coefficient or _NONE)[0]),
            Column("coefficient_value", "its value", digits=4, get=lambda d: (d.coefficient or _NONE)[1]),
            Column("coefficient_std", "± std", digits=2, get=lambda d: (d.coefficient or _NONE)[2]),
        ]
    if found.again:
        columns += [
            Column("bias", "mean error, simulated", digits=2, get=lambda d: (d.again or _NONE)[0]),
            Column("scatter", "scatter, simulated", digits=2, get=lambda d: (d.again or _NONE)[1]),
            Column("held", "coverage of 95 %, %", digits=3, get=lambda d: 100.0 * d.again[2] if d.again else None),
        ]
    columns += [Column("believed", "verdict", get=lambda d: f"{d.believed}{', changed' if d.changed else ''}")]
    return Table.of("derivatives", "Derivatives", _caption(found, known, scaled), columns, found.derivatives)


def _caption(found: Identified, known: bool, scaled: bool) -> str:
    out = [_READ, _BELIEVED]
    if known:
        sources = ", ".join(sorted({d.source for d in found.derivatives if d.source}))
        out.append(f"Before: {sources}. Changed: further from it than three standard errors.")
    if found.again:
        out.append(
            "Simulated: in flights of the estimated model with the noise of the residuals, identified by the same "
            "likelihood; stated errors are widened if they are smaller than these flights show."
        )
    scaling = None if found.flown is None else scaling_of(found.flown, found.before)
    if scaled and scaling is not None:
        whose = f" of {found.before.aircraft.name}" if found.before else ""
        mass = "" if scaling.mass.mass_kg is None else f" of {scaling.mass.mass_kg:.4g} kg"
        out.append(
            f"Coefficients with a mass{mass}, inertia and geometry{whose} at {scaling.V_m_s:.4g} m/s and a dynamic "
            f"pressure of {scaling.qbar_Pa:.4g} Pa, whose own errors are not included; CX and CZ in stability axes: "
            "CZ_alpha = −CL_alpha − CD."
        )
    return " ".join(out)
