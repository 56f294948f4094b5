"""The file of a ground vibration test read, with the CSV files beside it, and every fault told."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.aircraft.strips.ground_test import GroundTestFile
from testbench.core.door import read_text, read_toml
from testbench.core.errors import Faults, ScenarioError, located, nearest
from testbench.core.record import FloatArray
from testbench.core.schema import parse

QUANTITIES = ("bend_m", "twist_rad", "curvature_1_m")
_OF = {  # which motions of the tail a mode of either symmetry can have
    "symmetric": ("tail_up_m", "tail_pitch_rad"),
    "asymmetric": ("tail_side_m", "tail_roll_rad", "tail_yaw_rad"),
}
_FEWEST = 3
_AT_ROOT = 0.05  # of the largest value: what an asymmetric shape may show in the plane of symmetry


@dataclass(frozen=True, eq=False)
class MeasuredShape:
    """Columns of a shape at its own stations, (n,) each; ``curvature_1_m`` is None where it was not given."""

    y_m: FloatArray
    bend_m: FloatArray
    twist_rad: FloatArray
    curvature_1_m: FloatArray | None


@dataclass(frozen=True, eq=False)
class GroundTest:
    """A file that keeps its own laws, and the shapes of its modes in the same order.

    Attributes:
        path: of the file.
        content: what it says.
        shapes: one per mode.
        untwisted: names of the modes that came without any twist.
    """

    path: Path
    content: GroundTestFile
    shapes: tuple[MeasuredShape, ...]
    untwisted: tuple[str, ...]


def read_ground_test(path: Path) -> GroundTest:
    """Read the file of a ground vibration test and the CSV files that it names.

    Raises:
        RecordError: a file cannot be read.
        ScenarioError: a law is broken; every fault is told with file and key.
    """
    content, found = parse(GroundTestFile, read_toml(path, "ground test"), path)
    faults = Faults(path)
    faults += found
    if content is None:
        raise ScenarioError(faults)
    _masses_and_order(content, faults)
    wide = _Columns({}, {})
    if content.shapes is not None:
        with located(path, "shapes"):
            wide = _read(path.parent / content.shapes, QUANTITIES, len(content.mode), faults)
    shapes, untwisted = [], []
    for i, mode in enumerate(content.mode):
        shape = _shape(path, content, i, wide, faults)
        if shape is not None:
            shapes.append(shape)
            if not np.any(shape.twist_rad):
                untwisted.append(mode.name)
    if faults:
        raise ScenarioError(faults)
    return GroundTest(path, content, tuple(shapes), tuple(untwisted))


def check_span(test: GroundTest, half_span_m: float) -> None:
    """Check that every station lies on the wing.

    Raises:
        ScenarioError: one lies beyond the half span.
    """
    faults = Faults(test.path)
    seen: set[str] = set()
    for i, shape in enumerate(test.shapes):
        key = _stations_key(test.content, i)
        if shape.y_m[-1] > half_span_m * (1.0 + 1e-9) and key not in seen:
            seen.add(key)
            faults.note(key, f"stations <= {half_span_m:g} m, the half span, must hold, got {shape.y_m[-1]:g} m")
    if faults:
        raise ScenarioError(faults)


def _stations_key(content: GroundTestFile, i: int) -> str:
    return f"mode[{i}].csv" if content.mode[i].csv else "shapes" if content.shapes else "stations_m"


def _masses_and_order(content: GroundTestFile, faults: Faults) -> None:
    for i, mode in enumerate(content.mode):
        if i and mode.f_hz <= content.mode[i - 1].f_hz:
            before = content.mode[i - 1].f_hz
            faults.note(
                f"mode[{i}].f_hz",
                f"frequencies must rise from mode to mode, got {mode.f_hz:g} Hz after {before:g} Hz; "
                + ("give each mode once" if mode.f_hz == before else "put the modes in order"),
            )
        if content.normalisation == "mass" and mode.mass_kg_m2 is not None:
            faults.note(
                f"mode[{i}].mass_kg_m2",
                f"must not be given with normalisation 'mass', which makes it 1 kg m2, got {mode.mass_kg_m2:g}",
            )
        if content.normalisation == "given" and mode.mass_kg_m2 is None and content.mass is None:
            faults.note(
                f"mode[{i}].mass_kg_m2",
                "a generalised mass is required: give it, or a [mass] table from which it follows",
            )
        for symmetry, names in _OF.items():
            if symmetry != mode.symmetry:
                for name in (n for n in names if getattr(mode, n)):
                    faults.note(
                        f"mode[{i}].{name}",
                        f"must be 0 in {'an' if mode.symmetry[0] == 'a' else 'a'} {mode.symmetry} mode, "
                        f"got {getattr(mode, name):g}",
                    )
    mass = content.mass
    if mass is None:
        return
    if (mass.wing_kg is None) == (mass.wing_kg_per_m is None):
        faults.note("mass.wing_kg", "give either wing_kg or wing_kg_per_m with stations_m, got both or none")
    if mass.wing_kg_per_m is not None:
        n, m = len(mass.wing_kg_per_m), len(mass.stations_m or ())
        if n != m or n < 2:
            faults.note("mass.wing_kg_per_m", f"must have one value per station of mass.stations_m, got {n} for {m}")
        elif np.any(np.diff(np.array(mass.stations_m)) <= 0.0) or min(mass.wing_kg_per_m) < 0.0:
            faults.note("mass.stations_m", f"must rise, with masses that are not negative, got {mass.stations_m}")


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of a CSV file by name, and their quantities by mode number (0 without one)."""

    columns: dict[str, FloatArray]
    modes: dict[int, dict[str, FloatArray]]


