"""The index of a folder of results, two results side by side, and the server that shows them to this machine alone.

A result whose writer was killed between its commit and its last move is read whole, whoever reads it first.
"""

import json
import os
import shutil
from pathlib import Path

import pytest
from commands import ends
from killed import killed_at, whole
from short_flight import DE, Q, T

import testbench as tb
from testbench.core import store
from testbench.core.errors import RecordError
from testbench.core.files import write_file
from testbench.core.paths import AIRCRAFT, SCENARIOS, resolve
from testbench.core.record import FlightRecord
from testbench.core.store import COMMIT, OWN, PAGE, ResultFolder, Unsettled
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table
from testbench.questions.gap.new import record_files
from testbench.questions.plan.new import take
from testbench.questions.results.ask import KICKER, compare_results, list_results, verify_results
from testbench.questions.results.page import compared_page, files_of
from testbench.questions.tidy import COLUMNS

HOSTILE = "<script>document.title = 'run'</script>"


def written(folder: Path, title: str = "A title", size: float = 1.0, rows: int = 2) -> Path:
    columns = (Column("name", "name"), Column("size", "size", "m"))
    table = Table("sizes", "Sizes", "", columns, (("a", size), ("b", 2.0), ("b", 3.0))[:rows])
    only = Table(f"only_{folder.name}", "Only", "", columns, (("a", 1.0),))
    page = Page(kicker="A kind", title=title, question="how long?", answer=[f"it is {size:g} m; that is all", "more"],
                tables=[table, only], packages=COMPUTED)  # fmt: skip
    page.write(folder)
    return folder


def test_the_list_says_what_each_page_says_of_itself(tmp_path):
    written(tmp_path / "one", "First & foremost", 5.0)
    written(tmp_path / "deep" / "two", HOSTILE)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "report.html").write_bytes(b"\xff\x00 no page")
    found = list_results(tmp_path)
    assert [r.folder.name for r in found] == ["two", "one"]
    assert found[1].title == "First & foremost"
    assert found[1].answer == "It is 5 m; that is all."
    assert (found[1].kind, found[1].question) == ("A kind", "how long?")
    assert found[0].title == HOSTILE


def test_the_papers_results_are_listed_and_an_index_is_not(tmp_path):
    written(tmp_path / "one")
    index = f'<p class="kicker">{KICKER}</p><h1>results</h1>'
    (tmp_path / "index.html").write_text(index, encoding="utf-8")
    (tmp_path / "papers").mkdir()
    page = '<p class="kicker">flight-testbench: testbench reproduce</p><h1>Papers</h1>'
    (tmp_path / "papers" / "index.html").write_text(page, encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.html").write_text("<h1>Not ours</h1>", encoding="utf-8")
    found = list_results(tmp_path)
    assert sorted(r.folder.name for r in found) == ["one", "papers"]


def test_links_that_lead_out_are_not_followed(tmp_path):
    written(tmp_path / "outside" / "secret")
    inside = tmp_path / "results"
    written(inside / "one")
    (inside / "way_out").symlink_to(tmp_path / "outside")
    (inside / "one" / "way_out.txt").symlink_to(tmp_path / "outside" / "secret" / "report.html")
    assert [r.folder.name for r in list_results(inside)] == ["one"]
    answer = files_of(inside)
    assert answer("/one/report.html").kind == "text/html; charset=utf-8"
    for path in ("/way_out/secret/report.html", "/one/way_out.txt", "/../outside/secret/report.html",
                 "/%2e%2e/outside/secret/report.html", "/", "/one", "/missing", "/one/\0", "/one/.lock"):  # fmt: skip
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


MODEL = {"structure": "short_period", "covariance": [[0.04]], "parameters": {"M_q": {"value": -2.0, "free": True}}}
HEAD = '<p class="kicker">flight-testbench: run</p><h1>a</h1>'


def write(folder: Path) -> None:
    with ResultFolder(folder) as place:
        FlightRecord(T, ("de", "q"), [[*x] for x in zip(DE, Q, strict=True)], "measured").save(place.new / "a.nc")
        write_file(place.new / "models" / "a.json", json.dumps(MODEL))
        write_file(place.new / "designs" / "1_a.toml", (SCENARIOS / "eolo_alpha.toml").read_bytes())
        write_file(place.new / "tables" / "results.csv", ",".join(COLUMNS) + "\n")
        write_file(place.new / "aircraft.toml", 'schema = "aircraft 1"\n')
        write_file(place.new / PAGE, HEAD)


@pytest.fixture(scope="module")
def unsettled(tmp_path_factory) -> list[Path]:
    """The folder as a kill leaves it at each step from its commit on."""
    out = []
    for step in range(1, 60):
        folder = tmp_path_factory.mktemp("killed") / "out"
        killed = killed_at(step, lambda folder=folder: write(folder))
        if not killed:
            break
        if (folder / OWN / COMMIT).exists():
            out.append(folder)
    assert len(out) > 6
    assert [p.name for p in out[0].iterdir()] == [OWN]
    return out


READERS = {
    "record": lambda folder: tb.load_record(folder / "a.nc"),
    "records": lambda folder: record_files([folder]),
    "design --after": lambda folder: tb.known_after([folder], 16.0),
    "plan": lambda folder: take([folder]),
    "list": lambda folder: tb.list_results(folder.parent),
    "compare": lambda folder: tb.compare_results(folder, folder),
    "table": tb.read_results,
    "verify": verify_results,
    "aircraft": lambda folder: resolve(str(folder), AIRCRAFT),
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_whoever_reads_first(unsettled, tmp_path, read):
    for k, left in enumerate(unsettled):
        folder = shutil.copytree(left, tmp_path / str(k) / "out")
        read(folder)
        assert not (folder / OWN / COMMIT).exists(), left
        assert whole(folder)


@pytest.mark.parametrize("words", [("export", "out/a.nc", "--to=csv"), ("results", "out"), ("plan", "new", "out")])
def test_a_command_that_names_it(unsettled, tmp_path, monkeypatch, capsys, words):
    folder = shutil.copytree(unsettled[0], tmp_path / "out")
    monkeypatch.chdir(tmp_path)
    status, said = ends(monkeypatch, capsys, *words)
    assert (status, said) == (0, []) or words[0] == "plan"
    assert not (folder / OWN / COMMIT).exists()


def test_one_that_cannot_be_written_to_is_read_as_it_is(unsettled, tmp_path, monkeypatch):
    folder = shutil.copytree(unsettled[-1], tmp_path / "out")

    def read_only(*given, **more):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr(store, "locked", read_only)
    with pytest.warns(Unsettled, match="not all in place.*read as it is"):
        record = tb.load_record(folder / "a.nc")
    assert len(record) == len(T)
    assert (folder / OWN / COMMIT).exists()
