"""Estimated parameters of a run: values, standard errors and, on simulated flights, the truth beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.tables import Column, Table, Value
from testbench.questions.run.labels import case_names

if TYPE_CHECKING:
    from testbench.questions.run.result import RunResult


def parameter_table(result: RunResult) -> Table | None:
    """Return the parameters of every model that has some, one row each; None without such a model."""
    known = any(p.true is not None for case in result.cases for p in case.evaluation.parameters)
    columns = [
        Column("model", "model"),
        Column("parameter", "parameter"),
        Column("estimate", "estimate", digits=4),
        Column("standard_error", "± std", digits=2),
        Column("standard_error_white", "± if white", digits=2),
    ]
    if known:
        columns += [Column("true", "true", digits=4), Column("error_in_std", "off by", "std", decimals=1)]
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        for p in case.evaluation.parameters:
            if not p.free:
                continue
            rows.append((name, p.name, p.value, p.std, p.std_white, *((p.true, p.deviations) if known else ())))
    if not rows:
        return None
    caption = (
        "Standard errors are corrected for residuals that are correlated in time. The column beside them gives the "
        "errors that white residuals would have. Held parameters are in the model files. SI units and radians."
    )
    if known:
        caption += (
            " True: derivatives of the linearised aircraft at trim; its elastic modes follow statically unless the "
            "model has modes of its own. The values of a model that is too simple may be many standard errors off: "
            "standard errors measure scatter, not the form of a model."
        )
    return Table("parameters", "Estimated parameters", caption, tuple(columns), tuple(rows))
