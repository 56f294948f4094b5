"""answers.toml: the template that is handed out, reading it, and writing answers into it.

Description files, so that what is handed out can go straight into `testbench identify` and its like.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from testbench.core.channels import channel
from testbench.core.door import read_text, read_toml
from testbench.core.errors import RecordError, ScenarioError, nearest
from testbench.core.escape import one_line, table_lines
from testbench.core.files import write_file
from testbench.questions.exercise.exercise import Choice, Exercise, Question


def description(
    title: str,
    records: Sequence[str],
    channels: Sequence[str],
    identification: Mapping[str, Any],
    trim_s: float = 0.0,
    held_out: Sequence[str] = (),
) -> str:
    """Return a description (TOML) of the records of an exercise, the last 30 % of each held out if no others are.

    Args:
        title: of the exercise.
        records: names of the files in records/.
        channels: that they hold.
        identification: the table of that name: inputs, outputs and estimators.
        trim_s: steady flight before the manoeuvre, whose mean is taken off; 0 for records of deviations.
        held_out: names of the files in records/ to judge by.
    """
    uses = {
        **dict.fromkeys(records, "identification" if held_out else "split"),
        **dict.fromkeys(held_out, "validation"),
    }
    table = {
        "title": title,
        "source": "simulated for an exercise of the test bench",
        "rights": "none needed",
        "folder": ".",
        "trim_s": float(trim_s),
        "time": {"column": "t"},
        "record": [{"name": name, "file": f"records/{name}.nc", "use": use} for name, use in uses.items()],
        "channel": [{"name": name, "column": name, "unit": channel(name).unit} for name in channels],
        "preparation": {"bias": "trim" if trim_s else "none", "identification_fraction": 0.7},
        "identification": identification,
    }
    return "\n".join(table_lines(table)) + "\n"


ANSWERS = "answers.toml"
UNANSWERED = "?"
_COMMA = re.compile(r"^(\s*\w+\s*=\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*(?:#.*)?)$", re.MULTILINE)
_HABITS = {
    r"^\s*\w+\s*=\s*[-+]?\d+,\d+,": "thousands go without commas",
    r"^\w+\s*=\s*[-+]?[\d.]+(e[-+]?\d+)?\s*[a-zA-Z°%]": "a number goes without its unit",
    r"^\w+\s*=\s*[a-zA-Z]": "a word must stand in quotes",
}


def template(student: str, exercise: Exercise) -> str:
    """Return answers.toml with every answer still missing."""
    lines = [
        f"# {exercise.title}: answers of {one_line(student)}.",
        f'# Replace "{UNANSWERED}" by a number (no unit) or by one of the words listed.',
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

    A decimal comma is read as a decimal point, and a number in quotes as a number.

    Raises:
        RecordError: the file is missing.
        ScenarioError: it is not TOML or holds a key that no question has, with the nearest key.
    """
    try:
        content = _read(file)
    except ScenarioError as error:
        text = read_text(file, "answers")
        for pattern, hint in _HABITS.items():
            if re.search(pattern, text, re.MULTILINE):
                raise ScenarioError(f"{error}; {hint}") from error
        raise
    except RecordError as error:
        raise RecordError(f"{error}; `testbench exercise start` writes a template for it") from error
    keys = [q.key for q in questions]
    unknown = [one_line(key) for key in content if key not in keys]
    if unknown:
        raise ScenarioError([f"{file}, {key}: no question has this key{nearest(key, keys)}" for key in unknown])
    content = {k: one_line(v) if isinstance(v, str) else v for k, v in content.items()}  # it is printed, and in a table
    given = {k: v for k, v in content.items() if not (isinstance(v, str) and v.strip() in ("", UNANSWERED))}
    numbers = {q.key for q in questions if not isinstance(q, Choice)}
    return {k: _number(v) if k in numbers else v for k, v in given.items()}


def _read(file: Path) -> dict[str, Any]:
    """Return the content of a file of answers; where it is not TOML, that with points for decimal commas."""
    try:
        return read_toml(file, "answers")
    except ScenarioError:
        text = read_text(file, "answers")
        points = _COMMA.sub(r"\1.\2", text)
        if points == text:
            raise
    try:
        return tomllib.loads(points)
    except (ValueError, RecursionError):
        return read_toml(file, "answers")  # for its own words


def _number(value: Any) -> Any:
    """Return a number in quotes as a number; anything else as it is."""
    if not isinstance(value, str):
        return value
    try:
        return float(value.strip().replace(",", ".") if value.count(",") == 1 and "." not in value else value)
    except ValueError:
        return value


def write_answers(folder: Path, answers: Mapping[str, float | str | None]) -> None:
    """Put answers (None: leave as it is) into answers.toml of ``folder``, its comments kept.

    Raises:
        RecordError: there is no such file.
        ScenarioError: it has no such key.
    """
    file = folder / ANSWERS
    keys = list(read_toml(file, "answers"))
    text = read_text(file, "answers")
    for key, value in answers.items():
        if key not in keys:
            raise ScenarioError(f"{file}, {key}: no question has this key{nearest(key, keys)}")
        if value is not None:
            text = _answered(text, key, json.dumps(value if isinstance(value, str) else float(value)))
    write_file(file, text)


def _answered(text: str, key: str, shown: str) -> str:
    """Return a file of answers with the line of ``key`` replaced."""
    lines = [f"{key} = {shown}" if re.match(rf"{re.escape(key)}\s*=", line) else line for line in text.split("\n")]
    return "\n".join(lines)
