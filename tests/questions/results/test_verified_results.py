"""What a result was made from, whether it still is what was written, and a user's files beside it."""

import json
import sys
from pathlib import Path

import pytest

import testbench.cli as cli
from testbench.core.door import checked
from testbench.core.errors import RecordError, WriteError
from testbench.core.store import MANIFEST, OWN, ResultFolder
from testbench.page.page import Page
from testbench.page.tables import Column, Table
from testbench.questions.results.ask import verify_results

ROOT = Path(__file__).parents[3]
USERS = {f"{name}/mine.txt": name for name in ("figures", "models", "tables", "cards", "records")}


@pytest.fixture
def said(monkeypatch, capsys):
    """Return a function that runs a command in the test's process and gives its exit status and all it says."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["testbench", *map(str, words)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        found = capsys.readouterr()
        return status, found.out + found.err

    return run


def page(size: float = 1.0) -> Page:
    table = Table("sizes", "Sizes", "", (Column("size", "size", "m"),), ((size,),))
    return Page(kicker="A kind", title="A title", answer=["it is long"], tables=[table], packages=())


def of_user(folder: Path) -> dict[str, str]:
    """Put a user's files into a folder."""
    for name, text in USERS.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return USERS


def still(folder: Path) -> dict[str, str]:
    return {name: (folder / name).read_text() for name in USERS}


def test_a_result_says_which_files_are_changed_missing_or_the_users(tmp_path):
    page().write(tmp_path)
    assert verify_results(tmp_path).whole
    (tmp_path / "tables" / "sizes.csv").write_text("edited")
    (tmp_path / "tables" / "sizes.json").unlink()
    (tmp_path / "notes.md").write_text("mine")
    page().write(tmp_path / "another")
    found = verify_results(tmp_path)
    assert not found.whole
    assert (found.changed, found.missing, found.extra) == (("tables/sizes.csv",), ("tables/sizes.json",), ("notes.md",))


def test_a_result_says_what_would_change_if_it_were_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["testbench", "run"])
    monkeypatch.chdir(tmp_path)
    for name in ("same.toml", "other.toml", "gone.toml"):
        Path(name).write_text("1")
        checked(Path(name), "scenario")
    page().write("out")
    Path("other.toml").write_text("2")
    Path("gone.toml").unlink()
    file = Path("out") / OWN / MANIFEST
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"packages": {**content["packages"], "numpy": "1.0"}}))
    found = verify_results("out")
    assert found.whole
    assert "other.toml" in found.inputs_changed
    assert "gone.toml" in found.inputs_gone
    assert "same.toml" not in (*found.inputs_changed, *found.inputs_gone)
    assert [(name, then) for name, then, _ in found.versions] == [("numpy", "1.0")]


def test_the_command_verifies_one_result_and_ends_with_1_where_it_changed(tmp_path, said):
    page().write(tmp_path)
    status, text = said("results", tmp_path)
    assert status == 0
    assert "tables/sizes.csv" in text
    assert not (tmp_path / "index.html").exists()
    status, text = said("results", tmp_path, "--verify")
    assert (status, "All files are unchanged." in text) == (0, True)
    (tmp_path / "tables" / "sizes.csv").write_text("edited")
    status, text = said("results", tmp_path, "--verify")
    assert (status, "2 of 3 files are unchanged." in text) == (1, True)


def test_a_result_without_a_manifest_is_one_line(tmp_path):
    (tmp_path / "report.html").write_text("<h1>An older one</h1>")
    with pytest.raises(RecordError, match="made before there were manifests; run its command again into a new folder"):
        verify_results(tmp_path)


def test_the_papers_results_in_the_repository_are_what_was_written():
    """`make reproduction` replaces them in a clone, which it may since a manifest lists them."""
    found = verify_results(ROOT / "results" / "reproduction")
    assert found.whole
    assert found.manifest.command == ("testbench", "reproduce", "all")
    assert set(found.extra) <= {f"{OWN}/lock"}


def test_a_users_figures_models_tables_and_cards_are_never_touched(tmp_path, monkeypatch, said):
    """Into a folder that is the user's own: two results set beside each other, and a page from Python."""
    for k in (1, 2):
        page(float(k)).write(tmp_path / f"r{k}")
    monkeypatch.chdir(tmp_path)
    users = of_user(tmp_path)
    for _ in range(2):
        assert said("results", "r1", "r2", "-o", ".")[0] == 0
        assert still(tmp_path) == users
    page().write(".")
    assert still(tmp_path) == users
    assert not Path("tables/differences.csv").exists()


def test_a_table_of_the_users_is_not_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("tables").mkdir()
    Path("tables/sizes.csv").write_text("mine")
    with pytest.raises(WriteError, match=r"no manifest lists 'tables/sizes.csv'; the new result is in 'result'"):
        page().write(".")
    assert Path("tables/sizes.csv").read_text() == "mine"
    assert verify_results("result").whole


def test_the_name_of_a_scenario_cannot_lead_out_of_the_folder(tmp_path, said):
    text = (ROOT / "scenarios" / "taurus_doublet.toml").read_text(encoding="utf-8")
    (tmp_path / "...toml").write_text(text, encoding="utf-8")
    of_user(tmp_path)
    status, words = said("run", tmp_path / "...toml", "-o", tmp_path / "deep")
    assert (status, "must have a plain name, got '..'" in words) == (2, True)
    assert still(tmp_path) == USERS
    assert not (tmp_path / "deep").exists()


def test_a_folder_that_is_being_written_is_no_result(tmp_path):
    from testbench.questions.results.ask import list_results

    page().write(tmp_path / "r1")
    place = ResultFolder(tmp_path / "r2")
    page(2.0)._write_into(place.new)
    assert [r.folder.name for r in list_results(tmp_path)] == ["r1"]
    place.leave()


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("mine.html", "studio taurus --write mine.html"),
        ("design_scenario.json", "schema design -o ."),
        ("schemas/flight_plan.json", "plan new taurus -o p.toml"),
    ],
)
def test_a_single_file_of_the_users_is_not_replaced_either(tmp_path, monkeypatch, said, file, words):
    monkeypatch.chdir(tmp_path)
    Path(file).parent.mkdir(exist_ok=True)
    Path(file).write_text("mine")
    status, text = said(*words.split())
    assert (status, f"no manifest lists '{file}'" in text) == (2, True)
    assert Path(file).read_text() == "mine"


def test_a_file_may_be_named_in_the_folder_above(tmp_path, monkeypatch, said):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert said("schema", "design", "-o", "..")[0] == 0
    assert (tmp_path / "design_scenario.json").is_file()
