"""The page of a log: what it holds, its channels over time, and the manoeuvres that were found in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.logs.stretches import FLOWN, KINDS
from testbench.page.explore import Curve, Explorable, Panel, View
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.page import COMPUTED, Page
from testbench.page.plot import BAND, COLOURS, Plate, envelope, grid, label, new_figure, time_axis
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
    from matplotlib.figure import Figure

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
    spans = [(m.start_s, m.end_s) for m in imported.search.manoeuvres]

    def make(wide: bool) -> Figure:
        """Draw what was flown when, and the first channels one below the other, manoeuvres shaded."""
        shown = order[:_DRAWN]
        figure = new_figure(wide, 0.3 + 0.25 * len(kinds) + 0.2 + 0.85 * len(shown) + 0.2 * (len(shown) - 1) + 0.55)
        strip, *panels = grid(figure, 0.2, [0.25 * len(kinds), *[0.85] * len(shown)], gap_in=0.2)[:, 0]
        for k, kind in enumerate(kinds):
            bars = [(s.start_s, s.end_s - s.start_s) for s in imported.stretches if s.kind == kind]
            strip.broken_barh(bars, (k - 0.4, 0.8), color=COLOURS[0] if kind in FLOWN else COLOURS[4], linewidth=0)
        strip.set_yticks(range(len(kinds)), kinds)
        strip.set_ylim(len(kinds) - 0.5, -0.5)
        strip.set_xlim(float(record.t_s[0]), float(record.t_s[-1]))
        strip.tick_params(labelbottom=False)
        for i, (axes, name) in enumerate(zip(panels, shown, strict=True)):
            for a, b in spans:
                axes.axvspan(a, b, color=BAND, linewidth=0, zorder=0)
            axes.plot(*envelope(record.t_s, shown_unit(name)[0] * record[name]), color=COLOURS[0], linewidth=0.9)
            last = i == len(shown) - 1
            label(axes, "t, s" if last else "", axis_label(name))
            time_axis(axes)
            axes.tick_params(labelbottom=last)
        return figure

    def explore() -> Explorable:
        """Return every channel; those that are not drawn are switched off at first."""
        panels = [
            Panel(
                title=axis_label(name),
                x="t, s",
                curves=[Curve(name="as logged", x=record.t_s, y=shown_unit(name)[0] * record[name], colour=COLOURS[0])],
                marks=[(a, str(k)) for k, (a, _) in enumerate(spans, 1)],
                hidden=i >= _DRAWN,
            )
            for i, name in enumerate(order)
        ]
        return Explorable([View(name="record", panels=panels)])

    caption = (
        f"The record on one clock of {number(imported.rate_hz)} Hz. At the top the kind of flight: blue flies, yellow "
        "does not. Shaded as drawn, and numbered where they start "
        "when explored: the manoeuvres that were found."
    )
    if len(order) > _DRAWN:
        caption += f" {len(order) - _DRAWN} channels more can be switched on."
    return Plate("record", "Channels over time", caption, make, explore)
