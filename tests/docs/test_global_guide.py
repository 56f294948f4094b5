"""The guide on global models, run one block after the other as it stands there, in an empty folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from commands import command

import testbench as tb

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "global_model.md"


@pytest.mark.slow
def test_five_flights_become_functions_and_an_aircraft(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = GUIDE.read_text("utf-8")
    first, second = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict = {}
    exec(compile(first, str(GUIDE), "exec"), names)
    said = []
    for line in re.search(r"```sh\n(.*?)```", text, re.DOTALL)[1].splitlines():
        done = command(*shlex.split(line)[1:])
        assert done.returncode == 0, f"{line}: {done.stderr}"
        said.append(done.stdout)
    assert "6 coefficients of T38" in said[0]
    assert "eld-out log3: missed by CL" in said[0]
    assert "laws kept" in said[1]
    alpha = [tb.trim(tb.load_aircraft(n), tb.FlightCondition(120.0, 3000.0)).alpha for n in ("jsbsim:T38", "t38_flown")]
    assert alpha[1] == pytest.approx(alpha[0], abs=0.01)
    exec(compile(second, str(GUIDE), "exec"), names)
    out = capsys.readouterr().out
    CL, error, alpha = (float(x) for x in re.search(r"CL ([\d.]+) \+- ([\d.]+) .* at ([\d.]+) rad", out).groups())
    de = names["state"]["de"][0]
    assert pytest.approx(2.864 * alpha + 0.172 * de, abs=0.02) == CL  # the tables of JSBSim's T-38 below 14 deg
    assert 0.0 < error < 0.02
    assert "inside: False, CL nan" in out
