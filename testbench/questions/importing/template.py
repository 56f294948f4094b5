"""A description to fill in, made from the table itself: its columns, what they hold, and what to add.

In a folder ``writers`` it is the description of a writer: of all tables whose columns are called as those of this one.

A table without names shows only its numbers, so its owner must say which column is which channel. The description
proposes what the file shows: names of channels in the header, stated units, a column that counts time.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.channels import CHANNELS, CONTROLS, UNITS, channel
from testbench.core.constants import DEG_RAD
from testbench.core.door import open_file
from testbench.core.errors import RecordError
from testbench.core.escape import one_line
from testbench.core.paths import not_found
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.catalogue import FOLDER as WRITERS
from testbench.logs.foreign import HEAD, refuse_foreign
from testbench.logs.layout import SUFFIXES
from testbench.logs.mat import read_mat
from testbench.logs.names import clock_called, meaning, time_unit
from testbench.logs.signals import DEFAULT_THROW_RAD
from testbench.logs.structures import candidates
from testbench.logs.tables import Table, read_table
from testbench.logs.times import clock_unit, find_clock, holds_stamps, read_times
from testbench.questions.files import write_to_edit
from testbench.questions.importing.recipe import FEWEST, moving, propose
from testbench.questions.importing.recipe import lines as recipe_lines

_EVEN = 0.5  # steps of a column that counts time differ from the usual one by less than this share, but for gaps
_MOST_GAPS = 6
_MOST_PATHS = 40  # of a MAT file, tried for samples
_RATES = ("fs", "rate", "rate_hz", "fs_hz", "sampling_rate", "sample_rate", "sampling_frequency")


class _Clock(NamedTuple):
    """The column, counted from 1, that may count time, its unit, pieces without gaps, first to last s, and all s."""

    number: int
    unit: str
    pieces: tuple[tuple[float, float], ...]
    t_s: FloatArray


def write_template(path: Path | str, out: Path | str) -> Path:
    """Write the template for the table ``path`` to ``out`` and return that: of its writer in a folder ``writers``.

    Raises:
        RecordError: the table cannot be read, or ``out`` exists.
        WriteError: ``out`` cannot be written.
    """
    path, out = Path(path), Path(out)
    if out.suffix.lower() != ".toml":
        raise RecordError(f"a description must be a .toml file, got '{out}'")
    if out.resolve().parent.name == WRITERS:
        return write_to_edit(out, writer_template(path), "writer", "the form of a writer to fill in")
    folder = os.path.relpath(path.resolve().parent, out.resolve().parent)
    kind = "description of recorded flights"
    return write_to_edit(out, description_template(path, folder), kind, "a description to fill in")


def description_template(path: Path | str, folder: str = ".") -> str:
    """Return a description (TOML) of the table ``path`` in ``folder`` whose channels are still to be named.

    Raises:
        RecordError: the file is missing, no table, or cannot be read.
    """
    path = Path(path)
    table, variable, others = _read(path)
    columns = [table.numbers(i + 1) for i in range(len(table.names))]
    clock = _clock(table, columns)
    q = json.dumps
    lines = [
        f"# {one_line(path.name)}: {len(table)} rows, {len(columns)} columns.",
        "# To fill in: remove the # before the columns that are channels, give each its name and unit, and name inputs",
        "# and outputs below. Then:",
        "#   testbench check THIS_FILE       lists what is still missing",
        "#   testbench import THIS_FILE      shows its contents, and with -o cuts its manoeuvres",
        "#   testbench identify THIS_FILE    identifies",
        *_channel_list(),
        f"title = {q(path.stem)}",
        'source = "state here what was flown, by whom and when"',
        'rights = "state here the owner of the data and who may use them"',
        f"folder = {q(Path(folder).as_posix())}",
        "",
        "[time]",
        *_time_lines(table, columns, clock),
        "",
        "[[record]]",
        f"name = {q(path.stem)}",
        f"file = {q(path.name)}",
        'use = "split"  # the first part identifies, the rest judges',
    ]
    if variable:
        lines.append(f"variable = {q(variable)}" + (f"  # or {one_line(', '.join(others))}" if others else ""))
    lines += [f"decimal = {json.dumps(table.decimal)}"] if table.decimal != "." else []
    if clock and len(clock.pieces) > 1:
        lines.append("# times jump here; each piece becomes a record of its own")
        lines.append(f"segments = [{', '.join(f'[{a:.9g}, {b:.9g}]' for a, b in clock.pieces)}]")
    for i, values in enumerate(columns):
        if clock is None or i != clock.number - 1:
            lines += _column_lines(table, i, values)
    return "\n".join([*lines, *_HEAD, *_proposed(table, columns, clock), ""])


def writer_template(path: Path | str) -> str:
    """Return the form of a writer (TOML), whose tables have the columns of the table ``path``, still to be named.

    Raises:
        RecordError: the file is missing, no table, cannot be read, or its columns have no names.
    """
    path = Path(path)
    table = _read(path)[0]
    named = [i for i, name in enumerate(table.names) if name and table.names.count(name) == 1]
    if not named:
        raise RecordError(f"a writer is known by the names of its columns, but those of '{path}' have none")
    columns = [table.numbers(i + 1) for i in range(len(table.names))]
    clock = _clock(table, columns)
    q = partial(json.dumps, ensure_ascii=False)
    lines = [
        f"# The writer of {one_line(path.name)}. To fill in: remove the # before the columns that are channels, give",
        "# each its name and unit. SI value = factor of unit * (scale * column + offset). Tables beside this folder,",
        "# and those that are imported from where it lies, are then read so.",
        *_channel_list(),
        f"title = {q(path.stem)}",
        'source = "state here where the form of this writer is described"',
        f"columns = {q([table.names[i] for i in named])}  # a table that has all of them is of this writer",
    ]
    if clock is not None and clock.number - 1 in named:
        dates = holds_stamps(table.cells[clock.number - 1])
        lines += ["", "[time]", f"column = {q(table.names[clock.number - 1])}"]
        lines += [] if dates else [f'unit = "{clock.unit}"']
    for i in named:
        if clock is None or i != clock.number - 1:
            lines += [line for line in _column_lines(table, i, columns[i]) if "missing = " not in line]
    return "\n".join([*lines, ""])


def _read(path: Path) -> tuple[Table, str, list[str]]:
    """Return a table, which matrix or structure of a MAT file it is, and the others in it.

    Raises:
        RecordError: the file is missing, no table, or cannot be read.
    """
    if not path.is_file():
        raise RecordError(f"a table must be a file that exists, got {not_found(path)}")
    kind = SUFFIXES.get(path.suffix.lower())
    with open_file(path, "log") as file:
        refuse_foreign(path, file.read(HEAD), kind or "")
    if kind is None:
        raise RecordError(
            f"a description is for a table ({', '.join(SUFFIXES)}), got '{path}'; logs of autopilots need none"
        )
    variable, others = _variable(path) if kind == "mat" else ("", [])
    return read_table(path, kind, variable or None), variable, others


_HEAD = """
[preparation]
bias = "mean"
""".rstrip().splitlines()
_TAIL = """
[identification]
# inputs = ["de"]               # channels from above
# outputs = ["alpha", "q"]

