"""The page of a designed input; scenarios and signals ready to fly lie beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.page import Page, source_of
from testbench.page.words import counted
from testbench.questions.design.answer import air_words, design_sentences, limit_rows
from testbench.questions.design.figures import design_plates
from testbench.questions.design.ready import ready_to_fly
from testbench.questions.design.tables import design_tables, known_table, short_ranking, short_realised

if TYPE_CHECKING:
    from testbench.questions.design.known import AllKnown
    from testbench.questions.design.result import DesignResult
    from testbench.questions.design.scenario import DesignScenario


def design_page(result: DesignResult) -> Page:
    """Return the page of a design: what to fly, the ranking, and what prevents more accuracy."""
    scenario, ready = result.scenario, ready_to_fly(result)
    ranking, *others = design_tables(result)
    known = next((t for t in others if t.name == "known"), None)
    estimated = ", ".join(result.problem.experiment.structure.parameter_names)
    return Page(
        kicker=f"Input design: {result.name}",
        title=scenario.title,
        question=scenario.question,
        answer=design_sentences(result),
        tables=others,
        more_tables=[ranking],
        plates=design_plates(result),
        files=ready,
        template="questions/design/page.html.j2",
        context={"ranking": ranking, "ready": [path for path in ready if path.startswith("designs/")]},
        asked=[
            ("aircraft", result.aircraft.title),
            ("condition", f"{scenario.condition.V_m_s:g} m/s at {scenario.condition.h_m:g} m"),
            ("sensors", result.ensemble.range_.suite.title),
            ("flown by", f"{scenario.by}, steps of {scenario.shortest_s:g} s or longer"),
            ("time", f"{scenario.duration_s:g} s, the first {scenario.start_s:g} s undisturbed"),
            *([("flown before", result.known.prior.source)] if result.known is not None else []),
            *([("uncertainty", _drawn_words(result))] if result.draws is not None else []),
            ("air", air_words(result)),
            ("limits", "; ".join(limit_rows(result))),
            ("estimated", f"{estimated}; everything else is taken as known"),
        ],
        flown=result.tally,
        provenance=[("seed", str(scenario.seed))],
        source=source_of(scenario),
        terminal=[
            *([known.without("model", "value")] if known is not None else []),
            short_ranking(result),
            *([short_realised(result)] if result.best.realised else []),
        ],
        closing=[("Ready to fly", "testbench run {}/designs/1_*.toml")],
    )


def nothing_page(scenario: DesignScenario, found: AllKnown) -> Page:
    """Return the page of a design that needs no flight: what was flown before tells every target."""
    table = known_table(found.problem, found.known)
    return Page(
        kicker=f"Input design: {scenario.name}",
        title=scenario.title,
        question=scenario.question,
        answer=[
            f"Nothing has to be flown: every wanted accuracy is reached by {found.known.prior.source}",
            *found.known.notes,
        ],
        tables=[table],
        source=source_of(scenario),
        terminal=[table],
    )


def _drawn_words(result: DesignResult) -> str:
    """Return what was drawn, and what it decides."""
    assert result.draws is not None
    who = f"{result.aircraft.name} states" if result.aircraft.uncertainty else "handbooks reach"
    chosen = "the worst of them" if result.scenario.robust else "the believed aircraft"
    return (
        f"{counted(result.draws.asked, 'aircraft', 'aircraft')} drawn by what {who} of its coefficients; "
        f"input and amplitude are chosen for {chosen}"
    )
