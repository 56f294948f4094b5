"""The commands of the guide on synthetic data as they stand there, and its lines for PyTorch."""

from __future__ import annotations

import re
import shlex
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from commands import command
from drawn_sets import SMALL, StandIn

import testbench as tb

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "synthetic_data.md"
TEXT = GUIDE.read_text("utf-8")


@pytest.mark.slow
def test_its_commands_run_and_its_own_file_is_right(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second, third = (line for line in TEXT.splitlines() if line.startswith("testbench dataset "))
    done = command(*shlex.split(first)[1:])
    assert done.returncode == 0, done.stderr
    assert "200 flights of 50 draws" in done.stdout
    assert "every file agrees" in command(*shlex.split(second)[1:]).stdout
    code = "\n".join(re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL))
    exec(compile(code, str(GUIDE), "exec"), {})
    done = command(*shlex.split(third)[1:])
    assert done.returncode == 0, done.stderr
    assert {line.split()[0] for line in done.stdout.splitlines() if "M_alpha" in line} == {
        "clean", "sensed", "turbulent", "flexible",
    }  # fmt: skip
    (own,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    Path("mine.toml").write_text(own, encoding="utf-8")
    assert "a valid data set" in command("check", "mine.toml").stdout
    done = command("dataset", "mine.toml", "--out", "mine", "--runs", "12", "--workers", "1")
    assert done.returncode == 0, done.stderr


def test_its_lines_for_pytorch(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    tb.draw_dataset("small.toml", "my_set", workers=1)
    (lines,) = re.findall(r"```\{code-block\} python\n(.*?)```", TEXT, re.DOTALL)
    assert len(lines.strip().splitlines()) == 3
    try:
        import torch.utils.data  # noqa: F401
    except ImportError:
        for name in ("torch", "torch.utils", "torch.utils.data"):
            monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
        sys.modules["torch.utils.data"].DataLoader = StandIn
    namespace = {}
    exec(compile(lines, str(GUIDE), "exec"), namespace)
    readings, truth = next(iter(namespace["loader"]))
    assert tuple(readings.shape[1:]) == (251, 7)
    assert np.isfinite(np.asarray(truth)).any()
