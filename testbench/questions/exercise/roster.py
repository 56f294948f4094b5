"""A class: folders for every student, and a table of what each of them answered."""

from __future__ import annotations

import csv
import re
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.core.door import read_text
from testbench.core.errors import RecordError, Refusal, ScenarioError
from testbench.core.files import write_file
from testbench.core.store import ResultFolder, is_plain, manifest_of, settle
from testbench.page.tables import Column, Table, Value
from testbench.questions.exercise.ask import CARD, restore, start
from testbench.questions.exercise.check import Result
from testbench.questions.exercise.seal import NAMES, load_exercise, read_key

KEY, TABLE, MARKS = "key.txt", "roster.csv", "marks.csv"
HANDED_OUT = "students"
_HEADS = ("student", "exercise", "folder")
_MOST = 500


@dataclass(frozen=True)
class Roster:
    """What was written for a class."""

    folder: Path  # of the class; all in ``students`` may be handed out, the rest is the teacher's
    key_file: Path  # with the teacher's own key
    begun: tuple[Path, ...]  # folders that were written now
    kept: tuple[Path, ...]  # folders that were there already
    restored: tuple[Path, ...]  # files of theirs that were missing, and were written again


def students_of(words: str) -> tuple[str, ...]:
    """Return names of students: of a file with one name a line, or "student 1" and so on if a number is given.

    Raises:
        RecordError: there is no such file.
        ScenarioError: the number is not 1 to 500, or a name comes twice.
    """
    if re.fullmatch(r"[0-9]+", words):
        count = int(words)
        if not 1 <= count <= _MOST:
            raise ScenarioError(f"a class must have 1 to {_MOST} students, got {words}")
        return tuple(f"student {k + 1}" for k in range(count))
    try:
        lines = read_text(Path(words), "roster", "utf-8-sig").splitlines()
    except RecordError as error:
        raise RecordError(f"a class must be a number of students or a file of names; {error.message}") from error
    names = tuple(name for name in (line.strip() for line in lines) if name)
    folders = [_folder(name).casefold() for name in names]  # some systems know no capitals
    twice = sorted({n for n, f in zip(names, folders, strict=True) if folders.count(f) > 1})
    if twice or not names:
        got = f"{', '.join(twice)} twice" if twice else "no name"
        raise ScenarioError(f"{words}: names of students must differ, in letters and digits, got {got}")
    return names


def exercises_of(folder: Path) -> tuple[str, ...]:
    """Return the exercises that a class has, as its table tells them; all there are for a new class."""
    had = {row["exercise"] for row in _table(folder)}
    return tuple(name for name in NAMES if name in had) or NAMES


def _table(folder: Path) -> list[dict[str, str]]:
    """Return the rows of the table of a class; none if there is no table, or it is another one."""
    if not (folder / TABLE).exists():
        return []
    rows = [*csv.DictReader(read_text(folder / TABLE, "table").splitlines())]
    return [row for row in rows if [*row] == [*_HEADS] and all(row.values())]


def make_roster(students: Sequence[str], exercises: Sequence[str], folder: Path, key_file: Path | None) -> Roster:
    """Write the folder of every exercise for every student; of what is there already, only missing files are written.

    The teacher's key is that of ``key_file``, else the one in the folder, else a new one that is written there.

    Raises:
        BusyError: another process writes into the folder.
        RecordError: there is no such exercise.
        WriteError: the folder cannot be written to.
        ScenarioError: a name or the key breaks a law.
    """
    for name in exercises:
        load_exercise(name)
    begun: list[Path] = []
    kept: list[Path] = []
    restored: list[Path] = []
    with ResultFolder(folder, adds=True) as whole:
        own = key_file or folder / KEY
        if not own.is_file():
            write_file(own if key_file else whole.live(KEY), secrets.token_hex(16) + "\n")
        key = read_key(own)
        rows: dict[str, tuple[Value, ...]] = {row["folder"]: tuple(row.values()) for row in _table(folder)}
        for student in students:
            for name in exercises:
                place = folder / HANDED_OUT / _folder(student) / name
                if manifest_of(place) is not None or (place / CARD).is_file():
                    restored += [place / file for file in restore(place, name, student, key)]
                    kept.append(place)
                else:
                    start(name, student, key, place)
                    begun.append(place)
                where = place.relative_to(folder).as_posix()
                rows[where] = (student, name, where)
        write_file(whole.new / TABLE, _csv("roster", _HEADS, [*rows.values()]))
    return Roster(folder, own, tuple(begun), tuple(kept), tuple(restored))


def folders_of(places: Sequence[Path]) -> list[Path]:
    """Return the folders of exercises in some places, at whatever depth.

    Raises:
        RecordError: there is none.
    """
    found = sorted({card.parent for place in places for card in settle(place).rglob(CARD)})
    if not found:
        raise RecordError(
            f"marks are made of folders that `testbench exercise roster` or `start` wrote, got "
            f"'{', '.join(map(str, places))}' without any {CARD}"
        )
    return found


def marks_text(results: Mapping[Path, Result | Refusal]) -> str:
    """Return the marks as CSV: one row a folder, with what was not right and why."""
    rows: list[tuple[Value, ...]] = []
    for folder, result in results.items():
        if isinstance(result, Refusal):
            rows.append((folder.parent.name, folder.name, None, None, None, str(result)))
            continue
        missed = [v for v in result.verdicts if v.outcome != "right"]
        why = "; ".join(f"{v.question.key} = {v.given}: {v.words}" for v in missed if v.outcome != "missing")
        keys = ", ".join(f"{v.question.key} (missing)" if v.outcome == "missing" else v.question.key for v in missed)
        rows.append((result.student, result.name, result.right, len(result.verdicts), keys, why))
    return _csv("marks", ("student", "exercise", "right", "of", "not right", "why"), rows)


def _folder(student: str) -> str:
    name = re.sub(r"[^\w.-]+", "_", student.strip()).strip(".") or "_"
    return name if is_plain(name) else f"_{name}"


def _csv(name: str, heads: Sequence[str], rows: Sequence[tuple[Value, ...]]) -> str:
    return Table(name, name, "", tuple(Column(head, head) for head in heads), tuple(rows)).to_csv()
