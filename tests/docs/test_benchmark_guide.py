"""The benchmark: the commands of its guide, its hash, and that its scores are true where the answer is known."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import command

import testbench as tb
from testbench.core.errors import ScenarioError
from testbench.questions.compare.benchmark.ask import KEPT
from testbench.questions.compare.benchmark.bound import bound, mode_slopes
from testbench.questions.compare.benchmark.flights import TRUE, fly_with_surface
from testbench.questions.compare.benchmark.sets import SETS
from testbench.questions.files import find

TEXT = (Path(__file__).parents[2] / "docs" / "guides" / "benchmark_a_method.md").read_text("utf-8")
SMALL = {"seeds": 2, "sets": ("clean", "missing"), "methods": ("moesp", "output_error"), "workers": 1}


def test_its_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (own,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    Path("my_method.py").write_text(own, encoding="utf-8")
    _, second = (line for line in TEXT.splitlines() if line.startswith("testbench compare benchmark"))
    done = command(*shlex.split(second)[1:])
    assert done.returncode == 0, done.stderr
    (name,) = set(re.findall(r"SHA-256\s+([0-9a-f]{64})", done.stdout))
    assert name in Path("mine/report.html").read_text("utf-8")
    rows = pd.read_csv("mine/tables/benchmark.csv")
    assert rows.groupby("set").size().to_dict() == {"clean": 3, "missing": 3}
    assert "my_method.py:estimate" in set(rows["method"])
    assert (rows["failed"] == 0).all()


def test_it_is_named_by_what_decides_it_and_goes_on(tmp_path):
    first = tb.benchmark(tmp_path, **SMALL)
    kept = (tmp_path / KEPT).read_text("utf-8")
    (tmp_path / KEPT).write_text(kept[:-40], encoding="utf-8")  # interrupted within a line
    again = tb.benchmark(tmp_path, **SMALL)
    assert again.sha256 == first.sha256
    assert len((tmp_path / KEPT).read_text("utf-8").splitlines()) == len(kept.splitlines()) + 1
    assert again.score("missing", "output_error").rms == first.score("missing", "output_error").rms
    fewer = tb.benchmark(tmp_path, **SMALL | {"seeds": 1})
    assert fewer.sha256 != first.sha256
    assert tb.benchmark(tmp_path, **SMALL | {"sets": ("clean",)}).sha256 != first.sha256
    # Four errors in units of their bound: by chance beyond 3 with 3e-7, below 0.1 with 2e-4; seeds are fixed.
    assert 0.1 < first.score("clean", "output_error").rms < 3.0
    assert first.score("clean", "output_error").intervals == 10


def test_a_method_that_fails_is_a_row_and_absent_flights_are_said(tmp_path, monkeypatch):
    # Wherever the flights may lie: the description beside the packaged one names a folder without any.
    monkeypatch.delenv("TESTBENCH_FLIGHT_DATA", raising=False)
    described = find(Path(SETS["attas"].records), "identify").read_text("utf-8")
    away = re.sub(r"(?m)^folder = .*$", 'folder = "nowhere"', described)
    (tmp_path / "attas.toml").write_text(away, encoding="utf-8")
    monkeypatch.setitem(SETS, "attas", replace(SETS["attas"], records=str(tmp_path / "attas.toml")))
    own = tmp_path / "bad.py"
    own.write_text("def estimate(records, inputs, outputs):\n    raise ValueError('not today')\n", encoding="utf-8")
    found = tb.benchmark(tmp_path, seeds=1, sets=("8_hz", "attas"), methods=("moesp", f"{own}:estimate"), workers=1)
    assert [d.name for d in found.absent] == ["attas"]
    score = found.score("8_hz", "bad.py:estimate")
    assert score.failed == 1
    assert "not today" in score.reason
    with pytest.raises(ScenarioError, match="missing"):
        tb.benchmark(tmp_path, sets=("mising",))


def test_the_bound_follows_a_second_way():
    def mode(p):
        A = np.array([[p[0], 1.0], [p[2], p[3]]])
        wn = np.sqrt(np.linalg.det(A))
        return np.array([wn, -np.trace(A) / 2.0 / wn])

    steps = 1e-6 * np.eye(5)
    slopes = np.stack([(mode(TRUE + s) - mode(TRUE - s)) / 2e-6 for s in steps], axis=-1)
    np.testing.assert_allclose(mode_slopes(TRUE), slopes, rtol=1e-6, atol=1e-9)
    clean, coloured = (bound(c, *fly_with_surface(c, 1)) for c in ("clean", "colour"))
    slow = bound("slow", *fly_with_surface("slow", 1))
    assert (coloured > 3.0 * clean).all()
    assert (slow / clean) == pytest.approx(np.sqrt(6.0), rel=0.1)  # a sixth of the samples
    assert len(SETS) == 12
