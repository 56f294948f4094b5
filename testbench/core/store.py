"""Folders that the testbench writes: claimed before the first byte, built aside, swapped whole, with a manifest.

Each has a hidden folder, :data:`OWN`, with its lock, its manifest and what is unfinished. The manifest lists the files
that were written with size and SHA-256, the command, the version and the inputs. Only what a manifest lists is ever
replaced or deleted: a folder may hold a user's own files beside ours.

What a process that is killed leaves, step by step:

1. The folder is claimed and all is written into :attr:`ResultFolder.new`: the folder is as it was, and the next command
   that claims it takes the unfinished files away, or goes on with them.
2. The manifest of the new result is renamed to :data:`COMMIT`: from here on the new result is the one that counts.
3. The new files are moved to their places: the next command that opens the folder ends the moves, see :func:`settle`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path, PurePath, PurePosixPath
from types import TracebackType
from typing import TYPE_CHECKING, Any

from testbench.core.door import READ, read_text
from testbench.core.errors import BusyError, RecordError, WriteError
from testbench.core.files import not_written, write_file
from testbench.core.interrupts import held_back
from testbench.core.paths import AIRCRAFT_MODELS, PACKAGE, SCENARIOS, SUITES, stock_root

if TYPE_CHECKING:
    from filelock import FileLock

OWN = ".testbench"
"""The hidden folder within each folder of results."""
MANIFEST, COMMIT, LOCK, NEW = "manifest.json", "commit.json", "lock", "new"
PAGE, INDEX = "report.html", "index.html"
"""The page of a result is taken away first and put in place last: it never stands beside the tables of another."""
KEPT = ".kept"
"""Behind the name of a file that a user has changed since it was written, where a new one takes its place."""
WAIT_S = 10.0
"""Who adds a file to a folder waits this long for another writer, as one command for each file may run at once."""
_FORMAT = "testbench result 1"
_DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{k}" for port in ("com", "lpt") for k in range(1, 10))})
_NO_NAME = re.compile(r'[\x00-\x1f\x7f-\x9f\u2028\u2029\\/:*?"<>|]')
_LOCKS = Path("/proc/locks")

Entry = tuple[int, str] | None
"""Bytes and SHA-256 of a file; None for one that goes on changing (a store of runs), or that is not to be had."""


@dataclass(frozen=True)
class Manifest:
    """What a folder of results says of itself."""

    command: tuple[str, ...] = ()  # as it was typed; empty if a program wrote the folder
    version: str = ""  # of the testbench
    inputs: Mapping[str, Entry] = field(default_factory=dict)  # file that was read -> what it was then
    files: Mapping[str, Entry] = field(default_factory=dict)  # path in the folder, with "/" -> what was written
    packages: Mapping[str, str] = field(default_factory=dict)  # those that decide figures -> version
    added: tuple[str, ...] = ()  # names of the files that came beside a result, which another one does not take away

    def text(self, **more: Any) -> str:
        """Return the manifest as JSON."""
        head = {"format": _FORMAT, "command": self.command, "version": self.version, "packages": self.packages}
        lists = {"inputs": self.inputs, "files": self.files, "added": self.added}
        return json.dumps({**head, **lists, **more}, indent=1) + "\n"


def manifest_of(folder: Path | str) -> Manifest | None:
    """Return the manifest of a folder, once what was interrupted is settled; None if the testbench did not write it.

    Raises:
        RecordError: the manifest is damaged.
    """
    settle(Path(folder))
    found = _read(Path(folder) / OWN / MANIFEST)
    return None if found is None else found[0]


def folder_in(place: Path, name: str) -> Path:
    """Return the folder ``name`` in ``place``; a name comes from a file, and must not lead elsewhere.

    Raises:
        RecordError: it is not the name of one file or folder on every system: see :func:`is_plain`.
    """
    if not is_plain(name):
        raise RecordError(f"what is written must have a plain name, got {name!r}; change the name")
    return place / name


class KeptAside(UserWarning):
    """A file that the user had changed by hand was kept under another name; commands print this as a note."""


class ResultFolder:
    """A folder that this process writes, as a context manager: with the block's end the new result takes its place.

    If the block fails or is interrupted, the folder is as it was before.

    Args:
        path: the folder, which need not be there.
        resume: go on with what an interrupted command left in ``new`` instead of taking it away.
        adds: the new files come beside those of earlier commands, instead of in their place, and a writer that is
            nearly done is waited for; a pattern: only files whose names match it are replaced.
        sealed: the folder is handed out, and its manifest tells neither command nor inputs.

    Attributes:
        path: the folder.
        new: where the new result is written, each file at its place below.
        notes: sentences about a user's files that were met, once the block has ended; a command says them itself.

    Raises:
        BusyError: another process writes into it, or this one already does.
        WriteError: it cannot be written to, is no folder, or has a page that no manifest lists.
    """

    def __init__(self, path: Path | str, resume: bool = False, adds: bool | str = False, sealed: bool = False) -> None:
        self.path = Path(path)
        self.notes: list[str] = []
        self.new = self.path / OWN / NEW
        self._resume, self._adds, self._sealed = resume, adds, sealed
        self._lock: FileLock | None = None
        self._before = {} if running_command() else dict(READ)  # a program may have read much for other results
        folder_in(self.path.parent, Path(os.path.abspath(self.path)).name or "root")
        self._made = [folder for folder in (self.path, *self.path.parents) if not folder.exists()]
        try:
            within(self.path, self.path / OWN / LOCK)
            (self.path / OWN).mkdir(parents=True, exist_ok=True)
            self._lock = locked(self.path, wait_s=WAIT_S if adds else 0.0)
            _settle(self.path)
            self._old = (_read(self.path / OWN / MANIFEST) or (Manifest(), {}))[0]
            if not adds:
                self.check(PAGE)
            if not resume:
                _remove(self.new)
            self.new.mkdir(exist_ok=True)
            write_file(self.new / f".{LOCK}", "").unlink()  # a full or read-only disk shows before anything is computed
        except OSError as error:
            self.leave()
            raise not_written(self.path, error) from error
        except BaseException:
            self.leave()
            raise

    def __enter__(self) -> ResultFolder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if kind is None and self._lock is not None:
                with held_back():
                    self._commit()
        finally:
            self.leave(self._resume)
        for note in self.notes:
            warnings.warn(note, KeptAside, stacklevel=2)

    def check(self, name: str) -> None:
        """Refuse, before anything is computed, a folder in which a file of this name is not ours to replace.

        Raises:
            WriteError: the file is there and no manifest lists it.
        """
        if name not in self._old.files and os.path.lexists(self.path / name):
            raise _not_ours(self.path / name)

    def live(self, name: str) -> Path:
        """Return the place of a file or folder that is written where it lies, as a store of runs is, and list it.

        Raises:
            WriteError: something of this name is there that no manifest lists.
        """
        path = self.path / name
        if name not in self._old.files:
            self.check(name)
            self._old = replace(self._old, files={**self._old.files, name: None})
            write_file(self.path / OWN / MANIFEST, self._old.text())
        return path

    def leave(self, resume: bool = False) -> None:
        """Give the folder back as it is, also from within the block; doing so twice does no harm.

        Args:
            resume: leave what is unfinished for a command that goes on with it.
        """
        if self._lock is None:
            return
        own = self.path / OWN
        with contextlib.suppress(OSError):
            if not resume and not (own / COMMIT).exists():
                _remove(self.new)
            elif self.new.exists() and not any(self.new.iterdir()):
                self.new.rmdir()
            if {p.name for p in own.iterdir()} <= {LOCK}:  # as it was before
                _remove(own)
                for folder in self._made:
                    folder.rmdir()
        self._lock.release()
        self._lock = None

    def _commit(self) -> None:
        """Make the new result the one that counts, and move it into place.

        Raises:
            WriteError: a file would replace one that no manifest lists, or leave the folder by a link.
        """
        made = sorted(p.relative_to(self.new).as_posix() for p in self.new.rglob("*") if not p.is_dir())
        files = {name: entry_of(self.new / name) for name in made}
        old = self._old.files
        aside: list[tuple[str, str]] = []
        for name in made:
            there = within(self.path, self.path / name)
            if name in old and _changed(there, old[name]) and _changed(there, files[name]):
                aside.append((name, _free(self.path, name)))
                self.notes.append(f"'{there}' had been changed by hand; that one is kept as '{aside[-1][1]}'")
            elif name not in old and _changed(there, files[name]):
                raise _not_ours(there, self._saved(self._manifest(files)))
        pattern = self._adds if isinstance(self._adds, str) else "" if self._adds else "*"
        beside = {n for n in self._old.added if self._adds or n not in files}
        ours = {n for n, entry in old.items() if entry is not None and n not in files and fnmatchcase(n, pattern)}
        gone = ours if self._adds else ours - beside
        stale = sorted(n for n in gone if not _changed(self.path / n, old[n]))
        kept = {n: e for n, e in old.items() if n not in gone and (self._adds or (self.path / n).exists())}
        added = tuple(sorted((beside | (files.keys() - old.keys() if self._adds else set())) - gone))
        whole = replace(self._manifest(kept | files), added=added)
        write_file(self.path / OWN / COMMIT, whole.text(aside=aside, stale=stale))
        _settle(self.path)

    def _manifest(self, files: Mapping[str, Entry]) -> Manifest:
        """Return the manifest of what this process makes of what it has read."""
        from testbench import __version__

        if self._sealed:
            return Manifest((), __version__, {}, files)
        given, inputs = running_command(), self._inputs(files)
        if self._adds and self._old.files:  # what the folder is, its first command says
            given, inputs = self._old.command, {**self._old.inputs, **inputs}
        return Manifest(given, __version__, inputs, files, packages())

    def _inputs(self, files: Mapping[str, Entry]) -> dict[str, Entry]:
        """Return name -> entry of the files that were read for this result, but for its own."""
        own, new = {self.path.absolute() / name for name in files}, self.new.absolute()
        mine = {path for path in READ if path in own or path.is_relative_to(new)}
        read = {path: then for path, then in READ.items() if path not in mine and self._before.get(path) != then}
        return dict(sorted((_name_of(path), _entry_then(path, *then[:2])) for path, then in read.items()))

    def _saved(self, manifest: Manifest) -> Path:
        """Move a result that cannot take its place into a folder of its own below, so that it is not lost."""
        place = self.path / _free(self.path, "result", "")
        self.new.rename(place)
        write_file(place / OWN / MANIFEST, manifest.text())
        return place


def write_beside(path: Path, content: str | bytes | Callable[[Path], object]) -> Path:
    """Write one file that a user names beside what else is in its folder, and return its path.

    Args:
        path: the file; one that is there is replaced if the testbench wrote it.
        content: as :func:`testbench.core.files.write_file` takes it.

    Raises:
        BusyError: another process goes on writing into the folder.
        RecordError: its name is not plain.
        WriteError: the file is there and no manifest lists it, or it is not written.
    """
    with ResultFolder(path.parent, adds=True) as place:
        new = folder_in(place.new, path.name)
        place.check(path.name)
        if callable(content):
            content(new)
        else:
            write_file(new, content)
        if not new.is_file():
            raise WriteError(f"what writes '{path}' must write a file, but it wrote none")
    return path


class Unsettled(UserWarning):
    """A result was read whose files are not all in place; commands print this as a note."""


def settle(path: Path) -> Path:
    """Return ``path``, once the result that it is, or lies in, has all its files in place.

    A process that was killed while it moved them left that to whoever reads: the door of files settles what each lies
    in, the command line what its arguments name, and who lists a folder does so first. What cannot be written to is
    read as it is, with a warning.

    Raises:
        RecordError: a commit is damaged.
    """
    whole = path.absolute()
    for folder in () if OWN in whole.parts else (whole, *whole.parents):
        if not os.path.exists(folder / OWN / COMMIT):
            continue
        with contextlib.suppress(BusyError):  # its writer is at it
            try:
                lock = locked(folder)
                try:
                    _settle(folder)
                finally:
                    lock.release()
            except (OSError, WriteError) as error:
                why = f"the result in '{folder}' is not all in place, which a folder that can be written to would mend"
                warnings.warn(f"{why}; it is read as it is: {error}", Unsettled, stacklevel=2)
    return path


def _settle(folder: Path) -> None:
    own = folder / OWN
    found = _read(own / COMMIT)
    if found is None:
        return
    manifest, more = found
    new = own / NEW
    try:
        for name, kept in more["aside"]:
            if (new / name).exists() and (folder / name).exists() and not (folder / kept).exists():
                (folder / name).replace(folder / kept)
        for page in (PAGE, INDEX):
            if (new / page).exists():
                (folder / page).unlink(missing_ok=True)
        for name in sorted(more["stale"], key=lambda name: (name not in (PAGE, INDEX), name)):
            (folder / name).unlink(missing_ok=True)
            for above in list(PurePosixPath(name).parents)[:-1]:
                with contextlib.suppress(OSError):  # not empty: a user's files
                    (folder / above).rmdir()
        for name in sorted(manifest.files, key=lambda name: (name in (PAGE, INDEX), name)):
            if (new / name).exists():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (new / name).replace(folder / name)
        write_file(own / MANIFEST, manifest.text())
        (own / COMMIT).unlink()
        _remove(new)
    except OSError as error:
        raise not_written(folder, error) from error


def within(folder: Path, path: Path) -> Path:
    """Return ``path``, whose folder must lie in ``folder`` once links are followed.

    Raises:
        WriteError: a symbolic link leads out of the folder.
    """
    parent = path.parent.resolve()
    if not parent.is_relative_to(folder.resolve()):
        raise WriteError(
            f"results must stay in their folder '{folder}', got '{path.parent}', a symbolic link to '{parent}'; remove "
            "the link, or give another folder with --out"
        )
    return path


def entry_of(path: Path) -> Entry:
    """Return size and SHA-256 of a file; None if it cannot be read, or is a pipe or a device."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return file.tell(), digest
    except OSError:
        return None


