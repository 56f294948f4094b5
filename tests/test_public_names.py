"""What ``import testbench as tb`` offers: what each name says, that names stand for objects, and its examples."""

import builtins
import doctest
import inspect
import json
import os
import re
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import testbench as tb
from testbench.core import named
from testbench.page.shown import Shown

CONDITION = "tb.FlightCondition(12.0, 100.0)"
KNOWN = {*dir(builtins), *typing.__all__, "Callable", "Iterator", "Mapping", "Path", "Sequence", "pd", "xr"}


def test_dir_shows_the_public_names_alone():
    assert dir(tb) == sorted([*tb.__all__, "__version__"])
    assert {
        "run",
        "load_scenario",
        "load_aircraft",
        "load_suite",
        "read_records",
        "estimate",
        "METHODS",
        "find_gap",
        "Aircraft",
        "SensorSuite",
        "RunResult",
    } <= {*dir(tb)}


def returned(name: str) -> set[str]:
    """Return the names of types in what a public function returns."""
    thing = getattr(tb, name)
    text = "" if inspect.isclass(thing) or not callable(thing) else str(inspect.signature(thing).return_annotation)
    return {word for word in re.findall(r"(?<![.\w])[A-Za-z_]+", text) if word not in KNOWN}


def test_whatever_a_public_function_returns_can_be_imported():
    aliases = {"FloatArray", "WrittenStructure", "LinearWrittenStructure", "Refusal", "DataFrame", "Dataset", "Any"}
    missing = {name: sorted(returned(name) - aliases - {*tb.__all__}) for name in tb.__all__}
    assert {name: classes for name, classes in missing.items() if classes} == {}


@pytest.mark.parametrize("name", tb.__all__)
def test_every_name_has_an_example_that_is_right(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = getattr(tb, name)
    text = inspect.getdoc(thing)
    assert text
    by = [f for f in tb.__all__ if name in returned(f)]
    assert f"tb.{name}" in text.split("Example:")[-1] or by, "an example calls it by its public name, or returns it"
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example).failed == 0


@pytest.mark.parametrize(
    ("wrong", "right"), [("Aircarft", "Aircraft"), ("rum", "run"), ("load_aircaft", "load_aircraft")]
)
def test_a_misspelt_name_says_the_nearest(wrong, right):
    with pytest.raises(AttributeError, match=f"no attribute '{wrong}'; did you mean '{right}'"):
        getattr(tb, wrong)


def test_an_object_its_name_and_its_path_are_the_same_to_a_function():
    taurus, at = tb.load_aircraft("taurus"), tb.FlightCondition(12.0, 100.0)
    folder = Path(__file__).parents[1] / "aircraft_models" / "taurus"
    assert len({repr(tb.trim(given, at)) for given in ("taurus", taurus, folder)}) == 1
    assert (tb.linearise("taurus", tb.trim("taurus", at)).A == tb.linearise(taurus, tb.trim(taurus, at)).A).all()
    assert repr(tb.trim_many(["taurus", taurus], [at, at])[0]) == repr(tb.trim_many([taurus], [at])[0])
    by_name, by_object = (tb.run(s, causes=False) for s in ("taurus_doublet", tb.load("taurus_doublet")))
    assert by_name.page.to_dict() == by_object.page.to_dict()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tb.run("eolo_alfa"), "did you mean 'eolo_alpha'"),
        (lambda: tb.run("design/eolo_short_period"), "is a design scenario: use testbench design"),
        (lambda: tb.run(3), "a scenario must be a Scenario, a name or a path, got an? int"),
        (lambda: tb.run(tb.load("gap/battery")), "must be a Scenario, a name or a path, got a GapScenario"),
        (lambda: tb.trim("tarus", None), "an aircraft must be .* did you mean 'taurus'"),
        (lambda: tb.ask(tb.load_suite("taurus_8hz")), "must be a scenario or an aircraft, got a SensorSuite"),
        (lambda: tb.load("no_such_thing_anywhere"), "there is no file or folder of that name$"),
    ],
)
def test_what_is_not_meant_is_refused_with_the_nearest_name(call, message):
    with pytest.raises(tb.TestbenchError, match=message):
        call()


