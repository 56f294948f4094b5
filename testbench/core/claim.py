"""One writer per folder of results: the second process that would write into it is refused.

The system locks the folder itself, so that nothing is written for it and a process that ends, however it does, gives
it back. Another machine's processes are not seen. Where a system cannot lock folders, nobody is refused.
"""

from __future__ import annotations

import contextlib
import os
from collections import OrderedDict
from pathlib import Path

from testbench.core.errors import BusyError

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

_LOCKS = Path("/proc/locks")
_MOST = 64  # folders held at once; a program that writes into more gives the oldest back
_HELD: OrderedDict[tuple[int, int], int] = OrderedDict()


def claim(folder: Path) -> None:
    """Hold a folder until the process ends; it is made if it is missing. Doing so twice does no harm.

    Raises:
        BusyError: another process holds it.
        OSError: it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if fcntl is None:
        return
    descriptor = os.open(folder, os.O_RDONLY)
    found = os.fstat(descriptor)
    key = (found.st_dev, found.st_ino)
    if key in _HELD:
        os.close(descriptor)
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise BusyError(
            f"a folder of results takes one writer at a time, but {_holder(found)} is writing to '{folder}'; wait for "
            "it, or give another folder with --out"
        ) from error
    except OSError:  # a file system without locks
        os.close(descriptor)
        return
    _HELD[key] = descriptor
    if len(_HELD) > _MOST:
        os.close(_HELD.popitem(last=False)[1])


def _holder(found: os.stat_result) -> str:
    """Return the process that holds the lock, in words; Linux lists them with the numbers of their files."""
    with contextlib.suppress(OSError, ValueError):
        for line in _LOCKS.read_text(encoding="ascii").splitlines():
            words = line.split()
            if "FLOCK" in words and "->" not in words:
                major, minor, inode = words[5].split(":")
                if (os.makedev(int(major, 16), int(minor, 16)), int(inode)) == (found.st_dev, found.st_ino):
                    return f"process {words[4]}"
    return "another process"
