"""Work of others in processes of its own: how one ends that gave no answer is said, and no crash is repeated here."""

from __future__ import annotations

import os
import signal
import time

import pytest

from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.processes import Ahead, apart, processes


def test_the_result_and_the_errors_of_a_task_come_back():
    assert apart(os.getpid, "it", 10.0) != os.getpid()

    def refuses() -> None:
        raise ScenarioError(["one", "two"])

    with pytest.raises(ScenarioError) as error:
        apart(refuses, "it", 10.0)
    assert error.value.faults == ("one", "two")


@pytest.mark.parametrize(
    ("task", "how"),
    [
        (lambda: os._exit(0), "m.py:f must end with a result, but its process ended with status 0"),
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), "m.py:f must .* its process was ended by SIGSEGV: compiled"),
        (lambda: time.sleep(60.0), "m.py:f must end within 0.2 s"),
    ],
    ids=["exit", "crash", "no end"],
)
def test_a_task_that_gives_no_answer_is_said(task, how):
    with pytest.raises(EstimationError, match=how):
        apart(task, "m.py:f", 10.0 if "within" not in how else 0.2)


def test_a_task_that_crashed_its_process_is_not_done_here(tmp_path):
    """One that was killed, for want of memory, is."""
    here = os.getpid()

    def crashes() -> str:
        os.kill(os.getpid(), signal.SIGSEGV)
        return "here"

    def killed() -> str:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return "here"

    with processes(2), Ahead() as ahead:
        ahead.begin("effect", crashes)
        with pytest.raises(EstimationError, match=r"'effect' must end .* ended by SIGSEGV"):
            ahead.take("effect", crashes)
        ahead.begin("effect", killed)
        assert ahead.take("effect", killed) == "here"
