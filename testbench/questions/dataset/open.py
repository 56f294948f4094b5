"""Read a data set: as labelled arrays of xarray, or flight by flight as loaders of PyTorch want it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import checked
from testbench.core.errors import DatasetError, RecordError, ScenarioError, nearest
from testbench.core.files import parsed
from testbench.core.record import FlightRecord
from testbench.core.store import NEW, OWN, settle
from testbench.questions.dataset.layout import NONE, WITHHELD
from testbench.questions.dataset.scenario import SPLITS
from testbench.questions.dataset.store import STORE, SUMS, TRUTH, journal_in, made_in

if TYPE_CHECKING:
    import xarray as xr

_ALONG = {"truth": "figure", "drawn": "key", "effect_size": "size"}
"""Variable -> what stands along its second dimension."""


def open_dataset(folder: Path | str, split: str | None = None, truth: Path | str | None = None) -> xr.Dataset:
    """Open a data set; readings are read from the disk when they are used.

    Args:
        folder: of the data set.
        split: "train", "validation" or "test"; all flights if not given.
        truth: file with the labels of the test split, which are put in their places; "" for the one in the folder.

    Returns:
        Its variables by name, with the coordinates flight, time (s), channel and figure. Codes stand in their places
        with the attribute ``names``, a list.

    Raises:
        RecordError: there is no data set.
        DatasetError: it is not complete.
        ScenarioError: there is no such split.

    Example:
        >>> import testbench as tb
        >>> drawn = tb.draw_dataset("dataset/identification", "my_set", runs=8, workers=1)
        >>> flights = tb.open_dataset("my_set")
        >>> flights.readings.dims, flights.sizes["flight"]
        (('flight', 'time', 'channel'), 8)
    """
    import xarray as xr

    path = checked(store_of(folder), "record")
    with parsed(path, "the store of a data set"):
        out = xr.open_dataset(path, engine="h5netcdf", decode_cf=False)
        names = [n for n in ("channel", "figure", "key", "size", "channel_unit", "figure_unit") if n in out]
        out = out.set_coords(names)
        out = out.assign_coords(flight=np.arange(out.sizes["flight"]))
    for variable in out.data_vars.values():
        if "names" in variable.attrs:
            variable.attrs["names"] = [str(x) for x in np.atleast_1d(variable.attrs["names"])]
    if truth is not None:
        _put_truth(out, Path(truth) if truth else Path(folder) / TRUTH)
    return out if split is None else out.isel(flight=np.flatnonzero(out.split.values == code_of(split)))


def open_datatree(folder: Path | str, truth: Path | str | None = None) -> xr.DataTree:
    """Open a data set as a tree of xarray: /train, /validation and /test, each as :func:`open_dataset` gives it.

    Args:
        folder: of the data set.
        truth: as of :func:`open_dataset`.

    Raises:
        RecordError: there is no data set.
        DatasetError: it is not complete.

    Example:
        >>> import testbench as tb
        >>> drawn = tb.draw_dataset("dataset/identification", "my_set", runs=8, workers=1)
        >>> sorted(tb.open_datatree("my_set").children)
        ['test', 'train', 'validation']
    """
    import xarray as xr

    whole = open_dataset(folder, truth=truth)
    rows = {name: np.flatnonzero(whole.split.values == code) for code, name in enumerate(SPLITS)}
    return xr.DataTree.from_dict({f"/{name}": whole.isel(flight=at) for name, at in rows.items()})


class FlightSamples:
    """The flights of a split as a map-style data set: it has a length, and item i is (readings, labels) of a flight.

    That is all that ``torch.utils.data.DataLoader`` asks for. Readings are a view of the file, opened anew by each
    process, so that loaders with workers share no handle.

    Args:
        folder: of the data set.
        split: "train", "validation" or "test".
        labels: variable that is the label: "truth", "drawn", "effect", "effect_size" or "level".

    Raises:
        RecordError: there is no data set.
        DatasetError: it is not complete, or has no such variable.

    Example:
        >>> import testbench as tb
        >>> drawn = tb.draw_dataset("dataset/identification", "my_set", runs=40, workers=1)
        >>> readings, truth = tb.FlightSamples("my_set", "train")[0]
        >>> readings.dtype.name, readings.shape == (drawn.layout.samples, len(drawn.layout.channels))
        ('float32', True)
    """

    def __init__(self, folder: Path | str, split: str = "train", labels: str = "truth") -> None:
        import h5py  # type: ignore[import-untyped]

        self._path = checked(store_of(folder), "record")
        self._readings: Any = None
        with parsed(self._path, "the store of a data set"), h5py.File(self._path, "r") as file:
            if labels not in file:
                raise DatasetError(f"'{folder}' has no variable '{labels}'{nearest(labels, file)}")
            self.flights = np.flatnonzero(file["split"][:] == code_of(split))
            self._labels = file[labels][:][self.flights]
            self._shape, self._offset = file["readings"].shape, file["readings"].id.get_offset()

    def __len__(self) -> int:
        return len(self.flights)

    def __getitem__(self, i: int) -> tuple[Any, Any]:
        if self._readings is None:
            self._readings = np.memmap(self._path, "<f4", "r", self._offset, self._shape)
        return np.array(self._readings[self.flights[i]]), self._labels[i]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_readings": None}


# --- what is there so far ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DrawsSoFar:
    """Draws of a data set that is complete or still drawn."""

    #: flights, per_draw: of the whole set, and of one draw
    flights: int
    per_draw: int
    finished: int  #: draws that are there
    failed: int | None  #: attempts that could not fly; None for a complete set, whose datasheet counts them
    first_missing: int | None  #: the lowest draw that is not there; None if all are
    #: of each draw and failed attempt that was asked for: its ``draw`` and ``attempt``, ``names`` and ``values`` of
    #: what was drawn, ``truth`` by figure, ``why`` it failed or ""
    rows: list[dict[str, Any]]


def draws_so_far(folder: Path | str, first: int = 0, most: int = 2000) -> DrawsSoFar:
    """Return what is there of a data set; labels of the test split are withheld, as in its store.

    Args:
        folder: of the data set.
        first: draw that the rows begin with.
        most: numbers of draws from there on.

    Raises:
        RecordError: there is no data set, or it is damaged.
    """
    with _store_so_far(folder) as (place, file):
        per_draw, flights = len(np.atleast_1d(file["manoeuvre"].attrs["names"])), file["split"].shape[0]
        draws = -(-flights // per_draw)
        journal = {} if (place / SUMS).exists() else journal_in(place)
        spans = sorted((row["first"], row["first"] + row["draws"]) for row in journal.values())
        failed = None if (place / SUMS).exists() else [row for part in journal.values() for row in part["failed"]]
        spans = [(0, draws)] if failed is None else spans
        missing = 0
        for begin, end in spans:
            missing = end if begin <= missing else missing
        rows = [{"names": {k: row[k] for k in ("level", "aircraft", "effect") if row[k]}, "truth": {}, **row}
                for row in failed or () if first <= row["draw"] < first + most]  # fmt: skip
        for begin, end in spans:
            rows += _draws(file, max(begin, first), min(end, first + most), per_draw)
    return DrawsSoFar(
        flights=flights,
        per_draw=per_draw,
        finished=min(sum(end - begin for begin, end in spans), draws),
        failed=None if failed is None else len(failed),
        first_missing=missing if missing < draws else None,
        rows=rows,
    )


def flight_so_far(folder: Path | str, number: int) -> FlightRecord:
    """Return a flight of a data set as it was measured, complete or not.

    Raises:
        RecordError: it is not there.
    """
    with _store_so_far(folder) as (place, file):
        per_draw, flights = len(np.atleast_1d(file["manoeuvre"].attrs["names"])), file["split"].shape[0]
        there = (place / SUMS).exists() or any(
            row["first"] <= number // per_draw < row["first"] + row["draws"] for row in journal_in(place).values()
        )
        if not (there and 0 <= number < flights):
            raise RecordError(f"a flight of '{folder}' must be one of {flights} that is there, got {number}")
        n, channels = int(file["samples"][number]), tuple(file["channel"].asstr()[:])
        valid = file["valid"][number, :n].astype(bool) if "valid" in file else None
        data = file["readings"][number, :n].astype(float)
        flown = str(np.atleast_1d(file["aircraft"].attrs["names"])[int(file["aircraft"][number])])
        provenance = {"aircraft": flown, "flight": number}
        return FlightRecord(file["time"][:n], channels, data, "measured", valid, provenance)  # type: ignore[arg-type]


@contextmanager
def _store_so_far(folder: Path | str) -> Iterator[tuple[Path, Any]]:
    """Open the store of a data set where it lies."""
    import h5py

    settle(Path(folder))
    place = made_in(Path(folder))
    if place is None:
        raise RecordError(f"a data set must lie in its folder, but '{folder}' has no {STORE}")
    path = checked(place / STORE, "record")
    with parsed(path, "the store of a data set"), h5py.File(path, "r") as file:
        yield place, file


def _draws(file: Any, first: int, last: int, per_draw: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of the draws ``first`` to ``last``, the latter not included."""
    if first >= last:
        return
    at, flights = slice(first * per_draw, last * per_draw), file["split"].shape
    own = [n for n in file if file[n].shape[:1] == flights and n not in ("readings", "valid")]
    held = {n: file[n][at][::per_draw] for n in own}
    codes = {n: [str(x) for x in np.atleast_1d(file[n].attrs["names"])] for n in own if "names" in file[n].attrs}
    along = {n: [x.replace(": ", " ") for x in file[key].asstr()[:]] for n, key in _ALONG.items() if n in own}

    def known(names: Any, numbers: Any) -> dict[str, float]:
        return {str(n): float(x) for n, x in zip(names, numbers, strict=True) if np.isfinite(x)}

    def name(of: str, code: int) -> str:
        return "withheld" if code == WITHHELD else codes[of][code]

    for k in range(len(held["split"])):
        names = {n: name(n, int(held[n][k])) for n in ("level", "split", "aircraft")}
        if "effect" in held:
            acting = [name("effect", int(code)) for code in held["effect"][k] if code != NONE]
            names["effect"] = " + ".join(dict.fromkeys(acting)) or "none"
        condition = ("V_m_s", "h_m", "turbulence_rms_m_s", "scale")
        values = known(condition, [held[n][k] for n in condition])
        for of in ("drawn", "effect_size"):
            values |= known(along[of], held[of][k]) if of in along else {}
        truth = known(along["truth"], held["truth"][k])
        yield {"draw": first + k, "attempt": -1, "names": names, "values": values, "truth": truth, "why": ""}


