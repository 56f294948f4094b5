"""The pages of the gap workflow: of a case, and of manoeuvres that are only planned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.door import read_text
from testbench.page.page import Page, source_of
from testbench.questions.compatibility.page import fault_table
from testbench.questions.gap.drive import driven_by
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.figures import gap_plates, plan_plates
from testbench.questions.gap.starts import start_of
from testbench.questions.gap.tables import gap_tables, plan_tables
from testbench.questions.identify.instruments import agreement_in_words

if TYPE_CHECKING:
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.plan import GapPlan

_SHOWN = 5  # explanations on the terminal


def gap_page(result: GapResult) -> Page:
    """Return the page of a case, with the amended model, suite or air and its diff in amended/."""
    finding, tables = result.finding, gap_tables(result)
    amended = {f"amended/{path}": text for path, text in amended_files(result).items()}
    check = finding.check
    return Page(
        kicker=f"Gap between simulation and measurement: {result.name}",
        title=result.title,
        question=result.question,
        answer=finding.sentences,
        tables=tables,
        plates=gap_plates(result),
        files=amended,
        template="questions/gap/page.html.j2",
        context={
            "result": result,
            "starts": {n: f", from {s}" if (s := start_of(r)) else "" for n, r in result.records.items()},
            "driven_by": driven_by(list(result.records.values())),
            "data_check": agreement_in_words(check) if check else (),
            "check_tables": [fault_table(check)] if check and check.compared else [],
            "amended": list(amended),
            "diff": "\n".join(text for path, text in amended.items() if path.endswith(".diff")),
        },
        flown=finding.tally,
        provenance=[] if result.seed is None else [("seed", str(result.seed))],
        source=(result.file.name, read_text(result.file, "scenario")) if result.file else None,
        terminal=[tables[0].only("effect", "whole", "size", "share").first(_SHOWN)],
        notes=[f"Assumed: {note}" for note in result.notes],
    )


def gap_plan_page(plan: GapPlan) -> Page:
    """Return the page of what would be stated of planned manoeuvres, and what to add."""
    tables = plan_tables(plan)
    return Page(
        kicker=f"Which effects could be named: {plan.scenario.name}",
        title=f"{plan.scenario.title}: which effects would these manoeuvres name?",
        answer=plan.sentences,
        tables=tables,
        plates=plan_plates(plan),
        source=source_of(plan.scenario),
        terminal=[t for t in tables if t.name in ("additions", "again")],
    )
