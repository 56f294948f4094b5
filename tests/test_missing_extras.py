"""Without an optional package every command that needs it ends with one line: what is missing and what to install."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ends

from testbench.core import errors
from testbench.core.errors import MissingPackage, TestbenchError, missing
from testbench.core.record import FlightRecord
from testbench.envs import register

ROOT = Path(__file__).resolve().parents[1]


def hint(extra):
    """Return how an extra is installed where these tests lie."""
    return f"pip install '{'.' if Path.cwd() == ROOT else ROOT}[{extra}]'"


@pytest.fixture
def absent(monkeypatch):
    """Make packages absent, with all that has been imported of them."""

    def hide(*packages):
        for package in packages:
            for known in [name for name in sys.modules if name.startswith(f"{package}.")]:
                monkeypatch.delitem(sys.modules, known)
            monkeypatch.setitem(sys.modules, package, None)

    return hide


@pytest.mark.parametrize(
    ("url", "place"),
    [(None, "flight-testbench"), ("https://host/x.whl", "flight-testbench"), ("file://{}/a%20clone", "{}/a clone")],
)
def test_the_index_is_named_to_those_alone_who_installed_from_it(monkeypatch, tmp_path, url, place):
    class Installed:
        def read_text(self, name):
            return None if url is None else f'{{"url": "{url.format(tmp_path)}", "dir_info": {{}}}}'

    (tmp_path / "a clone").mkdir()
    (tmp_path / "a clone" / "pyproject.toml").touch()
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "site-packages" / "testbench" / "core" / "errors.py"))
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: Installed())
    assert missing("this needs that", "geometry").endswith(f"; pip install '{place.format(tmp_path)}[geometry]'")
    monkeypatch.chdir(tmp_path / "a clone")
    here = "." if url and url.startswith("file") else place
    assert missing("this needs that", "geometry").endswith(f"; pip install '{here}[geometry]'")


@pytest.mark.parametrize(("package", "extra", "name", "content"), [("pyarrow", "parquet", "flight.parquet", b"PAR1")])
def test_a_log_that_needs_an_extra_names_it(absent, monkeypatch, capsys, tmp_path, package, extra, name, content):
    (tmp_path / name).write_bytes(content)
    absent(package)
    status, said = ends(monkeypatch, capsys, "import", tmp_path / name)
    assert status == 2
    assert len(said) == 1
    assert said[0].startswith(f"error: '{tmp_path / name}' cannot be read: ")
    assert said[0].endswith(f"need {package}, which is not installed; {hint(extra)}")


@pytest.mark.parametrize(("to", "package"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_a_format_out_names_its_extra(absent, monkeypatch, capsys, tmp_path, to, package):
    t = np.arange(8) * 0.1
    file = tmp_path / "x.nc"
    FlightRecord(t, ("q",), np.zeros((8, 1)), "measured").save(file)
    absent(package)
    status, said = ends(monkeypatch, capsys, "export", file, "--to", to)
    assert (status, len(said)) == (2, 1)
    assert hint(to) in said[0]
    assert ends(monkeypatch, capsys, "export", file, "--to", "csv") == (0, [])


@pytest.mark.parametrize("package", ["distributed", "dask"])
def test_a_campaign_on_a_scheduler_names_its_extra_before_it_writes(absent, monkeypatch, capsys, tmp_path, package):
    absent(package)
    for verb in ("run", "resume"):
        words = (verb, "taurus_scatter", "--scheduler", "x")
        status, said = ends(monkeypatch, capsys, "campaign", *words, "-o", tmp_path / "out")
        assert (status, len(said)) == (3, 1)
        assert hint("campaign") in said[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("module", ["train", "baselines"])
def test_agents_and_baselines_name_their_extra(absent, monkeypatch, capsys, module):
    extra = {"train": "rl", "baselines": "envs"}[module]
    name = f"testbench.envs.{module}"
    absent("gymnasium", "stable_baselines3", "torch")
    for known in ("testbench.envs.train", "testbench.envs.baselines", "testbench.envs.excitation"):
        monkeypatch.delitem(sys.modules, known, raising=False)
    monkeypatch.setattr(sys, "argv", [name])
    law = rf"^error: [^\n]+ not installed; {re.escape(hint(extra))}$"
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
    assert said[0].endswith(f"needs aerosandbox, which is not installed; {hint('geometry')}")
    assert not (tmp_path / "mine").exists()


def test_the_environments_name_their_extra(absent, monkeypatch):
    absent("gymnasium")
    monkeypatch.delitem(sys.modules, "testbench.envs.excitation", raising=False)
    with pytest.raises(MissingPackage, match=re.escape(hint("envs"))) as found:
        register()
    assert isinstance(found.value, ImportError)
    assert isinstance(found.value, TestbenchError)
    with pytest.raises(MissingPackage, match=re.escape(hint("envs"))):
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
