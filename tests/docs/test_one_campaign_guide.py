"""The commands of the guide on one campaign, run one after the other as they stand there, in an empty folder."""

from __future__ import annotations

import csv
import os
import re
import shlex
from pathlib import Path

import pytest
from any_aircraft import geometry_of_the_guide
from commands import command

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "one_campaign.md"


@pytest.mark.slow
def test_the_loop_closes_without_editing_a_file(tmp_path, monkeypatch):
    """The aircraft that flies is drawn; what is amended follows the flight that it does not know better than before."""
    monkeypatch.chdir(tmp_path)
    Path("trainer.toml").write_text(geometry_of_the_guide(), encoding="utf-8")
    (block,) = re.findall(r"```sh\n(.*?)```", GUIDE.read_text("utf-8"), re.DOTALL)
    lines = block.splitlines()
    assert len([line for line in lines if line.startswith("testbench ")]) <= 10
    for line in lines:
        first, *words = shlex.split(line)
        if first == "cd":
            os.chdir(words[0])
            continue
        words = [str(f) for word in words for f in (sorted(Path().glob(word)) if "*" in word else [word])]
        done = command(*words)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    misses = {}
    for path in Path("results").glob("*/tables/amended_misses.csv"):
        with path.open(encoding="utf-8") as file:
            misses |= {r["output"]: (float(r["before"]), float(r["after"])) for r in csv.DictReader(file)
                       if r["records"] == "not used"}  # fmt: skip
    assert misses["q"][1] < 0.8 * misses["q"][0]
    assert misses["p"][1] < misses["p"][0]
    standing = command().stdout
    assert "the loop is closed" in standing
    assert len(standing.splitlines()) <= 10
