"""Nothing divides by the time that a clock has shown, which on some machines is none."""

import ast
import time
from pathlib import Path

import numpy as np
import pytest
from benchmarks import env_speed
from clock import since

from testbench.questions.campaign.ask import Progress
from testbench.questions.campaign.store import Counts

TESTS = Path(__file__).parent
CLOCKS = ("process_time", "perf_counter", "monotonic", "time", "thread_time")


@pytest.fixture
def still(monkeypatch):
    for clock in CLOCKS[:3]:
        monkeypatch.setattr(time, clock, lambda: 12.5)


@pytest.mark.parametrize("clock", CLOCKS[:3])
def test_time_since_a_reading_is_above_zero_and_what_a_clock_shows(clock, still):
    assert 0.0 < since(12.5, getattr(time, clock)) < 1e-6
    assert since(2.5, getattr(time, clock)) == 10.0


def read_alone(path: Path) -> list[int]:
    """Return the lines that take a reading of a clock away from another themselves."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text if "import time" in text else "")
    differences = [n for n in ast.walk(tree) if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Sub)]
    clocks = {f"time.{clock}" for clock in CLOCKS}
    return [n.lineno for n in differences if isinstance(n.left, ast.Call) and ast.unparse(n.left.func) in clocks]


def test_every_study_and_benchmark_measures_time_by_the_clock_that_stays_above_zero():
    paths = [p for folder in ("benchmarks", "studies") for p in sorted((TESTS / folder).rglob("*.py"))]
    using = [p for p in paths if "from clock import" in p.read_text(encoding="utf-8")]
    assert len(using) > 15
    alone = {p.name: lines for p in paths if (lines := read_alone(p))}
    assert alone == {}, "measure with since() of tests/clock.py, which is above zero"


class Environment:
    """Stands for an environment, or for two."""

    amplitude, num_envs = (0.1,), 2

    def reset(self, seed=None):
        return None

    def step(self, action):
        over = np.zeros(len(action), bool) if np.ndim(action) == 2 else False
        return None, None, over, over, None


def test_rates_of_environments_are_finite_when_no_time_passes(still):
    assert 0.0 < env_speed.steps_per_second(Environment(), 3, 0.1) < np.inf
    assert 0.0 < env_speed.steps_per_second_together(Environment(), 3, 0.1) < np.inf


def test_a_campaign_says_what_is_left_when_no_time_has_passed():
    begun = Progress(Counts(0, 2, 1), 1, 0.0, 1)
    assert (begun.rate, begun.left_s) == (0.0, 0.0)
    assert Progress(Counts(0, 3, 1), 1, 2.0, 1).left_s == 6.0
    assert Progress(Counts(0, 3, 0), 0, 2.0, 1).left_s is None
