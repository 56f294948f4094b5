"""Machine code of the batch: functions of its stages against C's library, and code that is kept on disk."""

import math
import os

import numpy as np
import pytest
from side_by_side import by_itself

from testbench.flight.batch import machine
from testbench.flight.batch.emit import ground
from testbench.flight.batch.vector import LANES, power, sincos

CORNERS = (0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -2.5, 1e-310, 1e300, 1e5, math.inf, -math.inf, math.nan)


def test_functions_of_the_stages_are_the_library_s_within_a_last_bit():
    def work(rows):
        rows[2] = power(rows[0], rows[1])
        rows[3], rows[4] = sincos(rows[0])

    rng, run = np.random.default_rng(3), by_itself(work)
    usual = [np.stack([np.exp(rng.uniform(-3.0, 3.0, LANES)), rng.uniform(-9.0, 9.0, LANES)]) for _ in range(200)]
    corners = [np.array([np.full(LANES, x), rng.choice(CORNERS, LANES)]) for x in CORNERS]
    for x, y in usual + corners:
        R = np.zeros((5, LANES))
        R[0], R[1] = x, y
        run(R)
        with np.errstate(all="ignore"):
            np.testing.assert_allclose(R[2], np.power(x, y), rtol=5e-16, atol=0.0)
            np.testing.assert_allclose(R[3:], [np.sin(x), np.cos(x)], rtol=5e-16, atol=0.0)


@pytest.mark.parametrize("left_by_a_crash", [b"", b"half", None])
def test_code_on_disk_is_used_only_if_it_is_whole(tmp_path, monkeypatch, left_by_a_crash):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked: list[int] = []

    def text():
        asked.append(1)
        return ground()

    code = machine._kept("ground", text)
    (file,) = tmp_path.rglob("*.o")
    if left_by_a_crash is not None:
        file.write_bytes(left_by_a_crash)
    assert machine._kept("ground", text) == code
    assert len(asked) == (1 if left_by_a_crash is None else 2)
    assert machine.Ground(file.read_bytes()[32:]).address("weigh") != 0


def test_the_oldest_code_on_disk_gives_way(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(machine, "_KEPT", 2)
    seen = []
    for k in range(4):
        machine._kept(f"{k}", ground)
        new = [f for f in tmp_path.rglob("*.o") if f not in seen]
        seen += new
        os.utime(new[0], (k, k))
    assert sorted(tmp_path.rglob("*.o")) == sorted(seen[-2:])
