"""The page of a plan after its flights: what was promised, realised and flown, what to repeat, which card is next."""

from __future__ import annotations

import math
from typing import Any

from testbench.core.constants import PERCENT
from testbench.design.realise import INTERVAL
from testbench.page.page import COMPUTED, Content, Page, json_text, source_of
from testbench.page.tables import Column, Table, Value
from testbench.questions.design.answer import is_ratio
from testbench.questions.plan.card_text import card_stem
from testbench.questions.plan.close_answer import close_answer
from testbench.questions.plan.flown_card import DESCRIPTIONS
from testbench.questions.plan.page import close_plates
from testbench.questions.plan.verdicts import CHANCE, SLACK, Campaign, JudgedCard, Target

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


# --- tables -----------------------------------------------------------------------------------------------------------


def cards_table(campaign: Campaign) -> Table:
    """Return one row per card: runs wanted, flown, good, and to fly, and whether it may be flown."""
    closed = campaign.closed

    def promised(c: JudgedCard) -> str | None:
        """Return how many targets are known as well as promised."""
        kept = sum(t.verdict == "reached" for t in c.targets)
        return f"{kept} of {len(c.targets)}" if c.flown.runs and c.targets else None

    columns = (
        Column("card", "card", get="card.number"),
        Column("manoeuvre", "manoeuvre", get="card.spec.name"),
        Column("V", "V", "m/s", given=True, get="card.point.V_m_s"),
        Column("wanted", "runs", get="card.repeats"),
        Column("flown", "flown", get=lambda c: len(closed.of(c.card))),
        Column("good", "good", get=lambda c: len(closed.good(c.card))),
        Column("promise", "as promised", get=promised),
        Column("left", "to fly", get="more"),
        Column("go", "go?", get=lambda c: "NO-GO: " + c.go if c.go else "GO" if c.more else "done"),
    )
    caption = (
        "Runs found in the logs by what was commanded. To fly: runs that the plan misses, or that bring every target "
        "to what is wanted of it. GO: the cards of slower points are flown, and met no limit."
    )
    return Table.of("cards", "Cards", caption, columns, campaign.cards, wide=True)


def targets_table(campaign: Campaign) -> Table:
    """Return one row per card and target: promised, realised in simulation, and flown."""
    shown = "standard error of the runs that were flown"
    columns = (
        Column("card", "card"),
        Column("target", "target"),
        Column("runs", "runs"),
        Column("believed", "believed", "", "value", digits=4),
        Column("here", "at the flown speed", "", "value", digits=4),
        Column("flown", "flown", "", "value", digits=4),
        Column("stated", "± stated by the estimator", "", "value", digits=2),
        Column("error", "±", "", "value", digits=2),
        Column("unit", "unit", "", "value"),
        Column("as", "in", "", shown),
        Column("wanted", "wanted", "", shown, digits=2),
        Column("promised", "promised", "", shown, digits=2),
        Column("realised", "realised", "", shown, digits=2),
        Column("low", "from", "", shown, digits=2),
        Column("high", "to", "", shown, digits=2),
        Column("flown error", "flown", "", shown, digits=2),
        Column("differs", "off the a-priori value, in errors", digits=2),
        Column("verdict", "verdict"),
        Column("more", "more runs"),
        Column("believe", "determined?"),
    )
    rows = tuple(_row(c, t) for c in campaign.cards for t in c.targets)
    return Table("targets", "Promised, realised, flown", _caption(campaign), columns, rows, wide=True)


def _row(c: JudgedCard, t: Target) -> tuple[Value, ...]:
    e, ratio = t.estimate, is_ratio(t.name) and math.isfinite(t.believed)
    per = abs(t.believed) * PERCENT if ratio else 1.0
    own = abs(e.value) * PERCENT if ratio and e is not None and e.value else per
    units = {} if c.flown.found is None else {d.name: d.unit for d in c.flown.found.derivatives}
    low, high = (None, None) if t.realised is None else (t.realised[1] / per, t.realised[2] / per)
    return (
        c.card.number,
        t.name,
        t.runs,
        _number(t.believed),
        _number(t.here) if t.estimate is not None else None,
        None if e is None else _number(e.value),
        None if e is None else _number(e.stated),
        _number(t.error),
        "rad/s" if t.name.startswith("wn of") else units.get(t.name) or None,
        "%" if ratio else "",
        _number(t.wanted / own),
        _number(t.promised / per),
        None if t.realised is None else t.realised[0] / per,
        low,
        high,
        _number(t.error / own),
        _number(t.differs),
        t.verdict,
        t.more,
        None if e is None else e.believed,
    )


def causes_table(campaign: Campaign) -> Table:
    """Return what makes errors larger than promised, one row per card and target that has a cause."""
    columns = (Column("card", "card"), Column("target", "target"), Column("why", "why"))
    rows = tuple((c.card.number, t.name, "; ".join(t.causes)) for c in campaign.cards for t in c.targets if t.causes)
    caption = "Causes of errors larger than promised, the likeliest first."
    return Table("causes", "Targets that are known less well than promised, and why", caption, columns, rows, wide=True)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _caption(campaign: Campaign) -> str:
    out = [
        "Promised: by Fisher information, of as many runs as were flown. Realised: root mean square of simulated "
        f"flights of the design, with the {100 * INTERVAL:g} % interval of one run's, for as many runs. Flown: the "
        "error that the estimator states, with the scatter of the runs, with the excess scatter of simulated errors "
        "over stated ones, and with their mean.",
        f"The promise is kept if the error is below the one that simulated flights exceed with {100 * CHANCE:g} %, or "
        f"{SLACK:g} times the promised one. The difference is in units of the flown error and of the effect of the "
        "airspeed sensor's stated offset on the a-priori value.",
    ]
    airs = {c.flown.promise.air for c in campaign.cards if c.flown.promise is not None and c.flown.promise.air}
    if airs:
        out.append(f"Simulated in {' or '.join(sorted(airs))}.")
    bare = [str(c.card.number) for c in campaign.cards if c.flown.promise is None or c.flown.promise.realised is None]
    if bare:
        out.append(f"Not realised in simulation: card{'s' if bare[1:] else ''} {', '.join(bare)}.")
    return " ".join(out)


def runs_table(campaign: Campaign) -> Table:
    """Return one row per run that was found."""
    columns = (
        Column("card", "card", get="card.number"),
        Column("log", "log"),
        Column("start", "start", "s", decimals=2, get="start_s"),
        Column("likeness", "likeness of the command", decimals=3),
        Column("amplitude", "amplitude", "%", decimals=0, get=lambda r: r.gain / PERCENT),
        Column("V", "V before", "m/s", decimals=1, get="V_m_s"),
        Column("inside", "least part inside the band", "%", decimals=0,
               get=lambda r: 100.0 * min(r.inside.values()) if r.inside else None),
        Column("faults", "why to repeat", get=lambda r: "; ".join(r.faults) or None),
    )  # fmt: skip
    caption = (
        "Likeness is 1 for the card's own command, amplitude 100 %; a negative one has the other sign. The band is the "
        "95 % band of the card, deviations from before."
    )
    return Table.of("runs", "Runs", caption, columns, campaign.closed.runs, wide=True)
