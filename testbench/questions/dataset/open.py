"""Read a data set: as labelled arrays of xarray, or flight by flight as loaders of PyTorch want it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import checked
from testbench.core.errors import DatasetError, RecordError, ScenarioError, nearest
from testbench.core.files import parsed
from testbench.core.store import NEW, OWN, settle
from testbench.questions.dataset.scenario import SPLITS
from testbench.questions.dataset.store import STORE, SUMS, TRUTH

if TYPE_CHECKING:
    import xarray as xr


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
        names = [n for n in ("channel", "figure", "size", "channel_unit", "figure_unit") if n in out]
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
        labels: variable that is the label: "truth", "effect", "effect_size" or "level".

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
