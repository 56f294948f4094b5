"""The folder of a data set: one HDF5 store, the withheld labels, and what a killed process left for the next.

All arrays of the store are contiguous, so that their places are known once the empty file is laid out. Its whole size
is then claimed from the disk, before anything is flown, and parts are written by Python at their places: HDF5, which
ends the process if the disk fills while it writes, is not there. A part counts once its line stands in the journal;
a process that is killed loses at most the part that it was writing, whose place is written again. All this is done
where :class:`ResultFolder` keeps what is unfinished; once the checksums are there, the data set takes its place.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.door import read_json, read_text, sha256
from testbench.core.errors import DatasetError, RecordError
from testbench.core.files import netcdf_bytes, not_written, write_file
from testbench.core.store import NEW, OWN, ResultFolder, manifest_of, running_command, settle
from testbench.questions.dataset.flying import Part
from testbench.questions.dataset.layout import WITHHELD, Layout, Variable
from testbench.questions.dataset.scenario import SPLITS

STORE, TRUTH, ABOUT, SUMS = "flights.h5", "truth_test.h5", "dataset.json", "checksums.sha256"
SHEET, SHEET_PAGE, CARD = "README.md", "README.html", "croissant.json"
_HEAD = 1 << 20  # bytes that names and structure take at most
_FIX = "free space, or give another folder with --out; what is finished is kept"
_TEST = SPLITS.index("test")
_WORK = ".drawing"
_COMMAND, _JOURNAL = "command.json", "parts.jsonl"


@dataclass(frozen=True, eq=False)
class Store:
    """A folder that is being filled."""

    folder: Path  # where the data set is made
    layout: Layout  # of its arrays
    about: str  # what decides its content, as JSON

    @classmethod
    def open(cls, place: ResultFolder, layout: Layout, about: Mapping[str, Any]) -> Store:
        """Go on with what lies in a folder, finished or not, or lay out a new data set.

        Raises:
            DatasetError: it holds something else.
            DiskError: the disk has no room for all of it.
        """
        folder = place.path if (place.path / SUMS).exists() else place.new
        store = cls(folder, layout, json.dumps(about, indent=1, sort_keys=True) + "\n")
        found = folder / ABOUT
        others = sorted(p.name for p in place.path.iterdir() if p.name != OWN)
        if others and folder == place.new:
            raise DatasetError(
                f"a data set needs a folder of its own, but '{place.path}' holds {others[0]}; give another --out"
            )
        if not found.exists():
            shutil.rmtree(folder)  # of a process that was killed while it laid out, or did something else
            store._lay_out()
            write_file(found, store.about, fix=_FIX)
        elif read_text(found, "text") != store.about:
            raise DatasetError(
                f"a folder holds one data set, but '{place.path}' holds another one ({_differs(found, about)}); give "
                "another folder with --out, or remove that one"
            )
        if store.complete:
            shutil.rmtree(folder / _WORK, ignore_errors=True)
        return store

    @property
    def complete(self) -> bool:
        """Whether all is there, checksums included."""
        return (self.folder / SUMS).exists()

    def _lay_out(self) -> None:
        """Make the empty store and the place of all labels, and claim from the disk all that they will take."""
        work = self.folder / _WORK
        work.mkdir(parents=True)
        try:
            with (work / "labels").open("wb") as labels:
                _claim_disk(labels.fileno(), self._label_bytes * self.layout.flights)
            with (work / STORE).open("w+b") as file:
                size = _HEAD + self.layout.row_bytes * self.layout.flights
                _claim_disk(file.fileno(), size + _HEAD)
                _write_empty(file, self.layout)
            (work / _COMMAND).write_text(json.dumps(running_command()), encoding="utf-8")
            os.replace(work / STORE, self.folder / STORE)
        except BaseException as error:
            shutil.rmtree(work, ignore_errors=True)
            if isinstance(error, OSError):
                raise not_written(self.folder / STORE, error, fix=_FIX) from error
            raise

    @property
    def _labels(self) -> list[Variable]:
        return [v for v in self.layout.variables if v.label]

    @property
    def _label_bytes(self) -> int:
        return sum(self.layout.bytes_of(v) for v in self._labels)

    def journal(self) -> dict[int, dict[str, Any]]:
        """Return part -> what was noted of it; a line that a killed process left half-written does not count."""
        return journal_in(self.folder)

    def write(self, number: int, first_flight: int, part: Part) -> None:
        """Write a part at its place, then its line into the journal.

        Raises:
            DiskError: the disk fails.
        """
        hidden = part.rows["split"] == _TEST
        offset = first_flight * self._label_bytes
        try:
            with (self.folder / _WORK / "labels").open("r+b") as labels:
                labels.seek(offset)
                labels.write(_records(part.rows, self._labels).tobytes())
                os.fsync(labels.fileno())
            with (self.folder / STORE).open("r+b") as file:
                for variable, place in places(self.folder / STORE, self.layout).items():
                    of = next(v for v in self.layout.variables if v.name == variable)
                    values = part.rows[variable]
                    if of.label:
                        values = values.copy()
                        values[hidden] = np.nan if "f" in of.dtype else WITHHELD
                    file.seek(place + first_flight * self.layout.bytes_of(of))
                    file.write(np.ascontiguousarray(values, of.dtype).tobytes())
                os.fsync(file.fileno())
            first = first_flight // self.layout.per_draw
            noted = {"part": number, "first": first, "draws": part.draws, "failed": part.failed}
            self._note(json.dumps(noted) + "\n")
        except OSError as error:
            raise not_written(self.folder / STORE, error, fix=_FIX) from error

    def _note(self, line: str) -> None:
        with (self.folder / _WORK / _JOURNAL).open("a+b") as journal:
            if journal.tell():
                journal.seek(-1, os.SEEK_END)
                if journal.read(1) != b"\n":
                    journal.write(b"\n")  # behind half a line that a killed process left
            journal.write(line.encode())
            journal.flush()
            os.fsync(journal.fileno())

    def labels(self) -> dict[str, Any]:
        """Return every label of all flights, those of the test split too."""
        raw = np.fromfile(self.folder / _WORK / "labels", _record_type(self.layout, self._labels))
        return {v.name: raw[v.name] for v in self._labels}

    def finish(self, sheet: str, page: str, card: Callable[[str], str], split: Any) -> None:
        """Write the withheld labels, the datasheet and, last, the checksums; then the data set is complete.

        Args:
            sheet: text of the datasheet.
            page: the same as HTML.
            card: SHA-256 of the store -> what catalogues of data sets read.
            split: (flights,) codes.
        """
        withheld = np.flatnonzero(split == _TEST)
        known = self.labels()
        write_file(self.folder / TRUTH, netcdf_bytes(lambda f: _write_truth(f, self.layout, withheld, known)), fix=_FIX)
        write_file(self.folder / SHEET, sheet, fix=_FIX)
        write_file(self.folder / SHEET_PAGE, page, fix=_FIX)
        of_store = sha256(self.folder / STORE, "record")
        write_file(self.folder / CARD, card(of_store), fix=_FIX)
        others = (f"{sha256(self.folder / n, 'record')}  {n}\n" for n in (TRUTH, ABOUT, SHEET, SHEET_PAGE, CARD))
        write_file(self.folder / SUMS, f"{of_store}  {STORE}\n" + "".join(others), fix=_FIX)
        shutil.rmtree(self.folder / _WORK, ignore_errors=True)


def journal_in(folder: Path) -> dict[int, dict[str, Any]]:
    """Return part -> what was noted of it where a data set is made; half a line of a killed process does not count."""
    path = folder / _WORK / _JOURNAL
    out: dict[int, dict[str, Any]] = {}
    text = read_text(path, "journal") if path.exists() else ""
    for line in text.splitlines(keepends=True):
        if line.endswith("\n"):
            with contextlib.suppress(ValueError):
                row = json.loads(line)
                out[row["part"]] = row
    return out


def made_in(folder: Path) -> Path | None:
    """Return where the store of a data set lies, complete or while it is drawn; None if there is none."""
    return next((p for p in (folder / OWN / NEW, folder) if (p / STORE).is_file()), None)


def command_of(folder: Path) -> list[str]:
    """Return the words that began a data set, without the program; none if a program did."""
    begun = folder / OWN / NEW / _WORK / _COMMAND
    if begun.is_file():
        return [str(word) for word in read_json(begun, "journal")][1:]
    made = manifest_of(folder)
    return [] if made is None else list(made.command[1:])


def places(path: Path, layout: Layout) -> dict[str, int]:
    """Return the byte at which each array of a store begins.

    Raises:
        DatasetError: the store is not the one that was laid out.
    """
    import h5py  # type: ignore[import-untyped]

    try:
        with h5py.File(path, "r") as file:
            return {v.name: int(file[v.name].id.get_offset()) for v in layout.variables}
    except (OSError, KeyError, TypeError) as error:
        raise DatasetError(f"'{path}' must be the store of a data set, but it is damaged; remove its folder") from error


def _claim_disk(descriptor: int, size: int) -> None:
    """Claim room for a file.

    Raises:
        OSError: there is none.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
    elif os.fstatvfs(descriptor).f_bavail * os.fstatvfs(descriptor).f_frsize < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class _Fresh(io.RawIOBase):
    """A file whose room is claimed already, as HDF5 wants to see it: empty at first."""

    def __init__(self, file: Any) -> None:
        self._file, self.size = file, 0

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a byte."""
        return int(self._file.seek(offset + (self.size if whence == 2 else 0), 0 if whence == 2 else whence))

    def tell(self) -> int:
        """Return where the file is."""
        return int(self._file.tell())

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer."""
        return int(self._file.readinto(buffer))

    def write(self, data: Any) -> int:
        """Write, and note how far the content reaches."""
        count = int(self._file.write(data))
        self.size = max(self.size, self.tell())
        return count

    def truncate(self, size: int | None = None) -> int:
        """Note how far the content reaches; the room stays claimed."""
        self.size = self.tell() if size is None else size
        return self.size

    def flush(self) -> None:
        """Write what is buffered."""
        self._file.flush()


