"""Tables of a flight plan: points, cards, runs, flights, and the damping of every mode at every point."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from testbench.page.tables import Column, Table, Value
from testbench.questions.plan.card_text import card_stem, standing
from testbench.questions.plan.scenario import Tow

if TYPE_CHECKING:
    from testbench.questions.plan.result import ModeAt, Plan, Point


def plan_tables(plan: Plan) -> list[Table]:
    """Return the tables of the page: flights, points, cards, damping."""
    out = [points_table(plan), cards_table(plan)]
    if plan.flights:
        out.insert(0, flights_table(plan))
    if any(p.modes for p in plan.points):
        out.append(modes_table(plan))
    return out


def runs_table(plan: Plan) -> Table:
    """Return one row per run, in the order of flying: the plan itself."""
    columns = (
        Column("run", "run"),
        Column("flight", "flight"),
        Column("start", "start", "min", decimals=1),
        Column("card", "card"),
        Column("manoeuvre", "manoeuvre"),
        Column("plane", "motion"),
        Column("repeat", "repeat"),
        Column("V", "V", "m/s", given=True),
        Column("h", "h", "m", given=True),
        Column("amplitude", "amplitude", "%", decimals=0),
        Column("length", "length", "s", given=True),
        Column("used", "energy used", "Wh", decimals=1),
    )
    rows: list[tuple[Value, ...]] = [
        (
            r.number,
            r.flight,
            r.start_s / 60.0,
            r.card.number,
            r.card.spec.name,
            r.card.spec.plane,
            r.repeat,
            r.card.point.V_m_s,
            r.card.point.h_m,
            100.0 * r.card.factor,
            r.card.length_s,
            r.used_J / 3600.0,
        )
        for r in plan.runs
    ]
    caption = "Runs in the order of flying. Times and energy count from take-off; energy up to the end of the run."
    return Table("plan", "Runs", caption, columns, tuple(rows))


def flights_table(plan: Plan) -> Table:
    """Return one row per flight on one battery or tank."""
    kind = plan.scenario.energy.kind
    columns = (
        Column("flight", "flight"),
        Column("runs", "runs"),
        Column("time", "time", "min", decimals=1),
        Column("energy", "energy", "Wh", decimals=1),
        Column("share", "of the usable", "%", decimals=0),
    )
    rows: list[tuple[Value, ...]] = [
        (
            f.number,
            f"{f.first_run} to {f.last_run}",
            f.time_s / 60.0,
            f.energy_J / 3600.0,
            100.0 * f.share,
        )
        for f in plan.flights
    ]
    spec = plan.scenario.energy
    caption = (
        f"A glider pays with height: every flight may sink from {spec.release_m:g} to {spec.lowest_m:g} m."
        if (isinstance(spec, Tow))
        else (
            f"Power is thrust times speed at trim over an efficiency of {spec.efficiency_percent:g} %, and "
            f"{spec.avionics_W:g} W ({spec.source}); {spec.usable_percent:g} % of the {kind} is usable."
        )
    )
    return Table("flights", f"Flights, each on one {'tank' if kind == 'fuel' else kind}", caption, columns, tuple(rows))


def points_table(plan: Plan) -> Table:
    """Return one row per point of the build-up."""

    def worst(p: Point, what: str) -> Value:
        """Return what is known of the mode of least damping."""
        return Column(what, "").of(_least_damped(p))

    columns = (
        Column("point", "point", get="number"),
        Column("V", "V", "m/s", given=True, get="V_m_s"),
        Column("h", "h", "m", given=True, get="h_m"),
        Column("margin", "below the onset", "%", decimals=0,
               get=lambda p: None if p.margin is None else 100.0 * p.margin),
        Column("alpha", "α at trim", "deg", decimals=1, get=lambda p: math.degrees(p.trimmed.alpha)),
        Column("power", "level power", "W", decimals=0, get="power_W"),
        Column("least", "least elastic damping ζ", decimals=4, get=lambda p: worst(p, "zeta")),
        Column("least_next", "predicted at the next", decimals=4, get=lambda p: worst(p, "zeta_next")),
        Column("mode", "of the mode", get=lambda p: worst(p, "name")),
        Column("go", "go", get=lambda p: "not cleared yet" if plan.waits(p.V_m_s) else "go"),
    )  # fmt: skip
    caption = (
        "From slow to fast. Damping is that of the linearised aircraft. A faster point is flown when `testbench modes` "
        "has cleared it from the records of the slower ones."
    )
    return Table.of("points", "Test points", caption, columns, plan.points, wide=True)


def _least_damped(point: Point) -> ModeAt | None:
    """Return the elastic mode with the least damping, here or predicted at the next point."""
    elastic = [m for m in point.modes if m.elastic]
    return min(elastic, key=lambda m: m.zeta if m.zeta_next is None else min(m.zeta, m.zeta_next), default=None)


def short_cards(plan: Plan) -> Table:
    """Return one row per card as a terminal shows it: its point, whether it is flown, runs, flights, least damping."""
    columns = (
        Column("card", "card"),
        Column("manoeuvre", "manoeuvre"),
        Column("V", "V", "m/s", given=True),
        Column("h", "h", "m", given=True),
        Column("margin", "below onset", "%", decimals=0),
        Column("status", "status"),
        Column("repeats", "runs"),
        Column("flights", "flight"),
        Column("least", "least elastic ζ", decimals=3),
        Column("least_next", "next", decimals=3),
    )
    rows: list[tuple[Value, ...]] = []
    for card in plan.cards:
        point, worst = card.point, _least_damped(card.point)
        flights = ", ".join(str(n) for n in sorted({r.flight for r in plan.runs if r.card is card}))
        margin = None if point.margin is None else 100.0 * point.margin
        least = (worst.zeta, worst.zeta_next) if worst else (None, None)
        rows.append(
            (
                *(card.number, card.spec.name, point.V_m_s, point.h_m, margin, standing(card), card.repeats),
                *(flights or None, *least),
            )
        )
    return Table("cards", "", "", columns, tuple(rows))


def cards_table(plan: Plan) -> Table:
    """Return one row per card."""
    columns = (
        Column("card", "card"),
        Column("manoeuvre", "manoeuvre"),
        Column("V", "V", "m/s", given=True),
        Column("h", "h", "m", given=True),
        Column("status", "status"),
        Column("amplitude", "amplitude", "%", decimals=0),
        Column("repeats", "runs"),
        Column("accuracy", "accuracy reached"),
        Column("met", "limits met at full amplitude"),
        Column("file", "file"),
    )
    rows: list[tuple[Value, ...]] = [
        (
            c.number,
            c.spec.name,
            c.point.V_m_s,
            c.point.h_m,
            standing(c),
            100.0 * c.factor,
            c.repeats,
            "; ".join(r.sentence for r in c.reached) or None,
            "; ".join(c.met) or None,
            card_stem(c),
        )
        for c in plan.cards
    ]
    caption = "Every card was flown in the simulator; a card that breaks a limit there is scaled down or refused."
    return Table("cards", "Cards", caption, columns, tuple(rows), wide=True)


def modes_table(plan: Plan) -> Table:
    """Return frequency and damping of every mode at every point."""
    columns = (
        Column("point", "point"),
        Column("V", "V", "m/s", given=True),
        Column("h", "h", "m", given=True),
        Column("mode", "mode"),
        Column("f", "f", "Hz"),
        Column("zeta", "ζ", decimals=4),
        Column("zeta_next", "ζ at the next point", decimals=4),
    )
    rows: list[tuple[Value, ...]] = [
        (p.number, p.V_m_s, p.h_m, m.name, m.f_hz, m.zeta, m.zeta_next) for p in plan.points for m in p.modes
    ]
    caption = (
        "Modes of the linearised aircraft. A mode that has split into two roots has damping 1, or −1 if one of them "
        "diverges."
    )
    return Table("damping", "Predicted modes", caption, columns, tuple(rows))
