"""The layout of recorded flights in files: the file, the channel and unit of each column, and the times."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from testbench.core.channels import channel, unit_factor
from testbench.core.errors import ChannelError, RecordError, excerpt
from testbench.core.scenario.base import Asked
from testbench.core.schema import NonNegative, Positive, Strict

ENVIRONMENT = "TESTBENCH_FLIGHT_DATA"


Format = Literal["csv", "text", "mat", "parquet", "netcdf"]


SUFFIXES: dict[str, Format] = {
    ".csv": "csv",
    ".tsv": "csv",
    ".txt": "text",
    ".asc": "text",
    ".dat": "text",
    ".log": "text",
    ".mat": "mat",
    ".parquet": "parquet",
    ".nc": "netcdf",
    ".h5": "netcdf",
    ".hdf5": "netcdf",
}
"""The format that a file has if its description does not say it."""


_OPTIONS: dict[str, tuple[Format, ...]] = {
    "variable": ("mat",),
    "header": ("csv", "text"),
    "skip_rows": ("csv", "text"),
    "delimiter": ("csv", "text"),
    "decimal": ("csv", "text"),
}


def _column(key: Any) -> Any:
    if isinstance(key, bool) or not isinstance(key, (int, str)) or key == "" or (isinstance(key, int) and key < 1):
        raise ValueError(f"must be a column's name, or its number counted from 1, got {key!r}")
    return key


def _known_channel(name: str) -> str:
    try:
        return channel(name).name
    except ChannelError as error:
        raise ValueError(error.message) from None


ColumnKey = Annotated[int | str, BeforeValidator(_column)]


ChannelName = Annotated[str, AfterValidator(_known_channel)]


Text = Annotated[str, Field(min_length=1)]


Segment = Annotated[tuple[float, float], Field(strict=False)]


class TimeColumn(Strict):
    """The times of the samples: a column of the file in ``unit``, or a constant rate from 0 on.

    A column of dates or times of the day needs no unit and is counted from its first sample.
    ``zero_s`` is the time of the file, in s, that is called 0 in the record and in the segments.
    """

    column: ColumnKey | None = None
    unit: Literal["s", "ms", "us", "ns", "min", "h", "d"] = "s"
    rate_hz: Positive | None = None
    zero_s: float = 0.0

    @model_validator(mode="after")
    def _one_clock(self) -> TimeColumn:
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("give either column (with its unit) or, for a file without times, rate_hz")
        return self


class RecordCondition(Strict):
    """The condition of a flight as far as the records lack it; given values have priority over recorded ones.

    Airspeed is true. The air is that of ``density_kg_m3``, else of the height in the standard atmosphere, at
    ``temperature_degC`` if that is given. Mass and inertia about the centre of gravity are the aircraft's where they
    are not given; Ixz is positive as in JSBSim's file.
    """

    V_m_s: Positive | None = None
    h_m: Annotated[float, Field(ge=-500.0, le=11000.0)] | None = None
    temperature_degC: Annotated[float, Field(gt=-100.0, lt=70.0)] | None = None
    density_kg_m3: Positive | None = None
    mass_kg: Positive | None = None
    Ixx_kg_m2: Positive | None = None
    Iyy_kg_m2: Positive | None = None
    Izz_kg_m2: Positive | None = None
    Ixz_kg_m2: float | None = None

    @model_validator(mode="after")
    def _one_air(self) -> RecordCondition:
        if self.density_kg_m3 is not None and self.temperature_degC is not None:
            raise ValueError("give either density_kg_m3 or temperature_degC (with a height), got both")
        return self

    def within(self, other: RecordCondition) -> RecordCondition:
        """Return this condition with what it does not give taken from ``other``."""
        own = {key: value for key, value in self.model_dump().items() if value is not None}
        air = ("density_kg_m3", "temperature_degC")
        rest = other.model_dump(exclude=set(air) if any(key in own for key in air) else None)
        return RecordCondition(**{**rest, **own})


class RecordFile(Strict):
    """One file, how it is read, and its use.

    ``segments`` are [first, last] times in s, both included, that must not be joined: each becomes a record of its own.
    ``condition`` goes before the condition of the description.
    """

    name: Text
    file: Text
    use: Literal["identification", "validation", "split"]
    format: Format | None = None
    variable: Text | None = None
    header: Literal["auto", "none"] = "auto"
    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    segments: Annotated[tuple[Segment, ...], Field(strict=False)] = ()
    condition: RecordCondition = RecordCondition()

    @model_validator(mode="after")
    def _readable(self) -> RecordFile:
        if self.format is None and Path(self.file).suffix.lower() not in SUFFIXES:
            raise ValueError(f"the suffix of '{self.file}' must be one of {', '.join(SUFFIXES)}, or format be given")
        for key, formats in _OPTIONS.items():
            if key in self.model_fields_set and self.kind_of_file not in formats:
                raise ValueError(
                    f"the key {key} is for format {' or '.join(formats)}, got format '{self.kind_of_file}'"
                )
        for start, end in self.segments:
            if not start < end:
                raise ValueError(f"a segment must be [first, last] with first < last, got [{start:g}, {end:g}]")
        return self

    @property
    def kind_of_file(self) -> Format:
        """The format given, else that of the suffix."""
        return self.format or SUFFIXES[Path(self.file).suffix.lower()]

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the records that come from this file, one per segment."""
        if len(self.segments) < 2:
            return (self.name,)
        return tuple(f"{self.name}_{i}" for i in range(1, len(self.segments) + 1))


