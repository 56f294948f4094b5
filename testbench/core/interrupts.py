"""Interrupts (Ctrl-C) are held back where foreign code would lose them."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Generator
from typing import Any


@contextlib.contextmanager
def held_back() -> Generator[None, None, None]:
    """Let an interrupt act once the block has ended, in which C++ calls Python: there it would vanish, or crash.

    Only the main thread of a process receives signals; elsewhere nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[tuple[int, Any]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(*came[0])
