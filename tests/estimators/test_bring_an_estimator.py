"""What a user brings works in an empty folder: the examples of the guides, and what is said of files that are wrong."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import command, ends

from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.contract import INPUTS, LAWS, OUTPUTS, flight, tried
from testbench.questions.run.scenario import Scenario

GUIDES = Path(__file__).resolve().parents[2] / "docs" / "guides"
FILE = re.compile(r"^```\w+\n# (\S+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def written(guide, folder):
    """Write the files that a guide shows."""
    for name, text in FILE.findall((GUIDES / f"{guide}.md").read_text(encoding="utf-8")):
        (folder / name).write_text(text, encoding="utf-8")


def test_the_estimator_of_the_guide_runs_from_an_empty_folder_and_says_whose_code_it_is(tmp_path):
    written("bring_an_estimator", tmp_path)
    for words in (("check", "mine.toml"), ("check", "my_method.py:estimate"), ("run", "mine.toml")):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr + done.stdout
        if words[1].endswith("estimate"):
            assert done.stdout.count("passed") == len(LAWS)
    (file,) = (tmp_path / "results/mine/models").glob("*my_method*.json")
    model = json.loads(file.read_text("utf-8"))
    path = tmp_path / "my_method.py"
    code = {"file": str(path), "name": "estimate", "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    assert model["provenance"] == {"estimator": code}
    assert model["method"] == "my_method.py:estimate"
    assert model["settings"] == {"ridge": 1e-6}


@pytest.mark.slow
def test_the_structure_of_the_guide_runs_from_an_empty_folder(tmp_path):
    written("bring_a_structure", tmp_path)
    for words in (("check", "structure.toml"), ("check", "my_structure.py:make"), ("run", "structure.toml")):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr + done.stdout
    model = json.loads((tmp_path / "results/structure/models/eolo_alpha_output_error.json").read_text("utf-8"))
    assert model["structure"] == "my short period"
    assert list(model["provenance"]) == ["structure"]


@pytest.mark.slow
def test_the_equations_of_the_guide_run_from_an_empty_folder(tmp_path):
    written("bring_a_structure", tmp_path)
    for words in (("check", "own_equations.toml"), ("run", "own_equations.toml")):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr + done.stdout
    model = json.loads((tmp_path / "results/own_equations/models/eolo_alpha_filter_error.json").read_text("utf-8"))
    assert model["structure"] == "my_short_period"
    assert not model["parameters"]["Z_de"]["free"]
    found = model["parameters"]["M_de"]
    assert -20.0 < found["value"] < -5.0
    assert found["standard_error"] < 2.0


def test_the_examples_of_the_guide_are_the_packaged_ones(tmp_path):
    written("bring_a_structure", tmp_path)
    packaged = sorted((SCENARIOS / "structures").glob("*.toml"))
    assert len(packaged) == 5
    for path in packaged:
        assert (tmp_path / path.name).read_text("utf-8") == path.read_text("utf-8")


METHOD = """
from dataclasses import dataclass

@dataclass
class Settings:
    gain: float
    order: int = 2

def estimate(records, inputs, outputs, settings: Settings, validation=()):
    if settings.gain < 0.0:
        return None
    values = {}
    return values["nothing"]

def other(a, b):
    pass

raise_at_import = 1
"""


@pytest.fixture
def project(tmp_path):
    """A folder with a scenario whose estimator is the user's, and a function that writes the entry."""
    written("bring_an_estimator", tmp_path)
    (tmp_path / "estimators").mkdir()
    (tmp_path / "estimators" / "wrong.py").write_text(METHOD, encoding="utf-8")
    scenario = tmp_path / "mine.toml"
    text = scenario.read_text(encoding="utf-8")

    def with_entry(entry):
        scenario.write_text(text.replace('method = "my_method.py:estimate"\nridge = 1e-6\n', entry), encoding="utf-8")
        return scenario

    return with_entry


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('method = "wrong.py:estimate"\n', "setting 'gain' of wrong.py is required and missing"),
        ('method = "wrong.py:estimate"\ngain = 1.0\nordr = 3\n', "has no setting 'ordr'; did you mean 'order'"),
        ('method = "wrong.py:estimat"\n', "wrong.py must define 'estimat'; did you mean 'estimate'"),
        ('method = "wrong.py:other"\n', "other of wrong.py must take (records, inputs, outputs, settings, validation)"),
        ('method = "wron.py:estimate"\n', "got no 'wron.py' in"),
        ('method = "output_error"\nstructure = "wrong.py:other"\n', "must take (inputs, outputs, trim), got (a, b)"),
        ('method = "output_error"\nstructure = "shortperiod"\n', "did you mean 'short_period'"),
        ('method = "output_error"\nstructure = "wrong.toml"\n', "got no 'wrong.toml' in"),
    ],
)
def test_check_reads_the_file_without_running_it(project, entry, said):
    (project(entry).parent / "estimators" / "wrong.py").open("a").write("raise SystemExit('it was run')\n")
    with pytest.raises(ScenarioError) as error:
        Scenario.load(project(entry))
    (fault,) = error.value.faults
    assert said in fault
    assert "mine.toml, identification.estimators[0]" in fault


