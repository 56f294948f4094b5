"""The page of a flight plan, its tables and figures; the cards to print, signals and scripts lie beside it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import PERCENT
from testbench.core.files import write_file
from testbench.page import figure as fig
from testbench.page.html import picture, render
from testbench.page.page import Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.card_figures import card_page, card_plate, kneeboard_page
from testbench.questions.plan.card_text import card_stem, card_text, card_title, short_name, standing
from testbench.questions.plan.injection import injected_signal, lua_script, px4_script, signal_csv
from testbench.questions.plan.injection.scripts import injectable
from testbench.questions.plan.scenario import Tow

if TYPE_CHECKING:
    from testbench.questions.plan.result import Card, Plan, Point
    from testbench.questions.plan.verdicts import Campaign, Target


_SHOWN_MODES = 4
_MOST = 14  # targets that one figure shows
_KINDS = (("promised", fig.MEASURED), ("realised in simulation", fig.COLOURS[0]), ("flown", fig.COLOURS[1]))


def plan_page(plan: Plan) -> Page:
    """Return the page of a plan, with plan.csv and .json, cards as HTML and PDF, signals and scripts."""
    runs, tables, files = runs_table(plan), plan_tables(plan), signals(plan)
    stems = [(card, card_stem(card)) for card in plan.cards]
    return Page(
        kicker=f"Flight plan: {plan.name}",
        title=plan.scenario.title,
        question=plan.scenario.question,
        answer=[*plan_answer(plan)],
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


# --- tables -----------------------------------------------------------------------------------------------------------


def plan_tables(plan: Plan) -> list[Table]:
    """Return the tables of the page: flights, points, cards, damping."""
    out = [points_table(plan), cards_table(plan).without("margin", "flights", "least", "least_next")]
    if plan.flights:
        out.insert(0, flights_table(plan))
    if any(p.modes for p in plan.points):
        out.append(modes_table(plan))
    return out


def _where(of: str = "") -> tuple[Column, Column]:
    """Return speed and height of the point that lies at the end of a path of attributes."""
    return Column("V", "V", "m/s", given=True, get=f"{of}V_m_s"), Column("h", "h", "m", given=True, get=f"{of}h_m")


def runs_table(plan: Plan) -> Table:
    """Return one row per run, in the order of flying: the plan itself."""
    columns = (
        Column("run", "run", get="number"),
        Column("flight", "flight"),
        Column("start", "start", "min", decimals=1, get=lambda r: r.start_s / 60.0),
        Column("card", "card", get="card.number"),
        Column("manoeuvre", "manoeuvre", get="card.spec.name"),
        Column("plane", "motion", get="card.spec.plane"),
        Column("repeat", "repeat"),
        *_where("card.point."),
        Column("amplitude", "amplitude", "%", decimals=0, get=lambda r: 100.0 * r.card.factor),
        Column("length", "length", "s", given=True, get="card.length_s"),
        Column("used", "energy used", "Wh", decimals=1, get=lambda r: r.used_J / 3600.0),
    )
    caption = "Runs in the order of flying. Times and energy count from take-off; energy up to the end of the run."
    return Table.of("plan", "Runs", caption, columns, plan.runs)


def flights_table(plan: Plan) -> Table:
    """Return one row per flight on one battery or tank."""
    spec = plan.scenario.energy
    columns = (
        Column("flight", "flight", get="number"),
        Column("runs", "runs", get=lambda f: f"{f.first_run} to {f.last_run}"),
        Column("time", "time", "min", decimals=1, get=lambda f: f.time_s / 60.0),
        Column("energy", "energy", "Wh", decimals=1, get=lambda f: f.energy_J / 3600.0),
        Column("share", "of the usable", "%", decimals=0, get=lambda f: 100.0 * f.share),
    )
    caption = (
        f"A glider uses height: every flight may sink from {spec.release_m:g} to {spec.lowest_m:g} m."
        if (isinstance(spec, Tow))
        else (
            f"Power is thrust times speed at trim over an efficiency of {spec.efficiency_percent:g} %, and "
            f"{spec.avionics_W:g} W ({spec.source}); {spec.usable_percent:g} % of the {spec.kind} is usable."
        )
    )
    title = f"Flights, each on one {'tank' if spec.kind == 'fuel' else spec.kind}"
    return Table.of("flights", title, caption, columns, plan.flights)


def points_table(plan: Plan) -> Table:
    """Return one row per point of the build-up."""
    columns = (
        Column("point", "point", get="number"),
        *_where(),
        Column("margin", "below the onset", "%", decimals=0, get=_margin),
        Column("alpha", "α at trim", "deg", decimals=1, get=lambda p: math.degrees(p.trimmed.alpha)),
        Column("power", "level power", "W", decimals=0, get="power_W"),
        Column("least", "least elastic damping ζ", decimals=4, get=lambda p: _worst(p, "zeta")),
        Column("least_next", "predicted at the next", decimals=4, get=lambda p: _worst(p, "zeta_next")),
        Column("mode", "of the mode", get=lambda p: _worst(p, "name")),
        Column("go", "go", get=lambda p: "not cleared yet" if plan.waits(p.V_m_s) else "go"),
    )  # fmt: skip
    caption = (
        "From slow to fast. Damping is that of the linearised aircraft. A faster point is flown when `testbench modes` "
        "has cleared it from the records of the slower ones."
    )
    return Table.of("points", "Test points", caption, columns, plan.points, wide=True)


def _margin(point: Point) -> float | None:
    return None if point.margin is None else 100.0 * point.margin


def _worst(point: Point, what: str) -> Value:
    """Return what is known of the elastic mode with the least damping, here or predicted at the next point."""
    elastic = [m for m in point.modes if m.elastic]
    worst = min(elastic, key=lambda m: m.zeta if m.zeta_next is None else min(m.zeta, m.zeta_next), default=None)
    return Column(what, "").of(worst)


def cards_table(plan: Plan) -> Table:
    """Return one row per card."""

    def flights(card: Card) -> str | None:
        """Return the flights that have a run of a card."""
        return ", ".join(str(n) for n in sorted({r.flight for r in plan.runs if r.card is card})) or None

    columns = (
        Column("card", "card", get="number"),
        Column("manoeuvre", "manoeuvre", get="spec.name"),
        *_where("point."),
        Column("margin", "below onset", "%", decimals=0, get=lambda c: _margin(c.point)),
        Column("status", "status", get=standing),
        Column("amplitude", "amplitude", "%", decimals=0, get=lambda c: 100.0 * c.factor),
        Column("repeats", "runs"),
        Column("flights", "flight", get=flights),
        Column("accuracy", "accuracy reached", get=lambda c: "; ".join(r.sentence for r in c.reached) or None),
        Column("met", "limits met at full amplitude", get=lambda c: "; ".join(c.met) or None),
        Column("file", "file", get=card_stem),
        Column("least", "least elastic ζ", decimals=3, get=lambda c: _worst(c.point, "zeta")),
        Column("least_next", "next", decimals=3, get=lambda c: _worst(c.point, "zeta_next")),
    )
    caption = "Every card was flown in the simulator; a card that breaks a limit there is scaled down or refused."
    return Table.of("cards", "Cards", caption, columns, plan.cards, wide=True)


def short_cards(plan: Plan) -> Table:
    """Return the cards as a terminal shows them: point, whether it is flown, runs, flights, least damping."""
    return replace(cards_table(plan).without("amplitude", "accuracy", "met", "file"), title="")


def modes_table(plan: Plan) -> Table:
    """Return frequency and damping of every mode at every point."""
    columns = (
        Column("point", "point"),
        *_where(),
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


# --- figures ----------------------------------------------------------------------------------------------------------


def plan_plates(plan: Plan) -> list[fig.Plate]:
    """Return the figures of the plan's page; the first shows what limits the plan, elastic modes or energy."""
    out = [_build_up(plan), *([_energy(plan)] if plan.flights else [])]
    return out if _weakest(plan) else out[::-1]


