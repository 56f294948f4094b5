"""The terminal: how commands print the running stage, answers and tables."""

from __future__ import annotations

import io
import json
import os
import re
import sys
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from testbench.page.tables import Table
    from testbench.page.words import Answer

PLAIN = {
    "°": " deg", "¹": "^1", "²": "^2", "³": "^3", "⁴": "^4", "⁰": "^0", "⁻": "^-", "±": "+/-", "×": "x", "·": ".",
    "–": "-", "—": "-", "−": "-", "…": "...", "’": "'", "‘": "'", "“": '"', "”": '"', "√": "sqrt ", "≤": "<=",
    "≥": ">=", "≈": "~", "α": "alpha", "β": "beta", "θ": "theta", "φ": "phi", "ψ": "psi", "ζ": "zeta", "ω": "omega",
    "σ": "sigma", "τ": "tau", "λ": "lambda", "μ": "mu", "µ": "u", "δ": "delta", "η": "eta", "π": "pi", "Δ": "Delta",
}  # fmt: skip
"""What stands for a sign where the terminal has no other way to show it."""
_WORD = 26  # letters of a word that stand side by side at least; longer ones, such as paths, are broken
_HEAD = 10  # letters of a word above numbers that stand side by side at least
_WORDS = re.compile("(?<!±)[ \n](?!±)")  # what stands between words; "0.10 ± 0.02" is one
_COUNTS = re.compile(r"\b(\d+) of (\d+)\b")
_LINES_S = 5.0  # between lines of a stage that counts
_TOLD_S = 2.0  # that a stage has run before it is said how long it still takes
_LEAST = 8  # letters of a text that stand side by side at least
_STYLES = {"lead": "bold", "wrong": "bold red", "doubt": "yellow"}


@dataclass
class Manner:
    """How a command answers, and what it has answered so far."""

    # "" in few lines, "quiet" with the first sentence and where the result lies, "verbose" with all of it, "json" with
    # the result as the API gives it
    how: str = ""
    # of the one JSON object that "json" prints when the command ends
    content: dict[str, Any] = field(default_factory=dict)


_MANNER: ContextVar[Manner] = ContextVar("how commands answer", default=Manner())  # noqa: B039


def manner() -> Manner:
    """Return how the running command answers."""
    return _MANNER.get()


@contextmanager
def in_manner(how: str) -> Iterator[None]:
    """Let commands answer in one manner within the block; see :class:`Manner`.

    What a command prints as "json" is kept, and becomes one object when the block ends without an error; lines that
    have no structure stand in it under "said".
    """
    new = Manner(how)
    token = _MANNER.set(new)
    try:
        if how != "json":
            yield
            return
        said = io.StringIO()
        with redirect_stdout(said):
            yield
        lines = said.getvalue().splitlines()
        print(json.dumps(new.content | ({"said": lines} if lines else {}), indent=1, ensure_ascii=False))
    finally:
        _MANNER.reset(token)


class _Unheard(io.FileIO):
    """Standard error: what cannot be written is dropped, so that work does not end for want of somebody to tell."""

    def write(self, content: Any) -> int:
        try:
            return super().write(content)
        except OSError:
            return len(content)


def open_streams() -> None:
    """Let the three standard streams stand for what a command needs of them, however a shell left them.

    A closed one becomes the null device: else the next file that is opened takes its place, and is written into by what
    prints. Standard error drops what it cannot write. Texts with signs that an encoding lacks are written in ASCII.
    """
    import codecs

    codecs.register_error("in_ascii", _in_ascii)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            stream = open(number, "w" if number else "r", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
        if number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="in_ascii")
    if sys.stderr is sys.__stderr__ and isinstance(sys.stderr, io.TextIOWrapper):
        unheard = io.BufferedWriter(_Unheard(2, "w", closefd=False))
        sys.stderr = io.TextIOWrapper(unheard, sys.stderr.encoding, "in_ascii", line_buffering=True)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Return what stands for the signs that an encoding lacks: letters without accents, "?" where nothing is near."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    out = ""
    for sign in error.object[error.start : error.end]:
        near = PLAIN.get(sign) or unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
        out += near or "?"
    return out, error.end


