"""The commands of the guide on plans, run one after the other as they stand there, in an empty folder."""

from __future__ import annotations

import csv
import resource
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from any_aircraft import geometry_of_the_guide
from commands import command

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "plan_a_flight.md"
MOST_S = 300.0
"""Of machine time, from the drawing to derivatives."""


def lines_of(chapter: str, end: str) -> list[str]:
    """Return the commands between two headings."""
    text = GUIDE.read_text("utf-8").split(chapter)[1].split(end)[0]
    return [line for line in text.splitlines() if line.startswith("testbench ")]


def in_a_process_of_its_own(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command so that its machine time is that of a child of this process."""
    code = "from testbench.cli import main; main()"
    return subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)


def fly_the_whole_way(more: str = "", run: Callable[..., Any] = command) -> list[str]:
    """Run the commands of the whole way in the working directory, the design with more lines; return what each said."""
    chapter = GUIDE.read_text("utf-8").split("## The whole way in six commands")[1]
    Path("trainer.toml").write_text(geometry_of_the_guide(), encoding="utf-8")
    asked = chapter.split("```toml\n")[1].split("```")[0]
    Path("short_period.toml").write_text(asked.replace("\n[condition]", f"{more}\n[condition]"), encoding="utf-8")
    lines, said = lines_of("## The whole way in six commands", "\n## 1."), []
    assert len(lines) == 6
    for line in lines:
        words = [str(file) for word in shlex.split(line)[1:] for file in (Path().glob(word) if "*" in word else [word])]
        done = run(*words)
        assert done.returncode == 0, f"{line}: {done.stderr}"
        said.append(done.stdout)
    assert list(Path("results/plan_short_period/cards").glob("*.pdf"))
    return said


def targets_found() -> dict[str, dict[str, str]]:
    """Return the rows of the table of targets by name."""
    with Path("results/close_short_period/tables/targets.csv").open(encoding="utf-8") as file:
        return {row["target"]: row for row in csv.DictReader(file)}


def identified_errors() -> dict[str, float]:
    """Return the errors of the targets that `testbench identify` gives for what `plan close` wrote."""
    (path,) = Path("results").glob("*/tables/derivatives.csv")
    with path.open(encoding="utf-8") as file:
        return {row["derivative"]: float(row["std"]) for row in csv.DictReader(file) if row["derivative"][0] == "M"}


@pytest.mark.slow
def test_the_whole_way_from_geometry_to_derivatives_in_small(tmp_path, monkeypatch):
    """The commands of the guide, with a design that no flight realises."""
    monkeypatch.chdir(tmp_path)
    said = fly_the_whole_way("draws = 0\nrealise = 0\n")
    assert "2 runs of 2 found in 1 log, 2 as their cards say" in said[4]
    rows = targets_found()
    assert set(rows) == {"M_alpha", "M_q", "M_de"}
    assert identified_errors() == {name: pytest.approx(float(row["error"])) for name, row in rows.items()}
    for row in rows.values():
        assert float(row["flown"]) == pytest.approx(float(row["here"]), rel=0.4)
        assert row["realised"] == ""
        assert row["verdict"] in ("reached", "not reached", "not identifiable")
    assert "Not realised in simulation: cards 1, 2" in Path("results/close_short_period/report.html").read_text("utf-8")
    assert "of 3 targets known as well as wanted, from 2 good of 2 planned runs" in " ".join(said[4].split())
    assert "M_alpha" in said[5]
    assert "MRSE on the validation records" in said[5], "the run that the design is judged by is kept back"
    (line,) = lines_of("### Design the next flight", "\n## What")[:1]
    done = command(*shlex.split(line)[1:])
    assert done.returncode == 0, done.stderr
    with Path("results/design_short_period_after_1/tables/known.csv").open(encoding="utf-8") as file:
        known = {row["target"]: row for row in csv.DictReader(file)}
    assert set(known) == set(rows)
    for name, row in known.items():
        error = float(rows[name]["error"])
        assert float(row["value"]) == pytest.approx(float(rows[name]["flown"]), abs=2.0 * error)
        assert float(row["after"]) < min(float(row["now"]), float(row["alone"]))


@pytest.mark.slow
def test_the_whole_way_as_the_guide_has_it_keeps_its_promise_in_five_minutes(tmp_path, monkeypatch):
    """Machine time is that of all processes of the commands together."""
    monkeypatch.chdir(tmp_path)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    fly_the_whole_way(run=in_a_process_of_its_own)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert 1.0 < took_s < MOST_S
    rows = targets_found()
    assert identified_errors() == {name: pytest.approx(float(row["error"])) for name, row in rows.items()}
    assert [row["verdict"] for row in rows.values()].count("reached") >= 2
    for row in rows.values():
        assert float(row["flown error"]) < 1.2 * max(float(row["wanted"]), float(row["realised"]))
        assert float(row["realised"]) > float(row["promised"])
        assert abs(float(row["differs"])) < 4.0


def test_the_guide_s_way_to_scripts_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = lines_of("## 4. Turn it into flights", "### Limits")
    assert len(lines) == 3
    for line in lines:
        done = command(*shlex.split(line)[1:])
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert len(list(Path("results/plan_my_plan/injection").glob("*.lua"))) == 2
