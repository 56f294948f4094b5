"""Interrupts (Ctrl-C, and SIGTERM as one) are held back where foreign code would lose them."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Generator
from typing import Any

_BOTH = (signal.SIGINT, signal.SIGTERM)


def heed_sigterm() -> None:
    """Let SIGTERM interrupt this process as Ctrl-C does, so that it leaves folders of results as they were."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextlib.contextmanager
def held_back() -> Generator[None, None, None]:
    """Let an interrupt act once the block has ended, in which C++ calls Python: there it would vanish, or crash.

    Only the main thread of a process receives signals; elsewhere nothing changes.
    """
    before = {number: signal.getsignal(number) for number in _BOTH}
    held = {number: handler for number, handler in before.items() if callable(handler)}
    if threading.current_thread() is not threading.main_thread():
        held = {}
    came: list[tuple[int, Any]] = []
    for number in held:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)
        if came:
            held[signal.Signals(came[0][0])](*came[0])