def console() -> Any:
    """Return a console on standard output."""
    from rich.console import Console

    return Console()


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Show the stage that is running: a spinner with the time elapsed on a terminal, plain lines elsewhere.

    There a stage that counts has a line as it begins and then one every five seconds.

    "quiet" shows none, "verbose" a line for each with the seconds since the first. One that says how many are done,
    "3 of 11", is followed by the time that the rest will take (:class:`TimeLeft`).
    """
    from rich.console import Console

    if manner().how == "quiet":
        yield lambda text: None
        return
    screen, left = Console(stderr=True), TimeLeft()
    if manner().how == "verbose":
        begun = time.monotonic()
        yield lambda text: print(f"{time.monotonic() - begun:7.1f} s  {left.added(text)}", file=sys.stderr, flush=True)
        return
    if not screen.is_terminal:

        def line(text: str) -> None:
            if left.due(text):
                print(f"... {left.added(text)}", file=sys.stderr, flush=True)

        yield line
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=screen, transient=True
    ) as progress:
        task = progress.add_task("start", total=None)
        yield lambda text: progress.update(task, description=left.added(text))


class TimeLeft:
    """How long a stage will still take, by how long its parts have taken so far."""

    def __init__(self) -> None:
        self._stage: tuple[str, ...] = ()
        self._first, self._begun_s, self._said_s = 0, 0.0, 0.0

    def due(self, text: str, now_s: float | None = None) -> bool:
        """Return whether a stage needs a line of its own; one that counts does as it begins, and every _LINES_S."""
        now = time.monotonic() if now_s is None else now_s
        counts = _COUNTS.search(text)
        again = counts is not None and self._of(text, counts) == self._stage and now - self._said_s < _LINES_S
        self._said_s = self._said_s if again else now
        return not again

    @staticmethod
    def _of(text: str, counts: re.Match[str]) -> tuple[str, ...]:
        return text[: counts.start()], counts[2], text[counts.end() :]

    def added(self, text: str, now_s: float | None = None) -> str:
        """Return a stage with the time left, if it says how many are done and some have been since it began.

        ``now_s`` is the time in s, that of the clock if it is not given.
        """
        now = time.monotonic() if now_s is None else now_s
        counts = _COUNTS.search(text)
        if counts is None:
            return text
        stage = self._of(text, counts)
        done, of = int(counts[1]), int(counts[2])
        if stage != self._stage or done < self._first:
            self._stage, self._first, self._begun_s = stage, done, now
        if done == self._first or now - self._begun_s < _TOLD_S:
            return text
        left_s = (now - self._begun_s) / (done - self._first) * (of - done)
        return f"{text}, {clock(left_s)} left" if left_s >= 1.0 else text


def clock(seconds: float) -> str:
    """Return a time as "0:07" or "1:02:03"."""
    minutes, s = divmod(round(seconds), 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02d}:{s:02d}" if hours else f"{m}:{s:02d}"


def print_answer(console: Console, answer: Answer, room: int | None = None) -> None:
    """Print the sentences of an answer, one below the other, without notes: the lead in bold, doubts in yellow.

    Args:
        console: to print on.
        answer: the sentences.
        room: lines that they may take, if not all are to be printed: each is then cut to its first clauses, the lead is
            printed in any case, and those that find no room are counted.
    """
    from rich.table import Table as Grid
    from rich.text import Text

    from testbench.page.words import answer_lines, brief, how_many_more

    if manner().how == "json":
        manner().content["answer"] = [line._asdict() for line in answer_lines(answer)]
        return
    lines = [line for line in answer_lines(answer) if line.kind != "note" or manner().how == "verbose"]
    grid = Grid.grid(padding=(0, 1))
    taken = 0
    for k, (kind, text) in enumerate(lines):
        shown = Text(text if room is None else brief(text)[0], style=_STYLES.get(kind, ""))
        taken += len(shown.wrap(console, max(console.width - 2, 1)))
        rest = lines[k:]
        if room is not None and k and taken + (len(rest) > 1) > room:
            if room:
                grid.add_row("-", Text(f"{how_many_more(rest)}: add -v, or see the report", style="dim"))
            break
        grid.add_row("-", shown)
    console.print(grid)


def print_table(console: Console, table: Table) -> None:
    """Print a table with its title: numbers to the right, units beside the heads, no column without any value."""
    from testbench.page.tables import MISSING

    if manner().how == "json":
        manner().content.setdefault("tables", {})[table.name] = table.to_dict()
        return
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
    """Print rows of texts under their heads; columns that are ``right`` stand to the right. No text is markup.

    No number and no word is broken: where those of a row do not fit side by side, each cell has a line of its own.
    """
    from rich.table import Table as Grid
    from rich.text import Text

    if manner().how == "json":
        manner().content.setdefault("rows", []).extend(dict(zip(heads, map(str, row), strict=True)) for row in rows)
        return
    least = [_least(k, heads, rows, right) for k in range(len(heads))]
    if console.width < sum(least) + 2 * (len(least) - 1):
        print_cells(console, heads, rows, title)
        return
    widths = [max(map(len, (head, *(row[k] for row in rows)))) for k, head in enumerate(heads)]
    free = console.width - 2 * (len(least) - 1)
    if sum(widths) > free:  # numbers that need not grow leave the room to texts
        widths = [least[k] if right and right[k] else width for k, width in enumerate(widths)]
    cells = [max(map(len, (row[k] for row in rows)), default=0) for k in range(len(heads))]
    while sum(widths) > free:  # then heads give way, which stand there once, then the widest text
        shrinking = (k for k in range(len(widths)) if widths[k] > least[k])
        widths[max(shrinking, key=lambda k: (widths[k] > cells[k], widths[k]))] -= 1
    if title:  # a grid would wrap its title at its own width
        console.print(Text(title))
    grid = Grid(box=None, pad_edge=False)
    for k, head in enumerate(heads):
        justify: Any = "right" if right and right[k] else "left"
        grid.add_column(Text(head), justify=justify, overflow="fold", width=widths[k])
    for row in rows:
        grid.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
    console.print(grid)


def _least(k: int, heads: Sequence[str], rows: Sequence[Sequence[str | Text]], right: Sequence[bool]) -> int:
    """Return the width below which a column cannot be read: of its longest number, or of its longest word."""
    if right and right[k]:
        head = max((len(word) for word in heads[k].split()), default=1)
        return max(min(head, _HEAD), max((len(row[k]) for row in rows), default=1))
    words = [word for row in (heads, *rows) for word in _WORDS.split(str(row[k]))]
    longest = max((len(row[k]) for row in rows), default=1)
    return max(min(longest, _LEAST), min(max(map(len, words), default=1), _WORD))


def print_cells(console: Console, heads: Sequence[str], rows: Sequence[Sequence[str | Text]], title: str) -> None:
    """Print rows one below the other, each cell in a line with its head."""
    from rich.text import Text

    if title:
        console.print(Text(title))
    for row in rows:
        for k, (head, cell) in enumerate(zip(heads, row, strict=True)):
            console.print(Text(f"{'  ' if k else ''}{head}: ").append(cell))
