"""How far a campaign is, on a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from testbench.page.terminal import clock

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.campaign.ask import Progress


@contextmanager
def show_progress(console: Console) -> Iterator[Callable[[Progress], None]]:
    """Give a function that shows how far a campaign is: a bar on a terminal, now and then a line elsewhere."""
    if not console.is_terminal:
        yield _lines(console)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    with Bar(
        TextColumn("fly"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), console=console
    ) as bar:
        task = bar.add_task("start workers", total=None)

        def show(p: Progress) -> None:
            """Move the bar."""
            bar.update(task, completed=p.counts.finished, total=p.counts.total, description=_words(p))

        yield show


def _lines(console: Console) -> Callable[[Progress], None]:
    said = [-math.inf]

    def show(p: Progress) -> None:
        """Print a line every ten seconds, and the last one."""
        if p.elapsed_s - said[0] >= 10.0 or p.counts.finished == p.counts.total:
            said[0] = p.elapsed_s
            console.print(f"... {p.counts.finished} of {p.counts.total} runs, {_words(p)}", highlight=False)

    return show


def _words(p: Progress) -> str:
    left = "" if p.left_s is None else f", {clock(p.left_s)} left"
    workers = f"{p.workers} worker{'' if p.workers == 1 else 's'}"
    return f"{p.counts.failed} failed, {p.rate:.1f} runs/s on {workers}{left}"
