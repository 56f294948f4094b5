"""FlightRecord: sampled channels of one flight, with validity, provenance and outcome; NetCDF on disk.

NetCDF keeps everything of a record. CSV, Parquet and MAT are tables for other programs: time and channels with their
units, a sample that was not taken as NaN (null in Parquet).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel, require
from testbench.core.door import memory_of, opened, require_room
from testbench.core.errors import RecordError, Refusal, located, missing
from testbench.core.files import mat_bytes, netcdf_bytes, parsed, write_file

FORMAT = "testbench-record-1"
Kind = Literal["truth", "measured"]
Outcome = Literal["completed", "aborted"]
FloatArray = NDArray[np.float64]
NEEDS_MCAP = ("recordings in MCAP need mcap", "mcap")
"""What needs a package, and the extra that brings it, for :func:`testbench.core.errors.missing`."""
NEEDS_PYARROW = ("Parquet files need pyarrow", "parquet")
_MASK = "_valid"
_TIME = {"units": "s", "long_name": "time"}


_ARRAYS = ("t_s", "data", "valid")


def _frozen(name: str, array: Any, dtype: type = np.float64) -> NDArray[Any]:
    if np.asarray(array).dtype.kind == "c":  # numpy would drop the imaginary part with a warning only
        raise RecordError(f"{name} must be real numbers, got complex ones")
    try:
        out: NDArray[Any] = np.array(array, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise RecordError(f"{name} must be an array of numbers, got: {error}") from error
    out.setflags(write=False)
    return out


AS_DESIGNED = "commanded_as_designed"
"""Of a record's provenance: likeness of its commands to those of a plan made before the flight (1: the same)."""


