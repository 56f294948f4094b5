"""The index of a folder of results, two results side by side, and the server that shows them to this machine alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from testbench.core.errors import RecordError
from testbench.page.page import COMPUTED, Page
from testbench.page.serve import Answer
from testbench.page.tables import Column, Table
from testbench.questions.results.ask import compare_results, list_results
from testbench.questions.results.page import compared_page, files_of, index_html

HOSTILE = "<script>document.title = 'run'</script>"


def written(folder: Path, title: str = "A title", size: float = 1.0, rows: int = 2) -> Path:
    columns = (Column("name", "name"), Column("size", "size", "m"))
    table = Table("sizes", "Sizes", "", columns, (("a", size), ("b", 2.0), ("b", 3.0))[:rows])
    only = Table(f"only_{folder.name}", "Only", "", columns, (("a", 1.0),))
    page = Page(kicker="A kind", title=title, question="how long?", answer=[f"it is {size:g} m; that is all", "more"],
                tables=[table, only], packages=COMPUTED)  # fmt: skip
    page.write(folder)
    return folder


def test_the_index_says_what_each_page_says_of_itself(tmp_path):
    written(tmp_path / "one", "First & foremost", 5.0)
    written(tmp_path / "deep" / "two", HOSTILE)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "report.html").write_bytes(b"\xff\x00 no page")
    found = list_results(tmp_path)
    assert [r.folder.name for r in found] == ["two", "one"]
    assert found[1].title == "First & foremost"
    assert found[1].answer == "It is 5 m; that is all."
    assert (found[1].kind, found[1].question) == ("A kind", "how long?")
    page = index_html(found, tmp_path)
    assert 'href="one/report.html"' in page
    assert "First &amp; foremost" in page
    assert HOSTILE not in page


def test_the_papers_results_are_listed_and_an_index_is_not(tmp_path):
    written(tmp_path / "one")
    (tmp_path / "index.html").write_text(index_html(list_results(tmp_path), tmp_path), encoding="utf-8")
    (tmp_path / "papers").mkdir()
    page = '<p class="kicker">flight-testbench: testbench reproduce</p><h1>Papers</h1>'
    (tmp_path / "papers" / "index.html").write_text(page, encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.html").write_text("<h1>Not ours</h1>", encoding="utf-8")
    found = list_results(tmp_path)
    assert sorted(r.folder.name for r in found) == ["one", "papers"]
    assert 'href="papers/index.html"' in index_html(found, tmp_path)


def test_links_that_lead_out_are_not_followed(tmp_path):
    written(tmp_path / "outside" / "secret")
    inside = tmp_path / "results"
    written(inside / "one")
    (inside / "way_out").symlink_to(tmp_path / "outside")
    (inside / "one" / "way_out.txt").symlink_to(tmp_path / "outside" / "secret" / "report.html")
    assert [r.folder.name for r in list_results(inside)] == ["one"]
    answer = files_of(inside, lambda: "index")
    assert answer("/") == answer("/index.html") == Answer(b"index")
    assert answer("/one/report.html").kind == "text/html; charset=utf-8"
    for path in ("/way_out/secret/report.html", "/one/way_out.txt", "/../outside/secret/report.html",
                 "/%2e%2e/outside/secret/report.html", "/one", "/missing", "/one/\0", "/one/.lock"):  # fmt: skip
        assert answer(path) is None, path


def test_a_folder_without_results_is_said(tmp_path):
    with pytest.raises(RecordError, match="has none; run a question first"):
        list_results(tmp_path)
    with pytest.raises(RecordError, match="folder that exists"):
        list_results(tmp_path / "missing")
    with pytest.raises(RecordError, match=r"folder with report\.html"):
        compare_results(written(tmp_path / "one"), tmp_path)


def test_two_results_are_compared_number_by_number(tmp_path):
    compared = compare_results(written(tmp_path / "one"), written(tmp_path / "two", size=1.5, rows=3))
    found = {(d.table, d.row, d.column): (d.first, d.second) for d in compared.differences}
    assert found == {("sizes", "a", "size [m]"): (1.0, 1.5), ("sizes", "b no. 2", "size [m]"): (None, 3.0)}
    assert compared.equal == 1
    assert (compared.only_first, compared.only_second) == (("only_one",), ("only_two",))
    page = compared_page(compared)
    assert page.answer[0] == (
        "lead",
        "1 of 2 numbers that both have differ; 1 in tables of both stands in one of them only",
    )
    assert page.write(tmp_path / "both")[-1].is_file()
    assert str(tmp_path) not in (tmp_path / "both" / "report.html").read_text(encoding="utf-8")
    written(tmp_path / "day" / "one", size=2.0)
    assert compared_page(compare_results(tmp_path / "one", tmp_path / "day" / "one")).title == "one and day/one"
    same = compare_results(tmp_path / "one", tmp_path / "one")
    assert (same.differences, same.equal) == ((), 3)