def test_an_error_in_own_code_is_one_sentence_with_its_line(project, monkeypatch, capsys):
    file = project('method = "wrong.py:estimate"\ngain = 1.0\n')
    status, lines = ends(monkeypatch, capsys, "run", file, "-o", file.parent / "out")
    assert (status, lines) == (0, []), "the estimator beside it goes on"
    (table,) = (file.parent / "out").rglob("failed.csv")
    failed = table.read_text(encoding="utf-8")
    assert "wrong.py:estimate must return a model, got KeyError: 'nothing' (wrong.py, line 13)" in failed
    scenario = Scenario.load(project('method = "wrong.py:estimate"\ngain = -1.0\n'))
    with pytest.raises(EstimationError, match="must return an IdentifiedModel, got NoneType"):
        estimate(scenario.identification.estimators[0], [flight(1)], INPUTS, OUTPUTS)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('status="warning"', "argument 'status'.*leave status out: it follows from advice"),
        ('advice="careful"', "advice of .* must be a tuple of sentences, got 'careful'"),
        ("advice=(1,)", "must be a tuple of sentences"),
    ],
)
def test_a_status_of_ones_own_is_refused(tmp_path, monkeypatch, more, said):
    written("bring_an_estimator", tmp_path)
    file = tmp_path / "my_method.py"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('method="my method",', f'method="my method", {more},'), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EstimationError, match=said):
        estimate("my_method.py:estimate", [flight(1)], INPUTS, OUTPUTS)


def test_a_plain_sentence_is_a_doubt(tmp_path, monkeypatch):
    written("bring_an_estimator", tmp_path)
    file = tmp_path / "my_method.py"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('method="my method",', 'method="my method", advice=("careful",),'), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    model = estimate("my_method.py:estimate", [flight(1)], INPUTS, OUTPUTS)
    assert model.status == "doubt"
    assert [(a, a.severity, a.code) for a in model.advice] == [("careful", "doubt", "own")]


def test_from_python_the_file_is_found_where_one_works(tmp_path, monkeypatch):
    written("bring_an_estimator", tmp_path)
    monkeypatch.chdir(tmp_path)
    model = estimate("my_method.py:estimate", [flight(1)], INPUTS, OUTPUTS, ridge=0.0)
    assert model.method == "my_method.py:estimate"
    with pytest.raises(EstimationError, match="has no setting 'rigde'; did you mean 'ridge'"):
        estimate("my_method.py:estimate", [flight(1)], INPUTS, OUTPUTS, rigde=0.0)
    with pytest.raises(EstimationError, match="greater than or equal to 0"):
        estimate("my_method.py:estimate", [flight(1)], INPUTS, OUTPUTS, ridge=-1.0)


CARELESS = """
import numpy as np
from testbench.estimators.state_space import StateSpaceModel

calls = []

def estimate(records, inputs, outputs):
    calls.append(1)
    u, y = records[0].columns(inputs), records[0].columns(outputs)
    n = len(outputs)
    a = np.linalg.lstsq(np.hstack([y, u])[:-1], y[1:], rcond=None)[0]
    return StateSpaceModel(method="", inputs=tuple(inputs), outputs=tuple(outputs), dt_s=records[0].dt_s,
        settings={"calls": len(calls)}, A=a[:n].T, B=a[n:].T, C=np.eye(n), D=np.zeros((n, len(inputs))))
"""


def test_the_laws_find_what_a_careless_method_does(tmp_path, monkeypatch, capsys):
    (tmp_path / "careless.py").write_text(CARELESS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    failed = {law: why for law, holds, why in tried("careless.py:estimate") if not holds}
    assert "a truth record must be refused" in failed["truth is refused"]
    assert "two runs must give the same model" in failed["the same records give the same bytes"]
    assert "IndexError" in failed["too little data are refused"]
    assert "no excitation is refused" in failed
    assert "exact data are recovered" not in failed
    status, lines = ends(monkeypatch, capsys, "check", "careless.py:estimate")
    assert status == 2
    assert any("careless.py:estimate: truth is refused" in line for line in lines)
    (tmp_path / "neither.py").write_text("def f(x): ...\n", encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "check", "neither.py:f")
    assert status == 2
    assert "must be an estimator" in lines[0]


def test_a_record_with_gaps_reaches_own_code_with_its_mask(tmp_path, monkeypatch):
    written("bring_an_estimator", tmp_path)
    monkeypatch.chdir(tmp_path)
    clean = flight(1)
    valid = np.ones(clean.data.shape, bool)
    valid[40:60] = False
    record = FlightRecord(clean.t_s, clean.channels, np.where(valid, clean.data, 9.0), "measured", valid)
    model = estimate("my_method.py:estimate", [record], INPUTS, OUTPUTS)
    assert np.allclose(model.A, estimate("my_method.py:estimate", [clean], INPUTS, OUTPUTS).A, atol=1e-6)
