"""Signals that end the work: Ctrl-C, and what a system sends; both are held back where foreign code would lose them."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Generator
from typing import Any

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
                signal.raise_signal(signal.SIGINT)

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
    """Let signals end the process at once, as they end one that knows nothing of them."""
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