def _changed(path: Path, entry: Entry) -> bool:
    """Say whether a file is there and not what was written."""
    return entry is not None and os.path.lexists(path) and (path.is_symlink() or entry_of(path) != entry)


def _free(folder: Path, name: str, end: str = KEPT) -> str:
    """Return the first name in a folder that nothing has: ``name`` with ``end``, then with a number behind."""
    found, k = f"{name}{end}", 2
    while os.path.lexists(folder / found):
        found, k = f"{name}{end}_{k}", k + 1
    return found


def _not_ours(path: Path, saved: Path | None = None) -> WriteError:
    where = "" if saved is None else f"the new result is in '{saved}'; "
    return WriteError(
        f"only files that the testbench wrote are replaced, but no manifest lists '{path}'; {where}move it away, or "
        "give another folder"
    )


def is_plain(name: str) -> bool:
    """Return whether a name is that of one file on every system: no path, line end, device of Windows or last dot."""
    device = name.split(".")[0].strip().lower() in _DEVICES
    whole = name == PurePath(name).name and name == name.rstrip(". ") and not _NO_NAME.search(name)
    return bool(name.strip()) and whole and not device


def is_fresh(folder: Path) -> bool:
    """Return whether a folder is not there, or holds nothing but what an interrupted command left."""
    if not os.path.lexists(folder):
        return True
    return folder.is_dir() and manifest_of(folder) is None and all(path.name == OWN for path in folder.iterdir())


