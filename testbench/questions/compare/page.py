"""The page of a comparison of sensor suites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.page import Page, source_of
from testbench.questions.compare.answer import compare_answer, compare_sentences, quantity_words
from testbench.questions.compare.figures import compare_plates
from testbench.questions.compare.methods import OVER, ranked_contests
from testbench.questions.compare.tables import compare_tables, information_table
from testbench.questions.side_by_side import best_words, rank_plates
from testbench.questions.tidy import COLUMNS, files_of

if TYPE_CHECKING:
    import pandas as pd

    from testbench.questions.compare.result import CompareResult


def tidy_comparison(result: CompareResult) -> pd.DataFrame:
    """Return one row per repetition, input, suite, estimator and quantity; the value is the error of the estimate."""
    import pandas as pd

    rows = [
        (k, *case, f"error of {quantity_words(quantity)}", float(error), quantity.unit, "")
        for case, quantities in result.errors.items()
        for quantity, errors in quantities.items()
        for k, error in enumerate(errors)
    ]
    rows += [(f.repetition, *f.case, "", float("nan"), "", f.reason) for f in result.failures]
    found = pd.DataFrame(rows, columns=["run", "input", "suite", "estimator", "figure", "value", "unit", "reason"])
    same = {"scenario": result.name, "aircraft": result.scenario.aircraft, "seed": result.seed}
    none = dict.fromkeys(("truth", "standard_error"), float("nan"))
    return found.assign(**same, **none)[list(COLUMNS)].sort_values("run", kind="stable", ignore_index=True)


def compare_page(result: CompareResult) -> Page:
    """Return the page of a comparison: what each sensor buys, by simulation and by information."""
    contests = ranked_contests(result)
    first, *doubts = compare_answer(result)
    return Page(
        kicker=f"Comparison of sensor suites: {result.name}",
        title=result.scenario.title,
        question=result.scenario.question,
        answer=[first, *(("finding", text) for text in best_words(contests, OVER)), *doubts],
        tables=compare_tables(result),
        plates=[*compare_plates(result), *rank_plates(contests, OVER)],
        files=files_of(tidy_comparison(result)) if result.errors else {},
        template="questions/compare/page.html.j2",
        context={"result": result, "details": compare_sentences(result)},
        provenance=[("seed", str(result.seed))],
        flown=result.tally if result.flights else None,
        source=source_of(result.scenario),
        terminal=[information_table(result)],
    )
