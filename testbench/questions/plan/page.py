"""The page of a flight plan; the cards to print, signals and scripts lie beside it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.files import write_file
from testbench.page.html import picture, render
from testbench.page.page import Page, source_of
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.card_figures import card_page, card_plate, kneeboard_page
from testbench.questions.plan.card_text import card_stem, card_text, card_title, standing
from testbench.questions.plan.figures import plan_plates
from testbench.questions.plan.injection import injected_signal, lua_script, px4_script, signal_csv
from testbench.questions.plan.injection.lua import injectable
from testbench.questions.plan.tables import modes_table, plan_tables, runs_table, short_cards

if TYPE_CHECKING:
    from testbench.questions.plan.result import Card, Plan


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
        closing=[("Cards", "{}/cards.pdf"), *([("Kneeboard", "{}/kneeboard.pdf")] if plan.runs else [])],
    )


# --- the files of every card: the card itself as HTML and PDF, its signal, and the script of an autopilot -------------


_HAND_PERIOD_MS = 20


def write_cards(plan: Plan, folder: Path) -> list[Path]:
    """Write cards/NAME.html and NAME.pdf, one page A4 each, and cards.pdf with all of them; return the paths.

    kneeboard.pdf, A5, has what a card is flown by; refused cards have no page in it.
    """
    from testbench.page.draw import pdf_pages, styled

    out = []
    pages = [styled(card_page(card, plan)) for card in plan.cards]
    for card, page in zip(plan.cards, pages, strict=True):
        stem = card_stem(card)
        html = render(
            "questions/plan/card.html.j2",
            card=card,
            count=len(plan.cards),
            title=plan.scenario.title,
            head=card_title(card, plan),
            text=card_text(card, plan),
            picture=picture(card_plate(card, plan)),
        )
        out.append(write_file(folder / "cards" / f"{stem}.html", html))
        out.append(write_file(folder / "cards" / f"{stem}.pdf", pdf_pages([page])))
    out.append(write_file(folder / "cards.pdf", pdf_pages(pages)))
    knees = [styled(kneeboard_page(card, plan)) for card in plan.cards if card.status != "refused"]
    if knees:
        out.append(write_file(folder / "kneeboard.pdf", pdf_pages(knees)))
    return out


def signals(plan: Plan) -> dict[str, str]:
    """Return signals/NAME.csv of every card and, where an autopilot flies it, its script, as path -> text."""
    scenario = plan.scenario
    by_autopilot = scenario.flown_by == "autopilot"
    period = scenario.autopilot.period_ms if by_autopilot else _HAND_PERIOD_MS
    out = {}
    for card in plan.cards:
        stem = card_stem(card)
        out[f"signals/{stem}.csv"] = signal_csv(injected_signal(card, period), plan.aircraft)
        path = script_of(card, plan)
        if path is not None:
            write = lua_script if path.endswith(".lua") else px4_script
            out[path] = write(card, plan.aircraft, scenario.autopilot)
    return out


def script_of(card: Card, plan: Plan) -> str | None:
    """Return where the script that flies a card lies in the folder of the plan, or None if there is none."""
    autopilot = plan.scenario.autopilot
    if plan.scenario.flown_by != "autopilot" or not autopilot.scripted or not injectable(card):
        return None
    return f"injection/{card_stem(card)}{'.lua' if autopilot.system == 'ardupilot' else '.py'}"
