"""A page and what belongs to it are written beside the old ones and moved into place together."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Generator
from pathlib import Path

from testbench.core.errors import RecordError
from testbench.core.files import not_written

PAGE = "report.html"
UNFINISHED = "unfinished"
"""Folder within a folder of results in which the next page is made; what a killed process left there is taken away."""
OF_ONE_PAGE = ("tables", "figures", "models", "cards")
"""Folders that belong to the page: replaced whole, so that nothing of an older run stands beside a newer one."""
_OLD = "old"


@contextlib.contextmanager
def written_beside(folder: Path) -> Generator[Path, None, None]:
    """Give a folder to write a page into; once the block has ended, move what is there into ``folder``.

    The old page is taken away first and the new one comes last. A process that is killed in between leaves no page,
    never one that belongs to other tables. If the block fails, ``folder`` is as it was.

    Raises:
        RecordError: ``folder`` cannot be written to, or a symbolic link in it leads out of it.
    """
    part = folder / UNFINISHED
    try:
        take_away(part)
        part.mkdir(parents=True)
        yield part
        made = sorted((p for p in part.rglob("*") if not p.is_dir()), key=lambda p: (p == part / PAGE, p))
        moves = [(path, folder / path.relative_to(part)) for path in made]
        for _, there in moves:
            if there.relative_to(folder).parts[0] not in OF_ONE_PAGE:
                within(folder, there)
        (folder / PAGE).unlink(missing_ok=True)
        for name in OF_ONE_PAGE:
            _retire(folder / name, part)
        for path, there in moves:
            there.parent.mkdir(parents=True, exist_ok=True)
            path.replace(there)
    except OSError as error:
        raise not_written(folder, error) from error
    finally:
        with contextlib.suppress(OSError):
            take_away(part)


def within(folder: Path, path: Path) -> Path:
    """Return ``path``, which must lie in ``folder`` once links are followed; its last part may itself be a link.

    Raises:
        RecordError: a symbolic link leads out of the folder.
    """
    parent = path.parent.resolve()
    if not parent.is_relative_to(folder.resolve()):
        raise RecordError(
            f"results must stay in their folder '{folder}', got '{path.parent}', a symbolic link to '{parent}'; remove "
            "the link, or give another folder with --out"
        )
    return path


def take_away(path: Path) -> None:
    """Remove a file, a folder with all in it, or a link but not what it leads to; if there is none, do nothing."""
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.exists():
        shutil.rmtree(path)


def _retire(path: Path, part: Path) -> None:
    """Move what an older page wrote out of the way in one step; it goes with ``part``."""
    if path.is_symlink() or path.exists():
        (part / _OLD).mkdir(exist_ok=True)
        path.replace(part / _OLD / path.name)
