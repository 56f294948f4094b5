"""Exercises in the app: what a student sees, and nothing of the truth."""

import json

import pytest

from testbench.core.errors import RecordError, ScenarioError
from testbench.questions.app.exercises import answer_exercise, list_exercises, page_of
from testbench.questions.exercise.ask import start
from testbench.questions.exercise.check import check

KEY = "of a test"


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    return folder, start("doublet_length", "Ada Lovelace", KEY, folder / "class" / "students" / "ada")


def test_what_is_shown_holds_no_answer(given):
    folder, started = given
    told = list_exercises(folder)
    (one,) = told["begun"]
    assert (one["folder"], one["student"]) == ("class/students/ada", "Ada Lovelace")
    assert [q["key"] for q in one["questions"]] == [q.key for q in started.exercise.questions]
    assert all(q["given"] is None for q in one["questions"])
    assert len(told["catalogue"]) >= 15
    shown = json.dumps(told) + (folder / one["page"]).read_text("utf-8")
    right = started.exercise.answer(started.case)
    numbers = [f"{a.value:.3g}" for a in right.values() if isinstance(a.value, float)]
    assert numbers
    assert not [n for n in numbers if n in json.dumps(told["begun"])]
    assert "hidden" not in shown
    assert set(one) == {"folder", "exercise", "title", "student", "page", "records", "questions"}


def test_answers_go_into_the_file_that_the_checker_reads(given):
    folder, started = given
    right = {k: a.value for k, a in started.exercise.answer(started.case).items()}
    typed = {k: str(v).replace(".", ",") if isinstance(v, float) else v for k, v in right.items()}
    told = answer_exercise(folder, {"exercise": "class/students/ada", "answers": typed})
    assert check(started.folder, KEY).passed
    assert [q["given"] for q in told["questions"]] == [right[q["key"]] for q in told["questions"]]
    answer_exercise(folder, {"exercise": "class/students/ada", "answers": dict.fromkeys(right, "")})
    assert check(started.folder, KEY).passed  # what is left empty stays


@pytest.mark.parametrize(
    ("asked", "law"),
    [
        ({"exercise": "class", "answers": {}}, r"a \.toml file in the folder of the app must be named"),
        ({"exercise": "../x", "answers": {}}, r"a \.toml file in the folder of the app must be named"),
        ({"exercise": "class/students/ada", "answers": []}, "answers must be numbers or words"),
        ({"exercise": "class/students/ada", "answers": {"length": "1"}}, "no question has this key"),
    ],
)
def test_what_cannot_be_answered_is_said(given, asked, law):
    with pytest.raises((RecordError, ScenarioError), match=law):
        answer_exercise(given[0], asked)


def test_a_number_must_be_one(given):
    folder, started = given
    key = next(q.key for q in started.exercise.questions if hasattr(q, "unit"))
    for text in ("fast", "inf", "nan", "1 rad"):
        with pytest.raises(ScenarioError, match=f"{key} must be a finite number without its unit"):
            answer_exercise(folder, {"exercise": "class/students/ada", "answers": {key: text}})


def test_texts_of_exercises_alone_are_served(given):
    folder, _ = given
    assert page_of(folder, "class/students/ada/README.html") is not None
    (folder / "README.html").write_text("not of an exercise", encoding="utf-8")
    ada = "class/students/ada"
    for path in ("README.html", f"{ada}/notebook.ipynb", "../x/README.html", f"{ada}/exercise.toml"):
        assert page_of(folder, path) is None, path
