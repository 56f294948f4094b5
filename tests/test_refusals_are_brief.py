"""A refusal quotes at most 200 letters of what it got, wherever that came from."""

from __future__ import annotations

import pytest
from commands import ends

from testbench.core.errors import QUOTED, ScenarioError, TestbenchError, WriteError, brief

SIGN = "\N{SECTION SIGN}"
TEXTS = {
    "unbroken": SIGN * 6000,
    "with blanks": f"{SIGN * 20} " * 300,
    "with quotes": f"{SIGN * 9}'s \"{SIGN * 9} " * 300,
}
TEXT = pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)


@pytest.mark.parametrize(
    ("text", "letters"),
    [
        ("a value must be > 0, got '{}'; give another", 200),
        ('a value must be > 0, got "{}"; give another', 200),
        ("no file {}; give another", 200),
        ("{}", 200),
        ("'{}' and '{}' differ", 400),
        ("a\n{}\nb", 200),
    ],
)
def test_what_is_quoted_is_cut_in_the_middle(text, letters):
    for value in ("x" * 5000, "/".join(["folder"] * 900)):
        short = brief(text.format(value, value))
        ours = len(text.format("", ""))
        assert ours < len(short) <= ours + letters + 8
    assert brief(f"no '{'a' * 300}/end.toml'").endswith("a/end.toml'")


def test_our_own_words_are_left_alone():
    lists = "valid: " + ", ".join(f"name_{k}" for k in range(150))
    assert brief(lists) == lists
    words = f"'a.' is {'a long sentence of ours, ' * 20}and 'b' too; the aircraft's law and the sensors' law hold"
    assert brief(words) == words
    assert brief("x" * QUOTED) == "x" * QUOTED


def test_errors_of_every_kind_are_brief_however_they_are_made():
    kinds = [TestbenchError]
    for kind in kinds:
        kinds += kind.__subclasses__()
        if kind.__init__ in (TestbenchError.__init__, WriteError.__init__):
            error = kind("got " + "x" * 5000)
            error.place = "y" * 5000
            assert len(str(error)) < 450
    many = ScenarioError(f"key_{k}: unknown" for k in range(10_000))
    assert str(many).startswith("10000 faults:\n  key_0")
    assert str(many).endswith("and 9950 more")
    assert len(many.faults) == 10_000


def quoted(monkeypatch, capsys, words) -> int:
    """Run a command that must be refused, and return how many letters of the hostile text a line of it holds."""
    status, lines = ends(monkeypatch, capsys, *words)
    assert status != 0, words
    assert lines[0].startswith("error: ")
    return max(line.count(SIGN) for line in lines)


SCENARIO = {
    "a key": 'title = "t"\n{} = 1\n',
    "a title": "title = {}\n",
    "an aircraft": 'title = "t"\naircraft = {}\n',
    "a nested key": 'title = "t"\n[condition]\n{} = 3\n',
    "a value of the wrong kind": 'title = "t"\nduration_s = {}\n',
    "an estimator": "[[estimators]]\nmethod = {}\n",
    "broken TOML": "title = {} {}\n",
}


@TEXT
@pytest.mark.parametrize("name", SCENARIO)
def test_scenarios(tmp_path, monkeypatch, capsys, name, text):
    monkeypatch.chdir(tmp_path)
    value = '"' + text.replace('"', '\\"') + '"'
    (tmp_path / "s.toml").write_text(SCENARIO[name].replace("{}", value), encoding="utf-8")
    for command in (["run", "s.toml"], ["check", "s.toml"]):
        assert quoted(monkeypatch, capsys, command) <= QUOTED


@TEXT
@pytest.mark.parametrize(
    "command",
    [
        ["run", "{}"], ["run", "eolo_alpha", "{}"], ["run", "--{}"], ["{}"], ["list", "{}"], ["studio", "{}"],
        ["report", "{}"], ["new", "aircraft", "{}"], ["import", "{}"], ["check", "{}"], ["export", "{}"],
        ["plan", "new", "{}"], ["run", "eolo_alpha", "--out", "{}"], ["aircraft", "{}"], ["gap", "{}"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_arguments(tmp_path, monkeypatch, capsys, command, text):
    monkeypatch.chdir(tmp_path)
    assert quoted(monkeypatch, capsys, [part.format(text) for part in command]) <= QUOTED


@TEXT
@pytest.mark.parametrize("table", ["{},b\n1,2\n", "t [{}],q [deg]\n0,1\n1,2\n", "t [s],q [deg]\n0,{}\n1,{}\n", "{}\n"])
def test_headers_and_cells_of_tables(tmp_path, monkeypatch, capsys, table, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(table.format(text, text) * 1, encoding="utf-8")
    for command in (["import", "a.csv"], ["export", "a.csv", "--to", "b.csv"], ["modes", "a.csv"]):
        assert quoted(monkeypatch, capsys, command) <= QUOTED


@pytest.mark.parametrize("control", ["\x1b[31m", "\x1b]0;title\x07", "\x08\x08", "\r", "\x9b2J", "\u202e", "\udc9b"])
def test_no_control_of_a_terminal_reaches_it_from_a_name(monkeypatch, capsys, control):
    name = f"a{control}b<script>.toml"
    for text in (name, name + "x" * 3000):
        assert [c for c in brief(f"no file '{text}'\nis here") if not c.isprintable()] == ["\n"]
    status, lines = ends(monkeypatch, capsys, "check", name)
    assert status == 2
    assert all(line.isprintable() for line in lines)
