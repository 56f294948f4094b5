"""The answer of a run in a few lines, for the head of the page and for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.advice import Advice
from testbench.page.words import Line, advice_lines, counted, sentence, some
from testbench.questions.run.labels import case_names, failed_sentences
from testbench.questions.run.tables import reference_tables

if TYPE_CHECKING:
    from testbench.questions.run.result import RunResult


def run_answer(result: RunResult, most_doubts: int = 4) -> list[Line]:
    """Return found against printed values, then the findings of the run; verdicts if there are none.

    What must not be used stands right after the first of them, in one sentence and the first reason if there are
    several, of which the others come after the last; then doubts, and then notes. Implausible values come first among
    the doubts, and all of them. After ``most_doubts`` of what is wrong or doubtful
    with the models, only the number of the others is given.
    """
    told = result.findings[len(result.questions) :]
    found = [*_against_printed(result), *(text for text in told if not isinstance(text, Advice))]
    doubts = advice_lines(text for text in told if isinstance(text, Advice))
    modes = {e.sentence for e in result.truth.excitation} if result.truth else set()
    if set(found) <= modes:  # how well the models predict says more than what the input shows
        found[:0] = [
            f"{name}: {verdict}"
            for name, case in zip(case_names(result.cases), result.cases, strict=True)
            for verdict in case.evaluation.verdicts[:2]
        ]
    more = len(doubts) - most_doubts
    if more > 0:
        text = f"{counted(more, 'more doubt')} in the report, with the models"
        doubts = [*doubts[:most_doubts], Line("doubt", text)]
    lines = [Line("lead" if i == 0 else "finding", text) for i, text in enumerate(found)]
    worst = [line for line in doubts if line.kind == "wrong"]
    lines[1:1] = [_unusable(result), worst[0]] if len(worst) > 1 else worst
    lines += worst[1:]
    lines += [Line("doubt", text) for text in failed_sentences(result.failed)]
    lines += [Line("doubt", text) for text in result.questions]
    lines += [line for line in doubts if line.kind != "wrong"]
    return [Line(kind, sentence(text)) for kind, text in [*lines, *_notes(result)]]


def _unusable(result: RunResult) -> Line:
    """Return which models must not be used, in one sentence; the reasons are said one by one."""
    good: list[str] = []
    bad: list[str] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        (bad if any(a.severity == "wrong" for a in case.advice) else good).append(name)
    if not good:
        which = "the model" if len(bad) == 1 else f"any of the {len(bad)} models"
        return Line("wrong", f"do not use {which}: the reasons follow")
    which = f"; usable: {some(good)}" if len(good) <= len(bad) else f": {some(bad)}"
    return Line("wrong", f"do not use {len(bad)} of {len(result.cases)} models{which}")


def _notes(result: RunResult) -> list[Line]:
    """Return each note once, with the models that it holds for; all of them need no names."""
    about: dict[str, list[str]] = {}
    for case in result.cases:
        for advice in dict.fromkeys(case.advice):
            if advice.severity == "note":
                about.setdefault(advice, []).append(case.label)
    everywhere = len(result.cases)
    return [Line("note", text if len(of) == everywhere else f"{', '.join(of)}: {text}") for text, of in about.items()]


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
