"""The page of a run, and of an identification from recorded flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from testbench.core.scenario.base import FlownAt
from testbench.page.labels import file_stem, unique
from testbench.page.page import COMPUTED, FLOWN, Page, json_text, source_of
from testbench.page.tables import Table
from testbench.questions.files import promise_beside
from testbench.questions.run.answer import run_answer
from testbench.questions.run.figures import plates
from testbench.questions.run.labels import case_names, failed_table
from testbench.questions.run.result import found_of
from testbench.questions.run.seeds_answer import seeds_in_short
from testbench.questions.run.tables import flown_tables, result_tables, validation_table
from testbench.questions.tidy import files_of, of_found

if TYPE_CHECKING:
    import pandas as pd

    from testbench.questions.run.result import RunResult


def run_page(result: RunResult, V_m_s: float | None = None, beside: Sequence[Mapping[str, Any]] | None = None) -> Page:
    """Return the page of a run: what was flown and found, the models, and beside it the models with all digits.

    Args:
        result: of the run.
        V_m_s: airspeed of recorded flights; None if nobody knows.
        beside: for each case what its file in models/ holds beside the model.
    """
    simulated = result.truth is not None
    if isinstance(result.source, FlownAt):
        V_m_s = result.source.condition.V_m_s
    at: dict[str, Any] = {} if V_m_s is None else {"condition": {"V_m_s": V_m_s}}
    file = result.source.file if simulated else None
    if file is not None and (promise := promise_beside(file)) is not None:
        at["promise"] = promise.as_posix()  # what simulated flights of the design had: `testbench design --after`
    flown = flown_tables(result)
    stems = unique([file_stem(case.label) for case in result.cases])
    models = zip(map(file_stem, stems), result.cases, beside or [{}] * len(result.cases), strict=True)
    return Page(
        kicker=f"{'Simulated identification experiment' if simulated else 'Identification from recorded flights'}: "
        f"{result.name}",
        title=result.title,
        question=result.question,
        answer=run_answer(result),
        tables=result_tables(result),
        more_tables=flown,
        plates=plates(result),
        files={
            **{f"models/{stem}.json": json_text({**case.model.written(), **at, **more}) for stem, case, more in models},
            **files_of(tidy_run(result)),
        },
        template="questions/run/page.html.j2",
        context={
            "simulated": simulated,
            "flown": flown,
            "models": list(zip(case_names(result.cases), result.cases, strict=True)),
        },
        packages=FLOWN if simulated else COMPUTED,
        provenance=[
            *([("aircraft", result.source.aircraft)] if isinstance(result.source, FlownAt) else []),
            ("seed", str(result.seed) if simulated else "none: recorded data"),
            *_records(result),
        ],
        source=source_of(result.source),
        terminal=[*_scores_in_short(result), *([failed_table(result.failed)] if result.failed else [])],
    )


def _scores_in_short(result: RunResult) -> list[Table]:
    """Return what a terminal shows of the errors; nothing where no record is kept back, because no score is known."""
    if result.repeats is not None:
        return [seeds_in_short(result.repeats)]
    return [validation_table(result)] if any(case.validation for case in result.cases) else []


def tidy_run(result: RunResult) -> pd.DataFrame:
    """Return one row per suite, estimator and figure; see :func:`testbench.questions.tidy.read_results`."""
    flown = " + ".join(flight.name for flight in result.flights)
    aircraft = getattr(result.source, "aircraft", "")
    same = {"scenario": result.name, "aircraft": str(aircraft or ""), "input": flown}
    return of_found(found_of(result), 0, result.seed, **same)


def _records(result: RunResult) -> list[tuple[str, str]]:
    """Return (record, what it says of itself) of every flight."""
    out = []
    for flight in result.flights:
        record = flight.truth if flight.truth is not None else next(iter(flight.measured.values()))
        said = ", ".join(_words(k, v) for k, v in sorted(record.provenance.items()) if v not in ([], "", None))
        out.append((f"record {flight.name}", said or "no provenance"))
    return out


def _words(key: str, value: Any) -> str:
    """Return what a record says of itself; of a mapping its plain values alone."""
    if not isinstance(value, Mapping):
        return f"{key} {value}"
    plain = [_words(k, v) for k, v in value.items() if not isinstance(v, Mapping) and v not in ([], "", None)]
    return f"{key} ({', '.join(plain)})" if plain else key
