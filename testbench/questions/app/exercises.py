"""Exercises in the app: those that can be started, and those of the folder with text, questions and answers given.

Right answers are known to `testbench exercise check` alone, which the page asks as a terminal does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from testbench.core.door import read_toml
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.schema import parse
from testbench.questions.app.records import inside
from testbench.questions.exercise.answers import ANSWERS, read_answers, write_answers
from testbench.questions.exercise.ask import CARD, TEXT_PAGE, Card
from testbench.questions.exercise.exercise import Exercise, Number
from testbench.questions.exercise.seal import NAMES, load_exercise

_WHERE = (f"*/{CARD}", f"*/*/{CARD}", f"*/*/*/{CARD}")  # of a student, and below the folder of a class


def list_exercises(folder: Path) -> dict[str, Any]:
    """Return the exercises that can be started, and those that lie in a folder, each with its questions."""
    all_of_them = {name: load_exercise(name) for name in NAMES}
    begun = []
    for file in sorted(p for pattern in _WHERE for p in folder.glob(pattern)):
        with suppress(RecordError, ScenarioError):
            begun.append(_told(folder, file.parent))
    return {
        "catalogue": [
            {"name": name, "title": e.title, "level": e.level, "minutes": e.minutes} for name, e in all_of_them.items()
        ],
        "begun": begun,
    }


def _opened(folder: Path) -> tuple[Card, Exercise]:
    """Return card and exercise of a folder that was handed out; nothing that is secret is made."""
    card, faults = parse(Card, read_toml(folder / CARD, "answers"), folder / CARD)
    if card is None or faults:
        raise ScenarioError(faults)
    return card, load_exercise(card.exercise)


def _told(folder: Path, place: Path) -> dict[str, Any]:
    card, exercise = _opened(place)
    given: Mapping[str, Any] = {}
    with suppress(RecordError, ScenarioError):
        given = read_answers(place / ANSWERS, exercise.questions)
    questions = []
    for q in exercise.questions:
        of = {"unit": q.unit} if isinstance(q, Number) else {"options": dict(q.options)}
        questions.append({"key": q.key, "text": q.text, "given": given.get(q.key), **of})
    return {
        "folder": place.relative_to(folder).as_posix(),
        "exercise": card.exercise,
        "title": exercise.title,
        "student": card.student,
        "page": (place / TEXT_PAGE).relative_to(folder).as_posix(),
        "records": [p.relative_to(folder).as_posix() for p in sorted((place / "records").glob("*.nc"))],
        "questions": questions,
    }


def page_of(folder: Path, path: str) -> Path | None:
    """Return the text of an exercise by its path in a folder; None for all other files."""
    with suppress(RecordError):
        file = inside(folder, path, ".html")
        return file if file.name == TEXT_PAGE and (file.parent / CARD).is_file() else None
    return None


def answer_exercise(folder: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``answers``, key -> number or word, into the file of the ``exercise`` that lies in a folder.

    Raises:
        RecordError: there is no such exercise, or it cannot be read.
        ScenarioError: an answer is neither a number nor a word, or no question has its key.
    """
    place = inside(folder, f"{given.get('exercise')}/{CARD}", ".toml").parent
    _, exercise = _opened(place)
    answers = given.get("answers")
    if not isinstance(answers, dict) or not all(isinstance(v, (str, int, float)) for v in answers.values()):
        raise ScenarioError(f"answers must be numbers or words by their keys, got {str(answers)[:200]}")
    words = {q.key for q in exercise.questions if not isinstance(q, Number)}
    write_answers(place, {k: v if k in words else _number(k, v) for k, v in answers.items() if v != ""})
    return _told(folder, place)


def _number(key: str, value: str | float) -> float:
    text = str(value).strip().replace(",", ".").replace("−", "-")
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise ScenarioError(f"{key} must be a finite number without its unit, got '{text[:80]}'")
    return found