def _read(path: Path) -> tuple[Manifest, dict[str, Any]] | None:
    """Return a manifest and what a commit adds to it; None if there is none.

    Raises:
        RecordError: it is damaged.
    """
    if not os.path.lexists(path):
        return None
    try:
        content = json.loads(read_text(path, "text"))
        if content.pop("format") != _FORMAT:
            raise ValueError("another format")
        files, inputs = (
            {n: e and (int(e[0]), str(e[1])) for n, e in content.pop(k).items()} for k in ("files", "inputs")
        )
        if any(PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts for name in files):
            raise ValueError("a path that leaves the folder")
        command, made_by, others = (content.pop(k) for k in ("command", "version", "packages"))
        added = tuple(map(str, content.pop("added", ())))
        return Manifest(tuple(command), made_by, inputs, files, dict(others), added), content
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise RecordError(
            f"'{path}' must be the manifest of a folder of results, but it is damaged; remove it: the files beside it "
            "are then taken for your own"
        ) from error


def locked(folder: Path, name: str = LOCK, wait_s: float = 0.0) -> FileLock:
    """Return a lock of a folder, which the system frees when its process ends, however it ends.

    Args:
        folder: that has its hidden one.
        name: of the lock, where something in the folder is written while others write into the folder.
        wait_s: how long to wait for who holds it.

    Raises:
        BusyError: it is held.
    """
    from filelock import FileLock, Timeout  # takes longer to import than most commands need for their help

    lock = FileLock(folder / OWN / name)
    try:
        lock.acquire(timeout=wait_s)
    except Timeout as error:
        raise BusyError(
            f"a folder of results takes one writer at a time, but {_holder(folder / OWN / name)} is writing to "
            f"'{folder}'; wait for it, or give another folder with --out"
        ) from error
    except RuntimeError:
        pass  # a file system without locks refuses nobody; filelock says so by a subclass of it
    return lock


