"""The outside of an aircraft as both ways of describing it end up: lifting surfaces with flaps, and a body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbench.aircraft.geometry.airfoils import Airfoil

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
    """A part of a surface that a control moves.

    Attributes:
        moves: control channel.
        start, end: along the surface from its root, in shares of its length.
        chord_fraction: chord of the flap over that of the surface.
        gain: deflection of this part over that of the control.
    """

    moves: Moved
    start: float
    end: float
    chord_fraction: float
    gain: float = 1.0


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
        steps = [math.hypot(b.y_m - a.y_m, b.z_m - a.z_m) for a, b in self._panels]
        total = sum(steps)
        return tuple(float(s) / total for s in np.cumsum([0.0, *steps]))

    @property
    def length_m(self) -> float:
        """Length of one side in the plane across the flight."""
        return sum(math.hypot(b.y_m - a.y_m, b.z_m - a.z_m) for a, b in self._panels)

    @property
    def _panels(self) -> list[tuple[Station, Station]]:
        return list(zip(self.stations[:-1], self.stations[1:], strict=True))

    @property
    def area_m2(self) -> float:
        """Area of both sides, measured in the surface itself."""
        one = sum(0.5 * (a.chord_m + b.chord_m) * math.hypot(b.y_m - a.y_m, b.z_m - a.z_m) for a, b in self._panels)
        return (2.0 if self.mirrored else 1.0) * one

    @property
    def projected_m2(self) -> float:
        """Area of both sides as seen from above."""
        one = sum(0.5 * (a.chord_m + b.chord_m) * abs(b.y_m - a.y_m) for a, b in self._panels)
        return (2.0 if self.mirrored else 1.0) * one

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
class Hull:
    """A cross-section of the fuselage: x aft, height of its middle z up, width and height, m."""

    x_m: float
    z_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True)
class Plane:
    """The outside of an aircraft.

    Attributes:
        surfaces: the wing first.
        body: cross-sections of the fuselage from nose to end; empty without one.
        S_m2, b_m, cbar_m: what coefficients refer to.
        notes: what was left out or taken for granted when it was read, as sentences.
    """

    surfaces: tuple[LiftingSurface, ...]
    body: tuple[Hull, ...]
    S_m2: float
    b_m: float
    cbar_m: float
    notes: tuple[str, ...] = ()

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
        body = tuple(replace(h, x_m=h.x_m - x_m, z_m=h.z_m - z_m) for h in self.body)
        return replace(self, surfaces=tuple(s.moved(-x_m, -z_m) for s in self.surfaces), body=body)

    @property
    def length_m(self) -> float:
        """From the foremost to the rearmost point."""
        xs = [h.x_m for h in self.body]
        xs += [s.x_m + f * s.chord_m for surface in self.surfaces for s in surface.stations for f in (0.0, 1.0)]
        return max(xs) - min(xs)
