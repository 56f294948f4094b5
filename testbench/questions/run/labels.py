"""Names of the cases of a run, of their outputs and of the elastic modes of its aircraft; cases without a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.estimators.cells import FailedCell
from testbench.estimators.identification import estimator_name
from testbench.line import RECORDED
from testbench.page.labels import unique
from testbench.page.tables import Column, Table
from testbench.page.words import listed, some

if TYPE_CHECKING:
    from testbench.line import Case
    from testbench.questions.run.result import RunResult


def case_names(cases: Sequence[Case]) -> list[str]:
    """Return a short and unique name per case: suite, method and order as far as they differ, then a number."""
    suites, methods = {c.suite for c in cases}, {estimator_name(c.estimator) for c in cases}
    names = []
    for case in cases:
        by_suite = len(suites) > 1 or (len(methods) == 1 and case.suite != RECORDED)
        by_method = len(methods) > 1 or not by_suite
        parts = [*([case.suite] if by_suite else []), *([estimator_name(case.estimator)] if by_method else [])]
        order = case.model.diagnostics.get("order")
        same = [c for c in cases if _key(c) == _key(case)]
        if len(same) > 1 and order is not None:
            parts.append(f"n = {order}")
        names.append(", ".join(parts))
    return unique(names)


def _key(case: Case) -> tuple[str, str]:
    return case.suite, estimator_name(case.estimator)


def outputs_of(cases: Sequence[Case]) -> list[str]:
    """Return the outputs of all cases, in the order of the case that has most of them."""
    ordered = sorted(cases, key=lambda c: -len(c.model.outputs))
    return list(dict.fromkeys(o for c in ordered for o in c.model.outputs))


def elastic_names(result: RunResult) -> set[str]:
    """Return the names of the elastic modes of a simulated aircraft; none for a recorded one."""
    flown = None if result.truth is None else result.truth.aircraft.flown_modes()
    return {m.name for m in flown.modes} if flown else set()


# --- cases without a model --------------------------------------------------------------------------------------------


_NAMED = 3


def failed_sentences(failed: Sequence[FailedCell], words: str = " gave no model") -> list[str]:
    """Return one sentence per reason, with the suites and estimators that it holds for before the words."""
    of: dict[str, list[str]] = {}
    for cell in failed:
        of.setdefault(cell.reason, []).append(cell.label)
    return [f"{some(cells, _NAMED)}{words}: {reason}" for reason, cells in of.items()]


def failed_table(failed: Sequence[FailedCell]) -> Table:
    """Return suite, estimator and reason of each."""
    columns = (Column("suite", "suite"), Column("estimator", "estimator"), Column("reason", "reason"))
    rows = tuple((cell.suite, cell.estimator, cell.reason) for cell in failed)
    suites = listed(list(dict.fromkeys(cell.suite for cell in failed)))
    caption = f"What these found of {suites} is missing everywhere else; the other estimators are not touched."
    return Table("failed", "Estimators that gave no model", caption, columns, rows, wide=True)
