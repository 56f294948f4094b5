"""Suites and estimators without a model: in one sentence per reason, and as a table."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.estimators.cells import FailedCell
from testbench.page.tables import Column, Table
from testbench.page.words import listed, some

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
