"""Cells of tables on a page: long texts are notes below the table, long names may break, short texts do not."""

import re

from testbench.page.page import COMPUTED, Page
from testbench.page.tables import LONGEST, SHEET_PT, Column, Table
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
    assert typeset("7.7e-06 % of 3e+12, though past = 1e-5") == "7.7·10⁻⁶\u00a0% of 3·10¹², though past = 1e-5"
    assert typeset("0.08 +- 0.01 m/s2 at 5 Hz") == "0.08 ±\u00a00.01 m/s² at 5\u00a0Hz"
    assert sentence("ekf: it is") == "EKF: it is."
    assert sentence("thrust is late") == "Thrust is late."
    assert sentence("alpha is late") == "alpha is late."


def broad(groups: int, lead: int = 2) -> Table:
    """A table of some first columns and as many groups of three."""
    first = [Column(f"a{k}", f"first {k}") for k in range(lead)]
    rest = [Column(f"g{g} {k}", f"value {k}", "", f"group {g}") for g in range(groups) for k in range(3)]
    row = (*("phugoid",) * lead, *(-123.45 - k for k in range(3 * groups)))
    return Table("t", "T", "C.", (*first, *rest), (row, row))


def test_a_table_that_a_sheet_does_not_take_is_printed_in_parts_that_begin_alike():
    narrow = broad(3)
    assert narrow.sheets() == [narrow]
    table = broad(8)
    parts = table.sheets()
    assert len(parts) > 1
    assert all([c.key for c in part.columns[:2]] == ["a0", "a1"] for part in parts)
    assert [c.key for part in parts for c in part.columns[2:]] == [c.key for c in table.columns[2:]]
    assert [v for part in parts for v in part.rows[0][2:]] == list(table.rows[0][2:])
    for part in parts:  # no group is torn
        assert all(count == 3 for name, count in part.groups() if name)
        assert sum(part._least_pt(k) for k in range(len(part.columns))) <= SHEET_PT
    page = Page(kicker="k", title="t", answer=["it is"], tables=[table], packages=COMPUTED).html([])
    assert page.count('<table class="sheet">') == len(parts)
    assert page.count('<table class="whole">') == 1


def test_parts_of_a_table_without_groups_begin_with_its_first_column():
    columns = tuple(Column(f"c{k}", f"a column {k}") for k in range(30))
    parts = Table("t", "T", "C.", columns, (("x", *(1.5,) * 29),)).sheets()
    assert {part.columns[0].key for part in parts} == {"c0"}
    assert sum(len(part.columns) - 1 for part in parts) == 29


def test_a_group_wider_than_a_sheet_is_torn():
    columns = (Column("a", "a"), *(Column(f"c{k}", f"numbers {k}", "", "one group") for k in range(20)))
    parts = Table("t", "T", "C.", columns, (("x", *(-1234.5,) * 20),)).sheets()
    assert len(parts) > 1
    assert sum(len(part.columns) - 1 for part in parts) == 20


def test_what_is_rounded_to_zero_has_no_sign():
    assert Column("a", "a", decimals=0).text(-0.2) == "0"
    assert Column("a", "a", decimals=1).text(-0.04) == "0.0"
    assert Column("a", "a", decimals=1).text(-0.06) == "−0.1"
