"""The answer of a run in a few lines, for the head of the page and for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.words import Line, counted, sentence
from testbench.questions.run.labels import case_names
from testbench.questions.run.pole_tables import reference_tables

if TYPE_CHECKING:
    from testbench.questions.run.result import RunResult


def run_answer(result: RunResult, most_doubts: int = 4) -> list[Line]:
    """Return found against printed values, then the findings of the run, doubts last; verdicts if there are none.

    Values that are hardly meant come first among the doubts, and all of them.

    After ``most_doubts`` doubts, only the number of the others is given.
    """
    advice = tuple(a for case in result.cases for a in case.model.advice)
    told = result.findings[len(result.questions) :]
    findings = [text for text in told if not text.endswith(advice)] if advice else list(told)
    doubts = [text for text in told if text.endswith(advice)] if advice else []
    found = [*_against_printed(result), *findings]
    if not found:
        found = [
            f"{name}: {verdict}"
            for name, case in zip(case_names(result.cases), result.cases, strict=True)
            for verdict in case.evaluation.verdicts[:2]
        ]
    if len(doubts) > most_doubts:
        doubts = [
            *doubts[:most_doubts],
            f"{counted(len(doubts) - most_doubts, 'more doubt')} in the report, with the models",
        ]
    lines = [Line("lead" if i == 0 else "finding", sentence(text)) for i, text in enumerate(found)]
    return lines + [Line("doubt", sentence(text)) for text in (*result.questions, *doubts)]


def _against_printed(result: RunResult) -> list[str]:
    """Return one sentence per printed mode and estimator."""
    found: dict[tuple[str, str], list[str]] = {}
    for table in reference_tables(result):
        if table.name != "reference":
            continue
        for row in table.rows:
            text = {c.key: c.text(v) for c, v in zip(table.columns, row, strict=True)}
            printed = f"{text['printed']} (printed wn {text['printed wn']} rad/s, zeta {text['printed zeta']})"
            pole = f"wn {text['wn']} rad/s, zeta {text['zeta']}" if text["wn"] != "–" else "no such pole"
            found.setdefault((printed, text["model"]), []).append(f"{pole} from {text['outputs']}")
    return [f"{printed}: {model} finds {'; '.join(poles)}" for (printed, model), poles in found.items()]