def _weakest(plan: Plan) -> list[str]:
    """Return the elastic modes that are damped least at some point, the least first."""
    least: dict[str, float] = {}
    for p in plan.points:
        for m in p.modes:
            if m.elastic:
                least[m.name] = min(least.get(m.name, np.inf), m.zeta)
    return sorted(least, key=lambda n: least[n])[:_SHOWN_MODES]


def _build_up(plan: Plan) -> fig.Plate:
    names = _weakest(plan)
    caption = "Points are numbered in the order of flying: a circle as given, a diamond scaled, a square refused. " + (
        "Damping ratio of the least damped elastic modes. Dashed: onset of instability and, where the plan keeps it, "
        "the onset less the margin."
        if names
        else "The aircraft has no elastic modes: only its limits bound the build-up."
    )
    panels = [*([[_damping(plan, names)]] if names else []), [_points(plan, 1.1 if names else 1.6)]]
    return fig.Plate("build_up", "Build-up", caption, fig.Chart(panels))


def _span(plan: Plan) -> tuple[float, float]:
    """Return the range of speeds that is drawn."""
    speeds = [p.V_m_s for p in plan.points]
    onset = [p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None]
    low, high = min(speeds), max([*speeds, *onset])
    room = max(0.06 * (high - low), 0.5)
    return low - room, high + room


