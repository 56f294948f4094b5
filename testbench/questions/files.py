"""Files of all questions: which file a name means, of which kind a file is, and whether it is right."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from testbench.core.door import read_toml
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import SCENARIOS, find_scenario, not_found
from testbench.core.scenario.base import Asked
from testbench.core.schema import Strict
from testbench.questions import BY_COMMAND, QUESTIONS, Question

WITH_FILES = tuple(q for q in QUESTIONS if q.kind)
"""The questions that are asked in a file."""
PROMISES = "promises"
"""Folder beside ``designs`` where `testbench design` writes what it promises of each."""
_NEAR = 0.8  # likeness of a misspelt key, as difflib counts it


def find(path: Path, command: str, law: str = "") -> Path:
    """Return the file that ``path`` means for ``command``: a file, or a packaged one with or without its folder.

    ``law`` is what the path must be, of a command that takes other things beside such files.

    Raises:
        RecordError: there is no such file; the message has the nearest name of a file here or a packaged one.
        ScenarioError: it is a file for another command.
    """
    question = BY_COMMAND[command]
    file = path if path.is_file() else find_scenario(Path(question.folder) / path)
    if not file.is_file():
        file = find_scenario(path)
    if not file.is_file():
        packaged = [p.stem for p in (SCENARIOS / question.folder).glob("*.toml")]
        usual = f"a {question.kind} must be a file or a packaged one"
        raise RecordError(f"{law or usual}, got {not_found(path, packaged, None if law else _may_be_asked)}")
    kinds = kinds_of(file)
    if question not in kinds:
        raise ScenarioError([f"{file} is a {kinds[0].kind}: use testbench {kinds[0].command}"])
    return file


def promise_beside(scenario: Path) -> Path | None:
    """Return the file of what was promised of a designed scenario ``designs/NAME.toml``; None if there is none."""
    file = scenario.parent.parent / PROMISES / f"{scenario.stem}.json"
    return file if file.is_file() else None


def _may_be_asked(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() == ".toml"


def kinds_of(file: Path) -> list[Question]:
    """Return the questions to which a file may belong, in the order of the table; mostly there is one.

    A file belongs to the question that knows most of its keys; a misspelt key that is near one of the question's counts
    half. A file with none but common keys is taken for a scenario to run. A scenario to run may also be a comparison:
    both take the same keys, unless the file gives one that only a comparison has.

    Raises:
        RecordError, ScenarioError: the file cannot be read, is not TOML, is empty or has no key of any question.
    """
    content = read_toml(file)
    if not content:
        raise ScenarioError(
            [f"{file} must say what is asked, but it is empty; `testbench list scenarios` has examples"]
        )
    scores = {q.command: _score(q, content.keys()) for q in WITH_FILES}
    best = max(scores.values())
    if not best:
        raise ScenarioError(
            [
                f"{file} must have the keys of a question, but no question has a key like {', '.join(content)}; "
                "`testbench list scenarios` has examples"
            ]
        )
    return [q for q in WITH_FILES if scores[q.command] == best]


def _score(question: Question, given: Collection[str]) -> float:
    """Return how many of the given keys a question knows, one that is near a key of it as a half."""
    strange = set(given) - question.keys
    near = sum(bool(get_close_matches(key, question.keys, 1, _NEAR)) for key in strange)
    return len(given) - len(strange) + 0.5 * near


def file_classes() -> dict[str, type[Strict]]:
    """Return kind of file -> the class of its keys: of every question, and of what a user brings."""
    from testbench.aircraft.geometry.schema import BesideAvl, GeometryFile
    from testbench.aircraft.model import AircraftFile
    from testbench.aircraft.strips.ground_test import GroundTestFile
    from testbench.estimators.equations import Equations
    from testbench.questions.identify.pool.prior import PriorFile
    from testbench.sensors.files import SensorEntry, SuiteFile

    brought: dict[str, type[Strict]] = {
        "suite": SuiteFile,
        "sensor of a suite": SensorEntry,
        "aircraft": AircraftFile,
        "geometry": GeometryFile,
    }
    brought |= {"masses beside AVL": BesideAvl, "ground test": GroundTestFile, "structure": Equations}
    return {q.kind: q.file_class for q in WITH_FILES} | brought | {"prior": PriorFile}


def json_schemas() -> dict[str, dict[str, Any]]:
    """Return kind of file -> JSON schema of its keys; numbers have "unit", "minimum" and "maximum".

    Example:
        >>> json_schemas()["design"]["properties"]["duration_s"]["maximum"]
        36000.0
    """
    return {kind: file_class.model_json_schema() for kind, file_class in file_classes().items()}


def load(path: Path | str) -> Asked:
    """Return a file of any question, read and checked without flying.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: it cannot be read.

    Example:
        >>> import testbench as tb
        >>> tb.load("compare/eolo_alpha").seeds
        16
    """
    return _checked(Path(path))[1]


def check_file(path: Path) -> str:
    """Check a file of any question; return which kind it is.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: the file cannot be read.
    """
    return _checked(path)[0].kind


def check_and_notes(path: Path) -> tuple[str, list[str]]:
    """Check a file as :func:`check_file` does; return which kind it is, and what is to be known of it."""
    question, asked = _checked(path)
    return question.kind, asked.notes()


def _checked(path: Path) -> tuple[Question, Asked]:
    file = find_scenario(path)
    if not file.is_file():
        packaged = [p.relative_to(SCENARIOS).with_suffix("").as_posix() for p in SCENARIOS.rglob("*.toml")]
        got = not_found(path, packaged, _may_be_asked)
        raise RecordError(f"a scenario must be a file or a packaged one, got {got}")
    question = kinds_of(file)[0]
    return question, question.file_class.load(file)
