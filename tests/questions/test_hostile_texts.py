"""Hostile texts in every key of every kind of file: refused in words, or taken as a text."""

import copy
import json
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from testbench.core.errors import ScenarioError, TestbenchError
from testbench.core.paths import SCENARIOS
from testbench.questions import QUESTIONS
from testbench.questions.exercise.answers import read_answers
from testbench.questions.exercise.check import verdict
from testbench.questions.exercise.exercise import Answer
from testbench.questions.exercise.seal import load_exercise

HOSTILE = "x\nos.execute('touch PWNED') --"
ON_ONE_LINE = (
    "]] os.execute('touch PWNED') --[[",
    "=cmd|' /C calc'!A0",
    "</title><script>alert(1)</script>",
    "--><system file='x'/><!--",
    "$\\input{/etc/passwd}$",
    "../../escape",
    "$(touch PWNED)`touch PWNED`;touch PWNED",
    "{{ 7 * 7 }}{% raw %}",
    "\u202e right to left",
)
FILES = [(q, sorted((SCENARIOS / q.folder).glob("*.toml"))[0]) for q in QUESTIONS if q.kind]
"""Exercises have no scenarios; what students write, names and answers, is tried below."""
PROSE = ("question", "source", "rights", "note")


def places(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(content, str):
        yield at
    elif isinstance(content, (dict, list)):
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            yield from places(value, (*at, key))


def with_text(content: dict[str, Any], at: tuple[Any, ...], text: str) -> dict[str, Any]:
    out = copy.deepcopy(content)
    place: Any = out
    for key in at[:-1]:
        place = place[key]
    place[at[-1]] = text
    return out


@pytest.mark.parametrize(("question", "file"), FILES, ids=lambda v: getattr(v, "stem", getattr(v, "command", "")))
def test_every_text_of_a_file_is_one_line(question, file):
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    tried = 0
    for at in places(content):
        if at[-1] in PROSE:
            continue
        with pytest.raises(ScenarioError, match="must be one line without control characters") as error:
            question.file_class.of(with_text(content, at, HOSTILE), file)
        assert str(at[-1] if isinstance(at[-1], str) else at[-2]) in str(error.value)
        assert "\n" not in error.value.faults[0]
        tried += 1
    assert tried > 3


@pytest.mark.parametrize(("question", "file"), FILES, ids=lambda v: getattr(v, "stem", getattr(v, "command", "")))
def test_hostile_texts_of_one_line_are_texts_or_refused_in_words(question, file):
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    taken = 0
    for k, at in enumerate(places(content)):
        with suppress(TestbenchError):
            question.file_class.of(with_text(content, at, ON_ONE_LINE[k % len(ON_ONE_LINE)]), file)
            taken += 1
    assert taken > 0  # a title, at the least


@pytest.mark.parametrize(("question", "file"), FILES, ids=lambda v: getattr(v, "stem", getattr(v, "command", "")))
def test_prose_may_have_lines_but_no_other_control_characters(question, file):
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    content.setdefault("question", "Why?")
    for at in places(content):
        if at[-1] not in PROSE:
            continue
        assert question.file_class.of(with_text(content, at, HOSTILE), file) is not None
        for control in ("\x1b[2J", "\0", "\x85", "\u2028"):
            with pytest.raises(ScenarioError, match="without control characters") as error:
                question.file_class.of(with_text(content, at, f"x{control}y"), file)
            assert control not in str(error.value)


@pytest.mark.parametrize("text", [HOSTILE, "\x1b[2J", *ON_ONE_LINE])
def test_answers_of_a_student_are_judged_as_texts(tmp_path, text):
    exercise = load_exercise("doublet_length")
    file = tmp_path / "answers.toml"
    for question in exercise.questions:
        file.write_text(f"{question.key} = {json.dumps(text)}\n", encoding="utf-8")
        given = read_answers(file, exercise.questions)
        judged = verdict(question, given[question.key], Answer(1.0))
        assert judged.outcome == "wrong"
        for shown in (str(judged.given), judged.words):
            assert "\n" not in shown
            assert "\x1b" not in shown


@pytest.mark.parametrize("text", [HOSTILE, "\x1b[2J", *ON_ONE_LINE])
def test_a_key_of_answers_is_no_line_of_the_refusal(tmp_path, text):
    file = tmp_path / "answers.toml"
    file.write_text(f"{json.dumps(text)} = 1.0\n", encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        read_answers(file, load_exercise("doublet_length").questions)
    assert all("\n" not in fault and "\x1b" not in fault for fault in error.value.faults)


def test_a_line_end_in_a_key_is_refused():
    with pytest.raises(ScenarioError, match="a key of the file"):
        QUESTIONS[0].file_class.of({"title": "x", "a\nb": 1}, Path("x.toml"))


@pytest.mark.parametrize(
    "text", ["x = " + "{ y = " * 3000 + "1" + " }" * 3000, "x = " + "9" * 5000, "x = " + "[" * 9000]
)
def test_what_no_parser_can_hold_is_refused_in_words(tmp_path, text):
    file = tmp_path / "deep.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match="must be TOML") as error:
        QUESTIONS[0].file_class.load(file)
    assert len(str(error.value)) < 500