# --- places -----------------------------------------------------------------------------------------------------------


def code_of(split: str) -> int:
    """Return the code of a split.

    Raises:
        ScenarioError: there is none of that name.
    """
    if split not in SPLITS:
        raise ScenarioError(f"a split must be one of {', '.join(SPLITS)}, got '{split}'{nearest(split, SPLITS)}")
    return SPLITS.index(split)


def store_of(folder: Path | str) -> Path:
    """Return the store of a complete data set.

    Raises:
        RecordError: there is none.
        DatasetError: it is still being drawn.
    """
    path = Path(folder) / STORE
    settle(Path(folder))
    if (Path(folder) / OWN / NEW / STORE).exists() or (path.is_file() and not (Path(folder) / SUMS).exists()):
        raise DatasetError(f"'{folder}' is not complete; go on with the command `testbench dataset` that began it")
    if not path.is_file():
        raise RecordError(f"a data set must lie in its folder, but '{folder}' has no {STORE} ")
    return path


def truth_of(folder: Path | str, truth: Path | str | None = None) -> Path:
    """Return the file with the labels of the test split.

    Raises:
        RecordError: there is none.
    """
    path = Path(truth) if truth else Path(folder) / TRUTH
    if not path.is_file():
        raise RecordError(
            f"answers are judged by the labels of the test split, but there is no '{path}'; whoever holds them can "
            "score, and --truth gives another file"
        )
    return path


def _put_truth(out: xr.Dataset, path: Path) -> None:
    import h5py

    with parsed(truth_of("", path), "the labels of a test split"), h5py.File(checked(path, "record"), "r") as file:
        rows = file["flight"][:]
        for name in file:
            if name in out.data_vars:
                values = out[name].values.copy()
                values[rows] = file[name][:]
                out[name] = (out[name].dims, values, out[name].attrs)
