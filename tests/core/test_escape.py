"""A user's text in files of other languages stays a text."""

import csv
import io

import numpy as np
import pytest

from testbench.core.escape import csv_cell, lua_comment, one_line, xml_comment
from testbench.page.tables import Column, Table

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
