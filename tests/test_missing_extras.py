"""Without an optional package every command that needs it ends with one line: what is missing and what to install."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ends

from testbench.core.errors import MissingPackage, TestbenchError
from testbench.core.record import FlightRecord
from testbench.envs import register

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def absent(monkeypatch):
    """Make packages absent, with all that has been imported of them."""

    def hide(*packages):
        for package in packages:
            for known in [name for name in sys.modules if name.startswith(f"{package}.")]:
                monkeypatch.delitem(sys.modules, known)
            monkeypatch.setitem(sys.modules, package, None)

    return hide


@pytest.mark.parametrize(("package", "extra", "name", "content"), [("pyarrow", "parquet", "flight.parquet", b"PAR1")])
def test_a_log_that_needs_an_extra_names_it(absent, monkeypatch, capsys, tmp_path, package, extra, name, content):
    (tmp_path / name).write_bytes(content)
    absent(package)
    status, said = ends(monkeypatch, capsys, "import", tmp_path / name)
    assert status == 2
    assert len(said) == 1
    assert said[0].startswith(f"error: '{tmp_path / name}' cannot be read: ")
    assert said[0].endswith(f"need {package}, which is not installed; pip install 'flight-testbench[{extra}]'")


@pytest.mark.parametrize(("to", "package"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_a_format_out_names_its_extra(absent, monkeypatch, capsys, tmp_path, to, package):
    t = np.arange(8) * 0.1
    file = tmp_path / "x.nc"
    FlightRecord(t, ("q",), np.zeros((8, 1)), "measured").save(file)
    absent(package)
    status, said = ends(monkeypatch, capsys, "export", file, "--to", to)
    assert (status, len(said)) == (2, 1)
    assert f"pip install 'flight-testbench[{to}]'" in said[0]
    assert ends(monkeypatch, capsys, "export", file, "--to", "csv") == (0, [])


@pytest.mark.parametrize("package", ["distributed", "dask"])
def test_a_campaign_on_a_scheduler_names_its_extra_before_it_writes(absent, monkeypatch, capsys, tmp_path, package):
    absent(package)
    for verb in ("run", "resume"):
        words = (verb, "taurus_scatter", "--scheduler", "x")
        status, said = ends(monkeypatch, capsys, "campaign", *words, "-o", tmp_path / "out")
        assert (status, len(said)) == (3, 1)
        assert "pip install 'flight-testbench[campaign]'" in said[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("module", ["train", "baselines"])
def test_agents_and_baselines_name_their_extra(absent, monkeypatch, capsys, module):
    extra = {"train": "rl", "baselines": "envs"}[module]
    name = f"testbench.envs.{module}"
    absent("gymnasium", "stable_baselines3", "torch")
    for known in ("testbench.envs.train", "testbench.envs.baselines", "testbench.envs.excitation"):
        monkeypatch.delitem(sys.modules, known, raising=False)
    monkeypatch.setattr(sys, "argv", [name])
    law = rf"^error: [^\n]+ not installed; pip install 'flight-testbench\[{extra}\]'$"
    with pytest.raises(SystemExit, match=law):
        runpy.run_module(name, run_name="__main__")
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit, match=r"^0$"):
        runpy.run_module(name, run_name="__main__")
    assert "--task" in capsys.readouterr().out


def test_an_aircraft_from_its_geometry_names_its_extra(absent, monkeypatch, capsys, tmp_path):
    absent("aerosandbox")
    plan = ROOT / "aircraft_models" / "taurus" / "geometry.toml"
    status, said = ends(monkeypatch, capsys, "aircraft", "new", plan, "-o", tmp_path / "mine")
    assert (status, len(said)) == (2, 1)
    assert said[0].endswith("needs aerosandbox, which is not installed; pip install 'flight-testbench[geometry]'")
    assert not (tmp_path / "mine").exists()


def test_the_environments_name_their_extra(absent, monkeypatch):
    absent("gymnasium")
    monkeypatch.delitem(sys.modules, "testbench.envs.excitation", raising=False)
    with pytest.raises(MissingPackage, match=re.escape("pip install 'flight-testbench[envs]'")) as found:
        register()
    assert isinstance(found.value, ImportError)
    assert isinstance(found.value, TestbenchError)
    with pytest.raises(MissingPackage, match=re.escape("pip install 'flight-testbench[envs]'")):
        import testbench.envs.excitation  # noqa: F401


def test_what_compiles_for_environments_names_their_extra(absent, monkeypatch):
    absent("numba")
    monkeypatch.delitem(sys.modules, "testbench.envs.compiled", raising=False)
    with pytest.raises(MissingPackage, match="need numba, which is not installed"):
        import testbench.envs.compiled  # noqa: F401


def test_exercises_need_no_extra_to_be_started_and_checked(absent, monkeypatch, capsys, tmp_path):
    absent("nbclient", "nbformat", "ipykernel", "IPython")
    folder = tmp_path / "mine"
    assert ends(monkeypatch, capsys, "exercise", "start", "short_period", "--student", "anna", "-o", folder) == (0, [])
    assert (folder / "notebook.ipynb").is_file()
    assert ends(monkeypatch, capsys, "exercise", "check", folder)[0] == 1  # nothing answered yet


def test_the_documentation_names_its_extra(absent):
    errors = pytest.importorskip("sphinx.errors", reason="the site needs the extra docs")
    absent("latex2mathml", "furo")
    with pytest.raises(errors.ConfigError, match=r"furo, latex2mathml, not .*'flight-testbench\[docs\]'"):
        runpy.run_path(str(ROOT / "docs" / "conf.py"))