def _damping(plan: Plan, names: list[str]) -> fig.Panel:
    low, high = _span(plan)
    draws, top = list[fig.Drawn](), 0.0
    for envelope in plan.envelopes:
        V = np.array(envelope.speeds)
        inside = (low <= V) & (high * 1.08 >= V)
        for k, name in enumerate(names):
            zeta = np.nanmin(envelope.history(name)[1], axis=1)
            draws.append(fig.Curve(x=V[inside], y=zeta[inside], name=short_name(name), **fig.line_look(k)))
            at = [p for p in plan.points if p.h_m == envelope.h_m]
            here = np.array([(p.V_m_s, m.zeta) for p in at for m in p.modes if m.name == name]).reshape(-1, 2)
            draws.append(fig.Curve(x=here[:, 0], y=here[:, 1], colour=fig.COLOURS[k % 6], marker="o", size=4.0))
            top = max(top, float(here[:, 1].max(initial=0.0)))
    rules = [fig.Rule(at=0.0, of="y", colour=fig.INK, width=0.7), *_onsets(plan)]
    return fig.Panel(
        draws=[*draws, *rules], title="least damped elastic modes", y="damping ratio ζ", x_range=(low, high),
        y_range=(-0.25 * top, 1.15 * top), tall_in=2.3,
    )  # fmt: skip


def _onsets(plan: Plan) -> list[fig.Rule]:
    out = []
    for onset in {p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None}:
        out.append(fig.Rule(at=onset, colour=fig.WARN, width=1.1, dash=fig.DASHED))
        if not plan.scenario.allow_above_onset:
            out.append(fig.Rule(at=onset * (1.0 - plan.scenario.onset_margin_percent / 100.0), dash=fig.DASHED))
    return out


def _points(plan: Plan, tall_in: float) -> fig.Panel:
    heights = sorted({p.h_m for p in plan.points})
    draws: list[fig.Drawn] = []
    looks = {"refused": ("s", fig.WARN), "scaled": ("D", fig.COLOURS[4]), "": ("o", fig.COLOURS[2])}
    for p in plan.points:
        found = {c.status for c in plan.cards if c.point is p}
        marker, colour = looks[next((status for status in looks if status in found), "")]
        draws.append(fig.Curve(x=[p.V_m_s], y=[p.h_m], marker=marker, colour=colour, size=7.0, order=3.0))
        draws.append(fig.Words(x=p.V_m_s, y=p.h_m, text=str(p.number), shift=(0, 7), across="center", up="bottom"))
    room = max(0.25 * (heights[-1] - heights[0]), 20.0)
    return fig.Panel(
        draws=[*draws, *_onsets(plan)], title="test points", x="true airspeed V, m/s", y="h, m", x_range=_span(plan),
        y_range=(heights[0] - room, heights[-1] + 1.6 * room), tall_in=tall_in,
        y_ticks=[(h, f"{h:g}") for h in heights] if len(heights) < 5 else None,
    )  # fmt: skip


