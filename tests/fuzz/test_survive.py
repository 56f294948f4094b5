"""What watches damaged files notices an exception, a hang, memory and the end of the process, and nothing else."""

from __future__ import annotations

import os
import resource
import signal
import time

import numpy as np
import pytest
from fuzz import survive
from fuzz.mutations import damaged, garbled, mistyped

from testbench.core.errors import RecordError


def test_what_is_noticed(monkeypatch):
    monkeypatch.setattr(survive, "LONGEST_S", 2)
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # of which a child begins with any part
    monkeypatch.setattr(survive, "MOST_KB", peak_kb + 100_000)

    def refused(folder):
        raise RecordError("as it should be")

    cases = {
        "fine": lambda folder: (folder / "a").write_text("x"),
        "refused": refused,
        "raises": lambda folder: {}["missing"],
        "sleeps": lambda folder: time.sleep(5),
        "ends": lambda folder: os.kill(os.getpid(), signal.SIGKILL),
        "after the end": lambda folder: 1 / 0,
    }
    lines = [*survive.broken(cases)]
    monkeypatch.setattr(survive, "LONGEST_S", 60)  # memory as large as that of a worker with many tests takes seconds
    lines += survive.broken({"large": lambda folder: np.ones((peak_kb + 200_000) * 128).sum()})
    found = {line.partition(": ")[0]: line for line in lines}
    assert sorted(found) == ["after the end", "ends", "large", "raises", "sleeps"]
    assert "KeyError" in found["raises"]
    assert "TooLong" in found["sleeps"]
    assert "GB of memory" in found["large"]


@pytest.mark.parametrize(
    ("damage", "content"),
    [(damaged, bytes(range(256)) * 8), (garbled, "t,q\n0,1.5\n1,2.5\n"), (mistyped, 'title = "a"\nseed = 3\n')],
)
def test_one_seed_one_damage(damage, content):
    made = [damage(content, np.random.default_rng(seed)) for seed in range(50)]
    assert made == [damage(content, np.random.default_rng(seed)) for seed in range(50)]
    assert len(set(made)) > 40
