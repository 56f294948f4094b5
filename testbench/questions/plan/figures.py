"""The figures of a plan: damping of the elastic modes over speed, points, energy over time; and errors once flown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import PERCENT
from testbench.page.figure import (
    COLOURS,
    DASHED,
    INK,
    MEASURED,
    WARN,
    Chart,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Words,
    bars,
    line_look,
    rows,
)
from testbench.questions.plan.card_text import short_name

if TYPE_CHECKING:
    from testbench.questions.plan.result import Plan
    from testbench.questions.plan.verdicts import Campaign, Target

_SHOWN_MODES = 4
_MOST = 14  # targets that one figure shows
_KINDS = (("promised", MEASURED), ("realised in simulation", COLOURS[0]), ("flown", COLOURS[1]))


def plan_plates(plan: Plan) -> list[Plate]:
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


def _build_up(plan: Plan) -> Plate:
    names = _weakest(plan)
    caption = "Points are numbered in the order of flying: a circle as given, a diamond scaled, a square refused. " + (
        "Damping ratio of the least damped elastic modes. Dashed: onset of instability and, where the plan keeps it, "
        "the onset less the margin. Dotted: least admissible damping."
        if names
        else "The aircraft has no elastic modes: only its limits bound the build-up."
    )
    panels = [*([[_damping(plan, names)]] if names else []), [_points(plan, 1.1 if names else 1.6)]]
    return Plate("build_up", "Build-up", caption, Chart(panels))


def _span(plan: Plan) -> tuple[float, float]:
    """Return the range of speeds that is drawn."""
    speeds = [p.V_m_s for p in plan.points]
    onset = [p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None]
    low, high = min(speeds), max([*speeds, *onset])
    room = max(0.06 * (high - low), 0.5)
    return low - room, high + room


def _damping(plan: Plan, names: list[str]) -> Panel:
    low, high = _span(plan)
    draws, top = list[Drawn](), 0.0
    for envelope in plan.envelopes:
        V = np.array(envelope.speeds)
        inside = (low <= V) & (high * 1.08 >= V)
        for k, name in enumerate(names):
            zeta = np.nanmin(envelope.history(name)[1], axis=1)
            draws.append(Curve(x=V[inside], y=zeta[inside], name=short_name(name), **line_look(k)))
            at = [p for p in plan.points if p.h_m == envelope.h_m]
            here = np.array([(p.V_m_s, m.zeta) for p in at for m in p.modes if m.name == name]).reshape(-1, 2)
            draws.append(Curve(x=here[:, 0], y=here[:, 1], colour=COLOURS[k % 6], marker="o", size=4.0))
            top = max(top, float(here[:, 1].max(initial=0.0)))
    rules = [
        Rule(at=0.0, of="y", colour=INK, width=0.7),
        *_onsets(plan),
    ]
    return Panel(
        draws=[*draws, *rules], title="least damped elastic modes", y="damping ratio ζ", x_range=(low, high),
        y_range=(-0.25 * top, 1.15 * top), tall_in=2.3,
    )  # fmt: skip


def _onsets(plan: Plan) -> list[Rule]:
    out = []
    for onset in {p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None}:
        out.append(Rule(at=onset, colour=WARN, width=1.1, dash=DASHED))
        if not plan.scenario.allow_above_onset:
            out.append(Rule(at=onset * (1.0 - plan.scenario.onset_margin_percent / 100.0), dash=DASHED))
    return out


def _points(plan: Plan, tall_in: float) -> Panel:
    heights = sorted({p.h_m for p in plan.points})
    draws: list[Drawn] = []
    looks = {"refused": ("s", WARN), "scaled": ("D", COLOURS[4]), "": ("o", COLOURS[2])}
    for p in plan.points:
        found = {c.status for c in plan.cards if c.point is p}
        marker, colour = looks[next((status for status in looks if status in found), "")]
        draws.append(Curve(x=[p.V_m_s], y=[p.h_m], marker=marker, colour=colour, size=7.0, order=3.0))
        draws.append(Words(x=p.V_m_s, y=p.h_m, text=str(p.number), shift=(0, 7), across="center", up="bottom"))
    room = max(0.25 * (heights[-1] - heights[0]), 20.0)
    return Panel(
        draws=[*draws, *_onsets(plan)], title="test points", x="true airspeed V, m/s", y="h, m", x_range=_span(plan),
        y_range=(heights[0] - room, heights[-1] + 1.6 * room), tall_in=tall_in,
        y_ticks=[(h, f"{h:g}") for h in heights] if len(heights) < 5 else None,
    )  # fmt: skip


def _energy(plan: Plan) -> Plate:
    """Return the energy used over the time of each flight, one after the other."""
    draws, before = list[Drawn](), 0.0
    usable = plan.flights[0].usable_J / 3600.0
    for leg in plan.flights:
        mine = [r for r in plan.runs if r.flight == leg.number]
        ends = [r.start_s + r.card.length_s + plan.scenario.timing.turn_s for r in mine]
        t = before + np.array([0.0, mine[0].start_s, *ends]) / 60.0
        first = mine[0].used_J - mine[0].card.point.power_W * (ends[0] - mine[0].start_s)
        used = np.array([0.0, first, *(r.used_J for r in mine)]) / 3600.0
        draws.append(Curve(x=t, y=used, colour=COLOURS[0], marker=".", size=4.5, joined=True, width=1.2))
        draws.append(Words(x=t[0], y=usable, text=f"flight {leg.number}", shift=(3, 3), up="bottom", size=7.5))
        before += leg.time_s / 60.0
    panel = Panel(
        draws=[*draws, Rule(at=usable, of="y", colour=WARN, width=1.0, dash=DASHED)], x="time in the air, min",
        y="energy, Wh", title="energy used in each flight", x_range=(0.0, 1.01 * before),
        y_range=(0.0, 1.12 * usable), tall_in=1.75,
    )  # fmt: skip
    caption = "One dot per run; time between flights is left out. Dashed: usable energy."
    return Plate("energy", "Energy and time", caption, Chart([[panel]]))


# --- after the flights ------------------------------------------------------------------------------------------------


def close_plates(campaign: Campaign) -> list[Plate]:
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
    draws: list[Drawn] = [
        bars(at + 0.24 * (k - 1), low, errors[:, k], 0.2, name=name, colour=colour)
        for k, (name, colour) in enumerate(_KINDS)
    ]
    for y, (_, t) in enumerate(shown):
        if t.realised is not None and t.believed:
            draws.append(Curve(x=[end / abs(t.believed) / PERCENT for end in t.realised[1:]], y=[y, y], width=1.0))
    wanted = [_percent(t, t.wanted) for _, t in shown]
    x = [math.nan if v is None else v for v in wanted]
    draws.append(Curve(x=x, y=at, name="wanted", marker="|", size=18.0, colour=INK, order=4.0))
    panel = Panel(
        draws=draws, x="standard error, % of the believed value", log_x=True,
        x_range=(low, 2.0 * float(np.nanmax(errors))), **rows([f"{number}: {t.name}" for number, t in shown], 0.42),
    )  # fmt: skip
    return [Plate("errors", "Promised, realised, flown", caption, Chart([[panel]]))]


def _bars(t: Target) -> tuple[float | None, float | None, float | None]:
    """Return promised, realised and flown error, in percent of the believed value."""
    realised = math.nan if t.realised is None else t.realised[0]
    return _percent(t, t.promised), _percent(t, realised), _percent(t, t.error)


def _percent(t: Target, error: float) -> float | None:
    if not math.isfinite(error) or not t.believed or not math.isfinite(t.believed):
        return None
    return error / abs(t.believed) / PERCENT
