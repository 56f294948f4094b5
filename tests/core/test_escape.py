"""A user's text in files of other languages stays a text.

Tables written as TOML are read back as they were.
"""

import ast
import csv
import io
import shlex
import tomllib
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from testbench.core.advice import doubt
from testbench.core.escape import (
    csv_cell,
    lua_comment,
    markdown_cell,
    markdown_table,
    one_line,
    quoted,
    shell_word,
    table_lines,
    toml_value,
    xml_attribute,
    xml_comment,
    xml_text,
)  # fmt: skip
from testbench.core.files import write_file
from testbench.page.draw import styled
from testbench.page.figure import Chart, Curve, Panel
from testbench.page.html import text_page
from testbench.page.publish import data_of, latex_text
from testbench.page.tables import Column, Table
from testbench.questions.exercise.answers import template
from testbench.questions.exercise.seal import load_exercise
from testbench.questions.export.ask import Matrices, control_text, jsbsim_text

LINES = ("a\nb", "a\r\nb", "a\x0bb", "a\x1bb", "a\u2028b", "a\x85b", "a\x00b")


@pytest.mark.parametrize("text", LINES)
def test_what_ends_a_line_becomes_a_blank(text):
    assert one_line(text) == "a b"
    assert "\n" not in lua_comment(text)


@pytest.mark.parametrize("text", ["[[", "[==[ x", "x ]] y"])
def test_a_comment_of_one_line_stays_one(text):
    assert not f"--{lua_comment(text)}".startswith("--[")


@pytest.mark.parametrize("text", ["a--b", "a---b", "a-----", "-->", "a-"])
def test_a_comment_of_xml_holds_no_end(text):
    said = xml_comment(text)
    assert "--" not in said
    assert not said.endswith("-")


