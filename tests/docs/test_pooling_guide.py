"""The commands of the guide on several logs, run one after the other as they stand there, in an empty folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from commands import command

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "pool_several_logs.md"


def blocks(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", GUIDE.read_text("utf-8"), re.DOTALL)


@pytest.mark.slow
def test_three_days_disagree_until_the_mass_of_the_third_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    python, toml = blocks("python"), blocks("toml")
    first, second = (line for line in GUIDE.read_text("utf-8").splitlines() if line.startswith("testbench identify "))
    exec(compile(python[0], str(GUIDE), "exec"), {})
    done = command(*shlex.split(first)[1:])
    assert done.returncode == 0, done.stderr
    assert "day3_longitudinal lies apart" in done.stdout
    assert "mass and inertia alike" in done.stdout
    heavy = Path("results/day3/day3_longitudinal.toml")
    heavy.write_text(heavy.read_text("utf-8") + toml[0], encoding="utf-8")
    done = command(*shlex.split(second)[1:])
    assert done.returncode == 0, done.stderr
    assert "The logs agree within their errors" in done.stdout
    assert "What the data added to the prior of taurus" in done.stdout
    Path("tunnel.toml").write_text(toml[1], encoding="utf-8")
    done = command("identify", "day1.csv", "--aircraft", "taurus", "--prior", "tunnel.toml", "--out", "one")
    assert done.returncode == 0, done.stderr
    assert "wind tunnel, March" in done.stdout
