"""The commands of the guide on plans, run one after the other as they stand there, in an empty folder."""

from __future__ import annotations

import shlex
from pathlib import Path

from commands import command

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "plan_a_flight.md"


def test_the_guide_s_way_from_design_to_scripts_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chapter = GUIDE.read_text("utf-8").split("## 4. Turn it into flights")[1].split("### Limits")[0]
    lines = [line for line in chapter.splitlines() if line.startswith("testbench ")]
    assert len(lines) == 5
    for line in lines:
        done = command(*shlex.split(line)[1:])
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert list(Path("results/plan_taurus_short_period/cards").glob("*.pdf"))
    assert len(list(Path("results/plan_my_plan/injection").glob("*.lua"))) == 6
