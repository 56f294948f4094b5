"""Hostile texts in every key of every kind of file: refused in words, or taken as a text."""

import copy
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from testbench.core.errors import ScenarioError, TestbenchError
from testbench.core.paths import SCENARIOS
from testbench.questions import QUESTIONS

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
FILES = [
    (q, sorted((SCENARIOS / q.folder).glob("*.toml"))[0])
    for q in QUESTIONS
    if q.kind and q.command not in ("exercise",)
]
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
