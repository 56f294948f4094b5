"""What users bring is found beside their scenario, read without being run, and run once."""

import pickle
import sys

import pytest

from testbench.core import bring
from testbench.core.errors import ScenarioError


def test_what_is_brought_is_found_beside_the_scenario_first_and_then_where_one_works(tmp_path, monkeypatch):
    project, desk = tmp_path / "project", tmp_path / "desk"
    for folder in (project / "estimators", desk / "estimators"):
        folder.mkdir(parents=True)
    monkeypatch.chdir(desk)
    scenario = project / "s.toml"
    wanted = [project / "m.py", project / "estimators" / "m.py", desk / "m.py", desk / "estimators" / "m.py"]
    for path in reversed(wanted):
        path.write_text("")
        assert bring.find("m.py:f", scenario, "estimators") == (path, "f")
    assert bring.find("m.py:f", None, "estimators") == (wanted[2], "f")
    assert bring.find(f"{wanted[3]}:f", scenario, "estimators") == (wanted[3], "f")


def test_a_file_that_is_not_there_is_missed_with_the_nearest_that_is(tmp_path):
    (tmp_path / "my_method.py").write_text("")
    with pytest.raises(ScenarioError, match=r"got no 'my_methud.py' in .*did you mean 'my_method.py'"):
        bring.find("my_methud.py:f", tmp_path / "s.toml", "estimators")
    with pytest.raises(ScenarioError, match=r"must be named as FILE.py:NAME, got 'm.py:'"):
        bring.find("m.py:", tmp_path / "s.toml", "estimators")


def test_a_file_is_read_without_being_run(tmp_path):
    path = tmp_path / "m.py"
    path.write_text(
        "import os as system\nfrom sys import argv\nA = 1\nB: int = 2\nif A:\n    def f(x): ...\n"
        "class C: ...\n1 / 0\nprint('it runs')\n"
    )
    found = bring.declared(path)
    assert found.names == {"system", "argv", "A", "B", "f", "C"}
    assert (list(found.functions), list(found.classes), list(found.values)) == (["f"], ["C"], ["A", "B"])
    with pytest.raises(ScenarioError, match=r"m.py must define 'ff'; did you mean 'f'\?"):
        found.need("ff")
    path.write_text("from os import *\n")
    assert bring.declared(path).need("anything") is None
    path.write_text("x = 1\ndef f(:\n")
    with pytest.raises(ScenarioError, match=r"m.py, line 2: must be Python"):
        bring.declared(path)


def test_a_file_runs_once_until_it_changes_and_what_it_makes_can_be_pickled(tmp_path):
    path = tmp_path / "m.py"
    path.write_text("import neighbour\nclass C:\n    value = neighbour.value\n")
    (tmp_path / "neighbour.py").write_text("value = 3\n")
    before = list(sys.path)
    made = bring.load(path, "C")
    assert (made.value, sys.path) == (3, before)
    assert bring.load(path, "C") is made
    assert isinstance(pickle.loads(pickle.dumps(made())), made)
    with pytest.raises(ScenarioError, match=r"m.py must define 'D'; did you mean 'C'|m.py must define 'D'; valid"):
        bring.load(path, "D")
    path.write_text("value = 1\nraise ValueError('no\\nmore')\n")
    with pytest.raises(ScenarioError, match=r"must run without an error, got ValueError: no more \(m.py, line 2\)"):
        bring.load(path, "C")
    del sys.modules["neighbour"]
