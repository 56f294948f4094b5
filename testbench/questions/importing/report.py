"""The page of a log: what it holds, its channels over time, and the manoeuvres that were found in it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from testbench.logs.stretches import FLOWN, KINDS
from testbench.page.explore import View
from testbench.page.figure import COLOURS, Chart, Curve, Panel, Plate, Rule, Span, bars, rows
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table
from testbench.page.words import counted
from testbench.questions.importing.page import (
    NOISE,
    STRETCHES,
    channel_rows,
    import_answer,
    manoeuvre_rows,
    noise_rows,
    stretch_rows,
)

if TYPE_CHECKING:
    from testbench.questions.importing.ask import Imported

_FIRST = ("de", "de_cmd", "da", "dr", "V", "alpha", "q", "az", "theta", "p", "r", "h")
_DRAWN = 6  # channels that the figure shows; a reader switches the others on


def import_page(imported: Imported) -> Page:
    """Return the page of a log."""
    name = imported.log.file.name
    usable = sum(m.cut_s is not None for m in imported.search.manoeuvres)
    lead = (
        f"{counted(len(imported.search.manoeuvres), 'manoeuvre')}, {usable} ready to identify from, in "
        f"{number(imported.record.duration_s)} s of {counted(len(imported.channels), 'channel')} at "
        f"{number(imported.rate_hz)} Hz"
    )
    lines = [("finding" if kind == "lead" else kind, text) for kind, text in import_answer(imported)]
    tables = [
        _table("channels", "Channels", _CHANNELS, channel_rows(imported)),
        _table("stretches", "What was flown", STRETCHES, stretch_rows(imported)),
        _table("noise", "Noise", NOISE, noise_rows(imported)),
        _table("manoeuvres", "Manoeuvres", ("controls", "from, to", "cut"), manoeuvre_rows(imported)),
    ]
    digest = str(imported.record.provenance.get("sha256", ""))
    return Page(
        kicker=f"Flight log: {name}",
        title=f"{name}: what it holds",
        question="Which channels and manoeuvres are in this log, and can they be used?",
        answer=[("lead", lead), *lines],
        tables=[table for table in tables if table.rows],
        plates=[_plate(imported)],
        packages=COMPUTED,
        provenance=[("log", name), ("sha256", digest)],
    )


_CHANNELS = ("channel", "range", "rate", "gaps", "taken", "from", "conversion", "assumed")


def _table(name: str, title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    columns = tuple(Column(head.replace(", ", "_"), head) for head in heads)
    return Table(name, title, "As the log has them.", columns, tuple(rows), wide=len(heads) > 4)


def _plate(imported: Imported) -> Plate:
    record = imported.record
    order = [n for n in _FIRST if n in record] + [n for n in record.channels if n not in _FIRST]
    kinds = [kind for kind in KINDS if any(s.kind == kind for s in imported.stretches)]
    spans = [Span(low=m.start_s, high=m.end_s) for m in imported.search.manoeuvres]
    look: dict[str, Any] = {"name": "as logged", "colour": COLOURS[0], "width": 0.9}
    panels = [
        Panel(
            draws=[Curve(x=record.t_s, y=shown_unit(name)[0] * record[name], **look), *spans], x="t, s",
            y=axis_label(name), tall_in=0.85,
        )
        for name in order
    ]  # fmt: skip
    ends = (float(record.t_s[0]), float(record.t_s[-1]))
    strip = Panel(
        draws=[
            bars(
                [k] * len(found),
                [s.start_s for s in found],
                [s.end_s for s in found],
                0.8,
                colour=COLOURS[0] if kind in FLOWN else COLOURS[4],
            )
            for k, kind in enumerate(kinds)
            for found in [[s for s in imported.stretches if s.kind == kind]]
        ],
        x="t, s", x_range=ends, **rows(kinds, 0.25),
    )  # fmt: skip

    def explore() -> list[View]:
        """Return every channel, manoeuvres numbered; those that are not drawn are switched off at first."""
        marks = [Rule(at=s.low, text=str(k)) for k, s in enumerate(spans, 1)]
        shown = [replace(p, draws=[*p.curves, *marks], hidden=k >= _DRAWN) for k, p in enumerate(panels)]
        return [View(name="record", panels=shown)]

    caption = (
        f"The record on one clock of {number(imported.rate_hz)} Hz. At the top the kind of flight: blue flies, yellow "
        "does not. Shaded as drawn, and numbered where they start "
        "when explored: the manoeuvres that were found."
    )
    if len(order) > _DRAWN:
        caption += f" {len(order) - _DRAWN} channels more can be switched on."
    chart = Chart([*([[strip]] if kinds else []), *([p] for p in panels[:_DRAWN])], share_x=True, keys=())
    return Plate("record", "Channels over time", caption, chart, explore)
