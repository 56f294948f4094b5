"""All workers of an embedded cluster end: they are started again, or the campaign says why not and what to do."""

from __future__ import annotations

import json
import os
import signal
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from testbench.core.errors import CampaignError
from testbench.questions.campaign import ask, workers
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.flying import Outcome

EMPTY = json.dumps({"figures": {}, "poles": {}})


def flown(job, runs):
    """Return outcomes without flying."""
    return [Outcome(run, run, "{}", EMPTY, "", 0.0) for run in runs]


def kills_once(mark: Path):
    """Return a task that in run 5, once, kills the process that workers are forked from; by value."""

    def task(job, runs):
        if 5 in runs and not mark.exists():
            mark.touch()
            os.kill(os.getppid(), signal.SIGKILL)
            os.kill(os.getpid(), signal.SIGKILL)
        return [Outcome(run, run, "{}", EMPTY, "", 0.0) for run in runs]

    return task


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(ask, "_RESTART_S", 3.0)


@pytest.fixture
def no_process(monkeypatch):
    """Return what makes every further worker process fail to start, as a limit of processes does."""
    from distributed.process import AsyncProcess

    def refuse(self):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    return lambda: monkeypatch.setattr(AsyncProcess, "start", refuse)


def test_a_campaign_whose_fork_server_is_killed_starts_it_again_and_finishes(short, tmp_path, soon):
    mark = tmp_path / "killed"
    ending = fly_campaign(short("runs = 24"), tmp_path / "s", workers=2, task=kills_once(mark))
    assert mark.exists()
    assert (ending.counts.done, ending.counts.failed) == (24, 0)


def test_no_process_at_the_start_is_said_with_the_reason(short, tmp_path, no_process, monkeypatch):
    no_process()
    monkeypatch.setattr(workers, "why_none", lambda: "this machine starts no process")
    with pytest.raises(CampaignError, match="none could be started: this machine starts no process"):
        fly_campaign(short("runs = 24"), tmp_path / "s", workers=1)


def test_workers_that_cannot_come_back_end_the_session_and_resume_finishes(short, tmp_path, monkeypatch):
    """The workers are stand-ins of which none is ever there: dask itself may bring real ones back in time."""
    tried = []

    class Gone(workers.Workers):
        def count(self):
            return 0

        def wait(self, timeout_s):
            return []

    def restart():
        tried.append(1)
        raise CampaignError("no process can be started")

    @contextmanager
    def gone(count):
        yield Gone(None, "the embedded scheduler", restart)

    with monkeypatch.context() as patch:
        patch.setattr(ask, "local_workers", gone)
        patch.setattr(ask, "_RESTART_S", 0.01)
        patch.setattr(ask, "RESTARTS", 2)
        patch.setattr(ask, "_LOOK_S", 0.0)
        patch.setattr(ask, "why_none", lambda: "a reason")
        with pytest.raises(CampaignError, match=r"2 restarts have not helped: a reason\. .*campaign resume"):
            fly_campaign(short("runs = 24"), tmp_path / "s", workers=2, task=flown)
    assert len(tried) == 2
    ending = fly_campaign(short("runs = 24"), tmp_path / "s", workers=2, resume=True, task=flown)
    assert (ending.counts.done, ending.counts.failed) == (24, 0)


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("kill -9 $$", "ended by SIGKILL; the memory may be too small"),
        ("echo 'ImportError: no module' >&2; exit 1", r"cannot load the testbench \(ImportError: no module\)"),
        ("exec sleep 60", "does not load the testbench within 1 s"),
        ("exit 0", "something ends the workers"),
    ],
)
def test_a_process_that_is_tried_says_why_there_are_no_workers(tmp_path, monkeypatch, program, words):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{program}\n")
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(workers, "_TRY_S", 1.0)
    with pytest.raises(CampaignError, match=words):
        raise CampaignError(workers.why_none())


def test_a_machine_that_starts_no_process_is_named(monkeypatch):
    def refuse(*args, **kwargs):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(workers.subprocess, "run", refuse)
    assert workers.why_none().startswith("this machine starts no process (Resource temporarily unavailable)")


def test_a_process_of_this_machine_loads_what_workers_load():
    assert "lives" in workers.why_none()
