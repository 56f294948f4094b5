"""The page of a plan after its flights: what was flown of each card, what must be repeated, which card is next."""

from __future__ import annotations

from testbench.page.page import COMPUTED, Content, Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.page.words import counted, listed, some
from testbench.questions.plan.card_text import card_stem
from testbench.questions.plan.close import Closed


def close_page(closed: Closed) -> Page:
    """Return the page; the record of every run lies beside it in records/, for `testbench identify`."""
    plan = closed.plan
    files: dict[str, Content] = {}
    for card in plan.cards:
        for k, run in enumerate(closed.of(card), 1):
            files[f"records/{card_stem(card)}_run_{k}.nc"] = run.record.save
    table = cards_table(closed)
    return Page(
        kicker=f"Flight plan, after the flight: {plan.name}",
        title=plan.scenario.title,
        answer=close_answer(closed),
        tables=[table, runs_table(closed)],
        files=files,
        packages=COMPUTED,
        asked=[("logs", ", ".join(closed.logs))],
        source=source_of(plan.scenario),
        terminal=[table],
    )


def close_answer(closed: Closed) -> list[tuple[str, str]]:
    """Return (kind, sentence): what was flown, what is missing, what must be repeated, and what comes next."""
    plan = closed.plan
    wanted = sum(c.repeats for c in plan.cards)
    good = sum(not r.faults for r in closed.runs)
    logs, found = counted(len(closed.logs), "log"), counted(len(closed.runs), "run")
    out = [("lead", f"{found} of {wanted} found in {logs}, {good} as their cards say")]
    never = [str(c.number) for c in plan.cards if c.repeats and not closed.of(c)]
    if never:
        out.append(("finding", f"not flown: {'cards' if never[1:] else 'card'} {listed(never)}"))
    bad = [f"card {r.card.number} at {r.start_s:.1f} s of {r.log} ({r.faults[0]})" for r in closed.runs if r.faults]
    if bad:
        out.append(("doubt", f"to be repeated: {some(bad)}"))
    following = closed.following
    if following is None:
        out.append(("finding", "every card is flown as often as it should be"))
    else:
        left = counted(closed.missing(following), "run")
        out.append(("finding", f"next is card {following.number}, {following.title}: {left}"))
    return out


def cards_table(closed: Closed) -> Table:
    """Return one row per card: runs wanted, flown, good, and to fly."""
    columns = (
        Column("card", "card"),
        Column("manoeuvre", "manoeuvre"),
        Column("V", "V", "m/s", given=True),
        Column("wanted", "runs"),
        Column("flown", "flown"),
        Column("good", "good"),
        Column("left", "to fly"),
    )
    rows: list[tuple[Value, ...]] = []
    for c in closed.plan.cards:
        found = closed.of(c)
        good = sum(not r.faults for r in found)
        rows.append((c.number, c.spec.name, c.point.V_m_s, c.repeats, len(found), good, closed.missing(c)))
    return Table("cards", "Cards", "Runs found in the logs by what was commanded.", columns, tuple(rows))


def runs_table(closed: Closed) -> Table:
    """Return one row per run that was found."""
    columns = (
        Column("card", "card"),
        Column("log", "log"),
        Column("start", "start", "s", decimals=2),
        Column("likeness", "likeness of the command", decimals=3),
        Column("V", "V before", "m/s", decimals=1),
        Column("inside", "least part inside the band", "%", decimals=0),
        Column("faults", "why to repeat"),
    )
    rows: list[tuple[Value, ...]] = [
        (
            r.card.number,
            r.log,
            r.start_s,
            r.likeness,
            r.V_m_s,
            100.0 * min(r.inside.values()) if r.inside else None,
            "; ".join(r.faults) or None,
        )
        for r in closed.runs
    ]
    caption = "Likeness is 1 for the card's own command. The band is the 95 % band of the card, deviations from before."
    return Table("runs", "Runs", caption, columns, tuple(rows), wide=True)
