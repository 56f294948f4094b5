"""What watches damaged files notices an exception, a hang, memory and the end of the process, and nothing else."""

import os
import resource
import signal
import time

import numpy as np
import pytest
from commands import in_warm_process
from fuzz import survive
from fuzz.mutations import damaged, garbled, mistyped

from testbench.core.errors import RecordError


def noticed(told):
    """Write what is noticed of some cases, from a process that is small: one of its size is told by a larger one."""
    survive.LONGEST_S = 1
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # of which a child begins with any part
    survive.MOST_KB = peak_kb + 100_000

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
    survive.LONGEST_S = 60
    lines += survive.broken({"large": lambda folder: np.ones((peak_kb + 200_000) * 128).sum()})
    told.write_text("\n".join(lines), encoding="utf-8")


def test_what_is_noticed(tmp_path):
    assert in_warm_process(noticed, tmp_path / "told") == 0
    lines = (tmp_path / "told").read_text(encoding="utf-8").splitlines()
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
