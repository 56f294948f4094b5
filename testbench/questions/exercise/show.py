"""Exercises and verdicts as tables on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.errors import Refusal
from testbench.page.terminal import print_rows
from testbench.questions.exercise.exercise import Number
from testbench.questions.exercise.notebook import NOTEBOOK
from testbench.questions.exercise.seal import NAMES, load_exercise

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.exercise.ask import Started
    from testbench.questions.exercise.check import Result

_MARKS = {"right": ("right", "green"), "near": ("near", "yellow"), "wrong": ("wrong", "red"), "missing": ("–", "dim")}


def print_list(console: Console) -> None:
    """Print all exercises with level and time."""
    rows = []
    for name in NAMES:
        exercise = load_exercise(name)
        rows.append((name, str(exercise.level), f"{exercise.minutes}\u00a0min", exercise.title))
    print_rows(console, ("exercise", "level", "time", "what it is about"), rows, (False, True, True, False))
    console.print("\nStart one: testbench exercise start NAME --student YOUR_NAME", highlight=False)


def print_started(started: Started, console: Console) -> None:
    """Print what was written and what to do next."""
    from rich.text import Text

    console.print(Text(f"{started.exercise.title}: the version of {started.student}", style="bold"))
    for line in (
        f"Read:   {started.folder / 'README.html'} (or README.md)",
        f"Run:    {started.folder / NOTEBOOK} (Jupyter), if you like",
        f"Fill:   {started.folder / 'answers.toml'}",
        f"Check:  testbench exercise check {started.folder}",
    ):
        console.print(Text(line), soft_wrap=True)


def print_class(results: Mapping[Path, Result | Refusal], console: Console) -> None:
    """Print one line per folder: student, exercise, how many answers are right and which are not, or the error."""
    from rich.text import Text

    rows: list[tuple[str | Text, ...]] = []
    for folder, result in results.items():
        if isinstance(result, Refusal):
            rows.append((folder.name, "", Text("–", style="red"), str(result)))
            continue
        wrong = ", ".join(v.question.key for v in result.verdicts if v.outcome != "right")
        rows.append((result.student, result.name, f"{result.right} of {len(result.verdicts)}", wrong))
    print_rows(console, ("student", "exercise", "right", "not right"), rows)


def print_result(result: Result, console: Console, folder: Path) -> None:
    """Print the verdicts as a table, and how many answers are right."""
    from rich.text import Text

    console.print(Text(f"{result.title}: answers of {result.student}", style="bold"))
    rows: list[tuple[str | Text, ...]] = []
    for v in result.verdicts:
        word, style = _MARKS[v.outcome]
        given = f"{v.given:g}" if isinstance(v.given, float) else (v.given or "")
        unit = v.question.unit if isinstance(v.question, Number) else ""
        rows.append((v.question.key, given, unit, Text(word, style=style), v.words))
    print_rows(console, ("answer", "given", "unit", "", "why"), rows, (False, True, False, False, False))
    missing = sum(v.outcome == "missing" for v in result.verdicts)
    rest = f", {missing} not answered yet" if missing else ""
    console.print(Text(f"{result.right} of {len(result.verdicts)} right{rest}. File: {folder / 'answers.toml'}"))
