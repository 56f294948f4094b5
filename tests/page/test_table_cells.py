"""Cells of tables on a page: long texts are notes below the table, long names may break, short texts do not."""

from __future__ import annotations

import re

from testbench.page.page import COMPUTED, Page
from testbench.page.tables import LONGEST, Column, Table
from testbench.page.words import sentence, typeset

LONG = "the residuals are more than the noise; " * 8


def html(*texts: str) -> str:
    columns = (Column("k", "key"), Column("why", "why"))
    table = Table("t", "T", "Why.", columns, tuple((str(k), text) for k, text in enumerate(texts)))
    return Page(kicker="k", title="t", answer=["it is"], tables=[table], packages=COMPUTED).html([])


def test_equal_long_texts_are_one_note_below_the_table():
    assert len(LONG) > LONGEST
    page = html(LONG, "short", LONG, LONG + "<b>")
    assert page.count(LONG.strip()) == 2
    assert page.count('href="#note-t-1"') == 2
    assert page.count('id="note-t-1"') == page.count('id="note-t-2"') == 1
    assert "<b>" not in page
    assert all(len(cell) < LONGEST for cell in re.findall(r'<td class="text">([^<]*)', page))
    assert 'class="notes"' not in html("short")


def test_a_long_name_breaks_and_what_is_short_does_not():
    page = html("02_elevator_multisine_4_to_20_Hz.x", "5 % & <i>", "a_b.c")
    assert "02_<wbr>elevator_<wbr>multisine_<wbr>4_<wbr>to_<wbr>20_<wbr>Hz.<wbr>x" in page
    assert '<td class="short">5\u00a0% &amp; &lt;i&gt;</td>' in page
    assert ">a_b.c<" in page


def test_signs_are_those_of_print():
    assert typeset("0.08 +- 0.01 m/s2 at 5 Hz") == "0.08 ±\u00a00.01 m/s² at 5\u00a0Hz"
    assert sentence("ekf: it is") == "EKF: it is."
    assert sentence("thrust is late") == "Thrust is late."
    assert sentence("alpha is late") == "alpha is late."
