"""FlightRecord: sampled channels of one flight, with validity, provenance and outcome; NetCDF on disk."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from testbench.channels import channel, require
from testbench.errors import RecordError

FORMAT = "testbench-record-1"
Kind = Literal["truth", "measured"]
Outcome = Literal["completed", "aborted"]
FloatArray = NDArray[np.float64]


def _frozen(array: Any, dtype: type = np.float64) -> NDArray[Any]:
    out = np.array(array, dtype=dtype)
    out.setflags(write=False)
    return out


@dataclass(frozen=True, eq=False)
class FlightRecord:
    """Channels of one flight over time, in SI units and radians.

    Args:
        t_s: (n,) sample times, strictly increasing.
        channels: (m,) channel names of the channel table.
        data: (n, m) samples. A sample that was not taken (dropout, slow sensor) holds the last value that was taken
            and is marked in ``valid``.
        kind: "truth" from the simulator, "measured" from sensors, simulated or real.
        valid: (n, m) True where a sample was really taken; all True if not given.
        provenance: where the record comes from (aircraft, seed, versions, file), as JSON values.
        outcome: "completed", or "aborted" with ``reason``.

    Raises:
        RecordError: shapes disagree, times do not increase, or a value is not finite.
        ChannelError: a channel is not in the table.
    """

    t_s: FloatArray
    channels: tuple[str, ...]
    data: FloatArray
    kind: Kind
    valid: NDArray[np.bool_] = field(default=None)  # type: ignore[assignment]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    outcome: Outcome = "completed"
    reason: str = ""

    def __post_init__(self) -> None:
        t, data = _frozen(self.t_s), _frozen(self.data)
        names = tuple(self.channels)
        valid = _frozen(np.ones(data.shape) if self.valid is None else self.valid, bool)
        if t.ndim != 1 or data.shape != (t.size, len(names)) or valid.shape != data.shape:
            raise RecordError(
                f"data and valid must have shape (samples, channels) = ({t.size}, {len(names)}), "
                f"got {data.shape} and {valid.shape}"
            )
        if len(set(names)) != len(names):
            raise RecordError(f"channel names must differ, got {', '.join(names)}")
        for name in names:
            channel(name)
        if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
            bad = int(np.argmin(np.diff(t))) + 1 if np.all(np.isfinite(t)) else int(np.argmin(np.isfinite(t)))
            raise RecordError(f"times must increase strictly, got t = {t[bad]:g} s at sample {bad}")
        finite = np.isfinite(data)
        if not finite.all():
            row, column = np.argwhere(~finite)[0]
            raise RecordError(
                f"samples must be finite, got {data[row, column]} in channel '{names[column]}' at t = {t[row]:g} s; "
                "mark samples that were not taken in the validity mask"
            )
        for name, value in (("t_s", t), ("channels", names), ("data", data), ("valid", valid)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __getitem__(self, name: str) -> FloatArray:
        require([name], self.channels, "this reading")
        return self.data[:, self.channels.index(name)]

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def __len__(self) -> int:
        return self.t_s.size

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "provenance": dict(self.provenance)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        object.__setattr__(self, "provenance", MappingProxyType(state["provenance"]))

    @property
    def dt_s(self) -> float:
        """Sample time in s.

        Raises:
            RecordError: the record has fewer than two samples or is not sampled uniformly (to 1 % of the step).
        """
        if len(self) < 2:
            raise RecordError(f"a sample time needs at least 2 samples, got {len(self)}")
        steps = np.diff(self.t_s)
        dt = float((self.t_s[-1] - self.t_s[0]) / steps.size)
        worst = int(np.argmax(np.abs(steps - dt)))
        if abs(steps[worst] - dt) > 0.01 * dt:
            raise RecordError(
                f"samples must be uniform in time, got steps of {dt:g} s and of {steps[worst]:g} s at "
                f"t = {self.t_s[worst]:g} s; cut the record there or resample it"
            )
        return dt

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.t_s[-1] - self.t_s[0]) if len(self) else 0.0

    def columns(self, names: Iterable[str]) -> FloatArray:
        """Return the samples of ``names`` as an array of shape (n, len(names)).

        Raises:
            ChannelError: the record lacks a channel.
        """
        wanted = tuple(names)
        require(wanted, self.channels, "this reading")
        return self.data[:, [self.channels.index(name) for name in wanted]]

    def select(self, names: Iterable[str]) -> FlightRecord:
        """Return a record with the channels ``names`` only, in that order."""
        wanted = tuple(names)
        require(wanted, self.channels, "this selection")
        index = [self.channels.index(name) for name in wanted]
        return replace(self, channels=wanted, data=self.data[:, index], valid=self.valid[:, index])

    def between(self, start_s: float, end_s: float) -> FlightRecord:
        """Return the samples with ``start_s <= t < end_s``.

        Raises:
            RecordError: no sample lies there.
        """
        return self._rows((self.t_s >= start_s - 1e-9) & (self.t_s < end_s - 1e-9), f"{start_s:g} <= t < {end_s:g} s")

    def split(self, fraction: float) -> tuple[FlightRecord, FlightRecord]:
        """Return the first ``fraction`` of the samples and the rest as two records."""
        cut = round(fraction * len(self))
        rows = np.arange(len(self))
        return self._rows(rows < cut, "the first part"), self._rows(rows >= cut, "the second part")

    def decimate(self, stride: int) -> FlightRecord:
        """Return every ``stride``-th sample; no filter is applied."""
        return self._rows(np.arange(len(self)) % stride == 0, f"every {stride}th sample")

    def _rows(self, rows: NDArray[np.bool_], what: str) -> FlightRecord:
        if not rows.any():
            raise RecordError(
                f"a part of a record must hold samples, got none in {what} of {self.t_s[0]:g} to {self.t_s[-1]:g} s"
            )
        return replace(self, t_s=self.t_s[rows], data=self.data[rows], valid=self.valid[rows])

    def with_columns(self, columns: Mapping[str, FloatArray]) -> FlightRecord:
        """Return a record in which the given channels (each (n,)) replace those of the same name or are added."""
        names = (*self.channels, *(name for name in columns if name not in self.channels))
        data = np.column_stack([columns[n] if n in columns else self[n] for n in names])
        valid = np.ones(data.shape, bool)
        valid[:, : len(self.channels)] = self.valid
        return replace(self, channels=names, data=data, valid=valid)

    def to_xarray(self) -> Any:
        """Return the record as an xarray Dataset: one variable per channel with units, ``t`` as coordinate."""
        import xarray as xr

        variables: dict[str, Any] = {}
        for i, name in enumerate(self.channels):
            c = channel(name)
            attributes = {"units": c.unit, "long_name": c.description}
            variables[name] = ("t", self.data[:, i], attributes)
            if not self.valid[:, i].all():
                variables[name + "_valid"] = ("t", self.valid[:, i].astype(np.int8), {"long_name": f"{name} was sampled"})
        attrs = {
            "format": FORMAT,
            "channels": " ".join(self.channels),
            "kind": self.kind,
            "outcome": self.outcome,
            "reason": self.reason,
            "provenance": json.dumps(dict(self.provenance), sort_keys=True),
        }
        return xr.Dataset(variables, coords={"t": ("t", self.t_s, {"units": "s", "long_name": "time"})}, attrs=attrs)

    def save(self, path: Path | str) -> Path:
        """Write the record as NetCDF (readable by xarray, with units) and return the path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")  # so that a killed process never leaves half a record
        self.to_xarray().to_netcdf(part, engine="h5netcdf")
        part.replace(path)
        return path

    def save_csv(self, path: Path | str) -> Path:
        """Write time and channels as CSV, units in the header (``q [rad/s]``), 17 significant digits."""
        path = Path(path)
        header = ",".join(["t [s]", *(f"{n} [{channel(n).unit}]" for n in self.channels)])
        table = np.column_stack([self.t_s, np.where(self.valid, self.data, np.nan)])
        np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")
        return path


