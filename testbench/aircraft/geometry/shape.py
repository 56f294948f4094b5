"""The outside of an aircraft as both ways of describing it end up: lifting surfaces with flaps, and a body."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from testbench.aircraft.geometry.schema import Cross
from testbench.core.door import read_text
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray

_POINTS = 81  # on either side, closest at the nose
# Second and third digit of the five-digit series without reflex -> m and k1 of its mean line for a design lift of 0.3.
_FIVE = {
    "10": (0.0580, 361.4),
    "20": (0.1260, 51.64),
    "30": (0.2025, 15.957),
    "40": (0.2900, 6.643),
    "50": (0.3910, 3.230),
}
_LAW = 'an airfoil must be a NACA name with four or five digits ("naca2412") or a file of coordinates'


@dataclass(frozen=True, eq=False)
class Airfoil:
    """A section of unit chord."""

    name: str  # as it was asked for
    points: FloatArray  # (n, 2) x and y from the trailing edge over the upper side to the nose and back below
    file: Path | None = None  # where the coordinates came from; None for a formula

    @property
    def camber(self) -> tuple[FloatArray, FloatArray]:
        """Return x and height of the mean line between upper and lower side, (k,) each."""
        nose = int(np.argmin(self.points[:, 0]))
        upper, lower = self.points[: nose + 1][::-1], self.points[nose:]
        x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _POINTS)))
        sides = [np.interp(x, np.maximum.accumulate(s[:, 0]), s[:, 1]) for s in (upper, lower)]
        return x, 0.5 * (sides[0] + sides[1])


def airfoil(name: str, folder: Path | None = None) -> Airfoil:
    """Return the section called ``name``.

    Args:
        name: "naca2412", "NACA 23012", or the path of a file of coordinates, from ``folder`` or the working directory.
        folder: of the file that names the section.

    Raises:
        ScenarioError: there is no such section, or the file does not hold one.
    """
    digits = re.fullmatch(r"naca[ _-]*(\d+)", name.strip(), flags=re.IGNORECASE)
    if digits:
        return Airfoil(name, naca(digits[1]))
    paths = [p / name for p in (folder, Path.cwd()) if p is not None]
    path = next((p for p in paths if p.is_file()), None)
    if path is None:
        raise ScenarioError(f"{_LAW}, got '{name}', and no such file lies at '{paths[0]}'")
    return Airfoil(name, read_coordinates(path), path)


def naca(digits: str) -> FloatArray:
    """Return the points (n, 2) of a NACA section of four digits, or of five without reflex; see :class:`Airfoil`.

    Raises:
        ScenarioError: the series is another one, or the section has no thickness.
    """
    if not (digits.isascii() and digits.isdigit()):
        raise ScenarioError(f"{_LAW}, got naca{digits}: its digits must be digits")
    c = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _POINTS)))
    if len(digits) == 4:
        m, p = int(digits[0]) / 100.0, int(digits[1]) / 10.0
        if m > 0.0 and p == 0.0:
            raise ScenarioError(f"a cambered NACA section has its camber behind the nose, got naca{digits}")
        mean, slope = _four_digit_mean_line(c, m, p)
    elif len(digits) == 5 and digits[1:3] in _FIVE:
        m, k1 = _FIVE[digits[1:3]]
        k1 *= int(digits[0]) / 2.0  # the design lift is 0.15 times the first digit; the table is for 0.3
        mean = np.where(c < m, k1 / 6.0 * (c**3 - 3.0 * m * c**2 + m**2 * (3.0 - m) * c), k1 * m**3 / 6.0 * (1.0 - c))
        slope = np.where(c < m, k1 / 6.0 * (3.0 * c**2 - 6.0 * m * c + m**2 * (3.0 - m)), -k1 * m**3 / 6.0)
    else:
        raise ScenarioError(
            f"{_LAW}, got naca{digits}: of five digits, the middle two must be {', '.join(_FIVE)}; give coordinates"
        )
    t = int(digits[-2:]) / 100.0
    if t == 0.0:
        raise ScenarioError(f"a section must have thickness, got naca{digits}")
    half = 5.0 * t * (0.2969 * np.sqrt(c) - 0.126 * c - 0.3516 * c**2 + 0.2843 * c**3 - 0.1015 * c**4)
    cos, sin = 1.0 / np.hypot(1.0, slope), slope / np.hypot(1.0, slope)
    upper = np.column_stack([c - half * sin, mean + half * cos])
    lower = np.column_stack([c + half * sin, mean - half * cos])
    return np.vstack([upper[::-1], lower[1:]])


def _four_digit_mean_line(c: FloatArray, m: float, p: float) -> tuple[FloatArray, FloatArray]:
    if m == 0.0:
        return np.zeros_like(c), np.zeros_like(c)
    ahead = c < p
    mean = np.where(ahead, m / p**2 * (2 * p * c - c**2), m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * c - c**2))
    return mean, np.where(ahead, 2.0 * m / p**2 * (p - c), 2.0 * m / (1 - p) ** 2 * (p - c))


def read_coordinates(path: Path) -> FloatArray:
    """Return the points (n, 2) of a file: one x and y a line, in the order of Selig or of Lednicer, with any heading.

    They are shifted, turned and scaled to run from the nose at 0, 0 to the trailing edge at 1, 0.

    Raises:
        RecordError: it cannot be read.
        ScenarioError: fewer than ten points, or points that are no section.
    """
    return normalised(read_points(path), str(path))


def read_points(path: Path) -> FloatArray:
    """Return the points (n, 2) of a file as it lists them, from the trailing edge over the nose and back.

    Raises:
        RecordError: it cannot be read.
        ScenarioError: fewer than ten points.
    """
    pairs = []
    for line in read_text(path, "airfoil", errors="replace").splitlines():
        words = line.replace(",", " ").split()
        try:
            x, y = (float(w) for w in words)
        except ValueError:
            continue
        pairs.append((x, y))
    return _listed(pairs, str(path))


def _listed(pairs: Sequence[Sequence[float]] | FloatArray, source: str) -> FloatArray:
    points = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    if len(points) and np.all(points[0] > 1.5) and len(points) == 1 + round(float(points[0].sum())):
        n = round(float(points[0, 0]))  # Lednicer: numbers of points first, then either side from the nose
        points = np.vstack([points[1 : n + 1][::-1], points[n + 2 :]])
    if len(points) < 10 or not np.all(np.isfinite(points)):
        raise ScenarioError(
            f"a file of coordinates must hold at least ten rows of x and y, got {len(points)}: '{source}'"
        )
    return points


def normalised(pairs: Sequence[Sequence[float]] | FloatArray, source: str) -> FloatArray:
    """Return rows of x and y as the points of a section, see :func:`read_coordinates`; ``source`` is for messages."""
    points = _listed(pairs, source)
    end = 0.5 * (points[0] + points[-1])
    nose = points[np.argmax(np.hypot(*(points - end).T))]
    chord = end - nose
    length = float(np.hypot(*chord))
    along = chord / length if length > 0.0 else np.array([1.0, 0.0])
    points = (points - nose) @ np.array([[along[0], -along[1]], [along[1], along[0]]]) / (length or 1.0)
    upper = points[: int(np.argmin(points[:, 0])) + 1]
    if not len(points) > len(upper) > 3 or not 0.01 < float(np.ptp(points[:, 1])) < 0.6:
        raise ScenarioError(f"coordinates must run from the trailing edge round the nose and back: '{source}'")
    if np.trapezoid(upper[::-1, 1], upper[::-1, 0]) < np.trapezoid(
        points[len(upper) - 1 :, 1], points[len(upper) - 1 :, 0]
    ):
        points = points[::-1]  # they began below
    return points


Moved = Literal["de", "da", "dr"]
Role = Literal["wing", "tail", "fin"]
ALONG = 1e-6  # share of a span below which two places are one


@dataclass(frozen=True)
class Station:
    """A section: leading edge x aft, y right, z up (m), chord (m), twist nose up about the leading edge (deg)."""

    x_m: float
    y_m: float
    z_m: float
    chord_m: float
    twist_deg: float
    airfoil: Airfoil


@dataclass(frozen=True)
class Flap:
    """A part of a surface that a control moves."""

    moves: Moved  # control channel
    # start, end: along the surface from its root, in shares of its length
    start: float
    end: float
    chord_fraction: float  # chord of the flap over that of the surface
    gain: float = 1.0  # deflection of this part over that of the control


@dataclass(frozen=True)
class LiftingSurface:
    """A wing, tail or fin: stations from the root to the tip, and the same mirrored in y = 0 if ``mirrored``."""

    name: str
    role: Role
    mirrored: bool
    stations: tuple[Station, ...]
    flaps: tuple[Flap, ...] = ()

    @property
    def along(self) -> tuple[float, ...]:
        """Place of every station along the surface from 0 to 1, measured in the plane across the flight."""
        steps = self._steps_m
        total = sum(steps)
        return tuple(float(s) / total for s in np.cumsum([0.0, *steps]))

    @property
    def length_m(self) -> float:
        """Length of one side in the plane across the flight."""
        return sum(self._steps_m)

    @property
    def shortest_m(self) -> float:
        """Distance of the two stations that are nearest to each other, in that plane."""
        return min(self._steps_m)

    @property
    def _steps_m(self) -> list[float]:
        return [math.hypot(b.y_m - a.y_m, b.z_m - a.z_m) for a, b in pairwise(self.stations)]

    @property
    def area_m2(self) -> float:
        """Area of both sides, measured in the surface itself."""
        return self._area(self._steps_m)

    @property
    def projected_m2(self) -> float:
        """Area of both sides as seen from above."""
        return self._area([abs(b.y_m - a.y_m) for a, b in pairwise(self.stations)])

    def _area(self, steps_m: Sequence[float]) -> float:
        chords = [0.5 * (a.chord_m + b.chord_m) for a, b in pairwise(self.stations)]
        return (2.0 if self.mirrored else 1.0) * sum(c * s for c, s in zip(chords, steps_m, strict=True))

    @property
    def aspect_ratio(self) -> float:
        """Square of the span over the area, as seen from above."""
        return self.span_m**2 / self.projected_m2

    @property
    def swept_m(self) -> float:
        """How far the quarter chord of the tip lies behind that of the root."""
        root, tip = self.stations[0], self.stations[-1]
        return tip.x_m + 0.25 * tip.chord_m - root.x_m - 0.25 * root.chord_m

    @property
    def mean_chord_m(self) -> float:
        """Mean aerodynamic chord, the integral of c^2 over that of c."""
        return self._over_chord([s.chord_m for s in self.stations])

    @property
    def quarter_chord_m(self) -> tuple[float, float, float]:
        """Quarter chord of the mean aerodynamic chord, of one side: x, y, z, weighed by chord."""
        places = [(s.x_m + 0.25 * s.chord_m, s.y_m, s.z_m) for s in self.stations]
        x, y, z = (self._over_chord([p[i] for p in places]) for i in range(3))
        return x, y, z

    def _over_chord(self, values: Sequence[float]) -> float:
        """Return the mean over the area of a value that is linear from station to station."""
        at = np.asarray(self.along)
        s = np.union1d(np.linspace(0.0, 1.0, 2001), at)
        c = np.interp(s, at, [station.chord_m for station in self.stations])
        return float(np.trapezoid(c * np.interp(s, at, values), s) / np.trapezoid(c, s))

    @property
    def span_m(self) -> float:
        """From tip to tip as seen from the front: across; of a single fin, its height."""
        if self.role == "fin" and not self.mirrored:
            return self.length_m
        reach = max(abs(s.y_m) for s in self.stations)
        return 2.0 * reach if self.mirrored else reach

    @property
    def rises(self) -> bool:
        """Whether the tip lies above the root."""
        return self.stations[-1].z_m >= self.stations[0].z_m

    def moved(self, x_m: float, z_m: float) -> LiftingSurface:
        """Return the surface shifted by this much."""
        stations = tuple(replace(s, x_m=s.x_m + x_m, z_m=s.z_m + z_m) for s in self.stations)
        return replace(self, stations=stations)


@dataclass(frozen=True)
class Plane:
    """The outside of an aircraft."""

    surfaces: tuple[LiftingSurface, ...]  # the wing first
    body: tuple[Cross, ...]  # cross-sections of the fuselage from nose to end; empty without one
    # S_m2, b_m, cbar_m: what coefficients refer to
    S_m2: float
    b_m: float
    cbar_m: float
    notes: tuple[str, ...] = ()  # what was left out or taken for granted when it was read, as sentences

    @property
    def wing(self) -> LiftingSurface:
        """The wing."""
        return self.surfaces[0]

    def of(self, role: Role) -> tuple[LiftingSurface, ...]:
        """Return the surfaces that play a role."""
        return tuple(s for s in self.surfaces if s.role == role)

    @property
    def controls(self) -> tuple[Moved, ...]:
        """The controls that move something, in the order of the channels."""
        moved = {f.moves for s in self.surfaces for f in s.flaps}
        return tuple(n for n in ("de", "da", "dr") if n in moved)

    def about(self, x_m: float, z_m: float) -> Plane:
        """Return the aircraft with its places counted from this one in the plane of symmetry."""
        body = tuple(h.model_copy(update={"x_m": h.x_m - x_m, "z_m": h.z_m - z_m}) for h in self.body)
        return replace(self, surfaces=tuple(s.moved(-x_m, -z_m) for s in self.surfaces), body=body)

    @property
    def length_m(self) -> float:
        """From the foremost to the rearmost point."""
        xs = [h.x_m for h in self.body]
        xs += [s.x_m + f * s.chord_m for surface in self.surfaces for s in surface.stations for f in (0.0, 1.0)]
        return max(xs) - min(xs)
