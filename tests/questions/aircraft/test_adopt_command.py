"""``testbench aircraft adopt`` from an empty folder, and what follows."""

import shutil

import pytest
from any_aircraft import Visitor
from commands import command

from testbench.core.paths import stock_root

STOCK = stock_root() / "aircraft"


@pytest.mark.slow
@pytest.mark.usefixtures("rendered")
def test_a_model_of_somebody_else_becomes_ones_own(tmp_path):
    shutil.copytree(STOCK / "J3Cub", tmp_path / "models" / "J3Cub")
    done = command("aircraft", "adopt", "models/J3Cub", "-o", "aircraft/cub", "--speed", "30", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for words in ("fcs/elevator-cmd-norm moves", "piston", "assumed", 'aircraft = "cub"', "short period"):
        assert words in done.stdout, words
    text = (tmp_path / "aircraft" / "cub" / "aircraft.toml").read_text(encoding="utf-8")
    assert "design_V_m_s = 30.0" in text
    assert "[drawing]" in text
    assert (tmp_path / "results" / "aircraft_cub" / "figures" / "three_view.png").stat().st_size > 5000
    assert command("check", "aircraft/cub", cwd=tmp_path).returncode == 0
    file = Visitor("cub", 30.0, 1000.0, 0.3, 1.0).write(tmp_path)["run"]
    done = command("run", file, "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    mine = tmp_path / "aircraft" / "cub" / "aircraft.toml"
    mine.write_text(f"{text}# mine\n", encoding="utf-8")
    again = command("aircraft", "adopt", "models/J3Cub", "-o", "aircraft/cub", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "# mine" in (mine.parent / "aircraft.toml.kept").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ah1s", "a rotor"),
        ("ball", "control surfaces"),
        ("blank", "must begin with <fdm_config>"),
        ("nothing", "got 'nothing'"),
    ],
)
def test_what_cannot_be_adopted_is_said_in_one_sentence(tmp_path, name, words):
    done = command("aircraft", "adopt", name, cwd=tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("error:") == 1
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "aircraft").exists()
