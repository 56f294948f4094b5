"""What the server of worker processes has loaded first: a worker whose campaign ends as it begins says nothing."""

from __future__ import annotations

import sys
from types import TracebackType


def _unsaid(kind: type[BaseException], error: BaseException, at: TracebackType | None) -> None:
    """Say what went wrong by a traceback, unless it is an interrupt, or what a new process was to be handed is gone."""
    if not issubclass(kind, OSError | EOFError | KeyboardInterrupt):
        sys.__excepthook__(kind, error, at)


sys.excepthook = _unsaid