def load_record(path: Path | str) -> FlightRecord:
    """Read a record written by :meth:`FlightRecord.save`.

    Raises:
        RecordError: the file is missing, damaged or not a record of the testbench.
    """
    import xarray as xr

    path = Path(path)
    if not path.is_file():
        raise RecordError(f"a record file must exist, got '{path}'")
    try:
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            data = stored.load()
    except (OSError, ValueError, KeyError, RuntimeError, EOFError) as error:
        raise RecordError(f"'{path}' must be a NetCDF record, but it cannot be read: {str(error).splitlines()[0]}") from error
    if data.attrs.get("format") != FORMAT:
        raise RecordError(f"'{path}' must carry format = '{FORMAT}', got {data.attrs.get('format')!r}")
    names = tuple(str(data.attrs["channels"]).split())
    n = data.sizes["t"]
    values = np.column_stack([data[name].values for name in names]) if names else np.empty((n, 0))
    valid = [data[k].values.astype(bool) if (k := name + "_valid") in data else np.ones(n, bool) for name in names]
    return FlightRecord(
        t_s=data["t"].values,
        channels=names,
        data=values,
        kind=data.attrs["kind"],
        valid=np.column_stack(valid) if names else np.empty((n, 0), bool),
        provenance=json.loads(data.attrs["provenance"]),
        outcome=data.attrs["outcome"],
        reason=data.attrs["reason"],
    )
