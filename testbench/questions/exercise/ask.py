"""Write what a student gets: text, records, numbers given, a template for the answers."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from testbench.core.door import read_toml
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.escape import quoted
from testbench.core.files import write_file
from testbench.core.schema import Strict, parse
from testbench.core.store import ResultFolder, entry_of, is_fresh, manifest_of
from testbench.page.html import text_page
from testbench.questions.exercise.answers import ANSWERS, template
from testbench.questions.exercise.exercise import Case, Exercise, Handout
from testbench.questions.exercise.seal import CATALOGUE, Seal, load_exercise, seal
from testbench.questions.exercise.show import NOTEBOOK, notebook

CARD, GIVEN, TEXT, TEXT_PAGE = "exercise.toml", "given.toml", "README.md", "README.html"
_LONGEST = 80


class Card(Strict):
    """The content of exercise.toml: the exercise, the student, and the check that tells one key from another."""

    exercise: str
    student: str
    key_check: str


@dataclass(frozen=True, eq=False)
class Started:
    """A folder that was handed out, with the exercise and the student's own case, which is secret."""

    folder: Path
    name: str
    student: str
    exercise: Exercise
    case: Case


def start(name: str, student: str, key: str, folder: Path | None = None) -> Started:
    """Write the folder of one student's version of an exercise; the same student and key give the same bytes.

    Args:
        name: of the exercise.
        student: name or number; two students get two aircraft.
        key: see ``seal``.
        folder: where to write; NAME_STUDENT in the working directory if None.

    Raises:
        RecordError: there is no such exercise, or the folder exists and is not empty.
        ScenarioError: the student's name is empty or not one line.
    """
    exercise = load_exercise(name)
    student = student.strip()
    if not student or len(student) > _LONGEST or not student.isprintable():
        raise ScenarioError(f"a student must be 1 to {_LONGEST} printable characters, got {student!r}")
    folder = folder or Path(f"{name}_{re.sub(r'[^A-Za-z0-9._-]+', '_', student)}")
    _empty(folder)
    sealed = seal(key, name, student)
    case = case_of(exercise, sealed)
    with ResultFolder(folder, sealed=True) as place:
        _empty(folder)  # another process may have been there
        _hand_out(place.new, name, student, exercise, sealed, case)
    return Started(folder, name, student, exercise, case)


def restore(folder: Path, name: str, student: str, key: str) -> list[str]:
    """Write again what is missing of a folder that :func:`start` made, and return it; all else stays as it is.

    Raises:
        RecordError: it was started with another key.
    """
    listed = getattr(manifest_of(folder), "files", {})
    missing = [file for file in listed if not (folder / file).exists()]
    if missing:
        with ResultFolder(folder, adds=True, sealed=True) as place:
            exercise, sealed = load_exercise(name), seal(key, name, student)
            _hand_out(place.new, name, student, exercise, sealed, case_of(exercise, sealed))
            if entry_of(place.new / CARD) != listed.get(CARD):
                raise _other_key(folder)
            for path in [p for p in place.new.rglob("*") if p.is_file()]:
                if path.relative_to(place.new).as_posix() not in missing:
                    path.unlink()
    return missing


def _empty(folder: Path) -> None:
    """Refuse a folder that holds anything but what the start of an exercise left that was interrupted.

    Raises:
        RecordError: it does.
    """
    if not is_fresh(folder):
        begun = f", or go on with `testbench exercise check {folder}`" if (folder / CARD).is_file() else ""
        raise RecordError(
            f"an exercise must go into a new or empty folder, got '{folder}'; choose another with -o{begun}"
        )


def _hand_out(folder: Path, name: str, student: str, exercise: Exercise, sealed: Seal, case: Case) -> None:
    handout = exercise.hand_out(case)
    write_file(folder / CARD, _card(name, student, sealed))
    for file, text in _texts(name, student, exercise, handout).items():
        write_file(folder / file, text)
    for record_name, record in handout.records.items():
        blank = replace(record, provenance={"exercise": name, "record": record_name, "student": student})
        blank.save(folder / "records" / f"{record_name}.nc")
        blank.save_csv(folder / "records" / f"{record_name}.csv")


def reopen(folder: Path, key: str) -> Started:
    """Return what :func:`start` made in ``folder``.

    Raises:
        RecordError: it is not the folder of an exercise, or it was started with another key.
        ScenarioError: its card breaks a law.
    """
    file = folder / CARD
    if not file.is_file():
        raise RecordError(
            f"a folder made by `testbench exercise start` holds {CARD}, but '{folder}' does not; name that folder"
        )
    card, faults = parse(Card, read_toml(file, "answers"), file)
    if card is None or faults:
        raise ScenarioError(faults)
    exercise = load_exercise(card.exercise)
    sealed = seal(key, card.exercise, card.student)
    if sealed.key_check != card.key_check:
        raise _other_key(folder)
    return Started(folder, card.exercise, card.student, exercise, case_of(exercise, sealed))


def _other_key(folder: Path) -> RecordError:
    return RecordError(
        f"'{folder}' was started with another key than the one used now (or {CARD} was changed); whoever handed it "
        "out can check it: give their key with --key-file"
    )


def case_of(exercise: Exercise, sealed: Seal) -> Case:
    """Return a student's case."""
    return Case(exercise.draw(sealed.generator()), sealed.noise_seed)


def _card(name: str, student: str, sealed: Seal) -> str:
    return (
        "# Whose version of which exercise this is; the checker reads it.\n"
        f'exercise = "{name}"\nstudent = {quoted(student)}\nkey_check = "{sealed.key_check}"\n'
    )


def _texts(name: str, student: str, exercise: Exercise, handout: Handout) -> dict[str, str]:
    text = (CATALOGUE / f"{name}.md").read_text(encoding="utf-8")
    for key, value in handout.given.items():
        text = text.replace(f"@{key}@", f"{value:g}")
    page = text_page(f"Exercise: {name}, the version of {student}", text)
    files = {TEXT: text, TEXT_PAGE: page, ANSWERS: template(student, exercise), **handout.files}
    if handout.given:
        files[GIVEN] = "".join(f"{key} = {value!r}\n" for key, value in handout.given.items())
    steps = CATALOGUE / f"{name}.steps.md"
    files[NOTEBOOK] = notebook(text, steps.read_text(encoding="utf-8") if steps.is_file() else "", exercise.questions)
    return files