@contextlib.contextmanager
def one_writer(file: Path) -> Iterator[None]:
    """Let nobody else change a user's own file, as a project's is, within the block; who is at it is waited for.

    Raises:
        BusyError: it takes them too long.
        WriteError: its folder cannot be written to.
    """
    try:
        (file.parent / OWN).mkdir(exist_ok=True)
        lock = locked(file.parent, f"{file.name}.{LOCK}", WAIT_S)
    except OSError as error:
        raise not_written(file, error) from error
    try:
        yield
    finally:
        lock.release()


def _holder(lock: Path) -> str:
    """Return the process that holds a lock, in words; Linux lists them with the numbers of their files."""
    with contextlib.suppress(OSError, ValueError):
        found = lock.stat()
        for line in _LOCKS.read_text(encoding="ascii").splitlines():
            words = line.split()
            if "FLOCK" in words and "->" not in words:
                major, minor, inode = words[5].split(":")
                if (os.makedev(int(major, 16), int(minor, 16)), int(inode)) == (found.st_dev, found.st_ino):
                    return f"process {words[4]}"
    return "another process"


def running_command() -> tuple[str, ...]:
    """Return the command that runs, if it is the testbench's command line."""
    program = Path(sys.argv[0])
    ours = program.name == "testbench" or program.parts[-2:] == ("testbench", "__main__.py")
    return ("testbench", *sys.argv[1:]) if ours else ()


