"""Exercises and verdicts as tables on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.errors import TestbenchError
from testbench.questions.exercise.exercise import Number
from testbench.questions.exercise.names import NAMES, load_exercise

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.exercise.check import Result
    from testbench.questions.exercise.start import Started

_MARKS = {"right": ("right", "green"), "near": ("near", "yellow"), "wrong": ("wrong", "red"), "missing": ("–", "dim")}


def print_list(console: Console) -> None:
    """Print all exercises with level and time."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("exercise", no_wrap=True)
    table.add_column("level", justify="right")
    table.add_column("time", justify="right", no_wrap=True)
    table.add_column("what it is about", overflow="fold")
    for name in NAMES:
        exercise = load_exercise(name)
        notebook = " (with a notebook)" if exercise.notebook else ""
        table.add_row(name, str(exercise.level), f"{exercise.minutes} min", exercise.title + notebook)
    console.print(table)
    console.print("\nStart one: testbench exercise start NAME --student YOUR_NAME", highlight=False)


def print_started(started: Started, console: Console) -> None:
    """Print what was written and what to do next."""
    from rich.text import Text

    console.print(Text(f"{started.exercise.title}: version of {started.student}", style="bold"))
    for line in (
        f"Read:   {started.folder / 'README.md'}",
        *([f"Run:    {started.folder / 'notebook.ipynb'} (Jupyter)"] if started.exercise.notebook else []),
        f"Fill:   {started.folder / 'answers.toml'}",
        f"Check:  testbench exercise check {started.folder}",
    ):
        console.print(Text(line), soft_wrap=True)


def print_class(results: Mapping[Path, Result | TestbenchError], console: Console) -> None:
    """Print one line per folder: student, exercise, how many answers are right and which are not, or the error."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for head in ("student", "exercise", "right", "not right"):
        table.add_column(head, overflow="fold")
    for folder, result in results.items():
        if isinstance(result, TestbenchError):
            table.add_row(Text(folder.name), "", Text("–", style="red"), Text(str(result)))
            continue
        wrong = ", ".join(v.question.key for v in result.verdicts if v.outcome != "right")
        table.add_row(Text(result.student), result.name, f"{result.right} of {len(result.verdicts)}", wrong)
    console.print(table)


def print_result(result: Result, console: Console, folder: Path) -> None:
    """Print the verdicts as a table, and how many answers are right."""
    from rich.table import Table
    from rich.text import Text

    console.print(Text(f"{result.title}: answers of {result.student}", style="bold"))
    table = Table(box=None, pad_edge=False)
    for head, justify in (("answer", "left"), ("given", "right"), ("unit", "left"), ("", "left"), ("why", "left")):
        table.add_column(head, justify=justify, overflow="fold", no_wrap=head == "answer")  # type: ignore[arg-type]
    for v in result.verdicts:
        word, style = _MARKS[v.outcome]
        given = f"{v.given:g}" if isinstance(v.given, float) else (v.given or "")
        unit = v.question.unit if isinstance(v.question, Number) else ""
        table.add_row(v.question.key, Text(given), Text(unit), Text(word, style=style), Text(v.words))
    console.print(table)
    missing = sum(v.outcome == "missing" for v in result.verdicts)
    rest = f", {missing} not answered yet" if missing else ""
    console.print(Text(f"{result.right} of {len(result.verdicts)} right{rest}. File: {folder / 'answers.toml'}"))
