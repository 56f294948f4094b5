"""Signals that end the work: Ctrl-C, and what a system sends; both are held back where foreign code would lose them.

A limit on how long a piece of work may take, for work that we did not write and that may never end.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import signal
import sys
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from os import _exit
from types import FrameType
from typing import Any, NoReturn

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


_ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextlib.contextmanager
def ended_by_signals() -> Generator[list[int], None, None]:
    """Let SIGTERM and SIGHUP end the block as Ctrl-C does, so that what keeps results then keeps them now, too.

    The list that is given holds the signals that came: libraries turn the exception into others. A signal that the
    user or a program took is left to them. What a library cannot pass on, as from a half-made object that is removed,
    is not shown; an interrupt among that comes again.
    """
    came: list[int] = []
    over, once = threading.Event(), threading.Lock()

    def end(number: int, frame: Any) -> None:
        came.append(number)
        if not over.is_set():
            raise KeyboardInterrupt

    def again() -> None:
        with once:
            if not over.is_set():
                # A process in the background of a shell ignores SIGINT: the signal that came comes again.
                signal.raise_signal(came[-1] if came else signal.SIGINT)

    def unheard(said: Any) -> None:
        if isinstance(said.exc_value, KeyboardInterrupt):
            threading.Timer(0.02, again).start()

    here = threading.current_thread() is threading.main_thread()
    ours = [n for n in _ENDING if here and signal.getsignal(n) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, end)
    before, sys.unraisablehook = sys.unraisablehook, unheard
    try:
        yield came
    finally:
        while not over.is_set():
            # What comes now finds the block at its end: it ends nothing twice, and is in the list if it is not Ctrl-C.
            with contextlib.suppress(KeyboardInterrupt), once:
                over.set()
        sys.unraisablehook = before
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def leave_to_the_system() -> None:
    """Let signals end the process at once, as they end one that knows nothing of them; those that came are over.

    An interrupt that passed through ``exec`` of a text, as modules are imported that make classes so, would end Python
    by SIGINT, whatever its status, unless another text is run (CPython's pythonrun.c).
    """
    exec("")
    for number in (signal.SIGINT, *_ENDING):
        signal.signal(number, signal.SIG_DFL)


def handled() -> dict[int, Any]:
    """Return the signals that end a command -> their handlers in Python; none outside of the main thread."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    handlers: dict[int, Any] = {n: signal.getsignal(n) for n in (signal.SIGINT, *_ENDING)}
    return {n: handler for n, handler in handlers.items() if callable(handler)}


@contextlib.contextmanager
def held_back() -> Generator[None, None, None]:
    """Let signals act once the block has ended, in which C++ calls Python: there they would vanish, or crash.

    Only the main thread of a process receives signals; elsewhere nothing changes.
    """
    before = handled()
    if not before:
        yield
        return
    came: list[tuple[int, Any]] = []
    for number in before:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            before[came[0][0]](*came[0])
