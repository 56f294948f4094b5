"""What the answer of a row says by the coefficients that it accuses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from testbench.questions.gap.sealed.cases import Case
from testbench.questions.gap.sealed.verdict import NO_GAP

Flown = Callable[[Case, str], float]
"""Case and coefficient -> what it is times the believed one, as it flies."""


def drawn(case: Case, coefficient: str) -> float:
    """Return what a coefficient was drawn as, times the believed one."""
    return float(case.factors.get(coefficient, 1.0))


def accusations(row: Mapping[str, Any]) -> list[tuple[str, float, float, tuple[str, ...]]]:
    """Return coefficient, factor, standard error, and the effects that the data do not tell from it."""
    return [(name, f, e, tuple(more[0]) if more else ()) for name, f, e, *more in row.get("accused", ())]


def of_wrong_size(case: Case, row: Mapping[str, Any], flown: Flown) -> bool:
    """Return whether a coefficient is accused by a factor that is four of its errors from what flies."""
    return any(abs(f - flown(case, name)) > 4.0 * e for name, f, e, _ in accusations(row))


def answer(case: Case, row: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return the outcome of a row and its names.

    "No gap, but a coefficient is wrong, or one of these effects" is a set of that coefficient and these. A coefficient
    that was drawn as far off is told rightly, whatever else is hidden: it is none of the names.
    """
    names = list(row["names"])
    if names or row["outcome"] != NO_GAP:
        return row["outcome"], names
    for name, f, e, rivals in accusations(row):
        if abs(f - drawn(case, name)) > 4.0 * e:
            names += [n for n in (name, *rivals) if n not in names]
    return "set" if names else NO_GAP, names
