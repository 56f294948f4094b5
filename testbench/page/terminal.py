"""The terminal: how commands print the running stage, answers and tables."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from testbench.page.tables import Table
    from testbench.page.words import Answer

_STYLES = {"lead": "bold", "wrong": "bold red", "doubt": "yellow"}


def console() -> Any:
    """Return a console on standard output."""
    from rich.console import Console

    return Console()


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Show the stage that is running: a spinner with the time elapsed on a terminal, plain lines elsewhere."""
    from rich.console import Console

    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield lambda text: print(f"... {text}", file=sys.stderr, flush=True)
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=screen, transient=True
    ) as progress:
        task = progress.add_task("start", total=None)
        yield lambda text: progress.update(task, description=text)


def print_answer(console: Console, answer: Answer) -> None:
    """Print the sentences of an answer, one below the other, without notes: the lead in bold, doubts in yellow."""
    from rich.table import Table as Grid
    from rich.text import Text

    from testbench.page.words import answer_lines

    grid = Grid.grid(padding=(0, 1))
    for kind, text in answer_lines(answer):
        if kind != "note":
            grid.add_row("-", Text(text, style=_STYLES.get(kind, "")))
    console.print(grid)


def print_table(console: Console, table: Table) -> None:
    """Print a table with its title: numbers to the right, units beside the heads, no column without any value."""
    from testbench.page.tables import MISSING

    values = zip(table.columns, zip(*table.rows, strict=True), strict=False)
    table = table.only(*(c.key for c, found in values if any(c.text(v) != MISSING for v in found)))
    heads = [", ".join(filter(None, (c.head, c.unit))) for c in table.columns]
    rows = [[text for text, _ in row] for row in table.cells()]
    print_rows(console, heads, rows, table.numeric(), table.title)


def print_rows(
    console: Console,
    heads: Sequence[str],
    rows: Sequence[Sequence[str | Text]],
    right: Sequence[bool] = (),
    title: str = "",
) -> None:
    """Print rows of texts under their heads; columns that are ``right`` stand to the right. No text is markup."""
    from rich.table import Table as Grid
    from rich.text import Text

    grid = Grid(title=Text(title) if title else None, title_justify="left", title_style="", box=None, pad_edge=False)
    for k, head in enumerate(heads):
        justify: Any = "right" if right and right[k] else "left"
        grid.add_column(Text(head), justify=justify, overflow="fold")
    for row in rows:
        grid.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    console.print(grid)