[[identification.estimators]]
method = "dsr_e"
order = 2  # states of pitch; roll and yaw have 4
past_horizon = 10
future_horizon = 10
""".rstrip().splitlines()


def _proposed(table: Table, columns: Sequence[FloatArray], clock: _Clock | None) -> list[str]:
    """Return what import would propose for the columns that are called channels.

    Where a unit is missing, inputs and outputs are remarks, and numbers are taken in SI: only what is believed of an
    airspeed hangs on them.
    """
    held: dict[str, FloatArray] = {}
    sure = True
    for i, values in enumerate(columns):
        called = None if clock is not None and i == clock.number - 1 else meaning(table.names[i], table.units[i])
        if called is None or called.of_throw or called.channel in held or not np.all(np.isfinite(values)):
            continue
        held[called.channel] = called.convert(values) if called.unit else called.scale * values
        sure = sure and bool(called.unit)
    if clock is None or not held or clock.t_s.size != len(columns[0]) or clock.t_s.size < FEWEST:
        return _TAIL
    record = FlightRecord(clock.t_s, tuple(held), np.column_stack(list(held.values())), "measured")
    names = [n if n in held else f"{n}_cmd" for n in CONTROLS]
    inputs = moving([record], [n for n in names if n in held])
    recipe = propose(inputs, [record], 1.0 / float(np.median(np.diff(clock.t_s)))) if inputs else None
    if recipe is None:
        return _TAIL
    entries = recipe_lines(recipe, inputs)
    if sure:
        return entries
    return [f"# {line}" if line.startswith(("inputs", "outputs")) else line for line in entries]


def _variable(path: Path) -> tuple[str, list[str]]:
    """Return the path to read of a MAT file that holds several, that with most samples, and the others."""
    try:
        return read_table(path, "mat").root, []
    except RecordError:
        try:
            paths = candidates(read_mat(path))
        except RecordError:
            return "", []  # the common reader says what is wrong
        sizes = {}
        for name in paths[:_MOST_PATHS]:
            try:
                sizes[name] = len(read_table(path, "mat", name))
            except RecordError:
                continue
        names = sorted(sizes, key=lambda k: -sizes[k])
        return (names[0], names[1:]) if names and sizes[names[0]] > 1 else ("", [])


def _clock(table: Table, columns: Sequence[FloatArray]) -> _Clock | None:
    """Return the column that is called time, or, if none is, the first one that runs on evenly; None if none does."""
    called = find_clock(table)
    ordered = sorted(range(len(columns)), key=lambda i: (i != called, not clock_called(table.names[i])[0], i))
    for i in ordered:
        if not clock_called(table.names[i])[0] and i != called and time_unit(table.units[i]) == "" != table.units[i]:
            continue
        try:
            unit = clock_unit(table, i)[0]
            t = read_times(table, i + 1, unit)
        except RecordError:
            continue
        if t.size < 3 or not np.all(np.isfinite(t)):
            continue
        steps = np.diff(t)
        usual = float(np.median(steps))
        if usual <= 0.0 or np.any(steps <= 0.0):
            continue
        cuts = np.flatnonzero(np.abs(steps - usual) > _EVEN * usual)
        if cuts.size >= _MOST_GAPS:
            continue
        starts, ends = np.r_[0, cuts + 1], np.r_[cuts, t.size - 1]
        pieces = tuple((float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True) if b > a)
        return _Clock(i + 1, unit, pieces, t)
    return None


def _time_lines(table: Table, columns: Sequence[FloatArray], clock: _Clock | None) -> list[str]:
    if clock is not None:
        i = clock.number - 1
        dates = holds_stamps(table.cells[i])
        t = clock.t_s if dates else columns[i]
        step = float(np.median(np.diff(t)))
        from_first = f"dates, {one_line(table.cell(i + 1, 0))} is 0 s; " if dates else ""
        runs = f"runs from {t[0]:.6g} to {t[-1]:.6g} in steps of {step:.6g}"
        return [f"column = {_key(table, i)}  # {from_first}{runs}", *([] if dates else [f'unit = "{clock.unit}"'])]
    for name, values in zip(table.names, columns, strict=True):
        given = values[np.isfinite(values)]
        if name.strip().lower() in _RATES and given.size and np.all(given == given[0]) and given[0] > 0.0:
            return [f"rate_hz = {float(given[0])!r}  # no column counts time; column '{one_line(name)}' says this"]
    return ["# no column contains times: give the number of rows per second", "# rate_hz = 100.0"]


def _column_lines(table: Table, i: int, values: FloatArray) -> list[str]:
    """Return the entry of one column, as a remark unless its name is that of a channel."""
    taken = values[np.isfinite(values)]
    name, stated = table.names[i], table.units[i].strip()
    head = f"# column {i + 1}" + (f", {one_line(name)}" if name else "") + (f" [{one_line(stated)}]" if stated else "")
    if not taken.size:
        return ["", f"{head}: no numbers"]
    extent = f"{taken.min():.5g} to {taken.max():.5g}" if taken.min() < taken.max() else f"{taken[0]:.5g} throughout"
    head += f": {extent}" + (f", {values.size - taken.size} missing" if taken.size < values.size else "")
    called = meaning(name, stated)
    found, unit, sign = called[:3] if called is not None else ("", "", 1.0)
    scale = [f"scale = {sign}"] if sign != 1.0 else []
    if called is not None and called.of_throw:  # the deflection in deg at full command is for the user to give
        unit, scale = "", [f"scale = {sign * DEFAULT_THROW_RAD / DEG_RAD:g}  # deg at full throw"]
    known = bool(found and unit and taken.size == values.size)
    entry = [
        "[[channel]]",
        f'name = "{found or "?"}"',
        f"column = {_key(table, i)}",
        f'unit = "{unit or "?"}"' + (f"  # one of {', '.join(_units(found))}" if found and not unit else ""),
    ]
    entry += scale
    entry += ['missing = "mask"'] if taken.size < values.size else []
    return ["", head, *(entry if known else [f"# {line}" for line in entry])]


def _key(table: Table, i: int) -> str:
    """Return how the description names a column: by its name where that is the only one, else by its number."""
    name = table.names[i]
    return json.dumps(name, ensure_ascii=False) if name and table.names.count(name) == 1 else str(i + 1)


def _units(name: str) -> list[str]:
    si = channel(name).unit
    return list(UNITS.get(si, {si: 1.0}))


def _channel_list() -> list[str]:
    """Return the channels that a table may hold, by the units they can be given in, as remarks."""
    groups: dict[str, list[str]] = {}
    for name in (*CHANNELS, "az_wing_1", "strain_wing_1"):
        groups.setdefault(channel(name).unit, []).append(name)
    out = ["#", "# Channels, and the units that their columns may be in:"]
    out += [f"#   {', '.join(names)}: {', '.join(_units(names[0]))}" for names in groups.values()]
    return [
        *out,
        "# az_wing and strain_wing are numbered by station. Signs: de is positive trailing edge down, da where it",
        "# rolls the right wing down, dr trailing edge left; az is -9.81 m/s2 in level flight. scale = -1.0 turns a",
        "# column; minus_column = N subtracts another one (da from left and right).",
        "",
    ]
