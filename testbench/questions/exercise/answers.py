"""answers.toml: the template that is handed out, reading it, and writing answers into it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from testbench.core.errors import RecordError, ScenarioError, nearest
from testbench.core.files import write_file
from testbench.core.schema import read_toml
from testbench.questions.exercise.exercise import Choice, Exercise, Question

ANSWERS = "answers.toml"
UNANSWERED = "?"
_HABITS = {
    r"^\w+\s*=\s*[-+]?\d+,\d": "numbers need a decimal point, not a comma",
    r"^\w+\s*=\s*[-+]?[\d.]+(e[-+]?\d+)?\s*[a-zA-Z°%]": "a number goes without its unit",
    r"^\w+\s*=\s*[a-zA-Z]": "a word must stand in quotes",
}


def template(student: str, exercise: Exercise) -> str:
    """Return answers.toml with every answer still missing."""
    lines = [
        f"# {exercise.title}: answers of {student}.",
        f'# Replace "{UNANSWERED}" by a number (decimal point, no unit) or by one of the words listed.',
        f'# What is not known stays "{UNANSWERED}". Then: testbench exercise check FOLDER',
        "",
    ]
    for question in exercise.questions:
        lines.append(f"# {question.text}")
        if isinstance(question, Choice):
            lines += [f'#   "{option}": {meaning}' for option, meaning in question.options.items()]
        else:
            unit = "a number without unit" if question.unit == "1" else f"in {question.unit}"
            lines.append(f"#   {unit}, right within {_tolerance(question.tolerance, question.absolute)}")
        lines += [f'{question.key} = "{UNANSWERED}"', ""]
    return "\n".join(lines)


def _tolerance(relative: float, absolute: float) -> str:
    parts = [f"{100.0 * relative:g} %"] if relative else []
    parts += [f"{absolute:g}"] if absolute else []
    return " or ".join(parts)


def read_answers(file: Path, questions: Sequence[Question]) -> dict[str, Any]:
    """Return key -> answer of a file of answers, without questions that are not answered.

    Raises:
        RecordError: the file is missing.
        ScenarioError: it is not TOML or holds a key that no question has, with the nearest key.
    """
    try:
        content = read_toml(file)
    except ScenarioError as error:
        text = file.read_text(encoding="utf-8")
        for pattern, hint in _HABITS.items():
            if re.search(pattern, text, re.MULTILINE):
                raise ScenarioError([f"{error}; {hint}"]) from error
        raise
    except RecordError as error:
        raise RecordError(f"{error}; `testbench exercise start` writes a template for it") from error
    keys = [q.key for q in questions]
    faults = [f"{file}, {key}: no question has this key{nearest(key, keys)}" for key in content if key not in keys]
    if faults:
        raise ScenarioError(faults)
    return {k: v for k, v in content.items() if not (isinstance(v, str) and v.strip() in ("", UNANSWERED))}


def write_answers(folder: Path, answers: Mapping[str, float | str | None]) -> None:
    """Put answers (None: leave as it is) into answers.toml of ``folder``, its comments kept.

    Raises:
        RecordError: there is no such file.
        ScenarioError: it has no such key.
    """
    file = folder / ANSWERS
    keys = list(read_toml(file))
    text = file.read_text(encoding="utf-8")
    for key, value in answers.items():
        if key not in keys:
            raise ScenarioError([f"{file}, {key}: no question has this key{nearest(key, keys)}"])
        if value is not None:
            text = _answered(text, key, json.dumps(value if isinstance(value, str) else float(value)))
    write_file(file, text)


def _answered(text: str, key: str, shown: str) -> str:
    """Return a file of answers with the line of ``key`` replaced."""
    lines = [f"{key} = {shown}" if re.match(rf"{re.escape(key)}\s*=", line) else line for line in text.split("\n")]
    return "\n".join(lines)