class ChannelColumn(Strict):
    """A channel and its column: SI value = factor of unit * (scale * (column - minus_column) + offset).

    ``missing`` says what happens to a sample that is empty or NaN: "error", or "mask" (hold the last value and mark
        it).
    """

    name: ChannelName
    column: ColumnKey
    minus_column: ColumnKey | None = None
    unit: Text
    scale: float = 1.0
    offset: float = 0.0
    missing: Literal["error", "mask"] = "error"

    @model_validator(mode="after")
    def _unit_and_scale(self) -> ChannelColumn:
        try:
            unit_factor(self.name, self.unit)
        except ChannelError as error:
            raise ValueError(error.message) from None
        if self.scale == 0.0:
            raise ValueError("scale must differ from 0: it would make the channel a constant")
        return self


class Recorded(Asked):
    """Recorded flights: files, columns, units and uses, their source, and who may use them.

    Every record, and every segment of one, begins with ``trim_s`` of undisturbed flight.
    """

    unnamed: ClassVar[str] = "records"

    source: Text
    rights: Text
    folder: Text = "."
    trim_s: NonNegative = 0.0
    condition: RecordCondition = RecordCondition()
    time: TimeColumn
    record: Annotated[tuple[RecordFile, ...], Field(min_length=1, strict=False)]
    channel: Annotated[tuple[ChannelColumn, ...], Field(min_length=1, strict=False)]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that every record holds."""
        return tuple(column.name for column in self.channel)


def find_data_folder(description: Recorded, given: Path | str | None = None) -> Path:
    """Return the folder that the files of ``description`` lie in.

    It is ``given`` (the option ``--data``). Otherwise it is the description's ``folder``, relative to the description
    file, if that holds the first record; otherwise the environment variable TESTBENCH_FLIGHT_DATA. So the variable
    finds the records of packaged descriptions and does not change your own descriptions.

    Raises:
        RecordError: the folder does not exist; the message says where it was looked for and how to set it.
    """
    base = description.file.parent if description.file else Path()
    folder, origin = (base / description.folder).resolve(), f"folder = '{description.folder}'"
    if given is not None:
        folder, origin = Path(given), "--data"
    elif os.environ.get(ENVIRONMENT) and not (folder / description.record[0].file).is_file():
        folder, origin = Path(os.environ[ENVIRONMENT]), f"the environment variable {ENVIRONMENT}"
    if not folder.is_dir():
        files = ", ".join(dict.fromkeys(record.file for record in description.record))
        raise RecordError(
            f"the data folder of '{description.name}' must exist, got '{folder}' from {origin}; it must hold {files}; "
            f"obtain them ({excerpt(description.rights)}) and give --data FOLDER, or set {ENVIRONMENT}, "
            "or correct folder in the description"
        )
    return folder