def test_one_table_has_every_reader():
    for words, place in named._READERS.values():
        module, name = place.split(":")
        assert words.startswith(("a ", "an "))
        assert callable(getattr(__import__(module, fromlist=[name]), name))


def test_load_takes_anything_that_has_a_name_or_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("def estimate(records, inputs, outputs):\n    return None\n")
    result = tb.run("taurus_doublet", causes=False)
    tb.write_results(result, "out")
    flight = result.flights[0]
    flight.truth.save("truth.nc")
    kinds = {
        "eolo_alpha": "Scenario",
        "plan/taurus_63": "PlanScenario",
        "taurus_scatter": "CampaignSpec",
        "taurus": "Aircraft",
        "jsbsim:c172p": "Aircraft",
        "taurus_8hz": "SensorSuite",
        "structures/rates_alone.toml": "Equations",
        "ground_tests/taurus": "GroundTest",
        "mine.py:estimate": "function",
        "truth.nc": "FlightRecord",
        "out": "DataFrame",
    }
    assert {name: type(tb.load(name)).__name__ for name in kinds} == kinds
    assert tb.load(result) is result


def test_a_result_shows_itself():
    result = tb.ask("taurus_doublet", causes=False)
    assert isinstance(result, Shown)
    tables = {t.name: t for t in result.page.all_tables}
    frame = result.to_pandas("excitation")
    assert frame.to_dict("list") == {
        head: [row[k] for row in tables["excitation"].rows] for k, head in enumerate(tables["excitation"].heads())
    }
    assert result.to_pandas().equals(tables[next(iter(tables))].to_pandas())
    with pytest.raises(
        tb.TestbenchError, match="a table must be one that the page has, got 'excitatoin'; did you mean"
    ):
        result.to_pandas("excitatoin")
    names = [plate.name for plate in result.page.plates]
    assert len(result.plot(names[1]).axes) > 0
    assert result.plot().get_size_inches()[0] > 1.0
    said = result._repr_html_()
    assert said.startswith("<div>")
    assert said.count("<table") == 1
    assert "data:image/svg+xml" in said
    assert json.loads(json.dumps(result.to_dict()))["tables"].keys() == tables.keys()


@pytest.mark.slow
def test_a_users_file_has_types(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import testbench as tb\n"
        'result = tb.run("eolo_alpha")\n'
        "reveal_type(result)\n"
        f'reveal_type(tb.trim("taurus", {CONDITION}))\n'
        'reveal_type(tb.load_suite("eolo_alpha"))\n'
        "reveal_type(result.to_pandas)\n"
        "def fly(aircraft: tb.Aircraft, suite: tb.SensorSuite) -> tb.FlightRecord:\n    raise ValueError\n"
        "tb.run(3)\n"
        "tb.rum\n"
    )
    found = subprocess.run(
        [
            sys.executable,
            "-m",
            "mypy",
            "--strict",
            "--follow-imports=silent",
            "--cache-dir",
            str(tmp_path / "cache"),
            "mine.py",
        ],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(Path(tb.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    lines = [line for line in found.splitlines() if line.startswith("mine.py")]
    assert re.findall(r'Revealed type is "([\w.]+)"', found) == [
        "testbench.questions.run.result.RunResult",
        "testbench.flight.condition.TrimmedFlight",
        "testbench.sensors.suite.SensorSuite",
    ]
    errors = [line for line in lines if " error: " in line]
    assert len(errors) == 2, errors
    assert 'incompatible type "int"; expected "Scenario | Path | str"' in errors[0]
    assert 'has no attribute "rum"' in errors[1]
