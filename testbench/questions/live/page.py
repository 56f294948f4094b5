"""The page of a flight that was followed: derivatives as they came, and all that was called out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.figure import COLOURS, Chart, Curve, Drawn, Panel, Plate, Rule, band
from testbench.page.page import FLOWN, Page
from testbench.page.tables import Column, Table
from testbench.questions.live.answer import called, live_answer

if TYPE_CHECKING:
    from testbench.questions.live.ask import Session

_PLANES = ("longitudinal", "lateral")
_ACROSS = 2


def live_page(session: Session) -> Page:
    """Return the page of a session."""
    return Page(
        kicker=f"In flight: {session.source}",
        title=f"{session.aircraft.name} as it flew",
        answer=live_answer(session),
        tables=[_derivatives(session), _calls(session)],
        more_tables=[_rates(session)],
        plates=[plate for plane in _PLANES if (plate := _history(session, plane)) is not None],
        files={"updates.jsonl": "".join(u.line() for u in session.updates)},
        packages=FLOWN,
    )


def _derivatives(session: Session) -> Table:
    columns = (
        Column("derivative", "derivative", get="name"),
        Column("value", "value"),
        Column("half", "± (95 %)", digits=2),
        Column("believed", "believed"),
        Column("wanted", "wanted std", digits=2, get=lambda e: e.wanted or None),
        Column("reached", "as wanted", get=lambda e: e.reached if e.wanted else None),
        Column("more_s", "more manoeuvres", "s", digits=2, get=lambda e: e.more_s or None),
    )
    rows = [e for plane in _PLANES for e in session.latest(plane)]
    caption = "SI units and radians, at the trim of the last run; errors allow for residuals that are coloured."
    return Table.of("derivatives", "Derivatives when the flight ended", caption, columns, rows)


def _calls(session: Session) -> Table:
    columns = (Column("t_s", "time", "s", decimals=1), Column("call", "what was called", get=called))
    return Table.of("calls", "What was called out", "In the order of the flight.", columns, session.calls, wide=True)


def _rates(session: Session) -> Table:
    columns = (
        Column("channel", "channel", get=lambda x: x[0]),
        Column("hz", "rate", "Hz", decimals=1, get=lambda x: x[1].hz),
        Column("lost", "lost", "%", decimals=1, get=lambda x: 100.0 * x[1].lost),
        Column("jitter", "jitter of arrival", "ms", decimals=1, get=lambda x: 1000.0 * x[1].jitter_s),
    )
    return Table.of("link", "What the link gave", "Over the first seconds.", columns, session.rates.items())


def _history(session: Session, plane: str) -> Plate | None:
    updates = [u for u in session.updates if u.estimates.get(plane)]
    names = [e.name for e in session.latest(plane) if e.wanted]
    if len(updates) < 2 or not names:
        return None
    t = np.array([u.t_s for u in updates])
    panels = []
    for name in names:
        of = [next(e for e in u.estimates[plane] if e.name == name) for u in updates]
        value, half = np.array([e.value for e in of]), np.array([e.half for e in of])
        most = 3.0 * max(
            abs(of[-1].value), abs(of[-1].believed or 0.0), float(half[-1])
        )  # beyond it the first seconds lie
        # The first seconds lie far beyond.
        low, value, high = (np.clip(x, -most, most) for x in (value - half, value, value + half))
        draws: list[Drawn] = [band(t, low, high, COLOURS[0]), Curve(x=t, y=value, colour=COLOURS[0], width=1.4)]
        if of[-1].believed is not None:
            draws.append(Rule(at=of[-1].believed, of="y"))
        panels.append(Panel(draws=draws, title=name, x="time, s", tall_in=1.2))
    rows = [panels[k : k + _ACROSS] for k in range(0, len(panels), _ACROSS)]
    caption = "Each derivative with its 95 % interval as the samples came; the line is the believed value."
    return Plate(f"history_{plane}", f"{plane.capitalize()} derivatives in flight", caption, Chart(rows, aligned=True))