def _shape(path: Path, content: GroundTestFile, i: int, wide: _Columns, faults: Faults) -> MeasuredShape | None:
    """Return the shape of a mode from wherever it stands; None if it is faulty, which is noted."""
    mode, before = content.mode[i], len(faults)
    inline = {q: np.array(v) for q in QUANTITIES if (v := getattr(mode, q)) is not None}
    given = [
        word
        for word, there in (
            ("csv", mode.csv is not None),
            ("lists in the file", bool(inline)),
            ("columns of shapes", i + 1 in wide.modes),
        )
        if there
    ]
    if len(given) > 1:
        faults.note(f"mode[{i}]", f"a shape must be given once, got {' and '.join(given)}")
        return None
    if mode.csv is not None:
        with located(path, f"mode[{i}].csv"):
            read = _read(path.parent / mode.csv, QUANTITIES, 0, faults)
        y, found, key = read.columns.get("y_m"), read.modes.get(0, {}), f"mode[{i}].csv"
    elif inline:
        y, found, key = np.array(content.stations_m or ()), inline, f"mode[{i}]"
        for q, values in inline.items():
            if len(values) != len(y):
                faults.note(
                    f"mode[{i}].{q}", f"must have one value per station of stations_m, got {len(values)} for {len(y)}"
                )
    else:
        y, found, key = wide.columns.get("y_m"), wide.modes.get(i + 1, {}), "shapes"
    if len(faults) > before or (wide.columns == {} and content.shapes is not None and not given):
        return None
    if y is None or not ({"bend_m", "twist_rad"} & set(found)):
        where = f"columns bend_m_{i + 1} or twist_rad_{i + 1}" if key == "shapes" and content.shapes else "bend_m"
        faults.note(f"mode[{i}]" if key == "shapes" else key, f"a shape along the wing is required: give {where}")
        return None
    stations = _stations_key(content, i)
    if len(y) < _FEWEST or np.any(np.diff(y) <= 0.0) or y[0] < 0.0:
        law = f"at least {_FEWEST} stations must rise from the root to the tip of the right wing (y >= 0)"
        text = f"{law}, got {', '.join(f'{v:g}' for v in y)}"
        if f"{faults.file}, {stations}: {text}" not in faults:
            faults.note(stations, text)
        return None
    bend, twist = found.get("bend_m", np.zeros(len(y))), found.get("twist_rad", np.zeros(len(y)))
    tail = any(getattr(mode, n) for names in _OF.values() for n in names)
    if not (np.any(bend) or np.any(twist) or tail):
        faults.note(key, "something must move in a mode, got zero everywhere")
    if mode.symmetry == "asymmetric" and y[0] == 0.0:
        for q, values in (("bend_m", bend), ("twist_rad", twist)):
            if abs(values[0]) > _AT_ROOT * np.max(np.abs(values)):
                law = "an asymmetric shape must be 0 at y = 0, where both wings move alike"
                faults.note(f"{key}.{q}" if inline else key, f"{law}, got {q} = {values[0]:g}")
    return MeasuredShape(y, bend, twist, found.get("curvature_1_m")) if len(faults) == before else None


def _read(path: Path, quantities: tuple[str, ...], modes: int, faults: Faults) -> _Columns:
    """Return the columns of a CSV file; what is wrong with it is noted under its own name and row.

    Args:
        path: of the file.
        quantities: names of columns beside y_m.
        modes: number of modes whose number ends the names of columns; 0 if names have none.
        faults: where faults are noted.
    """
    own = Faults(path)
    text = read_text(path, "shapes", "utf-8-sig")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    rows = [
        (k, [cell.strip() for cell in row]) for (k, _), row in zip(lines, csv.reader(x for _, x in lines), strict=False)
    ]
    heads = rows[0][1] if rows else []
    known = {"y_m": ("y_m", 0)}
    known |= {q: (q, 0) for q in quantities} if not modes else {
        f"{q}_{i}": (q, i) for i in range(1, modes + 1) for q in quantities
    }  # fmt: skip
    if "y_m" not in heads:
        own.note("first row", f"must name the columns, y_m among them, got '{', '.join(heads)}'")
    for head in heads:
        if head not in known:
            own.note(f"column {head}", f"unknown column '{head}'{nearest(head, known)}")
        elif heads.count(head) > 1:
            own.note(f"column {head}", "a column must stand once, got it twice")
    data: dict[str, list[float]] = {head: [] for head in heads}
    for line, cells in rows[1:]:
        if len(cells) != len(heads):
            own.note(f"row {line}", f"must have {len(heads)} values, got {len(cells)}")
            continue
        for head, cell in zip(heads, cells, strict=True):
            value = _number(cell)
            if value is None:
                got = f"'{cell}'" if cell else "nothing"
                own.note(
                    f"row {line}, {head}", f"must be a number, got {got}; leave the row out if it was not measured"
                )
            else:
                data[head].append(value)
    faults.extend(dict.fromkeys(own))
    if own:
        return _Columns({}, {})
    columns = {head: np.array(values) for head, values in data.items()}
    by_mode: dict[int, dict[str, FloatArray]] = {}
    for head, values in columns.items():
        quantity, number = known[head]
        if quantity != "y_m":
            by_mode.setdefault(number, {})[quantity] = values
    return _Columns(columns, by_mode)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
