"""A Jupyter notebook of an exercise, made from its text: NAME.md, and NAME.steps.md where steps are shown.

The steps are Markdown whose blocks of Python become cells of code. What all notebooks have in common (read the records,
draw them, write the answers, have them judged) is added here, so that an exercise is written once.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence

from testbench.questions.exercise.exercise import Question

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
