"""Files that are there whole or not at all, and the same bytes for the same content.

Folders for what a process writes for itself, and the removal of those that killed processes left behind.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import hashlib
import io
import os
import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from testbench.core.errors import DiskError, RecordError, TestbenchError, WriteError
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


_OF_THE_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
"""What the system says if the disk and not the path is at fault."""
_LONGEST = 200  # letters of a reason


LAW, _FIX = "results must go to a folder that can be written to", "give another folder or free space"


def not_written(path: Path, error: OSError, law: str = LAW, fix: str = _FIX) -> WriteError:
    """Return what to raise where a file or folder cannot be written; a :class:`DiskError` if for want of space."""
    if error.errno in _OF_THE_DISK:
        return DiskError(f"the disk must have room for '{path}', got: {error.strerror or error}; {fix}")
    return WriteError(f"{law}, got '{path}': {error.strerror or error}; {fix}")


def write_file(path: Path, content: str | bytes | Callable[[Path], object], law: str = LAW, fix: str = _FIX) -> Path:
    """Write a file under another name, rename it to ``path`` and return ``path``; its folder is made if it is missing.

    A process that is killed while it writes leaves the file that was there before, or none. If writing fails, what was
    written of it is removed, so that it does not fill the disk.

    Args:
        path: the file.
        content: text, written as UTF-8, a lone surrogate as "?"; bytes; or a function that writes the file whose path
            it is given.
        law: what must hold, as the error says it.
        fix: what to do, as the error says it.

    Raises:
        WriteError: the file cannot be written; a :class:`DiskError` if that is for want of space.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)  # a link of this name is not to be followed
        if callable(content):
            part.touch()  # a folder that cannot be written to shows here, before a library trips over it
            content(part)
        else:
            part.write_bytes(content.encode("utf-8", "replace") if isinstance(content, str) else content)
        part.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            raise not_written(path, error, law, fix) from error
        raise
    return path


def must_be_new(path: Path, what: str) -> None:
    """Check that nothing lies where a file is to be written that a user will edit.

    Raises:
        RecordError: something does.
    """
    if os.path.lexists(path):
        raise RecordError(f"{what} must be a new file, got '{path}', which exists; give another name")


def write_new(path: Path, content: str, what: str) -> Path:
    """Write a file as :func:`write_file` does, but never in the place of one that is there, and return ``path``.

    Args:
        path: the file.
        content: its text.
        what: it is, as the error says it: "a new plan".

    Raises:
        RecordError: the file is there.
        WriteError: it cannot be written.
    """
    must_be_new(path, what)
    made = write_file(path.with_name(f"{path.name}.new"), content)  # of one name: what a kill leaves goes next time
    try:
        os.link(made, path)  # unlike a rename, this fails if somebody has just made the file
    except FileExistsError:  # as it is now
        must_be_new(path, what)
    except OSError:  # a file system without links
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)
    return path


def netcdf_bytes(fill: Callable[[Any], object]) -> bytes:
    """Return a NetCDF file that ``fill`` fills, given an open ``h5netcdf.File``.

    It is made in memory and written by Python: HDF5 ends the process if the disk fills while it writes.
    """
    import h5netcdf

    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        fill(file)
    return buffer.getvalue()


def kept_in(kind: str) -> Path | None:
    """Return the user's folder of what is kept so that it need not be found again; None if there is no home."""
    base = os.environ.get("XDG_CACHE_HOME")
    with contextlib.suppress(RuntimeError):
        return Path(base or Path.home() / ".cache") / "flight-testbench" / kind
    return None


@lru_cache
def sources(*rooms: str) -> str:
    """Return a hash of the code in rooms of the package, such as "flight/batch": it tells what other code has made."""
    package = Path(__file__).parents[1]
    files = [p for room in rooms for p in sorted((package / room).rglob("*.py"))]
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()[:12]


def keep(file: Path, content: bytes) -> None:
    """Write a file that others may read or write at the same time; if it cannot be, it is not kept."""
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        new = file.with_suffix(f".{os.getpid()}")
        new.write_bytes(content)
        new.replace(file)


@contextlib.contextmanager
def parsed(path: Path | str, what: str) -> Iterator[None]:
    """Turn whatever a parser raises at a file that it cannot read into an error that names the file.

    What a file holds decides what a parser trips over, so that its exceptions cannot be listed: HDF5's attributes of
    an unknown type raise AttributeError, JSON of many brackets RecursionError. Only calls of parsers, and what takes
    their results apart, belong inside.

    Args:
        path: the file.
        what: it must be, as "a NetCDF record".

    Raises:
        RecordError: the parser failed. Errors of the testbench pass.
    """
    try:
        yield
    except TestbenchError:
        raise
    except Exception as error:
        raise RecordError(f"'{path}' must be {what}, but it is damaged or none: {reason_of(error)}") from error


def reason_of(error: BaseException) -> str:
    """Return the first line of what an exception says, or its kind if it says nothing that can be understood alone."""
    text = str(error).strip("'\"").strip()
    line = text.splitlines()[0] if text else ""
    if isinstance(error, OSError) and error.strerror:
        line = error.strerror
    told = line[:_LONGEST] + ("..." if len(line) > _LONGEST else "")
    return told if len(told.split()) > 1 else f"{type(error).__name__} {told}".strip()


def mat_bytes(content: Mapping[str, Any], what: str = "", **options: Any) -> bytes:
    """Return variables as a MAT file of version 5.

    scipy writes the time of day into the first 116 bytes, which are text for people; this text takes their place, so
    that the same variables give the same bytes.

    Args:
        content: name -> value, as ``scipy.io.savemat`` takes them.
        what: kind of content, told in the text.
        options: of ``scipy.io.savemat``.
    """
    from io import BytesIO

    from scipy.io import savemat

    buffer = BytesIO()
    savemat(buffer, dict(content), **options)
    text = ", ".join(filter(None, ["MATLAB 5.0 MAT-file, written by flight-testbench", what]))
    return text.ljust(116).encode() + buffer.getvalue()[116:]