def packages() -> dict[str, str]:
    """Return the version of each package that decides figures."""
    from importlib.metadata import version  # which a command that only reads does not need

    return {name: version(name) for name in ("numpy", "scipy", "jsbsim")}


@lru_cache(maxsize=1000)
def _entry_then(path: Path, size: int, time_ns: int) -> Entry:
    """Return the entry of a file as it was; None if it has changed since."""
    with contextlib.suppress(OSError):
        found = path.stat()
        if (found.st_size, found.st_mtime_ns) == (size, time_ns):
            return entry_of(path)
    return None


def _packaged() -> Iterator[tuple[str, Path]]:
    """Yield what names begin with of files that are packaged, and the folder that it stands for."""
    yield from (("testbench:aircraft/", AIRCRAFT_MODELS), ("testbench:scenarios/", SCENARIOS))
    yield from (("testbench:suites/", SUITES), ("testbench:", PACKAGE))
    if (root := stock_root()) is not None:
        yield "jsbsim:", root


def _name_of(path: Path) -> str:
    """Return the name of an input: of a packaged file the same on every machine, else as seen from where we run."""
    for begin, root in _packaged():
        if path.is_relative_to(root):
            return f"{begin}{path.relative_to(root).as_posix()}"
    here = Path.cwd()
    return (path.relative_to(here) if path.is_relative_to(here) else path).as_posix()


def input_at(name: str, folder: Path) -> Path | None:
    """Return the file that an input of a folder's manifest is now; None if there is none.

    A relative one is looked for from where this process runs, then from the folders above ``folder``.
    """
    places = [root / name.removeprefix(begin) for begin, root in _packaged() if name.startswith(begin)]
    places = places or [above / name for above in (Path.cwd(), *folder.absolute().parents)]
    return next((path for path in places if path.is_file()), None)


def _remove(path: Path) -> None:
    """Remove a file, a folder with all in it, or a link but not what it leads to; if there is none, do nothing."""
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.exists():
        shutil.rmtree(path)
