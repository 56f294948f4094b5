"""What is published: wheel and source archive are built from the checkout, and the wheel serves in an empty folder."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from testbench import __version__

ROOT = Path(__file__).resolve().parents[1]
TEMPLATES = "testbench/page/templates"
NOT_CODE = {  # kind of file that is read at run time, and where it lies in the wheel
    "*.j2": TEMPLATES,
    "*.js": TEMPLATES,
    "uPlot.*": "testbench/page/uplot",
    "*.css": "testbench/questions/studio/page",
    "*.lua": "testbench/questions/plan/injection",
    "*.md": "testbench/questions/exercise/catalogue",
    "*.steps.md": "testbench/questions/exercise/catalogue",
    "*.toml": "testbench/sensors/suites",
    "*.typed": "testbench",
    "*.pyi": "testbench",
}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return the folder with the wheel and the source archive."""
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling builds the wheel: pip install hatchling")
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", folder], cwd=ROOT, check=True, capture_output=True
    )
    return folder


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Return the folder into which the wheel was installed, without what it depends on: that is here already."""
    folder = tmp_path_factory.mktemp("installed")
    (wheel,) = built.glob("*.whl")
    words = ("-m", "pip", "install", "-q", "--no-deps", "--no-index", "--no-compile", "--target", folder, wheel)
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    return folder


def in_empty_folder(installed, tmp_path, *words):
    """Run Python in an empty folder, with the installed package before any other."""
    return subprocess.run(
        [sys.executable, *words], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(installed)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_the_wheel_holds_every_file_that_is_no_code(built):
    (wheel,) = built.glob("*.whl")
    inside = set(zipfile.ZipFile(wheel).namelist())
    for pattern, folder in NOT_CODE.items():
        there = {str(p.relative_to(ROOT)) for p in (ROOT / "testbench").rglob(pattern)}
        assert any(name.startswith(folder) for name in there), f"no {pattern} lies in {folder}"
        assert there <= inside
    for folder in ("aircraft_models", "scenarios"):
        kinds = (".toml", ".xml", ".md")
        there = {f"testbench/data/{p.relative_to(ROOT)}" for p in (ROOT / folder).rglob("*") if p.suffix in kinds}
        assert there
        assert there <= inside
    assert not [name for name in inside if "/tests/" in name or name.endswith((".pyc", ".nc"))]


def test_the_source_archive_holds_what_is_needed_to_test_it(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        inside = {name.partition("/")[2] for name in file.getnames()}
    for name in (
        "Makefile",
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "LICENSE",
        "constraints.txt",
    ):
        assert name in inside
    for folder in ("testbench", "aircraft_models", "scenarios", "tests", "docs"):
        there = {str(p.relative_to(ROOT)) for kind in ("*.py", "*.toml") for p in (ROOT / folder).rglob(kind)}
        assert there <= inside


def test_the_installed_package_names_what_is_public(installed, tmp_path):
    code = "import testbench as tb; print(tb.__file__); print(*dir(tb))"
    done = in_empty_folder(installed, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    file, names = done.stdout.splitlines()
    assert Path(file).is_relative_to(installed)
    assert {"run", "load_scenario", "load_aircraft", "estimate", "METHODS", "find_gap"} <= set(names.split())


def test_the_installed_command_finds_its_scenarios(installed, tmp_path):
    main = ("-c", "from testbench.cli import main; main()")
    listed = in_empty_folder(installed, tmp_path, *main, "list", "scenarios")
    assert listed.returncode == 0, listed.stderr
    assert "eolo_alpha" in listed.stdout
    assert str(ROOT) not in listed.stdout
    checked = in_empty_folder(installed, tmp_path, *main, "check", "eolo_alpha")
    assert checked.returncode == 0, checked.stderr
    assert "eolo_alpha: a valid scenario" in checked.stdout
    assert not list(tmp_path.iterdir())


MINE = """
title = "Mine"
aircraft = "mine"
suites = ["logger"]
condition = { V_m_s = 12.0, h_m = 100.0 }

[[manoeuvre]]
name = "doublet"
use = "split"
duration_s = 8.0
input = [{ signal = "doublet", control = "de", amplitude_deg = 3.0, period_s = 1.0 }]

[identification]
inputs = ["de_cmd"]
outputs = ["q", "theta"]
estimators = [{ method = "one_step.py:estimate" }]
"""
ONE_STEP = """
import numpy as np
from testbench.estimators.state_space import StateSpaceModel

def estimate(records, inputs, outputs):
    n = len(outputs)
    xu = np.vstack([np.hstack([r.columns(outputs), r.columns(inputs)])[:-1] for r in records])
    x = np.vstack([r.columns(outputs)[1:] for r in records])
    a = np.linalg.lstsq(xu, x, rcond=None)[0].T
    return StateSpaceModel(method="one step", inputs=tuple(inputs), outputs=tuple(outputs), dt_s=records[0].dt_s,
        A=a[:, :n], B=a[:, n:], C=np.eye(n), D=np.zeros((n, len(inputs))))
"""


def test_what_a_user_brings_is_flown_by_the_installed_package(installed, tmp_path):
    data = installed / "testbench" / "data"
    shutil.copytree(data / "aircraft_models" / "taurus", tmp_path / "aircraft" / "mine")
    for folder in ("suites", "estimators"):
        (tmp_path / folder).mkdir()
    suites = installed / "testbench" / "sensors" / "suites"
    shutil.copy(suites / "taurus_8hz.toml", tmp_path / "suites" / "logger.toml")
    (tmp_path / "estimators" / "one_step.py").write_text(ONE_STEP, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(MINE, encoding="utf-8")
    main = ("-c", "from testbench.cli import main; main()")
    checked = in_empty_folder(installed, tmp_path, *main, "check", "mine.toml", "aircraft/mine", "suites/logger.toml")
    assert checked.returncode == 0, checked.stderr
    ran = in_empty_folder(installed, tmp_path, *main, "run", "mine.toml")
    assert ran.returncode == 0, ran.stderr
    (model,) = (tmp_path / "results" / "mine" / "models").glob("*.json")
    assert json.loads(model.read_text(encoding="utf-8"))["provenance"]["estimator"]["file"].endswith("one_step.py")


def test_the_command_has_the_name_of_the_readme(installed):
    (points,) = installed.glob("*.dist-info/entry_points.txt")
    assert "testbench = testbench.__main__:main" in points.read_text(encoding="utf-8")
    assert (installed / "bin" / "testbench").is_file() or (installed / "Scripts" / "testbench.exe").is_file()


def test_one_version_is_told_everywhere(built):
    assert f'version = "{__version__}"' not in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert [p.name for p in built.glob("*.whl")] == [f"flight_testbench-{__version__}-py3-none-any.whl"]
    assert f"version: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_conda_recipe_needs_what_the_wheel_needs():
    """Same names and bounds, but for matplotlib, which conda-forge gives without a toolkit as matplotlib-base."""
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    run = recipe.partition("\n  run:\n")[2].partition("\n\n")[0]
    needs = {line.strip("- ").replace("matplotlib-base", "matplotlib").replace(" ", "") for line in run.splitlines()}
    assert needs == {*asked["dependencies"], f"python{asked['requires-python']}"}
    assert f'"TESTBENCH_VERSION", "{__version__}"' in recipe
    for file in asked["license-files"]:
        assert f"- {file}\n" in recipe
