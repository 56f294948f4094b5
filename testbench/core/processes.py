"""Work spread over several processes when cores are free: the same results, sooner.

Processes are forked, so that they know all that their parent knows at no cost. Threads would wait for one another,
because JSBSim keeps the interpreter's lock. If a system cannot fork, or one process is asked for, all work is done in
turn.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Generator, Hashable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, current_process, get_context
from types import TracebackType
from typing import Any, Self, TypeVar

from testbench.core.errors import EstimationError
from testbench.core.files import Scratch
from testbench.core.interrupts import held_back, leave_to_the_system

T = TypeVar("T")
_CRASHES = frozenset({signal.SIGSEGV, signal.SIGABRT, signal.SIGILL, signal.SIGFPE, getattr(signal, "SIGBUS", 0)})
_PROCESSES: ContextVar[int] = ContextVar("processes", default=1)
_CONTEXT: Any = get_context("fork" if sys.platform == "linux" else "spawn")


@contextlib.contextmanager
def processes(count: int) -> Generator[None, None, None]:
    """Let the work inside the block use ``count`` processes; 1, the default, does everything in this one."""
    token = _PROCESSES.set(count if sys.platform == "linux" and not current_process().daemon else 1)
    try:
        yield
    finally:
        _PROCESSES.reset(token)


def cores() -> int:
    """Return how many processor cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Child:
    """A process of ours, our end of the pipe to it, and the folder of what it writes, which goes with it."""

    process: Any
    pipe: connection.Connection
    folder: Scratch

    @classmethod
    def start(cls, work: Callable[[connection.Connection], None]) -> Self:
        """Start a process that does ``work`` with its end of the pipe; where none is forked, it is sent by pickle.

        Raises:
            OSError: the machine starts no process.
        """
        mine, theirs = _CONTEXT.Pipe()
        folder = Scratch()
        process = _CONTEXT.Process(target=_begin, args=(work, mine, theirs, folder.name), daemon=True)
        with held_back():  # after a fork Python calls back what modules registered, where an interrupt would vanish
            process.start()
        theirs.close()
        return cls(process, mine, folder)

    def end(self) -> None:
        """Wait for its end, and remove what is left of it."""
        self.pipe.close()
        self.process.join()
        self.folder.remove()

    def kill(self) -> None:
        """End it now."""
        self.process.kill()
        self.end()


class Ahead:
    """Tasks that begin before their results are asked for.

    A task must change nothing that is used later: what it does to objects stays in its process.
    """

    def __init__(self) -> None:
        self.most = _PROCESSES.get()
        self._running: dict[Hashable, Child] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        while self._running:
            self._running.popitem()[1].kill()

    def begin(self, key: Hashable, task: Callable[[], Any]) -> None:
        """Begin a task, unless it is running or all work is to be done in turn."""
        if self.most > 1 and key not in self._running:
            self._running[key] = Child.start(partial(_answer, task))

    def take(self, key: Hashable, task: Callable[[], T]) -> T:
        """Return the result of a task, begun before under the same key or done here and now.

        Raises:
            whatever the task raises.
        """
        running = self._running.pop(key, None)
        if running is None:
            return task()
        try:
            done, result = running.pipe.recv()
        except (EOFError, OSError):  # it was ended from outside, for want of memory, or its answer cannot be sent
            running.end()
            if -(running.process.exitcode or 0) in _CRASHES:  # here it would end all
                raise EstimationError(f"'{key}' must end with a result, but {ended(running.process)}") from None
            return task()
        except BaseException:
            running.kill()  # it may wait to answer: a process forked later holds the other end, too
            raise
        running.end()
        if not done:
            raise result
        return result


def apart(task: Callable[[], T], what: str, limit_s: float) -> T:
    """Return the result of a task in a process of its own, so that it can neither end this one nor keep it for ever.

    Where a system cannot fork, it is done here.

    Args:
        task: its result must be such that it can be pickled.
        what: it is, to begin a message.
        limit_s: of the clock, s.

    Raises:
        EstimationError: it took longer, or its process ended.
        whatever the task raises.
    """
    if sys.platform != "linux" or current_process().daemon:
        return task()
    with processes(2), Ahead() as ahead:
        ahead.begin(what, task)
        running = ahead._running[what]
        if not running.pipe.poll(limit_s):
            raise EstimationError(f"{what} must end within {limit_s:g} s, got no end by then")
        try:
            done, result = running.pipe.recv()
        except (EOFError, OSError):
            running.process.join()
            raise EstimationError(f"{what} must end with a result, but {ended(running.process)}") from None
    if not done:
        raise result
    found: T = result
    return found


def ended(process: Any) -> str:
    """Return in words how a process ended that gave no answer."""
    code = process.exitcode
    if not code or code > 0:
        return f"its process ended with status {code}"
    return f"its process was ended by {signal.Signals(-code).name}: compiled code that crashes, or too little memory"


def spread(tasks: Sequence[Callable[[], T]], done: Callable[[int], None] = lambda number: None) -> list[T]:
    """Return the results of tasks that do not depend on one another, dealt to the processes in turn.

    ``done`` is called with about the number that is done, as this process ends each of its own.
    """
    count = max(1, min(_PROCESSES.get(), len(tasks)))

    def share(first: int) -> Callable[[], list[T]]:
        def results() -> list[T]:
            out = []
            for k, task in enumerate(tasks[first::count], 1):
                out.append(task())
                if not first:
                    done(min(k * count, len(tasks)))
            return out

        return results

    if count == 1:
        return share(0)()

    out: list[Any] = [None] * len(tasks)
    with Ahead() as ahead:
        for first in range(1, count):
            ahead.begin(first, share(first))
        for first in range(count):  # the first share is this process's own
            out[first::count] = ahead.take(first, share(first))
    return out


def _begin(work: Callable[[Any], None], mine: connection.Connection, theirs: connection.Connection, name: str) -> None:
    leave_to_the_system()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is the parent's to handle: it ends this one
    mine.close()
    _PROCESSES.set(1)
    tempfile.tempdir = name
    work(theirs)


def answer_to(task: Callable[[], Any]) -> tuple[bool, Any]:
    """Return (True, the result of a task), or (False, what it raised)."""
    try:
        return True, task()
    except Exception as error:
        return False, error


def _answer(task: Callable[[], Any], pipe: connection.Connection) -> None:
    # Without an answer, as it cannot be sent or whoever waited is gone, the work is done there.
    with contextlib.suppress(Exception):
        pipe.send(answer_to(task))
