"""Folders for what a process writes for itself, and the removal of those that killed processes left behind."""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import tempfile
import time
import weakref
from functools import lru_cache
from pathlib import Path

from testbench.core.errors import DiskError
from testbench.core.interrupts import held_back

try:
    import fcntl
except ImportError:  # not on Windows: there what a killed process leaves stays, as it did before
    fcntl = None  # type: ignore[assignment]

_FIX = "free space, or set TMPDIR to a folder that can be written to"
_PREFIX = "testbench_run-"
_YOUNG_S = 60.0  # a folder may not be locked yet by the process that has just made it


def temporary() -> str:
    """Return the folder for temporary files.

    Raises:
        DiskError: none can be written to.
    """
    try:
        return tempfile.gettempdir()
    except FileNotFoundError as error:  # Python writes a file into each that it knows, and found no room
        raise DiskError(
            f"the disk must have room for '{os.environ.get('TMPDIR', '/tmp')}', got: {error}; {_FIX}"
        ) from error


class Scratch:
    """A folder of its own that is removed with this object, by the process that made it: forked ones leave it be.

    All folders of a process lie in one, which the process, and those that it forks, hold locked for as long as they
    live. A folder that nobody holds locked was left by a process that was killed; it is removed when the next one
    begins.

    Raises:
        DiskError: no folder for temporary files can be written to.
    """

    def __init__(self) -> None:
        self.name = tempfile.mkdtemp(dir=_of_process(os.getpid(), temporary()))
        self._removal = weakref.finalize(self, _remove, self.name, os.getpid())

    def remove(self) -> None:
        """Remove the folder now: an interrupt would vanish in what runs when an object is collected."""
        with held_back():
            self._removal()


@lru_cache(maxsize=1)
def _of_process(process: int, place: str) -> str:
    """Return the locked folder of a process in ``place``, made anew after a fork or if temporary files go elsewhere."""
    _sweep(Path(place))
    name = tempfile.mkdtemp(prefix=_PREFIX, dir=place)
    _locked(Path(name))
    atexit.register(_remove, name, process)
    return name


def _remove(name: str, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(name, ignore_errors=True)


def _locked(folder: Path) -> int | None:
    """Return a descriptor that holds the lock of a folder until it is closed; None if another process holds it."""
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _sweep(place: Path) -> None:
    """Remove the folders that nobody holds locked; those of other users cannot be opened and stay."""
    for folder in place.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):  # another process sweeps, too, or it is another user's
            if time.time() - folder.stat().st_mtime < _YOUNG_S:
                continue
            descriptor = _locked(folder)
            if descriptor is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(descriptor)