def _plain(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``provenance`` as JSON gives it back, so that a record read from disk equals the one written."""
    try:
        return dict(json.loads(json.dumps(dict(provenance), sort_keys=True, allow_nan=False)))
    except (TypeError, ValueError) as error:
        raise RecordError(
            f"provenance must hold JSON values only (text, finite numbers, lists), got: {error}"
        ) from error


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
        RecordError: shapes disagree, times do not increase, a value is not finite, kind or outcome is not one of the
            above, an aborted record gives no reason, or the provenance is not JSON.
        ChannelError: a channel is not in the table.

    Example:
        >>> import testbench as tb
        >>> record = tb.FlightRecord([0.0, 0.1, 0.2], ("q",), [[0.0], [0.1], [0.0]], "measured")
        >>> record["q"].tolist()
        [0.0, 0.1, 0.0]
    """

    t_s: FloatArray
    channels: tuple[str, ...]
    data: FloatArray
    kind: Kind
    valid: NDArray[np.bool_] = None  # type: ignore[assignment]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    outcome: Outcome = "completed"
    reason: str = ""

    def __post_init__(self) -> None:
        t, data = _frozen("t_s", self.t_s), _frozen("data", self.data)
        names = tuple(self.channels)
        valid = _frozen("valid", np.ones(data.shape, bool) if self.valid is None else self.valid, bool)
        if t.ndim != 1 or data.shape != (t.size, len(names)) or valid.shape != data.shape:
            raise RecordError(
                f"data and valid must have shape (samples, channels) = ({t.size}, {len(names)}), "
                f"got {data.shape} and {valid.shape}"
            )
        if len(set(names)) != len(names):
            raise RecordError(f"channel names must differ, got {', '.join(names)}")
        for name in names:
            channel(name)
        for key, allowed in (("kind", get_args(Kind)), ("outcome", get_args(Outcome))):
            if getattr(self, key) not in allowed:
                raise RecordError(f"{key} must be {' or '.join(allowed)}, got {getattr(self, key)!r}")
        if self.outcome == "aborted" and not self.reason:
            raise RecordError("an aborted record must give its reason, got none")
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
        object.__setattr__(self, "provenance", MappingProxyType(_plain(self.provenance)))

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
        for name in _ARRAYS:  # pickle forgets that they are read-only
            state[name].setflags(write=False)
        object.__setattr__(self, "provenance", MappingProxyType(state["provenance"]))

    @cached_property
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
        """Return the first ``fraction`` of the samples and the rest as two records.

        Raises:
            RecordError: fraction is not between 0 and 1, or one part would hold no sample.
        """
        if not 0.0 < fraction < 1.0:
            raise RecordError(f"0 < fraction < 1 must hold to split a record, got {fraction}")
        cut = round(fraction * len(self))
        rows = np.arange(len(self))
        return self._rows(rows < cut, "the first part"), self._rows(rows >= cut, "the second part")

    def decimate(self, stride: int) -> FlightRecord:
        """Return every ``stride``-th sample from the first on; no filter is applied.

        Raises:
            RecordError: stride is not a whole number of at least 1, or the record is empty.
        """
        if stride < 1 or stride != int(stride):
            raise RecordError(f"a stride must be a whole number of at least 1, got {stride}")
        return self._rows(np.arange(len(self)) % stride == 0, f"every {stride}th sample")

    def _rows(self, rows: NDArray[np.bool_], what: str) -> FlightRecord:
        if not rows.any():
            extent = f"{self.t_s[0]:g} to {self.t_s[-1]:g} s" if len(self) else "an empty record"
            raise RecordError(f"a part of a record must hold samples, got none in {what} of {extent}")
        return replace(self, t_s=self.t_s[rows], data=self.data[rows], valid=self.valid[rows])

    def with_columns(self, columns: Mapping[str, FloatArray]) -> FlightRecord:
        """Return a record in which the given channels (each (n,)) replace those of the same name or are added.

        A channel that is replaced keeps its validity; one that is added is valid throughout.

        Raises:
            RecordError: a column is not of shape (n,).
            ChannelError: a channel is not in the table.
        """
        names = (*self.channels, *(name for name in columns if name not in self.channels))
        for name, column in columns.items():
            if np.shape(column) != (len(self),):
                raise RecordError(f"channel '{name}' must have shape ({len(self)},), got {np.shape(column)}")
        data = np.empty((len(self), len(names)))
        for i, name in enumerate(names):
            data[:, i] = columns[name] if name in columns else self.data[:, i]
        valid = np.ones(data.shape, bool)
        valid[:, : len(self.channels)] = self.valid
        return replace(self, channels=names, data=data, valid=valid)

    def _attributes(self) -> dict[str, str]:
        return {
            "format": FORMAT,
            "channels": " ".join(self.channels),
            "kind": self.kind,
            "outcome": self.outcome,
            "reason": self.reason,
            "provenance": json.dumps(dict(self.provenance), sort_keys=True),
        }

    def _variables(self) -> dict[str, tuple[NDArray[Any], dict[str, str]]]:
        """Return what NetCDF holds: a variable per channel, and its mask where samples are missing, with attributes."""
        out: dict[str, tuple[NDArray[Any], dict[str, str]]] = {}
        for i, name in enumerate(self.channels):
            c = channel(name)
            out[name] = self.data[:, i], {"units": c.unit, "long_name": c.description}
            if not self.valid[:, i].all():
                out[name + _MASK] = self.valid[:, i].astype(np.int8), {"long_name": f"{name} was sampled"}
        return out

    def to_xarray(self) -> Any:
        """Return the record as an xarray Dataset: one variable per channel with units, ``t`` as coordinate."""
        import xarray as xr

        variables = {name: ("t", values, attrs) for name, (values, attrs) in self._variables().items()}
        return xr.Dataset(variables, coords={"t": ("t", self.t_s, dict(_TIME))}, attrs=self._attributes())

    def save(self, path: Path | str) -> Path:
        """Write the record as NetCDF-4 (readable by xarray, with units), without loss, and return the path.

        Raises:
            WriteError: the file cannot be written.
        """

        def fill(file: Any) -> None:
            """Fill the NetCDF file; by h5netcdf, because xarray takes several times as long on many small variables."""
            file.dimensions = {"t": len(self)}
            file.attrs.update(self._attributes())
            for name, (values, attributes) in {"t": (self.t_s, _TIME), **self._variables()}.items():
                file.create_variable(name, ("t",), data=values).attrs.update(attributes)

        return _write(Path(path), netcdf_bytes(fill))

    def save_csv(self, path: Path | str) -> Path:
        """Write time and channels as CSV, units in the header (``q [rad/s]``), 17 significant digits; return the path.

        Raises:
            WriteError: the file cannot be written.
        """
        header = ",".join(["t [s]", *(f"{n} [{channel(n).unit}]" for n in self.channels)])
        table = np.column_stack([self.t_s, self._with_gaps()])
        return _write(
            Path(path), lambda part: np.savetxt(part, table, delimiter=",", header=header, comments="", fmt="%.17g")
        )

    def save_mat(self, path: Path | str) -> Path:
        """Write time ``t`` and each channel as a column of its own in a MAT file (version 5), and return the path.

        ``units`` is a structure with the unit of each channel, ``testbench`` holds kind, outcome, reason and
        provenance as JSON text.

        Raises:
            WriteError: the file cannot be written.
        """

        columns = dict(zip(self.channels, self._with_gaps().T, strict=True))
        units = {"t": "s"} | {name: channel(name).unit for name in self.channels}
        content = {"t": self.t_s, **columns, "units": units, "testbench": json.dumps(self._attributes())}
        return _write(Path(path), mat_bytes(content, FORMAT, oned_as="column"))

    def save_parquet(self, path: Path | str) -> Path:
        """Write time ``t`` and channels as Parquet, unit in each field's metadata (``unit``), and return the path.

        Raises:
            WriteError: the file cannot be written.
            RecordError: pyarrow is not installed.
        """
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError as error:
            raise RecordError(missing(*NEEDS_PYARROW)) from error
        fields = [pa.field("t", pa.float64(), metadata={"unit": "s"})]
        fields += [pa.field(name, pa.float64(), metadata={"unit": channel(name).unit}) for name in self.channels]
        columns = [pa.array(self.t_s)]
        columns += [pa.array(self.data[:, i], mask=~self.valid[:, i]) for i in range(len(self.channels))]
        schema = pa.schema(fields, metadata={"testbench": json.dumps(self._attributes())})
        return _write(Path(path), lambda part: pq.write_table(pa.table(columns, schema=schema), part))

    def save_mcap(self, path: Path | str) -> Path:
        """Write the samples as messages in JSON of a recording in MCAP, and return the path.

        Each channel has a topic of its own, ``/NAME``, with ``value`` and, in its schema, its unit: a viewer draws
        what was taken, and no more. The clock begins at 0 s with that of the record, whose own may begin before; the
        metadata ``testbench`` hold kind, outcome, reason and provenance as JSON text.

        Raises:
            WriteError: the file cannot be written.
            RecordError: mcap is not installed.
        """
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise RecordError(missing(*NEEDS_MCAP)) from error

        def fill(part: Path) -> None:
            """Write the messages in the order of their times."""
            with part.open("wb") as file:
                writer = Writer(file)
                writer.start(profile="", library="testbench")
                topics = []
                for name in self.channels:
                    unit = channel(name).unit
                    value = {"type": "number", "description": f"{channel(name).description}, {unit}", "unit": unit}
                    schema = json.dumps({"type": "object", "properties": {"value": value}}).encode()
                    of = writer.register_schema(name=name, encoding="jsonschema", data=schema)
                    topics.append(writer.register_channel(topic=f"/{name}", message_encoding="json", schema_id=of))
                begin = min(0.0, float(self.t_s[0]))
                for t, row, taken in zip(self.t_s - begin, self.data.tolist(), self.valid, strict=True):
                    ns = round(1e9 * float(t))
                    for topic, value, is_taken in zip(topics, row, taken, strict=True):
                        if is_taken:
                            told = json.dumps({"value": value}).encode()
                            writer.add_message(channel_id=topic, log_time=ns, publish_time=ns, data=told)
                writer.add_metadata("testbench", {"record": json.dumps(self._attributes())})
                writer.finish()

        return _write(Path(path), fill)

    def _with_gaps(self) -> FloatArray:
        return np.where(self.valid, self.data, np.nan)


def _write(path: Path, content: bytes | Callable[[Path], object]) -> Path:
    return write_file(path, content, "a record must be written to a folder that can be written to")


def load_record(path: Path | str) -> FlightRecord:
    """Read a record written by :meth:`FlightRecord.save`.

    Raises:
        RecordError: the file is missing, damaged or not a record of the testbench; the message names the file.
        SizeError: it takes more memory than the limit of :mod:`testbench.core.door`.

    Example:
        >>> import testbench as tb
        >>> record = tb.load_record("results/eolo_alpha/records/doublet_eolo_alpha.nc")  # doctest: +SKIP
        >>> record.channels, record.dt_s  # doctest: +SKIP
    """
    path = Path(path)
    with parsed(path, "a NetCDF record"), opened(path) as file:
        form = file.attrs.get("format")
        if not isinstance(form, str) or form != FORMAT:
            raise RecordError(f"'{path}' must carry format = '{FORMAT}', got {str(form)[:60]!r}")
        stated: dict[str, Any] = {key: str(file.attrs[key]) for key in ("kind", "outcome", "reason")}
        provenance = dict(json.loads(file.attrs["provenance"]))
        names = tuple(file.attrs["channels"].split())
        wanted = [n for name in ("t", *names) for n in (name, name + _MASK) if n == name or n in file]
        require_room(f"the record '{path}'", memory_of(file[n] for n in wanted), "cut it into parts")
        values = {name: file[name][()] for name in wanted}
    with located(path, "record"):
        t = values["t"]
        if any(np.shape(column) != np.shape(t) for column in values.values()):
            raise RecordError(f"every channel must hold {np.size(t)} samples, as t does")
        if any(np.asarray(column).dtype.kind not in "fiub" for column in values.values()):
            raise RecordError("every channel must hold real numbers")
        if len(set(names)) != len(names):
            raise RecordError("channel names must differ")
        masks = [values.get(name + _MASK) for name in names]
        columns = [values.pop(name) for name in names]
        shape = (np.size(t), len(names))
        data, valid = np.empty(shape), np.ones(shape, bool)
        for i, mask in enumerate(masks):
            data[:, i], columns[i] = columns[i], None  # an hour at a high rate is not held twice
            if mask is not None:
                valid[:, i] = mask
        return FlightRecord(t_s=t, channels=names, data=data, valid=valid, provenance=provenance, **stated)


class FlightAborted(Refusal):
    """A simulated flight ended before its manoeuvre did; ``record`` holds what was flown until then."""

    exit_status = 3

    def __init__(self, message: str, time_s: float, reason: str, record: FlightRecord | None = None) -> None:
        super().__init__(message)
        self.time_s = time_s
        self.reason = reason
        self.record = record
