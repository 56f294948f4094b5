"""The catalogue of writers: a TOML file each in writers/, and those of the user, say what columns of a table mean.

A file names the columns by which its writer is recognised, and for each column that general names do not tell (see
names.py) the channel, the unit, sign and offset: what a writer gives in a way of its own. Users add writers in a folder
``writers`` beside the log or where they work; theirs go before the packaged ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.core.channels import SURFACES, unit_factor
from testbench.core.door import read_toml
from testbench.core.errors import ChannelError, ScenarioError
from testbench.core.schema import Strict, parse
from testbench.logs.layout import ChannelName, Text
from testbench.logs.names import THROWS, Meaning, label_of
from testbench.logs.tables import Table

_PACKAGED = Path(__file__).parent / "writers"
FOLDER = "writers"
"""Name of the folders in which users have theirs."""
Texts = Annotated[tuple[Text, ...], Field(strict=False)]


class WriterTime(Strict):
    """The column of times, and its unit."""

    column: Text
    unit: Literal["s", "ms", "us", "ns", "min", "h", "d"] = "s"


class WriterColumn(Strict):
    """A column and its channel: SI value = factor of unit * (scale * column + offset).

    A surface, or its command, may be in "norm" or "%": a part of full throw. ``assumed`` says what the file does not.
    """

    name: ChannelName
    column: Text
    unit: Text
    scale: float = 1.0
    offset: float = 0.0
    assumed: str = ""

    @model_validator(mode="after")
    def _unit_fits(self) -> WriterColumn:
        try:
            if not (self.unit in THROWS and self.name.removesuffix("_cmd") in SURFACES):
                unit_factor(self.name, self.unit)
        except ChannelError as error:
            raise ValueError(error.message) from None
        return self

    @property
    def meaning(self) -> Meaning:
        """What the column means."""
        return Meaning(self.name, self.unit, self.scale, self.offset, self.assumed)


class Writer(Strict):
    """A writer of tables.

    For a table to be of it all ``columns`` must be there, and one of ``one_of``. ``ignore`` are columns that are called
    as a channel and are none. Names are compared as written but for case, blanks, brackets with units, and the path
    before the last dot.
    """

    title: Text
    source: Text
    columns: Texts = ()
    one_of: Texts = ()
    ignore: Texts = ()
    vehicle: Literal["", "fixed wing", "VTOL", "rotorcraft", "other"] = ""
    time: WriterTime | None = None
    channel: Annotated[tuple[WriterColumn, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _recognised(self) -> Writer:
        if not (self.columns or self.one_of):
            raise ValueError("give columns, or one_of, by which a table of this writer is recognised")
        return self

    def wrote(self, table: Table) -> bool:
        """Say whether a table has the columns by which this writer is recognised."""
        held = set(_labels(table))
        one = not self.one_of or any(label_of(name) in held for name in self.one_of)
        return one and {label_of(name) for name in self.columns} <= held

    def meanings(self, table: Table) -> dict[int, Meaning | None]:
        """Return column, from 0 -> what it means by this writer, None if it is no channel; in the order of the file."""
        labels = _labels(table)
        out: dict[int, Meaning | None] = {}
        for column in self.channel:
            key = label_of(column.column)
            if key in labels:
                out.setdefault(labels.index(key), column.meaning)
        return out | {labels.index(key): None for name in self.ignore if (key := label_of(name)) in labels}

    def clock(self, table: Table) -> int | None:
        """Return the column, from 0, that counts time by this writer; None if it does not say so."""
        labels = _labels(table)
        key = label_of(self.time.column) if self.time else ""
        return labels.index(key) if key in labels else None


def writer_of(table: Table) -> Writer | None:
    """Return the writer of a table, the one with most columns by which it is recognised; None if none is known.

    Raises:
        ScenarioError: a file of the user is wrong.
    """
    for folder in dict.fromkeys((table.file.resolve().parent / FOLDER, Path.cwd() / FOLDER, _PACKAGED)):
        found = [writer for writer in writers_in(folder) if writer.wrote(table)]
        if found:
            return max(found, key=lambda writer: len(writer.columns))
    return None


def _labels(table: Table) -> Sequence[str]:
    return [label_of(name.rpartition(".")[2] or name) for name in table.names]


@cache
def writers_in(folder: Path) -> tuple[Writer, ...]:
    """Return the writers that the TOML files of a folder describe.

    Raises:
        RecordError, ScenarioError: a file cannot be read, or breaks its schema.
    """
    out = []
    for file in sorted(folder.glob("*.toml")):
        writer, faults = parse(Writer, read_toml(file, "writer"), file)
        if writer is None or faults:
            raise ScenarioError("\n".join(faults))
        out.append(writer)
    return tuple(out)
