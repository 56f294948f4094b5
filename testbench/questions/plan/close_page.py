"""The page of a plan after its flights: what was promised, realised and flown, what to repeat, which card is next."""

from __future__ import annotations

import math
from typing import Any

from testbench.page.page import COMPUTED, Content, Page, source_of
from testbench.page.write import json_text
from testbench.questions.plan.card_text import card_stem
from testbench.questions.plan.close_answer import close_answer
from testbench.questions.plan.close_tables import cards_table, causes_table, runs_table, targets_table
from testbench.questions.plan.figures import close_plates
from testbench.questions.plan.flown_card import DESCRIPTIONS
from testbench.questions.plan.verdicts import Campaign, JudgedCard

_SHORT = ("card", "target", "flown", "error", "as", "promised", "realised", "flown error", "verdict", "more")


def close_page(campaign: Campaign) -> Page:
    """Return the page; the model of every card lies beside it in models/.

    The records of the runs in records/ and their descriptions in identify/ lie there since the cards were identified.
    """
    files: dict[str, Content] = {}
    notes, descriptions = [], []
    for c in campaign.cards:
        if c.flown.case is not None:
            files[f"models/{card_stem(c.card)}.json"] = json_text(_written(c))
        if c.flown.file is not None:
            descriptions.append(c.flown.file.name)
        notes += [f"card {c.card.number}: {text}" for text in c.flown.notes]
    targets = targets_table(campaign)
    tables = [t for t in (targets, causes_table(campaign)) if t.rows]
    short = targets.only(*_SHORT)
    closing = [("Identify again", f"testbench identify {{}}/{DESCRIPTIONS}/{descriptions[0]}")] if descriptions else []
    return Page(
        kicker=f"Flight plan, after the flight: {campaign.plan.name}",
        title=campaign.plan.scenario.title,
        answer=[*close_answer(campaign), *(("note", text) for text in notes)],
        tables=[*tables, cards_table(campaign), runs_table(campaign)],
        plates=close_plates(campaign),
        files=files,
        packages=COMPUTED,
        asked=[("logs", ", ".join(campaign.closed.logs))],
        source=source_of(campaign.plan.scenario),
        terminal=[cards_table(campaign).without("promise"), *([short] if targets.rows else [])],
        closing=closing,
    )


def _written(c: JudgedCard) -> dict[str, Any]:
    """Return the model of a card, with what `testbench design --after` asks for: the condition, and flown errors.

    They hold the scatter of the runs and what estimates in simulated flights of the design had beyond stated errors.
    """
    assert c.flown.case is not None
    errors = {t.name: t.error for t in c.targets if t.estimate is not None and math.isfinite(t.error)}
    V = c.card.point.V_m_s if c.flown.V_m_s is None else c.flown.V_m_s
    return {**c.flown.case.model.written(), "condition": {"V_m_s": V, "h_m": c.card.point.h_m}, "flown_errors": errors}
