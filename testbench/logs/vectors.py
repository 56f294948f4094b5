"""Vectors and quaternions in the columns of a table: attitude, rates and specific forces as ROS and others write them.

Four columns of one name, with w, x, y, z or 0 to 3 behind, are a quaternion if the sum of their squares is 1 in nearly
every row: an attitude, whatever its parts are called. ROS (REP 103, sensor_msgs/Imu) counts forward, left, up in the
body and east, north, up over ground; the specific force tells which axes a table has, because level flight has 1 g
upwards. So do the logs of Betaflight and iNav that blackbox_decode writes: rates in deg/s, counts of the accelerometer,
of which the usual size is taken for 1 g, attitude in tenths of a degree, pitch positive nose down (their MAVLink
telemetry turns it). A unit that the heading states goes before these.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from testbench.core.channels import unit_factor
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.names import LARGEST, stated_unit
from testbench.logs.signals import AT_IMU, Rule, scaled
from testbench.logs.tables import Table

AXES = {"frd": "forward, right, down", "flu": "forward, left, up"}
"""Axes of the body, and what they are called."""
_PART = re.compile(r"(.+?)[._/ ]*\[?([wxyz]|[0-4])\]?")
_RATES, _FORCES, _EULER = ("p", "q", "r"), ("ax", "ay", "az"), ("phi", "theta", "psi")
_IN_WORDS = (
    (r"(?:angular|body|gyro)?(?:angular|body)?(?:rates?|velocity)|gyro", _RATES),
    (r"(?:linear|body)?accel(?:eration)?s?|specificforce", _FORCES),
    (r"orientation|attitude|euler(?:angles)?|rpy", _EULER),
    (r"pos(?:ition)?ned", ("north", "east", "h")), (r"vel(?:ocity)?ned", ("v_north", "v_east", "hdot")),
)  # fmt: skip
"""Words that a vector is called by, and its channels, where its name ends in their unit: ``accel_body_mps2[0]``."""
_COUNTS = "counts"
_OF_1_G = "1 g is the usual size of its counts, wrong where a vehicle turns much: blackbox_decode --unit-acceleration g"
_FRAMES = ("body", "b", "frd", "imu")
_VECTORS = {
    "angularvelocity": (_RATES, "xyz", 1.0, "rad/s"), "linearacceleration": (_FORCES, "xyz", 1.0, "m/s2"),
    "gyroadc": (_RATES, "012", DEG_RAD, "deg/s"),
    "accsmooth": (_FORCES, "012", 0.0, _COUNTS),
}  # fmt: skip
"""Names of vectors, without strokes -> channels, what stands behind the name, factor to SI (0: 1 g), unit."""
_BLACKBOX = ("loopIteration", "attitude", 0.1 * DEG_RAD, "tenths of a degree")
"""The column that every blackbox has, its attitude, the factor to rad, and the unit."""
_UNIT = 0.02  # of the sum of squares of a quaternion's parts, which are written with few digits
_WHOLE = 0.9  # of the rows: others lie between two signs of it, as of a table that was interpolated
_UPRIGHT = 0.5  # of the usual size of the specific force: beyond it, level flight tells what is up


class Vectors(NamedTuple):
    """Rules for the vectors in a table, the columns that they take, and what was assumed of their axes or told them."""

    rules: tuple[Rule, ...]
    columns: frozenset[str]
    assumed: str
    notes: tuple[str, ...] = ()


def vectors_of(table: Table, axes: str | None = None) -> Vectors:
    """Return the rules for the attitude, rates and specific forces that the columns of a table hold as vectors.

    Args:
        table: the table.
        axes: those of the body, one of :data:`AXES`; told by the specific force if not given, else those of ROS.

    Raises:
        RecordError: ``axes`` is none of them.
    """
    if axes is not None and axes not in AXES:
        raise RecordError(f"axes must be one of {', '.join(AXES)}, got '{axes}'")
    groups: dict[str, dict[str, str]] = {}
    for name in table.names:
        if (match := _PART.fullmatch(name)) and table.names.count(name) == 1:
            groups.setdefault(match[1].rstrip("._/ "), {})[match[2]] = name
    turned = {base: parts for base, held in groups.items() if (parts := _quaternion(table, held))}
    known = [_Known([held[part] for part in of[1]], *of[::2], of[3]) for base, held in groups.items()
             for word, of in _VECTORS.items() if _plain(base).endswith(word) and set(of[1]) <= held.keys()]  # fmt: skip
    known += [vector for base, held in groups.items() if (vector := _stated(base, held)) is not None]
    known = [_in_its_unit(table, vector) for vector in known]
    if not turned and not known:
        return Vectors((), frozenset(), "")
    up, known = _upright(table, known)
    seen = "flu" if up > _UPRIGHT * G0_M_S2 else "frd" if up < -_UPRIGHT * G0_M_S2 else ""
    taken = axes or seen or ("flu" if known or _of_ros(turned) else "frd")
    marker, attitude, factor, unit = _BLACKBOX
    if marker in table.names and set("012") <= groups.get(attitude, {}).keys():
        known.append(_Known([groups[attitude][part] for part in "012"], _EULER, factor, unit))
    other = next(name for name in AXES if name != taken)
    said = f"axes {AXES[taken]}"
    assumed = "" if axes or seen else f"{said}, which nothing determines: --axes {other} if they are {AXES[other]}"
    notes = (f"vectors are read with {said}: the specific force is {up:.3g} m/s2 along z",) if seen and not axes else ()
    rules = [rule for parts in turned.values() for rule in _attitude(parts, taken, said)]
    rules += [rule for vector in known for rule in _components(vector, taken, said)]
    columns = {name for parts in turned.values() for name in parts}
    return Vectors(tuple(rules), frozenset(columns | {name for rule in rules for name in rule.fields}), assumed, notes)


class _Known(NamedTuple):
    """A vector: its three columns, their channels, the factor to SI units, and its unit in words."""

    columns: list[str]
    channels: tuple[str, str, str]
    factor: float
    unit: str


def _stated(base: str, held: Mapping[str, str]) -> _Known | None:
    """Return the vector whose name ends in the unit of its channels; None if it is none."""
    index = next((parts for parts in ("012", "xyz") if set(parts) <= held.keys() and len(held) == len(parts)), "")
    words = re.sub(r"[^a-z0-9]+", "_", base.lower()).strip("_").split("_")
    for n in (1, 2) if index else ():
        plain = "".join(word for word in words[:-n] if word not in _FRAMES)
        for pattern, channels in _IN_WORDS:
            unit = stated_unit(channels[0], "_".join(words[-n:]))
            if unit and re.fullmatch(pattern, plain):
                return _Known([held[part] for part in index], channels, unit_factor(channels[0], unit), unit)
    return None


def _in_its_unit(table: Table, vector: _Known) -> _Known:
    """Return a vector in the unit that the table states of all its columns; as it is, where it states none."""
    units = {stated_unit(vector.channels[0], table.units[table.names.index(column)]) for column in vector.columns}
    unit = units.pop() if len(units) == 1 else ""
    return vector._replace(factor=unit_factor(vector.channels[0], unit), unit=unit) if unit else vector


def _upright(table: Table, known: list[_Known]) -> tuple[float, list[_Known]]:
    """Return the usual specific force along z, m/s2, 0 without one, and the vectors with counts scaled to 1 g."""
    up, out = 0.0, []
    for vector in known:
        if vector.channels == _FORCES:
            force = np.array([table.numbers(column) for column in vector.columns])
            size = float(np.nanmedian(np.linalg.norm(_within(force), axis=0)))
            vector = vector._replace(factor=vector.factor or (G0_M_S2 / size if size > 0.0 else 1.0))
            up = vector.factor * float(np.nanmedian(force[2]))
        out.append(vector)
    return up, out


def _within(x: FloatArray) -> FloatArray:
    """Return numbers whose squares can be formed: those that a damaged file makes beyond that are cut to it."""
    return np.clip(x, -LARGEST, LARGEST)


def _plain(base: str) -> str:
    return re.sub(r"[^a-z]", "", base.lower())


def _of_ros(turned: Mapping[str, object]) -> bool:
    return any(_plain(base).endswith("orientation") for base in turned)


def _quaternion(table: Table, held: Mapping[str, str]) -> tuple[str, ...]:
    """Return the columns of a quaternion, its scalar part first; () if these are none."""
    for parts in ("wxyz", "0123", "1234"):
        if not set(parts) <= held.keys():
            continue
        size = np.sum([_within(table.numbers(held[part])) ** 2 for part in parts], axis=0)
        if np.isfinite(size).any() and np.mean(np.abs(size[np.isfinite(size)] - 1.0) < _UNIT) > _WHOLE:
            return tuple(held[part] for part in parts)
    return ()


def _attitude(parts: tuple[str, ...], axes: str, said: str) -> Iterator[Rule]:
    world = "" if axes == "frd" else "; heading from east-north-up"
    for i, name in enumerate(_EULER):
        words = f"Euler angle (3-2-1) of the quaternion; {said}{world if name == 'psi' else ''}"
        yield Rule(name, "", parts, partial(euler, i, axes), words, in_si=True)


def euler(i: int, axes: str, w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Return an Euler angle (3-2-1), rad: bank (0), pitch (1) or heading (2).

    The quaternion (w, x, y, z) turns the axes of the body to those of the ground: forward, right, down to north, east,
    down ("frd"), or forward, left, up to east, north, up ("flu").
    """
    w, x, y, z = map(_within, (w, x, y, z))
    if i == 0:
        angle = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    elif i == 1:
        angle = (1.0 if axes == "frd" else -1.0) * np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    else:
        turned = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        angle = turned if axes == "frd" else 0.5 * np.pi - turned
    return np.where(np.abs(w * w + x * x + y * y + z * z - 1.0) < _UNIT, angle, np.nan)


def _components(vector: _Known, axes: str, said: str) -> Iterator[Rule]:
    force = vector.channels == _FORCES
    for column, name in zip(vector.columns, vector.channels, strict=True):
        minus = name in ("h", "hdot") or (axes == "flu" and name in ("q", "r", "ay", "az", "theta"))
        words = f"{'minus ' if minus else ''}{vector.unit}; {said}"
        factor = -vector.factor if minus else vector.factor
        assumed = "; ".join([AT_IMU] * force + [_OF_1_G] * (vector.unit == _COUNTS))
        yield Rule(name, "", (column,), scaled(factor), words, assumed, in_si=True)