def _energy(plan: Plan) -> fig.Plate:
    """Return the energy used over the time of each flight, one after the other."""
    draws, before = list[fig.Drawn](), 0.0
    usable = plan.flights[0].usable_J / 3600.0
    for leg in plan.flights:
        mine = [r for r in plan.runs if r.flight == leg.number]
        ends = [r.start_s + r.card.length_s + plan.scenario.timing.turn_s for r in mine]
        t = before + np.array([0.0, mine[0].start_s, *ends]) / 60.0
        first = mine[0].used_J - mine[0].card.point.power_W * (ends[0] - mine[0].start_s)
        used = np.array([0.0, first, *(r.used_J for r in mine)]) / 3600.0
        draws.append(fig.Curve(x=t, y=used, colour=fig.COLOURS[0], marker=".", size=4.5, joined=True, width=1.2))
        draws.append(fig.Words(x=t[0], y=usable, text=f"flight {leg.number}", shift=(3, 3), up="bottom", size=7.5))
        before += leg.time_s / 60.0
    panel = fig.Panel(
        draws=[*draws, fig.Rule(at=usable, of="y", colour=fig.WARN, width=1.0, dash=fig.DASHED)],
        x="time in the air, min", y="energy, Wh", title="energy used in each flight", x_range=(0.0, 1.01 * before),
        y_range=(0.0, 1.12 * usable), tall_in=1.75,
    )  # fmt: skip
    caption = "One dot per run; time between flights is left out. Dashed: usable energy."
    return fig.Plate("energy", "Energy and time", caption, fig.Chart([[panel]]))


# --- after the flights ------------------------------------------------------------------------------------------------


def close_plates(campaign: Campaign) -> list[fig.Plate]:
    """Return the figure of the errors; none where nothing was promised or found."""
    targets = [(c.card.number, t) for c in campaign.cards for t in c.targets if _percent(t, t.promised) is not None]
    if not targets:
        return []
    left = len(targets) - _MOST
    shown = sorted(sorted(targets, key=lambda row: -row[1].lack)[:_MOST], key=lambda row: row[0])
    caption = (
        "Standard errors of the runs that were flown, of cards that were not, those of the planned ones. Lines: 95 % "
        "interval of what was realised. Marks: what was wanted."
        + (f" {left} more stand in the table." if left > 0 else "")
    )
    errors = np.array([[math.nan if v is None else v for v in _bars(t)] for _, t in shown])
    low, at = 0.5 * float(np.nanmin(errors)), np.arange(len(shown))
    draws: list[fig.Drawn] = [
        fig.bars(at + 0.24 * (k - 1), low, errors[:, k], 0.2, name=name, colour=colour)
        for k, (name, colour) in enumerate(_KINDS)
    ]
    for y, (_, t) in enumerate(shown):
        if t.realised is not None and t.believed:
            draws.append(fig.Curve(x=[end / abs(t.believed) / PERCENT for end in t.realised[1:]], y=[y, y], width=1.0))
    wanted = [_percent(t, t.wanted) for _, t in shown]
    x = [math.nan if v is None else v for v in wanted]
    draws.append(fig.Curve(x=x, y=at, name="wanted", marker="|", size=18.0, colour=fig.INK, order=4.0))
    panel = fig.Panel(
        draws=draws, x="standard error, % of the a-priori value", log_x=True,
        x_range=(low, 2.0 * float(np.nanmax(errors))), **fig.rows([f"{number}: {t.name}" for number, t in shown], 0.42),
    )  # fmt: skip
    return [fig.Plate("errors", "Promised, realised, flown", caption, fig.Chart([[panel]]))]


def _bars(t: Target) -> tuple[float | None, float | None, float | None]:
    """Return promised, realised and flown error, in percent of the believed value."""
    realised = math.nan if t.realised is None else t.realised[0]
    return _percent(t, t.promised), _percent(t, realised), _percent(t, t.error)


def _percent(t: Target, error: float) -> float | None:
    if not math.isfinite(error) or not t.believed or not math.isfinite(t.believed):
        return None
    return error / abs(t.believed) / PERCENT
