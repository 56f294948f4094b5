"""Files of all questions: which file a name means, which kind a file is, and whether it is right."""

from __future__ import annotations

from pathlib import Path

from testbench.core.errors import RecordError, ScenarioError, nearest
from testbench.core.paths import SCENARIOS, find_scenario
from testbench.core.scenario.base import Asked
from testbench.core.schema import read_toml
from testbench.questions import BY_COMMAND, QUESTIONS, Question

WITH_FILES = tuple(q for q in QUESTIONS if q.kind)
"""The questions that are asked in a file."""


def find(path: Path, command: str) -> Path:
    """Return the file that ``path`` means to ``command``: a file, or a packaged one with or without its folder.

    Raises:
        RecordError: there is no such file; the message has the nearest packaged name.
        ScenarioError: it is a file for another command.
    """
    question = BY_COMMAND[command]
    file = path if path.is_file() else find_scenario(Path(question.folder) / path)
    if not file.is_file():
        file = find_scenario(path)
    if not file.is_file():
        raise RecordError(_none(path, [p.stem for p in (SCENARIOS / question.folder).glob("*.toml")]))
    kinds = kinds_of(file)
    if question not in kinds:
        raise ScenarioError([f"{file} is a {kinds[0].kind}: use testbench {kinds[0].command}"])
    return file


def _none(path: Path, packaged: list[str]) -> str:
    """Return what is wrong with a path that is no file, and the nearest name of a packaged scenario."""
    got = f"'{path}'" + (", which is a folder" if path.is_dir() else "")
    return f"a scenario must be a file or a packaged one, got {got}{nearest(path.stem, packaged)}"


def kinds_of(file: Path) -> list[Question]:
    """Return the questions whose files have most of the file's keys, the first of the table first.

    A file of a question has only keys of that question, but for those that are misspelt; a key of another question
    counts against it as much as a key of its own counts for it.

    Raises:
        RecordError, ScenarioError: the file cannot be read, is not TOML or is empty.
    """
    content = read_toml(file)
    if not content:
        raise ScenarioError(
            [f"{file} must say what is asked, but it is empty; `testbench list scenarios` has examples"]
        )
    known = {q.command: len(q.keys & content.keys()) for q in WITH_FILES}
    most = max(known.values())
    return [q for q in WITH_FILES if known[q.command] == most]


def load(path: Path | str) -> Asked:
    """Return a file of any question, read and checked without flying.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: it cannot be read.
    """
    return _checked(Path(path))[1]


def check_file(path: Path) -> str:
    """Check a file of any question; return which kind it is.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: the file cannot be read.
    """
    return _checked(path)[0].kind


def _checked(path: Path) -> tuple[Question, Asked]:
    file = find_scenario(path)
    if not file.is_file():
        packaged = [p.relative_to(SCENARIOS).with_suffix("").as_posix() for p in SCENARIOS.rglob("*.toml")]
        raise RecordError(_none(path, packaged))
    question = kinds_of(file)[0]
    return question, question.file_class.load(file)
