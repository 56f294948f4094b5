"""One writer per store: a lock that says who holds it and that a killed process cannot leave behind."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from testbench.core.door import read_bytes
from testbench.core.errors import CampaignError, RecordError
from testbench.core.files import not_written


class WriterLock:
    """A lock file beside the store, locked by the operating system while its owner lives, with pid and host inside.

    The system frees it when the process ends, however it ends, so that a lock left behind on this machine is taken
    over. Of a process on another machine nothing can be known: its lock is refused until the file is deleted.

    Args:
        path: the lock file.

    Raises:
        CampaignError: another process writes to the store.
        RecordError: the disk is full, or the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path)
        here = socket.gethostname()
        try:
            self._lock.acquire(blocking=False)
        except Timeout as error:
            owner = self._owner()
            raise CampaignError(
                f"a campaign's store takes one writer at a time, but process {owner.get('pid', '?')} on "
                f"{owner.get('host', '?')} is writing to '{path.parent}'; wait for it, or end it"
            ) from error
        owner = self._owner()
        if owner.get("host", here) != here:
            self._lock.release()
            raise CampaignError(
                f"a campaign's store takes one writer at a time, but process {owner.get('pid', '?')} on "
                f"{owner['host']} has not given it back; if that process is gone, delete '{path}'"
            )
        try:
            path.write_text(json.dumps({"pid": os.getpid(), "host": here}), encoding="utf-8")
        except OSError as error:
            self._lock.release()
            raise not_written(path, error) from error

    def _owner(self) -> dict[str, Any]:
        try:
            owner = json.loads(read_bytes(self.path, "text") or b"{}")
        except (RecordError, ValueError):  # locked, or a writer was killed as it wrote its name
            return {}
        return owner if isinstance(owner, dict) else {}

    def release(self) -> None:
        """Give the lock back; doing so twice does no harm."""
        if self._lock.is_locked:
            self.path.write_text("", encoding="utf-8")
            self._lock.release()
