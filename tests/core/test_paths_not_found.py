"""A path where a file is wanted and none is: the refusal names why there is none, and what may have been meant."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import ends

from testbench.core.paths import find_scenario, not_found
from testbench.questions.files import find


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working folder with a log, a scenario, a folder of import, and folders that hold no description."""
    monkeypatch.chdir(tmp_path)
    for name in ("log1", "eolo_alpha", "attas_short_period", "records_mine", "empty"):
        Path(name).mkdir()
    Path("flight.csv").touch()
    Path("my_scenario.toml").write_text('title = "Mine"\naircraft = "taurus"\n', encoding="utf-8")
    Path("records_mine/flight_longitudinal.toml").touch()
    return tmp_path


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("nofolder", "'nofolder', but there is no file or folder of that name"),
        ("log2/", "'log2', but there is no file or folder of that name; did you mean 'log1'?"),
        ("log2/flight.toml", "'log2/flight.toml', but there is no folder 'log2'; did you mean 'log1'?"),
        ("lgo1/a/b.toml", "'lgo1/a/b.toml', but there is no folder 'lgo1'; did you mean 'log1'?"),
        ("log1/flight.toml", "'log1/flight.toml', but there is no file or folder of that name"),
        ("flght.csv", "'flght.csv', but there is no file or folder of that name; did you mean 'flight.csv'?"),
        ("flight.csv/whole.nc", "'flight.csv/whole.nc', but 'flight.csv' is a file"),
        ("log1", "'log1', which is a folder"),
        ("/dev/null", "'/dev/null', which is neither a file nor a folder"),
    ],
)
def test_the_cause_is_named_and_the_nearest_name_beside(here, path, said):
    assert not_found(Path(path)) == said


def test_packaged_names_and_descriptions_in_a_folder_are_offered(here):
    assert not_found(Path("eolo_alpah"), ["eolo_alpha"], lambda path: False).endswith("; did you mean 'eolo_alpha'?")
    assert not_found(Path("nothing"), ["eolo_alpha"]).endswith("of that name; packaged: eolo_alpha")
    mine = not_found(Path("records_mine"), ["eolo_alpha"])
    assert mine == "'records_mine', which is a folder; did you mean 'records_mine/flight_longitudinal.toml'?"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("identify nofolder", "what is identified must be a log, a folder that testbench import wrote, or a desc"),
        ("identify nofolder", "got 'nofolder', but there is no file or folder of that name"),
        ("identify flght.csv", "did you mean 'flight.csv'?"),
        ("identify empty", "a folder to identify must hold a description of records (.toml), got 'empty' without one"),
        ("run my_scenari", "did you mean 'my_scenario.toml'?"),
        ("run flight.toml", "a scenario must be a file or a packaged one, got 'flight.toml', but there is no file"),
        ("design nofolder", "a design scenario must be a file or a packaged one, got 'nofolder', but there is no"),
        ("compatibility records_mine", "did you mean 'records_mine/flight_longitudinal.toml'?"),
        ("check log2", "did you mean 'log1'?"),
        ("import flgt.csv", "a log must be a file that exists, got 'flgt.csv', but there is no file or folder of that"),
        ("import log1", "a log must be a file that exists, got 'log1', which is a folder"),
        ("export modl.json --to mat", "a model must be a file that exists, got 'modl.json', but there is no file or"),
        ("results log2", "a folder of results must be a folder that exists, got 'log2', but there is no file or fol"),
    ],
)
def test_a_command_names_the_cause(here, monkeypatch, capsys, words, said):
    status, lines = ends(monkeypatch, capsys, *words.split())
    assert status == 2
    assert said in " ".join(lines)


def test_a_folder_does_not_hide_a_packaged_scenario_of_its_name(here):
    assert find_scenario("eolo_alpha").is_file()
    assert find(Path("eolo_alpha"), "run").stem == "eolo_alpha"
    from testbench.questions.identify.logs import _in_folder

    assert [p.parent.name for p in _in_folder(Path("attas_short_period"))] == ["records"]
