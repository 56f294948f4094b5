"""Processes that are killed at one of their changes of the disk, and what they leave."""

import os
import signal
import traceback
from collections.abc import Callable
from pathlib import Path

from testbench.core.store import OWN, entry_of, manifest_of


def killed_at(step: int, action: Callable[[], object]) -> bool:
    """Run an action in a process of its own that is killed at a change of the disk; False if it ends before."""
    pid = os.fork()
    if not pid:
        done = 0

        def counted(old):
            def change(self, *given, **more):
                nonlocal done
                done += 1
                if done == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return old(self, *given, **more)

            return change

        for name in ("replace", "unlink", "mkdir", "rmdir"):
            setattr(Path, name, counted(getattr(Path, name)))
        try:
            action()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    _, status = os.waitpid(pid, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return os.WIFSIGNALED(status)


def shown(folder: Path) -> set[str]:
    """Return the files that a user sees in a folder, once what was interrupted is settled."""
    manifest_of(folder)
    paths = [p.relative_to(folder) for p in folder.rglob("*") if p.is_file()]
    return {path.as_posix() for path in paths if OWN not in path.parts}


def whole(folder: Path) -> bool:
    """Say whether all that a folder's manifest lists lies there as it was written."""
    manifest = manifest_of(folder)
    return manifest is not None and all(
        entry is None or entry_of(folder / name) == entry for name, entry in manifest.files.items()
    )