def _write_empty(file: Any, layout: Layout) -> None:
    """Write the structure of a store, every array in one piece and not yet filled."""
    import h5netcdf

    fresh = _Fresh(file)
    with h5netcdf.File(fresh, "w") as out:
        _write_names(out, layout)
        for v in layout.variables:
            array = out.create_variable(v.name, v.dims, np.dtype(v.dtype), fillvalue=None, fill_time="never")
            array[0] = 0  # allocates the whole array
            _describe(array, v)
    file.flush()
    file.truncate(fresh.size)


def _write_names(out: Any, layout: Layout) -> None:
    import h5py

    out.dimensions = layout.dims
    names = {
        "channel": layout.channels,
        "channel_unit": layout.units,
        "figure": layout.figures,
        "figure_unit": layout.figure_units,
        "key": layout.keys,
        "size": layout.sizes,
    }
    for name, of in names.items():
        dim = name.removesuffix("_unit")
        if of:
            out.create_variable(name, (dim,), h5py.string_dtype(), data=np.array(of, object))
    time = out.create_variable("time", ("time",), "<f8", data=np.arange(layout.samples) / layout.rate_hz)
    time.attrs["units_SI"] = "s"
    time.attrs["long_name"] = "since the start of the record"


def _describe(array: Any, v: Variable) -> None:
    array.attrs["long_name"] = v.words
    if v.unit:
        array.attrs["units"] = v.unit
    if v.codes:
        array.attrs["names"] = list(v.codes)


