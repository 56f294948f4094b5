"""One writer per store: a lock that says who holds it and that a killed process cannot leave behind."""

from __future__ import annotations

import json
import os
import socket
import sys
from pathlib import Path
from typing import Any

from testbench.core.errors import CampaignError


class WriterLock:
    """A lock file beside the store, locked by the operating system while its owner lives, with pid and host inside.

    The system frees it when the process ends, however it ends, so that a lock left behind on this machine is taken
    over. On another machine's word nothing can be known of that process: its lock is refused until the file is deleted.

    Args:
        path: the lock file.

    Raises:
        CampaignError: another process writes to the store.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            self._acquire()
        except CampaignError:
            os.close(self._descriptor)
            raise

    def _acquire(self) -> None:
        owned = _try_lock(self._descriptor)
        owner = self._owner()
        here = socket.gethostname()
        if not owned:
            raise CampaignError(
                f"a campaign's store takes one writer at a time, but process {owner.get('pid', '?')} on "
                f"{owner.get('host', '?')} is writing to '{self.path.parent}'; wait for it, or end it"
            )
        if owner.get("host", here) != here:
            _unlock(self._descriptor)
            raise CampaignError(
                f"a campaign's store takes one writer at a time, but process {owner.get('pid', '?')} on "
                f"{owner['host']} has not given it back; if that process is gone, delete '{self.path}'"
            )
        self._write(json.dumps({"pid": os.getpid(), "host": here}))

    def _owner(self) -> dict[str, Any]:
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        try:
            owner = json.loads(os.read(self._descriptor, 4096) or b"{}")
        except ValueError:  # a writer killed while it wrote its name
            return {}
        return owner if isinstance(owner, dict) else {}

    def _write(self, text: str) -> None:
        os.ftruncate(self._descriptor, 0)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, text.encode())

    def release(self) -> None:
        """Give the lock back; doing so twice does no harm."""
        if self._descriptor >= 0:
            self._write("")
            _unlock(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = -1


if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30  # beyond the text, which others must be able to read

    def _try_lock(descriptor: int) -> bool:
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _try_lock(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def _unlock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_UN)
