"""Work in processes of its own: the same results as in turn, and nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import pytest
from studies.blind.flights import fly_truth
from studies.blind.run import believe
from studies.blind.truths import TRUTHS

from testbench.core.files import Scratch
from testbench.core.processes import Ahead, processes, spread
from testbench.effects import EFFECTS
from testbench.flight.executive import Executive
from testbench.questions.gap.name import Sought, name_effect

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")


def test_tasks_are_shared_out_and_results_come_in_order():
    here = os.getpid()
    with processes(3):
        found = spread([partial(lambda k: (k, os.getpid()), k) for k in range(7)])
    assert [k for k, _ in found] == list(range(7))
    assert len({pid for _, pid in found}) == 3
    assert {pid for k, pid in found if k % 3 == 0} == {here}


def test_without_a_word_all_is_done_in_turn():
    assert spread([os.getpid, os.getpid]) == [os.getpid(), os.getpid()]


def test_what_a_task_raises_is_raised_where_its_result_is_asked_for():
    def fails() -> None:
        raise ValueError("no trim")

    with processes(2), Ahead() as ahead:
        ahead.begin("a", fails)
        with pytest.raises(ValueError, match="no trim"):
            ahead.take("a", fails)


@pytest.mark.parametrize("way", ["killed", "an answer that cannot be sent"])
def test_the_work_of_a_process_without_an_answer_is_done_here(way):
    here = os.getpid()

    def task():
        if os.getpid() == here:
            return "here"
        if way == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        return lambda: None

    with processes(2), Ahead() as ahead:
        ahead.begin("a", task)
        assert ahead.take("a", task) == "here"


def test_tasks_that_are_no_longer_wanted_are_ended_and_leave_no_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    Scratch()  # the folder of this process stays until it ends
    before = list(tmp_path.rglob("*"))

    def writes_and_waits():
        Path(tempfile.mkdtemp()).joinpath("model.xml").touch()
        signal.pause()

    with processes(2), Ahead() as ahead:
        for name in "ab":
            ahead.begin(name, writes_and_waits)
    assert list(tmp_path.rglob("*")) == before


def test_an_interrupt_while_processes_answer_ends_them_all():
    """Each answers with more than a pipe holds, and the second has the first one's pipe: none must wait for another."""
    code = (
        "import sys, time\n"
        "from testbench.core.processes import Ahead, processes\n"
        "def late():\n    time.sleep(1.0)\n    return bytes(10**6)\n"
        "with processes(2), Ahead() as ahead:\n"
        "    ahead.begin(1, late)\n    ahead.begin(2, late)\n"
        "    print('begun', flush=True)\n    ahead.take(1, late)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout is not None
    assert process.stdout.readline() == b"begun\n"
    process.send_signal(signal.SIGINT)
    try:
        assert process.wait(20.0) == -signal.SIGINT
    finally:
        process.kill()


def test_a_process_leaves_the_models_of_the_one_that_it_came_from(tmp_path, monkeypatch):
    from testbench.flight import executive

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    executive._write.cache_clear()
    believed = believe("taurus")
    Executive(believed.aircraft, believed.rate_hz, believed.condition)
    written = sorted(tmp_path.rglob("*.xml"))
    with processes(2), Ahead() as ahead:
        ahead.begin("a", executive._write.cache_clear)
        ahead.take("a", executive._write.cache_clear)
    assert written
    assert sorted(tmp_path.rglob("*.xml")) == written


def test_a_process_flies_on_when_the_one_that_it_came_from_removes_its_models():
    from testbench.flight import executive

    believed = believe("taurus")
    read, write = os.pipe()

    def load():
        return Executive(believed.aircraft, believed.rate_hz, believed.condition).get("inertia/weight-lbs")

    def load_later():
        os.read(read, 1)
        return load()

    weight = load()
    with processes(2), Ahead() as ahead:
        ahead.begin("a", load_later)
        executive._write.cache_clear()
        os.write(write, b"1")
        assert ahead.take("a", pytest.fail) == weight
    os.close(read)
    os.close(write)


def test_two_processes_name_what_one_does_with_the_same_numbers():
    """A search, and the same again: four seconds."""
    plan = TRUTHS["slow servo"]({"lag_rad_s": 12.0}, "taurus")
    records = list(fly_truth("taurus", plan, "short", 3).values())
    effects = {n: EFFECTS[n] for n in ("actuator_lag", "transport_delay", "q_lag")}
    alone = name_effect(believe("taurus"), records, Sought(effects))
    with processes(2):
        both = name_effect(believe("taurus"), records, Sought(effects))
    assert (both.outcome, both.names, both.rejected) == (alone.outcome, alone.names, alone.rejected)
    assert both.nuisances == alone.nuisances
    assert [(f.effect.name, f.values, f.chi2) for f in both.ranking] == [
        (f.effect.name, f.values, f.chi2) for f in alone.ranking
    ]
    assert both.best is not None
    assert both.best.effect is effects["actuator_lag"]
