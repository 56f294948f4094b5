"""An interrupt that comes while it is held back acts afterwards, once, and is not lost."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from testbench.core.interrupts import ended_by_signals, held_back


@pytest.fixture(autouse=True)
def interrupts():
    """Interrupts act as they do in a command, whatever runs the tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_acts_after_the_block():
    done = []

    @held_back()
    def block():
        os.kill(os.getpid(), signal.SIGINT)
        done.append("all of the block")

    with pytest.raises(KeyboardInterrupt):
        block()
    assert done == ["all of the block"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_error_of_the_block_and_a_block_without_interrupts_pass():
    with pytest.raises(ZeroDivisionError), held_back():
        _ = 1 / 0
    with held_back():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_in_another_thread_and_where_interrupts_are_ignored_nothing_changes():
    seen = []

    def work():
        with held_back():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with held_back():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_of_the_system_end_as_an_interrupt_does_once_they_may(number):
    done = []

    @held_back()
    def block():
        os.kill(os.getpid(), number)
        done.append("all of the block")

    with ended_by_signals() as came:
        with pytest.raises(KeyboardInterrupt):
            block()
        assert came == [number]
    assert done == ["all of the block"]
    assert signal.getsignal(number) is signal.SIG_DFL


def test_a_signal_that_somebody_took_is_left_to_them():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals() as came:
            os.kill(os.getpid(), signal.SIGHUP)
        assert came == []
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def test_an_interrupt_that_a_library_loses_comes_again():
    class Lost:
        def __del__(self):
            raise KeyboardInterrupt

    def wait():
        for _ in range(500):
            time.sleep(0.01)  # ends before an interrupt is seen

    with ended_by_signals():
        Lost()
        with pytest.raises(KeyboardInterrupt):
            wait()


def test_a_signal_at_the_very_end_of_the_block_ends_nothing_twice():
    class Lost:
        def __del__(self):
            raise KeyboardInterrupt

    after = []
    for wait in np.linspace(0.0, 0.03, 40):  # an interrupt comes again after 0.02 s: around the block's end
        try:
            with ended_by_signals():
                try:
                    Lost()
                    time.sleep(wait)
                except KeyboardInterrupt:
                    continue
        except KeyboardInterrupt:
            after.append(wait)
        try:
            time.sleep(0.001)
        except KeyboardInterrupt:
            after.append(wait)
    assert after == []


def test_a_signal_as_the_command_ends_has_its_status_and_is_no_traceback(monkeypatch):
    """Python acts on a signal at the next call: after a long removal of objects that may be the end of the block."""
    from testbench import cli

    @contextlib.contextmanager
    def late():
        came = []
        yield came
        came.append(signal.SIGTERM)
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "ended_by_signals", late)
    monkeypatch.setattr(cli, "_status", lambda: 0)
    monkeypatch.setattr("sys.argv", ["testbench", "list", "aircraft"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 128 + signal.SIGTERM


ENDED = """
import sys
from testbench.core.interrupts import leave_to_the_system
try:
    exec("raise KeyboardInterrupt")  # as where a module is imported that makes classes from texts
except KeyboardInterrupt:
    leave_to_the_system()
sys.exit(143)
"""


def test_python_ends_with_the_status_that_was_given_wherever_an_interrupt_struck(tmp_path):
    (tmp_path / "ended.py").write_text(ENDED, encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-S", "-m", "ended"]
    done = subprocess.run(command, env={"PYTHONPATH": paths}, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (143, "")
