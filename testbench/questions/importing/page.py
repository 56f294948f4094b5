"""What a log holds, printed: channels with rates and gaps, what was assumed, manoeuvres, the files written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.page.labels import number

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.logs.manoeuvres import Manoeuvre
    from testbench.logs.signals import Mapped
    from testbench.questions.importing.ask import Imported

_MOST_UNREAD = 12


def import_answer(imported: Imported) -> list[str]:
    """Return what the log is and what was found in it, in sentences."""
    log, record = imported.log, imported.record
    facts = ", ".join(f"{key} {value}" for key, value in log.facts.items())
    usable = sum(m.cut_s is not None for m in imported.search.manoeuvres)
    out = [
        f"{log.file.name} is {log.kind}" + (f" ({facts})" if facts else ""),
        f"{len(imported.channels)} channels over {number(record.duration_s, 4)} s, put on one clock at "
        f"{number(imported.rate_hz)} Hz; {number(100.0 * float(record.valid.mean()))} % of its samples were taken",
        f"{len(imported.search.manoeuvres)} manoeuvres found, {usable} begin and end quietly and can be cut out",
    ]
    return [*out, *(f"damage or loss: {text}" for text in log.warnings)]


def channel_rows(imported: Imported) -> list[tuple[str, ...]]:
    """Return a row per channel: name, range with unit, rate, gaps and the longest, source, conversion, assumption."""
    return [_channel_row(c) for c in imported.channels]


def _channel_row(c: Mapped) -> tuple[str, ...]:
    unit = channel(c.name).unit
    factor, shown = (1.0 / DEG_RAD, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)
    low, high = float(c.values.min()) * factor, float(c.values.max()) * factor
    gaps = c.gaps
    lost = f"{len(gaps)}, longest {number(max(b - a for a, b in gaps), 2)} s" if gaps else "none"
    extent = f"{number(low)} to {number(high)}{'' if shown == '1' else ' ' + shown}"
    return c.name, extent, f"{number(c.rate_hz)} Hz", lost, c.source, c.said, c.assumed


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
    from rich.table import Table as Grid
    from rich.text import Text

    def show(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        grid = Grid(box=None, pad_edge=False)
        for head in heads:
            grid.add_column(head, overflow="fold")
        for row in rows:
            grid.add_row(*map(Text, row))  # Text: what a log says is not markup
        console.print(grid)
        console.print()

    for sentence in import_answer(imported):
        console.print(Text(f"- {sentence}."), soft_wrap=True)
    console.print()
    rows = channel_rows(imported)
    show(("channel", "range", "rate", "gaps", "from", "conversion"), [row[:6] for row in rows])
    assumed: dict[str, list[str]] = {}
    for row in rows:
        if row[6]:
            assumed.setdefault(row[6], []).append(row[0])
    if assumed:
        show(("channels", "assumed, because the log does not say it"), [(", ".join(n), t) for t, n in assumed.items()])
    if imported.search.manoeuvres:
        show(("controls move", "from, to", "cut"), manoeuvre_rows(imported))
    for sentence in imported.search.said:
        console.print(Text(f"- {sentence}."), soft_wrap=True)
    unread = sorted(imported.log.unread.items(), key=lambda item: -item[1])
    if unread:
        more = f" and {len(unread) - _MOST_UNREAD} more" if len(unread) > _MOST_UNREAD else ""
        names = ", ".join(f"{name} ({count})" for name, count in unread[:_MOST_UNREAD])
        console.print(Text(f"- Also in the log, not used: {names}{more}."), soft_wrap=True)
    for path in paths:
        console.print(Text(f"Written: {path}"), soft_wrap=True)
