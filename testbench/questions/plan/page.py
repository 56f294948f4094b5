"""The page of a flight plan; the cards to print, signals and scripts lie beside it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from testbench.page.page import Page, source_of
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.card_text import card_stem, standing
from testbench.questions.plan.cards import script_of, signals, write_cards
from testbench.questions.plan.figures import plan_plates
from testbench.questions.plan.tables import modes_table, plan_tables, runs_table, short_cards

if TYPE_CHECKING:
    from testbench.questions.plan.result import Plan


def plan_page(plan: Plan) -> Page:
    """Return the page of a plan, with plan.csv and .json, cards as HTML and PDF, signals and scripts."""
    runs, tables, files = runs_table(plan), plan_tables(plan), signals(plan)
    stems = [(card, card_stem(card)) for card in plan.cards]
    return Page(
        kicker=f"Flight plan: {plan.name}",
        title=plan.scenario.title,
        question=plan.scenario.question,
        answer=plan_answer(plan),
        tables=tables,
        more_tables=[] if any(p.modes for p in plan.points) else [modes_table(plan)],
        plates=plan_plates(plan),
        files={"plan.csv": runs.to_csv(), "plan.json": runs.to_json(), **files},
        more_files=partial(write_cards, plan),
        template="questions/plan/page.html.j2",
        context={"cards": [(card, stem, script_of(card, plan), standing(card)) for card, stem in stems]},
        flown=plan.tally,
        source=source_of(plan.scenario),
        terminal=[short_cards(plan)],
        closing=[("Cards", "{}/cards.pdf")],
    )
