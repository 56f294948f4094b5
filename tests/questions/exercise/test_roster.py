"""A class: folders for every student, a key that nobody else has, and marks that say what each missed."""

import csv
import re
import shutil
from pathlib import Path

import pytest
from commands import command
from killed import killed_at, shown, whole

from testbench.core.errors import RecordError, ScenarioError
from testbench.core.store import OWN, entry_of, manifest_of
from testbench.questions.exercise.answers import write_answers
from testbench.questions.exercise.ask import reopen
from testbench.questions.exercise.roster import KEY, TABLE, _folder, exercises_of, make_roster, students_of
from testbench.questions.exercise.seal import NAMES, PUBLIC_KEY, load_exercise, read_key

EXERCISE = "doublet_length"


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_class_from_roster_to_marks(tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("Ada Lovelace\n\nJosé Núñez\n=cmd|' /C calc'!A0\n", encoding="utf-8")
    key_file = tmp_path / "class" / KEY
    key_file.parent.mkdir()
    key_file.write_text("0123456789abcdef0123456789abcdef\n")
    done = command("exercise", "roster", names, "--exercise", EXERCISE, "-o", tmp_path / "class")
    assert done.returncode == 0, done.stderr
    key = read_key(key_file)
    handed = tmp_path / "class" / "students"
    assert sorted(p.name for p in handed.iterdir()) == ["Ada_Lovelace", "José_Núñez", "_cmd_C_calc_A0"]
    everything = b"".join(p.read_bytes() for p in handed.rglob("*") if p.is_file())
    assert key.encode() not in everything
    ada = handed / "Ada_Lovelace" / EXERCISE
    solved = load_exercise(EXERCISE).solve(ada)
    write_answers(ada, {**solved, "step_s": 1e3})
    jose = handed / "José_Núñez" / EXERCISE
    write_answers(jose, load_exercise(EXERCISE).solve(jose))
    done = command("exercise", "marks", tmp_path / "class")
    assert done.returncode == 0, done.stderr
    rows = {row["student"]: row for row in table(tmp_path / "class" / "marks.csv")}
    assert rows["Ada Lovelace"]["right"] == "2"
    assert rows["Ada Lovelace"]["not right"] == "step_s"
    assert "step_s = 1000.0: too large by a factor" in rows["Ada Lovelace"]["why"]
    assert (rows["José Núñez"]["right"], rows["José Núñez"]["not right"]) == ("3", "")
    hostile = rows["'=cmd|' /C calc'!A0"]
    assert hostile["not right"].count("(missing)") == int(hostile["of"]) == 3


def test_without_exercises_a_new_class_gets_all_and_an_old_one_its_own(tmp_path):
    """`exercise roster 25` was refused for want of --exercise."""
    new = tmp_path / "new"
    done = command("exercise", "roster", "1", "-o", new)
    assert done.returncode == 0, done.stderr
    assert {row["exercise"] for row in table(new / TABLE)} == set(NAMES)
    old = tmp_path / "old"
    make_roster(["Ada"], [EXERCISE], old, None)
    assert exercises_of(old) == (EXERCISE,)


def test_who_joins_later_is_added_and_nothing_is_written_twice(tmp_path):
    first = make_roster(students_of("2"), [EXERCISE], tmp_path, None)
    assert (len(first.begun), len(first.kept)) == (2, 0)
    answers = tmp_path / "students" / "student_1" / EXERCISE / "answers.toml"
    answers.write_text("step_s = 2.0\n")
    key = first.key_file.read_text()
    assert re.fullmatch(r"[0-9a-f]{32}\n", key), "a key of its own"
    again = make_roster(students_of("3"), [EXERCISE], tmp_path, None)
    assert (len(again.begun), len(again.kept)) == (1, 2)
    assert answers.read_text() == "step_s = 2.0\n"
    assert again.key_file.read_text() == key
    assert len(table(tmp_path / TABLE)) == 3
    with pytest.raises(RecordError, match="started with another key"):
        reopen(answers.parent, PUBLIC_KEY)


@pytest.mark.parametrize(
    ("words", "error", "said"),
    [
        ("0", ScenarioError, "1 to 500 students, got 0"),
        ("100000", ScenarioError, "1 to 500 students, got 100000"),
        ("-3", RecordError, "a number of students or a file"),
        ("missing.txt", RecordError, "a number of students or a file"),
    ],
)
def test_a_class_that_cannot_be(words, error, said):
    with pytest.raises(error, match=said):
        students_of(words)


def test_names_that_would_share_a_folder_are_refused(tmp_path):
    (tmp_path / "names.txt").write_text("Ann Lee\nAnn/Lee\n")
    with pytest.raises(ScenarioError, match="must differ, in letters and digits, got Ann Lee, Ann/Lee twice"):
        students_of(str(tmp_path / "names.txt"))
    (tmp_path / "names.txt").write_text("Ann\nann\n")  # one folder where capitals do not count
    with pytest.raises(ScenarioError, match="got Ann, ann twice"):
        students_of(str(tmp_path / "names.txt"))
    assert _folder("con") == "_con"
    (tmp_path / "names.txt").write_text("\n")
    with pytest.raises(ScenarioError, match="got no name"):
        students_of(str(tmp_path / "names.txt"))


def test_marks_of_a_folder_without_exercises(tmp_path):
    done = command("exercise", "marks", tmp_path)
    assert done.returncode == 2
    assert "without any exercise.toml" in " ".join(done.stderr.split())


def handed_out(folder):
    return {place: shown(folder / "students" / place / EXERCISE) for place in ("student_1", "student_2")}


def test_a_class_whose_making_was_killed_is_finished_by_the_same_command(tmp_path):
    make_roster(students_of("2"), [EXERCISE], tmp_path / "whole", None)
    complete = handed_out(tmp_path / "whole")
    assert all("answers.toml" in files for files in complete.values())
    for step in (1, 3, 6, 15, 25, 40, 50, 60, 75):
        folder = tmp_path / str(step)
        assert killed_at(step, lambda folder=folder: make_roster(students_of("2"), [EXERCISE], folder, None))
        for place in (folder / "students").glob("*/*"):
            assert shown(place) in (set(), complete[place.parent.name])
        key = (folder / KEY).read_text() if (folder / KEY).exists() else None
        found = make_roster(students_of("2"), [EXERCISE], folder, None)
        assert key in (None, found.key_file.read_text())
        assert handed_out(folder) == complete
        assert all(whole(place) for place in (*found.begun, *found.kept, folder))
        assert not found.restored


def test_files_that_are_gone_are_written_again_and_answers_stay(tmp_path):
    make_roster(["Ada"], [EXERCISE], tmp_path, None)
    ada = tmp_path / "students" / "Ada" / EXERCISE
    complete = {p.relative_to(ada): p.read_bytes() for p in ada.rglob("*") if p.is_file()}
    (ada / "answers.toml").write_text("step_s = 2.0\n")
    (ada / "README.md").unlink()
    shutil.rmtree(ada / "records")
    done = command("exercise", "roster", "Ada.txt", "--exercise", EXERCISE, "-o", tmp_path, cwd=names_of(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "1 were there already" in done.stdout
    assert f"Missing, and written again: {ada / 'README.md'}" in done.stdout
    again = {p.relative_to(ada): p.read_bytes() for p in ada.rglob("*") if p.is_file()}
    assert {name for name in complete if again[name] != complete[name]} == {Path("answers.toml")}
    (ada / "README.md").unlink()
    other = tmp_path / "other"
    other.write_text("another key of the teacher")
    with pytest.raises(RecordError, match="started with another key"):
        make_roster(["Ada"], [EXERCISE], tmp_path, other)
    assert not (ada / "README.md").exists()


def names_of(folder):
    (folder / "Ada.txt").write_text("Ada\n")
    return folder


def test_what_is_handed_out_tells_neither_key_nor_command(tmp_path):
    key = tmp_path / "teacher_key"
    key.write_text("0123456789abcdef0123456789abcdef\n")
    words = ("exercise", "start", EXERCISE, "--student", "ada", "--key-file", key, "-o", tmp_path / "ada")
    done = command(*words)
    assert done.returncode == 0, done.stderr
    manifest = manifest_of(tmp_path / "ada")
    assert (manifest.command, manifest.inputs, manifest.packages) == ((), {}, {})
    hidden = b"".join(p.read_bytes() for p in (tmp_path / "ada" / OWN).iterdir())
    for secret in (key.read_bytes().strip(), key.name.encode(), entry_of(key)[1].encode()):
        assert secret not in hidden


def test_marks_are_a_file_of_the_class_and_one_that_is_not_ours_is_not_replaced(tmp_path):
    make_roster(["Ada"], [EXERCISE], tmp_path, None)
    later = make_roster(["Bo"], [EXERCISE], tmp_path, None)
    assert [row["student"] for row in table(tmp_path / TABLE)] == ["Ada", "Bo"]
    assert len(later.begun) == 1
    assert command("exercise", "marks", tmp_path).returncode == 0
    assert {*manifest_of(tmp_path).files} == {KEY, TABLE, "marks.csv"}
    (tmp_path / "mine.csv").write_text("mine")
    done = command("exercise", "marks", tmp_path, "-o", tmp_path / "mine.csv")
    assert done.returncode == 2
    assert "no manifest lists" in done.stderr
    assert (tmp_path / "mine.csv").read_text() == "mine"
