"""A command as a process that is begun in given surroundings, stopped at a given moment, and seen to its end.

Most are forked from a process that has imported everything: a trial then takes what the command takes, not the seconds
of imports. Fresh ones begin as a user's do.
"""

import atexit
import contextlib
import ctypes
import fcntl
import importlib
import locale
import os
import resource
import select
import signal
import struct
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from clock import since

import testbench

ROOT = Path(testbench.__file__).parents[1]
LONGEST_S = 300.0  # of processor, of what takes seconds
IDLE_S, WORK_S = 60.0, 0.2  # by the clock, and of processor: who does less in that time waits for what never comes
STREAMS = ("<&-", ">&-", "2>&-", ">/dev/full", "2>/dev/full", "| true")
"""What a shell does to a stream of a command."""
_LIBC, _CAPABILITIES, _SUBREAPER = ctypes.CDLL(None), 0x20080522, 36  # version 3 of capset; an option of prctl
_AT_ONCE = 1 << 20  # bytes that a pipe holds, so that nobody has to read while the command runs


@dataclass(frozen=True)
class Around:
    """The surroundings of a process.

    Attributes:
        streams: of STREAMS.
        bytes: of the largest file that it may write; a full disk fails in the same calls.
        plain: it has no rights beyond those that files give it, as any user but root.
        gone: its working directory has been removed.
        environment: beside that of this process.
        fresh: a Python of its own, not a fork.
        prepare: called in the process before the command.
    """

    streams: tuple[str, ...] = ()
    bytes: int | None = None
    plain: bool = False
    gone: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)
    fresh: bool = False
    prepare: Callable[[], object] | None = None


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    Attributes:
        status: as a shell says it, 128 and the signal's number if one ended it; None if it had to be ended as it hung.
        out, err: what it wrote.
        took_s: by the clock.
        cpu_s: of processor, its own and that of processes it waited for.
        orphans: processes below it that lived on.
    """

    status: int | None
    out: str
    err: str
    took_s: float
    cpu_s: float
    orphans: bool


class Running:
    """A process that runs ``testbench WORDS`` in a folder, as the head of a group of processes of its own."""

    def __init__(self, words: Sequence[str], place: Path, around: Around = Around(), module: str = "testbench") -> None:
        _LIBC.prctl(_SUBREAPER, 1, 0, 0, 0)  # processes whose parent was killed are waited for here
        ready, begun = os.pipe()
        pipes = [os.pipe() for _ in range(2)]
        for reading, writing in pipes:
            fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, _AT_ONCE)
            os.set_blocking(reading, False)
        sys.stdout.flush(), sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            for reading, _ in pipes:
                os.close(reading)
            _be(words, place, around, module, [pipes[0][1], pipes[1][1]], begun)
        os.close(begun)
        for _, writing in pipes:
            os.close(writing)
        self._pipes = [reading for reading, _ in pipes]
        self._end = os.pidfd_open(self.pid)
        os.read(ready, 1)
        os.close(ready)
        self.start = time.monotonic()

    def wait(self, seconds: float) -> bool:
        """Wait for so long at most; return whether it has ended."""
        return bool(select.select([self._end], [], [], max(0.0, seconds))[0])

    def wait_for_files(self, folder: Path, count: int, seconds: float) -> bool:
        """Wait until ``count`` files more than now lie below a folder; return whether it has ended before."""
        due, wanted = time.monotonic() + seconds, _files(folder) + count
        while not self.wait(0.001):
            if _files(folder) >= wanted:
                return False
            if time.monotonic() > due:
                return self.wait(0.0)
        return True

    def send(self, number: int, whom: str = "it") -> None:
        """Send a signal to it, to one process below it ("worker"), or to all of its group ("everything")."""
        with contextlib.suppress(ProcessLookupError):
            if whom == "everything":
                os.killpg(self.pid, number)
                return
            below = _below(self.pid) if whom == "worker" else []
            os.kill(below[len(below) // 2] if below else self.pid, number)

    def ended(self, patience_s: float = 5.0) -> Ended:
        """Wait for its end, ending it if it hangs, and return how it ended.

        It hangs if it works without end, or not at all: how long it takes by the clock says nothing where other work
        has the machine.

        Args:
            patience_s: that processes below it may live on.
        """
        used = 0.0
        while not (over := self.wait(IDLE_S)):
            before, used = used, _processor_s(self.pid)
            if used - before < WORK_S or used > LONGEST_S:
                break
        hung = not over
        if hung:
            self.send(signal.SIGKILL, "everything")
        _, status, usage = os.wait4(self.pid, 0)
        took, code = since(self.start, time.monotonic), os.waitstatus_to_exitcode(status)
        os.close(self._end)
        orphans = not _gone(self.pid, patience_s)
        if orphans:
            self.send(signal.SIGKILL, "everything")
            _gone(self.pid, 5.0)
        texts = [_drained(pipe) for pipe in self._pipes]
        shell = None if hung else code if code >= 0 else 128 - code
        return Ended(shell, *texts, took, usage.ru_utime + usage.ru_stime, orphans)


def _files(folder: Path) -> int:
    return sum(len(files) for _, _, files in os.walk(folder))


def _processor_s(group: int) -> float:
    """Return the processor time of the processes of a group, and of those that they have waited for."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            words = stat.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            if int(words[2]) == group:
                ticks += sum(map(int, words[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


def _below(process: int) -> list[int]:
    """Return the processes below one, as /proc lists them."""
    out: list[int] = []
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split():
            out += [int(child), *_below(int(child))]
    return out


def _gone(group: int, seconds: float) -> bool:
    """Wait for the end of all processes of a group; return whether they ended in time."""
    due = time.monotonic() + seconds
    while True:
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-group, os.WNOHANG)[0]:
                pass
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        if time.monotonic() > due:
            return False
        time.sleep(0.01)


def _drained(pipe: int) -> str:
    parts = []
    with contextlib.suppress(BlockingIOError):
        while part := os.read(pipe, _AT_ONCE):
            parts.append(part)
    os.close(pipe)
    return b"".join(parts).decode("utf-8", "replace")


def _be(words: Sequence[str], place: Path, around: Around, module: str, pipes: list[int], begun: int) -> None:
    """Become the command; this never returns."""
    status = 99
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.chdir(place)
        os.environ.update({"COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1", **around.environment})
        if around.gone:
            away = tempfile.mkdtemp()
            os.chdir(away)
            os.rmdir(away)
        _plug(around.streams, pipes)
        if around.bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (around.bytes, around.bytes))
        if around.plain:
            _LIBC.capset(struct.pack("Ii", _CAPABILITIES, 0), bytes(24))
        if around.fresh:
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
            os.environ["PYTHONPATH"] = f"{ROOT}{os.pathsep}{ROOT / 'tests'}"
            os.set_inheritable(begun, False)  # closed as Python begins
            begin = ["-m", module]
            if around.prepare is not None:
                first = f"from {around.prepare.__module__} import {around.prepare.__name__} as prepare; prepare()"
                begin = ["-c", f"{first}; from testbench.__main__ import main; main()"]
            os.execv(sys.executable, [sys.executable, *begin, *words])
        _as_python_begins(around)
        if around.prepare is not None:
            around.prepare()
        main = sys.modules["__main__"] = importlib.import_module(f"{module}.__main__")  # which spawned workers import
        sys.argv = [module, *words]
        os.write(begun, b".")
        os.close(begun)
        status = _called(main.main)
    finally:
        os._exit(status)


def _plug(streams: Sequence[str], pipes: list[int]) -> None:
    """Do to the three streams what a shell does; what stays open is read by the one that began the process."""
    with contextlib.ExitStack() as later:
        null = os.open(os.devnull, os.O_RDONLY)
        full = os.open("/dev/full", os.O_WRONLY)
        reading, unread = os.pipe()
        os.close(reading)
        ends = {0: null, 1: pipes[0], 2: pipes[1]}
        ends |= {int(s[0] == "2") + 1: full for s in streams if s.endswith("full")}
        if "| true" in streams:
            ends[1] = unread
        for number, end in ends.items():
            os.dup2(end, number)
        for end in {null, full, unread, *pipes}:
            later.callback(os.close, end)
    for stream in streams:
        if stream.endswith("&-"):
            os.close({"<": 0, ">": 1, "2": 2}[stream[0]])


def _as_python_begins(around: Around) -> None:
    """Make the streams, the time zone and the locale anew, as Python does at its start."""
    for name, number in (("stdin", 0), ("stdout", 1), ("stderr", 2)):
        try:
            os.fstat(number)
        except OSError:
            stream = None
        else:
            stream = open(number, "w" if number else "r", encoding="utf-8", closefd=False)  # noqa: SIM115
            if number == 2:
                stream.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    tempfile.tempdir = None
    time.tzset()
    if "LC_ALL" in around.environment:
        with contextlib.suppress(locale.Error):
            locale.setlocale(locale.LC_ALL, "")


def _called(main: Callable[[], object]) -> int:
    """Call the command and end as Python ends."""
    status = 0
    try:
        status = int(main() or 0)  # type: ignore[call-overload]
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException as error:
        traceback.print_exc()
        status = 130 if isinstance(error, KeyboardInterrupt) else 1
    with contextlib.suppress(BaseException):
        threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except OSError:
        return 120
    return status
