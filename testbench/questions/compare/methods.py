"""The estimators of a comparison side by side: what each errs by through the same suite."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.questions.compare.answer import quantity_words
from testbench.questions.compare.result import CaseKey
from testbench.questions.side_by_side import Contest

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.compare.result import CompareResult, Quantity

OVER = "repetitions of every input"


def contests(result: CompareResult) -> list[Contest]:
    """Return every error that two or more estimators give through the same suite from the same input."""
    out = []
    for manoeuvre in result.manoeuvres:
        for suite in result.suites:
            by_quantity: dict[Quantity, dict[str, FloatArray]] = {}
            for label in result.scenario.identification.labels:
                for quantity, errors in result.errors.get(CaseKey(manoeuvre, suite.name, label), {}).items():
                    by_quantity.setdefault(quantity, {})[label] = np.abs(errors)
            where = f"{suite.name}, {manoeuvre}"
            out += [
                Contest(where, quantity_words(q), q.unit, tuple(found), np.column_stack(list(found.values())))
                for q, found in by_quantity.items()
                if len(found) > 1
            ]
    return out


def ranked_contests(result: CompareResult) -> list[Contest]:
    """Return the errors of prediction by suite, the mean over the outputs that all estimators predict."""
    out = []
    for suite in result.suites:
        found = [
            (label, [result.errors.get(CaseKey(m, suite.name, label), {}) for m in result.manoeuvres])
            for label in result.scenario.identification.labels
        ]
        found = [(label, of) for label, of in found if all(of)]
        common = [
            q
            for q in (found[0][1][0] if found else {})
            if q.kind == "prediction" and all(q in e for _, of in found for e in of)
        ]
        if len(found) < 2 or not common:
            continue
        means = [np.concatenate([np.mean([e[q] for q in common], axis=0) for e in of]) for _, of in found]
        names = tuple(label for label, _ in found)
        out.append(Contest(suite.name, "prediction, mean over the outputs", "%", names, np.column_stack(means)))
    return out
