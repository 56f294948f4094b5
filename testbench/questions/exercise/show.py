"""Exercises and verdicts as tables on a terminal."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.errors import Refusal
from testbench.page.terminal import print_rows
from testbench.questions.exercise.exercise import Number, Question
from testbench.questions.exercise.seal import NAMES, load_exercise

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.exercise.ask import Started
    from testbench.questions.exercise.check import Result


NOTEBOOK = "notebook.ipynb"
_CODE = re.compile(r"^```python\n(.*?)^```\n?", re.MULTILINE | re.DOTALL)
_READ = """from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from testbench.core.record import load_record
from testbench.questions.exercise.answers import write_answers

FOLDER = Path(".")  # of the exercise; this notebook lies in it
records = {file.stem: load_record(file) for file in sorted((FOLDER / "records").glob("*.nc"))}"""
_LOOK = """for name, record in records.items():
    rows = len(record.channels)
    figure, axes = plt.subplots(rows, 1, sharex=True, squeeze=False, figsize=(9, 1.4 * rows + 0.6))
    for axis, channel in zip(axes[:, 0], record.channels, strict=True):
        axis.plot(record.t_s, record[channel], linewidth=0.9)
        axis.set_ylabel(channel)
    axes[0, 0].set_title(f"{name}: SI units and rad")
    axes[-1, 0].set_xlabel("t, s")
    plt.show()"""
_OWN = "## Your work\n\nA cell to begin with. The functions that the text names can be imported here."
_OWN_CODE = "# your own computation"
_ANSWERS = (
    "## Your answers\n\nWrite a number, or a word, for each `None`; what is `None` stays as answers.toml has it. The "
    "reasons of the checker are worth reading. With a teacher's own key only the teacher can check: hand in "
    "answers.toml then."
)
_CHECK = """from testbench.core.errors import TestbenchError
from testbench.questions.exercise.check import check
from testbench.questions.exercise.seal import read_key

try:
    result = check(FOLDER, read_key(None))
    for v in result.verdicts:
        print(f"{v.question.key:24} {v.outcome:8} {v.words}")
    print(f"{result.right} of {len(result.verdicts)} right")
except TestbenchError as error:
    print(error)"""
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


# --- the notebook -----------------------------------------------------------------------------------------------------


def notebook(text: str, steps: str, questions: Sequence[Question]) -> str:
    """Return a notebook (nbformat 4.5, as JSON, without outputs).

    Args:
        text: of the exercise, Markdown.
        steps: Markdown with blocks of Python; "" if none are shown.
        questions: whose answers the last cells take.
    """
    answers = "".join(f'    "{q.key}": None,\n' for q in questions)
    cells = [("markdown", text), ("code", _READ)]
    cells += list(_cells(steps)) if steps else [("code", _LOOK), ("markdown", _OWN), ("code", _OWN_CODE)]
    cells += [
        ("markdown", _ANSWERS),
        ("code", f"answers = {{\n{answers}}}\nwrite_answers(FOLDER, answers)"),
        ("code", _CHECK),
    ]
    content = {
        "cells": [_cell(kind, source.strip("\n"), k) for k, (kind, source) in enumerate(cells)],
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _cells(steps: str) -> Iterator[tuple[str, str]]:
    """Yield (kind, source) of the cells of Markdown with blocks of Python."""
    for k, part in enumerate(_CODE.split(steps)):
        if part.strip():
            yield ("code" if k % 2 else "markdown"), part


def _cell(kind: str, source: str, number: int) -> dict[str, object]:
    name = hashlib.sha256(f"{number} {source}".encode()).hexdigest()[:8]
    cell: dict[str, object] = {"cell_type": kind, "id": name, "metadata": {}}
    if kind == "code":
        cell |= {"execution_count": None, "outputs": []}
    return cell | {"source": source.splitlines(keepends=True)}
