"""A limit on how long a piece of work may take, for work that we did not write and that may never end."""

from __future__ import annotations

import ctypes
import multiprocessing
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from os import _exit
from types import FrameType
from typing import NoReturn

GRACE_S = 10.0
"""How long a worker process waits for work that does not notice its limit, before it ends with it."""
_ENDED = 70


class TimeUp(BaseException):
    """The time is up. No ``except Exception`` of the work itself takes it."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise :class:`TimeUp` inside the block if it takes longer than ``seconds`` of the clock.

    In the main thread a timer signal ends the work, also while it sleeps. In any other thread the exception comes with
    the next step of Python. Compiled code that takes no such step for another ``GRACE_S`` ends its process, if that is
    a worker of a parent process; in other processes it goes on.

    Example:
        >>> with time_limit(10.0):
        ...     1 + 1
        2
    """
    by_signal = threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")
    with _by_signal(seconds) if by_signal else _by_watch(seconds):
        yield


@contextmanager
def _by_signal(seconds: float) -> Iterator[None]:
    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise TimeUp

    before = signal.signal(signal.SIGALRM, end)
    left, again = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        rest, _ = signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if left > 0.0:  # somebody else's timer goes on
            signal.setitimer(signal.ITIMER_REAL, max(left - (seconds - rest), 1e-6), again)


@contextmanager
def _by_watch(seconds: float) -> Iterator[None]:
    work = ctypes.c_ulong(threading.get_ident())
    done, one = threading.Event(), threading.Lock()

    def watch() -> None:
        if done.wait(seconds):
            return
        with one:
            if done.is_set():
                return
            ctypes.pythonapi.PyThreadState_SetAsyncExc(work, ctypes.py_object(TimeUp))
        if multiprocessing.parent_process() is not None and not done.wait(GRACE_S):
            _exit(_ENDED)

    threading.Thread(target=watch, name="time limit", daemon=True).start()
    try:
        yield
    finally:
        while not done.is_set():  # the exception may come as late as here
            try:
                with one:
                    done.set()
                ctypes.pythonapi.PyThreadState_SetAsyncExc(work, None)
            except TimeUp:
                continue
