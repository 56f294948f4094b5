"""The commands of the guides on teaching and on any aircraft, run as they stand there, in an empty folder."""

from __future__ import annotations

import csv
import re
import shlex
import shutil
from pathlib import Path

import pytest
from any_aircraft import Visitor
from commands import Done, command

from testbench.core.paths import stock_root

GUIDES = Path(__file__).parents[2] / "docs" / "guides"


def blocks_of(guide: str, language: str) -> list[str]:
    """Return the blocks of a guide in one language."""
    text = (GUIDES / f"{guide}.md").read_text("utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def run_commands(guide: str, folder: Path) -> dict[str, Done]:
    """Run every command of a guide in a folder, in their order; return each with how it ended."""
    lines = [line for block in blocks_of(guide, "sh") for line in block.splitlines()]
    assert all(line.startswith("testbench ") for line in lines)
    return {line.split("#")[0].strip(): command(*shlex.split(line, comments=True)[1:], cwd=folder) for line in lines}


@pytest.mark.slow
def test_the_guide_on_teaching_hands_out_and_marks(tmp_path: Path) -> None:
    (tmp_path / "names.txt").write_text("Ada\nBen\n", encoding="utf-8")
    done = run_commands("teach", tmp_path)
    assert len(done) == 5
    check = done.pop("testbench exercise check doublet_length_ada")
    assert check.returncode == 1  # nothing is answered yet
    assert "0 of" in check.stdout
    for line, ended in done.items():
        assert ended.returncode == 0, f"{line}: {ended.stderr}"
    sheet = tmp_path / "doublet_length_ada"
    for name in ("README.html", "README.md", "answers.toml", "notebook.ipynb"):
        assert (sheet / name).is_file(), name
    assert (tmp_path / "class" / "key.txt").is_file()
    (marks,) = tmp_path.rglob("marks.csv")
    with marks.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["student"] for row in rows} == {"Ada", "Ben"}


@pytest.mark.slow
def test_the_guide_on_any_aircraft_shows_adopts_and_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    models, stock = tmp_path / "models", stock_root() / "aircraft" / "J3Cub"
    shutil.copytree(stock, models / "plane")
    (models / "plane" / "J3Cub.xml").rename(models / "plane" / "plane.xml")
    shutil.copytree(models / "plane", models, dirs_exist_ok=True)
    Visitor("../models/plane", 30.0, 1000.0, 0.3, 1.0).write(tmp_path)["run"].rename(tmp_path / "my_scenario.toml")
    scenario = (tmp_path / "my_scenario.toml").read_text(encoding="utf-8").replace("../models", "models")
    (tmp_path / "my_scenario.toml").write_text(scenario, encoding="utf-8")
    done = run_commands("any_aircraft", tmp_path)
    assert len(done) == 4
    for line, ended in done.items():
        assert ended.returncode == 0, f"{line}: {ended.stderr}"
    adopted = tmp_path / "aircraft" / "plane" / "aircraft.toml"
    assert (tmp_path / "aircraft" / "plane" / "plane.xml").is_file()
    monkeypatch.chdir(tmp_path)
    (python,) = blocks_of("any_aircraft", "python")
    space: dict[str, object] = {}
    exec(compile(python, "any_aircraft.md", "exec"), space)
    assert space["trimmed"].condition.V_m_s == 43.0  # type: ignore[attr-defined]
    (stabiliser,) = blocks_of("any_aircraft", "toml")
    adopted.write_text(adopted.read_text(encoding="utf-8") + "\n" + stabiliser, encoding="utf-8")
    checked = command("check", "aircraft/plane", cwd=tmp_path)
    assert checked.returncode == 0, checked.stderr
