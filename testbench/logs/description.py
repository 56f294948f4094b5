"""Descriptions of recorded flights: TOML in, frozen RecordDescription out, every fault of a file reported at once.

A description says where the files lie, which column is which channel in which unit, what each record is used for and
what is identified from it. It holds no code; a scenario's ``preparation`` and ``identification`` mean the same here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, model_validator

from testbench.channels import channel, unit_factor
from testbench.errors import ChannelError, RecordError, ScenarioError, nearest
from testbench.paths import find_scenario
from testbench.scenario import Identification, Preparation
from testbench.schema import NonNegative, Positive, Strict, parse, read_toml

ENVIRONMENT = "TESTBENCH_FLIGHT_DATA"
Format = Literal["csv", "text", "mat", "parquet", "netcdf"]
SUFFIXES: dict[str, Format] = {
    ".csv": "csv",
    ".txt": "text",
    ".asc": "text",
    ".dat": "text",
    ".mat": "mat",
    ".parquet": "parquet",
    ".nc": "netcdf",
}
"""The format that a file has if its description does not say it."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
_OPTIONS: dict[str, tuple[Format, ...]] = {
    "variable": ("mat",),
    "header": ("csv", "text"),
    "skip_rows": ("csv", "text"),
    "delimiter": ("csv",),
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
    """When the samples were taken: a column of the file in ``unit``, or a constant rate from 0 on.

    ``zero_s`` is the time of the file, in s, that is called 0 in the record and in the segments.
    """

    column: ColumnKey | None = None
    unit: Literal["s", "ms", "us", "ns", "min", "h"] = "s"
    rate_hz: Positive | None = None
    zero_s: float = 0.0

    @model_validator(mode="after")
    def _one_clock(self) -> TimeColumn:
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("give either column (with its unit) or, for a file without times, rate_hz")
        return self


class RecordFile(Strict):
    """One file, how it is read, and what it is used for.

    ``segments`` are [first, last] times in s, both included, that must not be joined: each becomes a record of its own.
    """

    name: Text
    file: Text
    use: Literal["identification", "validation", "split"]
    format: Format | None = None
    variable: Text | None = None
    header: Literal["auto", "none"] = "auto"
    skip_rows: Annotated[int, Field(ge=0)] = 0
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    segments: Annotated[tuple[Segment, ...], Field(strict=False)] = ()

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
    """A channel, and the column that holds it: SI value = factor of unit * (scale * (column - minus_column) + offset).

    ``missing`` says what a sample means that is empty or NaN: "error", or "mask" (hold the last value and mark it).
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


class Reference(Strict):
    """Printed results that a report shows beside what was found, and where they are printed.

    ``values`` are in SI units and radians; "wn_rad_s" and "zeta" are a mode's natural frequency and damping ratio.
    """

    source: Text
    values: Annotated[dict[str, float], Field(min_length=1)]


class RecordDescription(Strict):
    """Recorded flights: files, columns, units, uses, and what is identified from them.

    Every record, and every segment of one, begins with ``trim_s`` of undisturbed flight, over which the bias "trim" of
    the preparation is taken.
    """

    title: Text
    question: str = ""
    source: Text
    rights: Text
    folder: Text = "."
    trim_s: NonNegative = 0.0
    time: TimeColumn
    record: Annotated[tuple[RecordFile, ...], Field(min_length=1, strict=False)]
    channel: Annotated[tuple[ChannelColumn, ...], Field(min_length=1, strict=False)]
    preparation: Preparation = Preparation(bias="mean")
    identification: Identification
    reference: Reference | None = None
    _file: Path | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """The file that the description was read from."""
        return self._file

    @property
    def name(self) -> str:
        """The file's stem, or "records"; names the results folder."""
        return self._file.stem if self._file else "records"

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that every record holds."""
        return tuple(column.name for column in self.channel)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs to identify: those listed, else every channel that is not an input."""
        given = self.identification.outputs
        return given or tuple(name for name in self.channels if name not in self.identification.inputs)

    @property
    def reference_values(self) -> dict[str, float | str]:
        """The printed results by name, and under "source" where they are printed; empty if there are none."""
        return {} if self.reference is None else {"source": self.reference.source, **self.reference.values}


def load_description(path: Path | str) -> RecordDescription:
    """Read a description of recorded flights.

    ``path`` is a file, or the name of a packaged description such as ``attas_short_period``.

    Raises:
        ScenarioError: the file breaks a law; the message lists every fault with file and key.
        RecordError: the file does not exist or cannot be read.
    """
    file = find_scenario(path)
    if not file.exists():
        packaged = find_scenario(Path("scenarios", "records", Path(path).name))
        file = packaged if packaged.exists() else file
    content = read_toml(file)
    description, faults = parse(RecordDescription, content, file)
    if description is not None:
        faults += [f"{file}, {fault}" for fault in _broken_laws(description)]
    if faults or description is None:
        raise ScenarioError(faults)
    description.__pydantic_private__ = {"_file": file}
    return description


def _broken_laws(description: RecordDescription) -> Iterator[str]:
    """Yield what is wrong between the parts of a description that are each right: key, law, value."""
    records, channels = description.record, description.channels
    uses = [record.use for record in records]
    if "split" not in uses and not {"identification", "validation"} <= set(uses):
        yield "record: records must include use = 'identification' and 'validation', or one with use = 'split'"
    for what, names in (("record", [part for record in records for part in record.parts]), ("channel", channels)):
        for name in sorted({name for name in names if list(names).count(name) > 1}):
            yield f"{what}: names must differ (segments are named NAME_1, NAME_2), got '{name}' more than once"
    pieces = [(record, *piece) for record in records for piece in (record.segments or ((-float("inf"), float("inf")),))]
    for (first, start, end), (second, other_start, other_end) in combinations(pieces, 2):
        same = (first.file, first.variable) == (second.file, second.variable)
        if same and start <= other_end and other_start <= end:
            yield (
                f"record.segments: no sample may be used twice, but '{first.name}' ({first.use}) and '{second.name}' "
                f"({second.use}) overlap in {first.file}; give segments apart from each other"
            )
    for key in ("inputs", "outputs"):
        for name in getattr(description.identification, key):
            if name not in channels:
                hint = nearest(name, channels)
                yield f"identification.{key}: must be among the channels described, got '{name}'{hint}"
    both = set(description.identification.inputs) & set(description.identification.outputs)
    if both:
        yield f"identification.outputs: an input cannot be an output too, got {', '.join(sorted(both))}"
    if not description.outputs:
        yield "identification.outputs: there must be an output, but every channel described is an input"
    if description.preparation.bias == "trim" and description.trim_s == 0.0:
        yield "trim_s: must be > 0 where preparation.bias = 'trim', got 0; give it, or take bias = 'mean' or 'trend'"


def find_data_folder(description: RecordDescription, given: Path | str | None = None) -> Path:
    """Return the folder that the files of ``description`` lie in.

    It is ``given`` (the option ``--data``), else the description's ``folder``, taken relative to the description file,
    if it holds the first record, else the environment variable TESTBENCH_FLIGHT_DATA: the variable finds records that
    do not lie where a packaged description expects them, and leaves everybody's own descriptions alone.

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
            f"obtain them ({description.rights}) and give --data FOLDER, or set {ENVIRONMENT}, "
            "or correct folder in the description"
        )
    return folder
