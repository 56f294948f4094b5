"""The file of a ground vibration test: what it may say, how it is read, and the laws that it is checked by."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from testbench.aircraft.outline import Surface
from testbench.core.contract import Law
from testbench.core.door import read_text, read_toml
from testbench.core.errors import Faults, ScenarioError, located, nearest
from testbench.core.record import FloatArray
from testbench.core.schema import NonNegative, Positive, Strict, parse

ALIKE = 0.9  # modal assurance criterion beyond which two modes of one symmetry are taken for the same
_POINTS = 50
QUANTITIES = ("bend_m", "twist_rad", "curvature_1_m")
_OF = {  # which motions of the tail a mode of either symmetry can have
    "symmetric": ("tail_up_m", "tail_pitch_rad"),
    "asymmetric": ("tail_side_m", "tail_roll_rad", "tail_yaw_rad"),
}
_FEWEST = 3
_AT_ROOT = 0.05  # of the largest value: what an asymmetric shape may show in the plane of symmetry
Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Evidence = Literal["measured", "computed", "assumed"]


class ModeEntry(Strict):
    """One mode.

    Attributes:
        name: for people.
        f_hz, zeta: natural frequency and damping ratio without air.
        symmetry: whether the left wing does the same as the right one, or the opposite.
        mass_kg_m2: generalised mass, that of the shape as it is given.
        csv: file with columns y_m, bend_m, twist_rad and, if known, curvature_1_m, one row per station.
        bend_m, twist_rad, curvature_1_m: the same at ``stations_m`` of the file: displacement of the elastic axis of
            the right wing (up), twist (nose up), second derivative of the displacement.
        tail_up_m, tail_pitch_rad: of the horizontal tail (up, nose up), for symmetric modes.
        tail_side_m, tail_roll_rad, tail_yaw_rad: of the tail (right, right side down, nose right), for asymmetric ones.
        unit: what one unit of the coordinate is that flies: "largest" makes the largest of tip deflection (in chords),
            tip twist, tail deflection (in chords) and tail rotation (in rad) one; "given" leaves the shape as it is.
    """

    name: Annotated[str, Field(min_length=1)]
    f_hz: Positive
    zeta: Fraction
    symmetry: Literal["symmetric", "asymmetric"]
    mass_kg_m2: Positive | None = None
    csv: str | None = None
    bend_m: Numbers | None = None
    twist_rad: Numbers | None = None
    curvature_1_m: Numbers | None = None
    tail_up_m: float = 0.0
    tail_pitch_rad: float = 0.0
    tail_side_m: float = 0.0
    tail_roll_rad: float = 0.0
    tail_yaw_rad: float = 0.0
    unit: Literal["largest", "given"] = "largest"


class Aileron(Strict):
    """The ailerons on each half of the wing, and d alpha / d da there, if it is known."""

    inner_m: NonNegative
    outer_m: Positive
    effectiveness: float | None = None


class StripSettings(Strict):
    """Known data of the strips; all others are taken from the aircraft's own derivatives, or estimated.

    Attributes:
        elastic_axis: behind the leading edge, in chords.
        lift_slope_1_rad, tail_lift_slope_1_rad, fin_lift_slope_1_rad: of wing, tail and fin.
        downwash: d epsilon / d alpha at the tail.
        elevator_effectiveness, rudder_effectiveness: angle of flow per deflection.
        fin_height_m: centre of the fin above the centre of gravity.
        aileron: place and effectiveness.
        dihedral_deg: of the wing.
        CL: lift coefficient at the design condition.
        zero_lift_deg: angle of attack of the wing at zero alpha of the aircraft, from zero lift.
        section_thickness: of the wing, in chords; gives the height of strain gauges.
        own_derivatives: false: take nothing from the aircraft's own derivatives.
    """

    elastic_axis: Fraction | None = None
    lift_slope_1_rad: Positive | None = None
    tail_lift_slope_1_rad: Positive | None = None
    fin_lift_slope_1_rad: Positive | None = None
    downwash: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    elevator_effectiveness: float | None = None
    rudder_effectiveness: float | None = None
    fin_height_m: float | None = None
    aileron: Aileron | None = None
    dihedral_deg: float | None = None
    CL: float | None = None
    zero_lift_deg: float | None = None
    section_thickness: Fraction | None = None
    own_derivatives: bool = True


class MassEntry(Strict):
    """The distribution of mass, from which generalised masses follow.

    Attributes:
        evidence: what these numbers are.
        wing_kg: both sides, if its distribution is not known: the mass per length then goes with the chord squared.
        stations_m, wing_kg_per_m: the distribution along the right wing, linear between stations.
        centre_of_mass: of a section, behind the leading edge, in chords.
        gyration: radius of gyration of a section about its centre of mass, in chords.
        tail_kg: tail, moving with the end of the boom.
        tail_roll_inertia_kg_m2: about the boom.
        tail_mass_height_m: of its centre of mass above the boom.
    """

    evidence: Evidence
    wing_kg: Positive | None = None
    stations_m: Numbers | None = None
    wing_kg_per_m: Numbers | None = None
    centre_of_mass: Fraction
    gyration: Fraction
    tail_kg: NonNegative = 0.0
    tail_roll_inertia_kg_m2: NonNegative = 0.0
    tail_mass_height_m: float = 0.0


class GroundTestFile(Strict):
    """The file.

    Attributes:
        title: of the flexible aircraft.
        source: where the numbers come from, in a sentence.
        evidence: what frequencies, damping and shapes are.
        normalisation: "mass" if the generalised mass of every shape is 1 kg m2, "given" if ``mass_kg_m2`` says it.
        stations_m: y along the right wing of the shapes that stand in this file.
        shapes: one CSV file with columns y_m, bend_m_1, twist_rad_1, bend_m_2, ... for all modes by number.
        mode: the modes, in order of frequency.
        wing, tail, fin: plan forms; those of the aircraft's drawing if not given.
        strips: what is known of the aerodynamics of the strips.
        mass: where the mass sits.
    """

    title: str | None = None
    source: Annotated[str, Field(min_length=1)]
    evidence: Evidence
    normalisation: Literal["given", "mass"]
    stations_m: Numbers | None = None
    shapes: str | None = None
    mode: Annotated[tuple[ModeEntry, ...], Field(strict=False, min_length=1)]
    wing: Surface | None = None
    tail: Surface | None = None
    fin: Surface | None = None
    strips: StripSettings = StripSettings()
    mass: MassEntry | None = None


# --- reading ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MeasuredShape:
    """Columns of a shape at its own stations, (n,) each; ``curvature_1_m`` is None where it was not given."""

    y_m: FloatArray
    bend_m: FloatArray
    twist_rad: FloatArray
    curvature_1_m: FloatArray | None


@dataclass(frozen=True, eq=False)
class GroundTest:
    """A file that keeps its own laws, and the shapes of its modes in the same order."""

    path: Path  # of the file
    content: GroundTestFile  # what it says
    shapes: tuple[MeasuredShape, ...]  # one per mode
    untwisted: tuple[str, ...]  # names of the modes that came without any twist


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


# --- laws that testbench check tries ----------------------------------------------------------------------------------


def ground_test_laws(test: GroundTest) -> list[Law]:
    """Return for every pair of modes of one symmetry whether their shapes differ.

    The modal assurance criterion (R. J. Allemang, D. L. Brown, IMAC 1982) of displacement and twist along the wing and
    the motions of the tail, each kind over its largest value in any mode, must be below ``ALIKE``.
    """
    found = np.array([_motions(test, i) for i in range(len(test.shapes))])
    kinds = np.array([*["bend"] * _POINTS, *["twist"] * _POINTS, "up", "pitch", "side", "roll", "yaw"])
    for kind in set(kinds.tolist()):
        largest = np.max(np.abs(found[:, kinds == kind]))
        found[:, kinds == kind] /= largest if largest > 0.0 else 1.0
    laws = []
    for i, j in combinations(range(len(test.shapes)), 2):
        first, second = test.content.mode[i], test.content.mode[j]
        if first.symmetry == second.symmetry:
            mac = float((found[i] @ found[j]) ** 2 / ((found[i] @ found[i]) * (found[j] @ found[j])))
            law = f"'{first.name}' and '{second.name}' have different shapes"
            why = f"their modal assurance criterion is {mac:.2f}: is it one mode, or are stations too few?"
            laws.append(Law(law, mac < ALIKE, why))
    return laws


def _motions(test: GroundTest, i: int) -> FloatArray:
    """Return displacement and twist at points along all that was measured, and the motions of the tail."""
    mode, shape = test.content.mode[i], test.shapes[i]
    y = np.linspace(0.0, max(s.y_m[-1] for s in test.shapes), _POINTS)
    tail = [mode.tail_up_m, mode.tail_pitch_rad, mode.tail_side_m, mode.tail_roll_rad, mode.tail_yaw_rad]
    return np.concatenate([np.interp(y, shape.y_m, shape.bend_m), np.interp(y, shape.y_m, shape.twist_rad), tail])
