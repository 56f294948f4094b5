"""Print what a log holds: channels with rates and gaps, what was assumed, manoeuvres, and the files written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.door import read_text
from testbench.logs.layout import SUFFIXES
from testbench.logs.question import shown
from testbench.logs.stretches import FLOWN, KINDS, strip
from testbench.page.explore import View
from testbench.page.figure import COLOURS, Chart, Curve, Panel, Plate, Rule, Span, bars, rows
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table
from testbench.page.terminal import print_answer, print_rows
from testbench.page.words import counted, some
from testbench.questions.importing.ask import NOT_FLOWN, WHOLE, WINDOW_S
from testbench.questions.importing.balance import balance_rows
from testbench.questions.importing.changes import change_lines
from testbench.questions.importing.recipe import WITHOUT_STRUCTURE

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.logs.manoeuvres import Manoeuvre
    from testbench.logs.signals import Mapped
    from testbench.questions.importing.ask import Imported
    from testbench.questions.importing.balance import Signal


_MOST_UNREAD = 12
_MOST_STRETCHES = 12
STRETCHES = ("from, to", "kind", "mode", "told by")
_NUMBER = re.compile(r"\d[\d.]*")  # a cause has other numbers for every signal
_HASH, _SHORT = re.compile(r"\b([0-9a-f]{10})[0-9a-f]{30}\b"), r"\1"


def import_answer(imported: Imported) -> list[tuple[str, str]]:
    """Return what the log is and what was found in it, in sentences."""
    log, record = imported.log, imported.record
    facts = ", ".join(f"{key} {_HASH.sub(_SHORT, value)}" for key, value in log.facts.items())
    usable = sum(m.cut_s is not None for m in imported.search.manoeuvres)
    channels = f"{counted(len(imported.balance.kept), 'channel')} of the log"
    count = len(imported.balance.left_out)
    left = f"; {counted(count, 'signal that could be a channel is', 'signals that could be channels are')} left out"
    out = [
        f"the log {log.file.name} is read as {log.kind}" + (f" ({facts})" if facts else ""),
        f"the record holds {channels} over {number(record.duration_s, 4)} s on one clock at "
        f"{number(imported.rate_hz)} Hz; {number(100.0 * float(record.valid.mean()))} % of its samples were taken"
        f"{left if count else ''}",
        f"{counted(len(imported.search.manoeuvres), 'manoeuvre')} found; {usable} can be cut out, with quiet flight "
        "before and after",
    ]
    out += [record.provenance[NOT_FLOWN]] if NOT_FLOWN in record.provenance else []
    out += [f"a command? {text}" for text in imported.jumps]
    if imported.repeated:
        out.append(f"samples repeat those before, new ones come at {', '.join(imported.repeated)}")
    late = [f"{name} comes {delay.said}" for name, delay in imported.delays.items() if delay.matters]
    out += [f"channels are apart in time: {', '.join(late)}"] if late else []
    if imported.fed_back and imported.members:
        windows = [r for own in imported.members.values() for m, r in own.values() if m is None]
        which = (
            (
                f"without designed inputs: the {counted(len(windows), 'window')} of {WINDOW_S:g} s with the most "
                "excitation "
            )
            if len(windows) > 1
            else "what is cut out "
        )
        many = "are" if len(windows) > 1 else "is"
        out.append(f"{imported.fed_back}, so they respond to the motion; {which}{many} identified by filter error")
    fastest = max(c.rate_hz for c in imported.channels)
    if fastest > 1.5 * imported.rate_hz:
        out.append(
            f"logged at up to {number(fastest)} Hz and filtered to {number(imported.rate_hz)} Hz; --rate chooses"
        )
    out += imported.unusable
    out += change_lines(imported.watch) if imported.watch is not None else []
    doubts = [*(f"damage or loss: {text}" for text in (*log.warnings, *_outages(imported))), *_lost(imported)]
    doubts += imported.asked
    return [("lead", out[0]), *(("finding", text) for text in (*out[1:], *imported.balance.sensors)),
            *(("doubt", text) for text in doubts)]  # fmt: skip


def _outages(imported: Imported) -> list[str]:
    """Return a sentence on the stretches in which nothing was logged, however many channels there are."""
    outages = imported.balance.outages
    if not outages:
        return []
    first, last = max(outages, key=lambda ends: ends[1] - ends[0])
    where = f"from {number(first, 4)} to {number(last, 4)} s"
    if len(outages) == 1:
        return [f"nothing was logged {where}, of no channel"]
    out = sum(b - a for a, b in outages)
    return [f"nothing was logged, of no channel, for {number(out)} s in {len(outages)} outages, the longest {where}"]


def _lost(imported: Imported) -> list[str]:
    """Return a line per cause: the first signal that was lost by it, and the names of the others."""
    causes: dict[str, list[Signal]] = {}
    for s in imported.balance.lost:
        causes.setdefault(_NUMBER.sub("", s.reason), []).append(s)
    out = []
    for first, *others in causes.values():
        names = dict.fromkeys(s.channel or s.source for s in others)
        also = f"; likewise {', '.join(names)}" if names else ""
        out.append(f"lost: {first.channel} from {first.source}: {first.reason}{also}")
    return out


def channel_rows(imported: Imported) -> list[tuple[str, ...]]:
    """Return a row per channel: name, range with unit, rate, gaps, share taken, source, conversion, assumption."""
    return [_channel_row(c, s.valid) for c, s in zip(imported.channels, imported.balance.kept, strict=True)]


def _channel_row(c: Mapped, valid: float) -> tuple[str, ...]:
    unit = channel(c.name).unit
    factor, shown = (1.0 / DEG_RAD, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)
    low, high = float(c.values.min()) * factor, float(c.values.max()) * factor
    gaps = c.gaps
    lost = f"{len(gaps)}, longest {number(max(b - a for a, b in gaps), 2)} s" if gaps else "none"
    digits = next((n for n in (3, 4, 5, 6) if low == high or number(low, n) != number(high, n)), 6)
    extent = f"{number(low, digits)} to {number(high, digits)}{'' if shown == '1' else ' ' + shown}"
    return c.name, extent, f"{number(c.rate_hz)} Hz", lost, f"{number(100.0 * valid)} %", c.source, c.said, c.assumed


NOISE = ("channel", "noise", "quantisation", "new values", "noise at every sample", "delay")


def noise_rows(imported: Imported) -> list[tuple[str, ...]]:
    """Return a row per channel: noise where nothing happens, quantisation, rate of new values, white part, delay."""
    held = ((c.name, imported.noise[c.name]) for c in imported.channels)
    return [
        (name, shown(name, n.std), shown(name, n.step) if n.step else "none seen", f"{number(n.rate_hz)} Hz",
         shown(name, n.white), imported.delays[name].said if name in imported.delays else "not told")
        for name, n in held
    ]  # fmt: skip


def stretch_rows(imported: Imported) -> list[tuple[str, ...]]:
    """Return a row per stretch: from, to, kind of flight, mode of the autopilot, what told that it is not flight."""
    return [(f"{s.start_s:.1f} to {s.end_s:.1f} s", s.kind, s.mode or "not logged", s.why) for s in imported.stretches]


def manoeuvre_rows(imported: Imported) -> list[tuple[str, ...]]:
    """Return a row per manoeuvre: controls with amplitude, start and end of the movement, what is cut or why not."""
    return [_manoeuvre_row(m) for m in imported.search.manoeuvres]


def _manoeuvre_row(m: Manoeuvre) -> tuple[str, ...]:
    moved = []
    for name, size in zip(m.controls, m.amplitude, strict=True):
        angle = channel(name).unit == "rad"
        moved.append(f"{name} {number(size / DEG_RAD if angle else size, 2)}{' deg' if angle else ''}")
    cut = f"{m.cut_s[0]:.2f} to {m.cut_s[1]:.2f} s" if m.cut_s is not None else f"not cut: {m.reason}"
    return ", ".join(moved), f"{m.start_s:.2f} to {m.end_s:.2f} s", cut


def print_import(imported: Imported, console: Console, paths: Sequence[Path] = ()) -> None:
    """Print what the log holds, and the files written, if any."""
    from rich.text import Text

    print_answer(console, import_answer(imported))
    line, letters = strip(imported.stretches)
    console.print()
    console.print(Text(f"0 s |{line}| {number(imported.stretches[-1].end_s, 3)} s"), soft_wrap=True)
    console.print(Text(letters), soft_wrap=True)
    rows = channel_rows(imported)
    assumed: dict[str, list[str]] = {}
    for row in rows:
        if row[7]:
            assumed.setdefault(row[7], []).append(row[0])
    assumed |= {text: ["t"] for text in imported.log.assumed}
    stretches = stretch_rows(imported)
    left = [(row[0], row[1], row[2], row[3], row[5]) for row in balance_rows(imported.balance.left_out)]
    for heads, texts in (
        (("channel", "range", "rate", "gaps", "taken", "from", "conversion"), [row[:7] for row in rows]),
        (("left out", "from", "samples", "rate", "why"), left),
        (("channels", "assumed, because the log does not state it"), [(", ".join(n), t) for t, n in assumed.items()]),
        (STRETCHES, stretches[:_MOST_STRETCHES] if len(stretches) > 1 else []),
        (("controls move", "from, to", "cut"), manoeuvre_rows(imported)),
    ):
        if texts:
            console.print()
            print_rows(console, heads, texts)
    unread = [f"{s.source} ({s.samples})" for s in sorted(imported.balance.unknown, key=lambda s: -s.samples)]
    also = [f"no rule knows: {some(unread, _MOST_UNREAD, ', ')}"] if unread else []
    if unread and imported.log.file.suffix.lower() in SUFFIXES:
        also[0] += f"; testbench import {imported.log.file.name} --describe FILE.toml lets you name their channels"
    if len(stretches) > _MOST_STRETCHES:
        also.append(f"{len(stretches) - _MOST_STRETCHES} stretches more are on the page (--out)")
    said = [("finding", text) for text in (*imported.log.notes, *imported.search.said, *also)]
    if said:
        console.print()
        print_answer(console, said)
    for path in paths:
        console.print(Text(f"Written: {path}"), soft_wrap=True)
    for text in next_steps(paths):
        console.print(Text(text), soft_wrap=True)


def next_steps(paths: Sequence[Path]) -> list[str]:
    """Return what to do with the descriptions that were written; what no structure fits has frequency responses."""
    out = []
    for path in (p for p in paths if p.suffix == ".toml"):
        out.append(f"Next: testbench identify {path}")
        if f"# {WITHOUT_STRUCTURE}:" in read_text(path, "scenario"):
            out.append(f"      testbench response {path}: no structure fits its channels, but frequency responses do")
    cuts = [p for p in paths if p.suffix == ".nc" and p.stem != WHOLE]
    if len(cuts) > 1:
        out.append(
            f"If you have a model of the aircraft: testbench gap new case.toml --aircraft MODEL {cuts[0].parent}"
        )
    return out


# --- the page of a log ------------------------------------------------------------------------------------------------


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
        title=f"{name}: contents",
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
    return Table(name, title, "As logged.", columns, tuple(rows), wide=len(heads) > 4)


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

    marks = [Rule(at=s.low, text=str(k)) for k, s in enumerate(spans, 1)]
    shown = [replace(p, draws=[*p.draws, *marks], hidden=k >= _DRAWN) for k, p in enumerate(panels)]
    caption = (
        f"The record on one clock of {number(imported.rate_hz)} Hz. At the top the kind of flight: blue in flight, "
        "yellow not. Shaded, and numbered where they start when explored: the manoeuvres that were found."
    )
    if len(order) > _DRAWN:
        caption += f" {len(order) - _DRAWN} channels more can be switched on."
    chart = Chart([*([[strip]] if kinds else []), *([p] for p in panels[:_DRAWN])], share_x=True, keys=())
    return Plate("record", "Channels over time", caption, chart, [View(name="record", panels=shown)])