def _record_type(layout: Layout, variables: list[Variable]) -> np.dtype[Any]:
    return np.dtype([(v.name, v.dtype, tuple(layout.dims[d] for d in v.dims[1:])) for v in variables])


def _records(rows: Mapping[str, Any], variables: list[Variable]) -> Any:
    shapes = [(v.name, v.dtype, rows[v.name].shape[1:]) for v in variables]
    out = np.empty(len(rows["split"]), np.dtype(shapes))
    for v in variables:
        out[v.name] = rows[v.name]
    return out


def _write_truth(out: Any, layout: Layout, withheld: Any, known: Mapping[str, Any]) -> None:
    """Write the labels of the test split; ``flight`` says whose they are."""
    import h5py

    dims = {**layout.dims, "flight": len(withheld)}
    out.dimensions = dims
    for name, of in (("figure", layout.figures), ("key", layout.keys), ("size", layout.sizes)):
        if of:
            out.create_variable(name, (name,), h5py.string_dtype(), data=np.array(of, object))
    out.create_variable("flight", ("flight",), "<i4", data=withheld.astype("<i4"))
    for v in layout.variables:
        if v.label:
            _describe(out.create_variable(v.name, v.dims, np.dtype(v.dtype), data=known[v.name][withheld]), v)


def _sorted(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _differs(found: Path, about: Mapping[str, Any]) -> str:
    """Return which keys of what decides the content differ."""
    try:
        before = json.loads(read_text(found, "text"))
        keys = [k for k in {**before, **about} if _sorted(before.get(k)) != _sorted(about.get(k))]
    except (ValueError, AttributeError):
        return f"its {ABOUT} is damaged"
    return f"{', '.join(keys) or 'the order'} differ{'s' if len(keys) == 1 else ''}"


def damaged(folder: Path) -> Iterator[str]:
    """Yield the files of a complete data set that differ from its checksums, or are gone.

    Raises:
        RecordError: there are no checksums.
    """
    settle(folder)
    path = folder / SUMS
    if not path.exists():
        raise RecordError(f"a complete data set has {SUMS}, but '{folder}' has none; draw it to its end first")
    for line in read_text(path, "text").splitlines():
        digest, _, name = line.partition("  ")
        if not (folder / name).exists():
            if name not in (TRUTH, ABOUT):  # a contest withholds them
                yield name
        elif sha256(folder / name, "record") != digest:
            yield name