@pytest.mark.parametrize("text", ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3+cmd|x", "\t=1", "-x"])
def test_a_formula_is_a_text_in_a_table(text):
    table = Table("t", "t", "", (Column("name", text), Column("x", "x")), ((text, 1.0),))
    rows = list(csv.reader(io.StringIO(table.to_csv())))
    assert all(cell[0] == "'" for cell in (rows[1][0], csv_cell(text)))
    assert rows[1][1] == "1.0"


@pytest.mark.parametrize("text", ["-54.0 ± 1.7", "+3", "-1e-3", "– 3", "de", "", "3-2-1-1"])
def test_numbers_and_words_stay_as_they_are(text):
    assert csv_cell(text) == text


def test_numbers_below_zero_are_written_as_numbers():
    table = Table("t", "t", "", (Column("x", "x"),), ((-np.pi,),))
    assert table.to_csv().splitlines()[1] == repr(-np.pi)


HOSTILE = (
    "e\nPWNED = 1 #",
    "e\r\nPWNED = 1",
    "e\rPWNED = 1",
    '"""\nPWNED = 1\n"""',
    '\\"""; PWNED = 1 #',
    "'; PWNED = 1; '",
    "--]] PWNED = 1 --[[",
    "--><pwned/><!--",
    "]]><pwned/>",
    "</title><script>pwned()</script>",
    "=cmd|' /C calc'!A0",
    "a | b \\| c `d` | <img src=x onerror=pwned()>",
    "$(touch PWNED) `touch PWNED`; touch PWNED",
    "\\input{/etc/passwd}",
    "a\u2028PWNED = 1\u2029\x85b",
    "a\ud800b\x00c\ufffe",
)
"""Names that are code in some language."""


def model(name: str) -> Matrices:
    one, none = np.array([[0.5]]), np.zeros((1, 1))
    return Matrices(name, name, ("de",), ("q",), one, one, one, none, 0.02, none, (doubt("own", name),))


def shape_of(text: str) -> list[str]:
    """The statements of a Python program: kinds of nodes without what is inside of literals."""
    return [type(node).__name__ for node in ast.walk(ast.parse(text))]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_model_in_python_and_in_xml_has_its_name_as_a_text(name):
    assert shape_of(control_text(model(name))) == shape_of(control_text(model("e")))
    made, plain = (ET.fromstring(jsbsim_text(model(n)).encode("utf-8", "replace")) for n in (name, "e"))
    assert [e.tag for e in made.iter()] == [e.tag for e in plain.iter()]
    assert [e.attrib for e in list(made.iter())[1:]] == [e.attrib for e in list(plain.iter())[1:]]


@pytest.mark.parametrize("name", HOSTILE)
def test_the_program_of_a_figure_has_its_labels_as_literals(name):
    def drawn(text: str) -> tuple[str, str]:
        panel = Panel(draws=[Curve(x=[0.0, 1.0], y=[1.0, 2.0], name=text)], title=text, x=text)
        data = data_of(styled(Chart([[panel]])), text)
        return data[".py"], data[".csv"]

    (program, table), (plain, _) = drawn(name), drawn("e")
    tree, kinds = ast.parse(program), shape_of(plain)
    assert shape_of(program) == kinds
    assert name in {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert [len(row) for row in csv.reader(io.StringIO(table))] == [2, 2, 2]


@pytest.mark.parametrize("name", HOSTILE)
def test_xml_toml_and_the_shell_read_a_name_back(name):
    xml = ET.fromstring(f"<a b={xml_attribute(name)}>{xml_text(name)}<!-- {xml_comment(name)} --></a>")
    assert len(list(xml.iter())) == 1
    if name.isprintable():
        assert (xml.text, xml.get("b")) == (name, name)
    text = f"name = {quoted(name)}\n# {one_line(name)}\n"
    read = tomllib.loads(text.encode().decode())
    assert read == {"name": name.replace("\ud800", "?")}
    assert shlex.split(shell_word(name)) == [one_line(name)]
    answers = tomllib.loads(template(name, load_exercise("doublet_length")))
    assert answers == tomllib.loads(template("e", load_exercise("doublet_length")))


@pytest.mark.parametrize("name", HOSTILE)
def test_a_table_in_markdown_keeps_its_cells_and_gives_a_page_no_element(name):
    class Reader(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.seen: list[str] = []

        def handle_starttag(self, tag: str, attrs: object) -> None:
            self.seen.append(tag)

    def tags(text: str) -> list[str]:
        reader, table = Reader(), markdown_table(("a", "b"), [(text, 1)])
        reader.feed(text_page(text, "\n".join([f"# {markdown_cell(text)}", "", *table])))
        return [tag for tag in reader.seen if tag not in ("code", "em")]

    assert tags(name) == tags("e")


@pytest.mark.parametrize("name", HOSTILE)
def test_lua_and_latex_run_nothing_of_a_name(name):
    lua = pytest.importorskip("lupa").LuaRuntime()
    lua.execute(f"-- {lua_comment(name)}\nreached = true".encode("utf-8", "replace"))
    assert (lua.globals().reached, lua.globals().PWNED) == (True, None)
    assert "\\input" not in latex_text(name)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_cell_of_a_table_is_one_cell_and_no_formula(name):
    table = Table("t", "t", "", (Column("a", name), Column("b", "b")), ((name, 1.0),))
    rows = list(csv.reader(io.StringIO(table.to_csv(), newline="")))
    assert [len(row) for row in rows] == [2, 2]
    same = {name, name.replace("\r", "\n")}
    assert rows[1][0] in same | {f"'{text}" for text in same}
    assert rows[1][0][0] != "="


def test_what_utf_8_does_not_have_keeps_no_file_from_being_written(tmp_path):
    assert write_file(tmp_path / "x.py", "# a\ud800b\n").read_text(encoding="utf-8") == "# a?b\n"


def test_a_table_is_read_back_as_it_was_written():
    table = {
        "title": 'a "quoted" text\\ with a line\nend and \x7f',
        "empty": [],
        "numbers": [1.5, -2e-17, 3.0],
        "yes": True,
        "count": 3,
        "odd key, with.dots": "x",
        "inner": {"deep": {"a": 1.0}, "deeper": {"b": {"c": ["p", "q"]}}, "none": {}},
        "list": [{"name": "one", "by": {"de_cmd": {"lag_s": 0.03}}}, {"name": "two"}],
        "last": {"x": [[1.0, 2.0], [3.0, 4.0]]},
    }
    assert tomllib.loads("\n".join(table_lines(table))) == table
    assert tomllib.loads(f"x = {toml_value(table)}") == {"x": table}
    assert tomllib.loads("\n".join(table_lines({"a": 1, "b": None}))) == {"a": 1}
