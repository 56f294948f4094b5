"""What import advises works if it is followed: another rate gives a recipe, or is not advised."""

from __future__ import annotations

import re

import numpy as np
import pytest
from commands import ends
from scipy.io import savemat

from testbench.core.record import load_record
from testbench.questions.importing.ask import import_log, write_import

RATE = 50.0


def flight(path, control_hz, seconds=16.0, split=None):
    """Write a MAT file of a short period at 50 Hz whose elevator was logged more slowly, with times of its own."""
    n = round(seconds * RATE)
    t, u, x, y = np.arange(n) / RATE, np.zeros(n), np.zeros(2), np.zeros((n, 2))
    at, sign = 5.0, 1.0
    for k in (3, 2, 1, 1):
        u[(t >= at - 1e-9) & (t < at + 0.4 * k - 1e-9)] = 0.05 * sign
        at, sign = at + 0.4 * k, -sign
    A, B = np.array([[-1.2, 0.97], [-8.0, -2.0]]), np.array([-0.1, -9.0])
    for i in range(n):
        y[i] = x
        for _ in range(5):
            x = x + (A @ x + B * u[i]) / RATE / 5.0
    y += np.array([2e-4, 5e-4]) * np.random.default_rng(1).standard_normal(y.shape)
    k = round(RATE / control_hz)
    savemat(path, {"t": t, "alpha": y[:, 0], "q": y[:, 1], "de": u[::k], "t_de": t[::k]})
    return path


@pytest.mark.parametrize("control_hz", [25.0, 10.0, 5.0])
def test_the_rate_that_is_advised_gives_a_recipe(tmp_path, monkeypatch, capsys, control_hz):
    monkeypatch.chdir(tmp_path)
    flight(tmp_path / "slow.mat", control_hz)
    status, said = ends(monkeypatch, capsys, "identify", "slow.mat")
    assert status == 2
    advised = re.search(r"testbench (import) LOG (--rate) (\S+) (-o) FOLDER", " ".join(said))
    assert advised is not None, said
    words = [w.replace("LOG", "slow.mat").replace("FOLDER", "mine") for w in advised[0].split()[1:]]
    assert ends(monkeypatch, capsys, *words)[0] == 0
    assert [p.name for p in (tmp_path / "mine").glob("*.toml")] == ["slow_longitudinal.toml"]
    assert load_record(tmp_path / "mine" / "01_de.nc").valid.all()


def test_a_rate_that_would_not_help_is_not_advised(tmp_path):
    found = import_log(flight(tmp_path / "slow.mat", 2.0))
    (said,) = found.unusable
    assert "--rate 2 takes all of it, but does not help: it holds 21 samples, and a model needs 50 at least" in said
    other = import_log(tmp_path / "slow.mat", 2.0)
    assert not any(p.suffix == ".toml" for p in write_import(other, tmp_path / "mine"))


def test_a_channel_of_short_stretches_is_kept_by_the_rate_that_is_named(tmp_path):
    t = np.arange(4000) / 400.0
    fast = t[(np.arange(t.size) % 40) < 12]  # bursts of 30 ms every 0.1 s
    slow = np.arange(500) / RATE
    de = 0.05 * np.sign(np.sin(slow))
    content = {"t": slow, "de": de, "alpha": 0.1 * de, "q": np.sin(3.0 * fast), "t_q": fast}
    savemat(tmp_path / "bursts.mat", content)
    found = import_log(tmp_path / "bursts.mat", RATE)
    (left,) = [s for s in found.balance.left_out if s.channel == "q"]
    advised = re.search(r"--rate (\S+) keeps it", left.reason)
    assert advised is not None, left.reason
    assert "q" in import_log(tmp_path / "bursts.mat", float(advised[1])).record
