"""Page: what is written, what is shown, and how its sentences and tables read."""

import re
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from testbench.core.store import OWN
from testbench.page.page import COMPUTED, Page, source_of
from testbench.page.tables import Column, Table
from testbench.page.terminal import print_rows
from testbench.page.words import Line, answer_lines, counted, how_many_more, listed, sentence, some
from testbench.questions.run.scenario import Scenario

pytestmark = pytest.mark.drawn

TABLE = Table(
    "sizes",
    "Sizes",
    "Of everything.",
    (Column("name", "name"), Column("size", "size", "m", decimals=1), Column("none", "never known", "kg")),
    (("[bold]one[/bold]", 1.0, None), ("two", None, None)),
)


def page(**changes) -> Page:
    given = {"kicker": "A kind: a name", "title": "A title", "answer": ["it is 5 m long", ("doubt", "q: is it?")]}
    return Page(**given | changes)


def shown(made: Page, folder: str | None = None, width: int = 80) -> str:
    out = StringIO()
    made.show(Console(file=out, width=width, color_system=None), folder)
    return out.getvalue()


def test_a_sentence_has_a_capital_a_full_stop_and_its_units_on_one_line() -> None:
    assert sentence("it takes 5 s or 3.5 rad/s") == "It takes 5\u00a0s or 3.5\u00a0rad/s."
    assert sentence("alpha: is it 5 %?") == "alpha: is it 5\u00a0%?"
    assert sentence("M_q is known") == "M_q is known."
    assert sentence("ζ is 0.5!") == "ζ is 0.5!"
    assert sentence("a name") == "A name."
    once = sentence("5 s, 6 seconds")
    assert once == "5\u00a0s, 6 seconds."
    assert sentence(once) == once


def test_answers_have_a_lead_and_keep_the_kinds_that_are_given() -> None:
    assert answer_lines(["one", "two", ("doubt", "three")]) == [
        Line("lead", "One."), Line("finding", "Two."), Line("doubt", "Three."),
    ]  # fmt: skip
    assert answer_lines([("doubt", "one")]) == [Line("doubt", "One.")]


def test_lists_in_words() -> None:
    assert [listed(words) for words in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "none",
        "a",
        "a and b",
        "a, b and c",
    ]
    assert some("abc") == "a; b; c"
    assert some("abcde") == "a; b; c; and 2 more"
    assert some(iter("abcde"), 1, ", ") == "a, and 4 more"
    assert [counted(n, "battery", "batteries") for n in (0, 1, 2)] == ["0 batteries", "1 battery", "2 batteries"]
    assert counted(3, "flight") == "3 flights"


def test_everything_is_written_and_the_page_is_last(tmp_path) -> None:
    def both(folder: Path) -> list[Path]:
        """Write what is made together."""
        (folder / "pair.txt").write_text("pair")
        return [folder / "pair.txt"]

    made = page(
        tables=[TABLE],
        more_tables=[Table("long", "Long", "", TABLE.columns, TABLE.rows)],
        files={"deep/text.txt": "text", "bytes.bin": b"\x00", "own.txt": lambda path: path.write_text("own")},
        more_files=both,
        asked=[("what", "<that>")],
        provenance=[("seed", "3")],
        packages=COMPUTED,
        source=("a.toml", "title = '&'"),
    )
    paths = made.write(tmp_path)
    assert sorted(paths) == sorted(p for p in tmp_path.rglob("*") if p.is_file() and OWN not in p.parts)
    assert paths[-1] == tmp_path / "report.html"
    assert (tmp_path / "bytes.bin").read_bytes() == b"\x00"
    assert (tmp_path / "own.txt").read_text() == "own"
    html = paths[-1].read_text(encoding="utf-8")
    for text in (
        "<h1>A title</h1>",
        "It is 5 m long.",
        'class="doubt">q: is it?',
        "&lt;that&gt;",
        "title = &#39;&amp;",
    ):
        assert text in html
    assert "<dt>seed</dt><dd>3</dd>" in html
    assert "jsbsim" not in html
    assert 'id="table-sizes"' in html
    assert 'id="table-long"' not in html
    assert {p.read_bytes() for p in made.write(tmp_path)} == {p.read_bytes() for p in paths}


def test_what_an_older_run_wrote_does_not_stand_beside_the_newer_one(tmp_path) -> None:
    page(files={"models/a.json": "{}"}).write(tmp_path)
    (tmp_path / "models" / "notes.md").write_text("my own")
    paths = page(tables=[TABLE]).write(tmp_path)
    assert [str(p.relative_to(tmp_path)) for p in paths] == ["tables/sizes.csv", "tables/sizes.json", "report.html"]
    assert sorted(p for p in tmp_path.rglob("*") if p.is_file() and OWN not in p.parts) == sorted(
        [*paths, tmp_path / "models" / "notes.md"]
    )


def test_the_terminal_shows_answer_tables_notes_and_place() -> None:
    made = page(terminal=[TABLE], notes=["assumed: a thing"], closing=[("Fly", "testbench run {}/x.toml")])
    text = shown(made, "out")
    answer = ["A title", "It is 5 m long.", "q: is it?"]
    order = [
        *answer,
        "Sizes",
        "size, m",
        "Assumed: a thing.",
        "Report: out/report.html",
        "Fly: testbench run out/x.toml",
    ]
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert re.search(r"\[bold\]one\[/bold\] +1.0", text)
    assert "never known" not in text
    assert "Report" not in shown(page())


def test_rows_of_text_fold_instead_of_being_cut() -> None:
    out = StringIO()
    print_rows(Console(file=out, width=30, color_system=None), ("what", "n"), [("long " * 12, "7")], (False, True))
    assert out.getvalue().count("long") == 12


def test_a_table_can_be_shown_with_fewer_columns() -> None:
    assert TABLE.only("size", "name") == TABLE.without("none")
    assert TABLE.only("size").rows == ((1.0,), (None,))


def test_the_source_is_the_file_or_else_all_values() -> None:
    packaged = Scenario.load("taurus_doublet")
    name, text = source_of(packaged)
    assert name == "taurus_doublet.toml"
    assert text.startswith(packaged.file.read_text(encoding="utf-8")[:50])
    assert source_of(packaged.at(None))[0] == "as given"


def test_a_page_with_a_misspelt_part_is_refused() -> None:
    with pytest.raises(TypeError):
        page(tabels=[])


def test_what_is_not_shown_of_an_answer_is_counted_with_what_is_grave_in_it():
    lines = [Line(kind, "said") for kind in ("plain", "doubt", "wrong", "doubt")]
    assert how_many_more(lines) == "4 more (1 say do not use and 2 doubts)"
    assert how_many_more(lines[:1]) == "1 more"
