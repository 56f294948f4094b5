"""Vortex lattice of all lifting surfaces.

AeroSandbox 4.2 has one, but leaves flaps out of it, and bends the panels: trailing vortices of the wing then pass
through a fin at places of chance, where they drive it without bound. Here panels lie flat along x; camber, twist and
flaps tilt their normals only, as in AVL (M. Drela, H. Youngren). Surfaces that meet share the line along which they
meet, and vortices have a core where another surface feels them. A test holds it against AeroSandbox's lattice where
that applies.

Loads of tail and fin, and the sideslip at the fin, are those that wake and body leave (interference.py). At a Mach
number places along x count 1/beta times, and the velocity along x that vortices give too, beta = sqrt(1 - M^2) (the
rule of Prandtl and Glauert).

Boundary condition and forces are those of J. Katz, A. Plotkin, *Low-Speed Aerodynamics*, 2nd ed., section 12.1: no flow
through a panel at three quarters of its chord, and rho Gamma V x l on its bound vortex at a quarter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from testbench.aircraft.geometry.shape import ALONG, Airfoil, LiftingSurface, Moved, Plane, Station
from testbench.aircraft.strips.fit import helmbold
from testbench.core.record import FloatArray

FLAP = 0.78
_TAIL, _END_PLATE = 0.9, 1.55
_STATIONS = 400
_STRIPS = {"wing": 12, "tail": 6, "fin": 6}  # on one side
_TOUCH = 0.02  # of a surface's length within which another one touches it
CHORDWISE = 12
_OWN_CORE = 1e-4  # the same on its own surface, where it only keeps rounding out of the vortex itself
_CORE = 0.5  # of the width of a strip: radius of its vortices' cores as other surfaces feel them; AVL has the like


class Lattice:
    """The lattice of an aircraft whose places count from its centre of gravity.

    Args:
        plane: the outside.
        only: number of the one surface that is there; all if not given.
        mach: of the flight, below 1.
    """

    def __init__(self, plane: Plane, only: int | None = None, mach: float = 0.0) -> None:
        self.plane = plane
        self._thin = np.array([1.0 / math.sqrt(1.0 - mach**2), 1.0, 1.0])
        self._lines: dict[int, tuple[FloatArray, FloatArray]] = {}
        rows: list[tuple[Any, ...]] = []
        for number, surface in enumerate(plane.surfaces):
            if only is not None and number != only:
                continue
            for a, b in pairwise(cuts(surface, plane.surfaces)):
                for side in (1.0, -1.0) if surface.mirrored else (1.0,):
                    rows += self._strip(number, a, b, side)
        corners = np.array([row[0] for row in rows])  # (n, 4, 3): front left, back left, back right, front right
        self.number = np.array([row[1] for row in rows])
        self.tilt = np.array([row[2] for row in rows])
        self.share: FloatArray | float = np.array([share(plane, plane.surfaces[n]) for n in self.number])[:, None]
        wash = np.array([sidewash(plane, plane.surfaces[n]) for n in self.number])
        self.beta = np.column_stack([np.ones_like(wash), wash, np.ones_like(wash)])
        self.flap = {c: np.array([row[3].get(c, 0.0) for row in rows]) for c in plane.controls}
        front, back = corners[:, [0, 3]], corners[:, [1, 2]]
        self.left, self.right = np.moveaxis(0.75 * front + 0.25 * back, 1, 0)
        self.bound, self.centre = self.right - self.left, 0.5 * (self.left + self.right)
        self.control = (0.25 * front + 0.75 * back).mean(axis=1)
        across = self.bound * np.array([0.0, 1.0, 1.0])
        width = np.linalg.norm(across, axis=1)
        self.up = np.cross([1.0, 0.0, 0.0], across / width[:, None])
        self.core = np.where(self.number[:, None] == self.number[None, :], _OWN_CORE * width, _CORE * width[None, :])
        self.at_control, self.at_centre = (self._influence(points) for points in (self.control, self.centre))

    def _strip(self, number: int, a: Cut, b: Cut, side: float) -> list[tuple[Any, ...]]:
        """Return corners, number, tilt of the normal, and tilt by each control of the panels of a strip."""
        surface = self.plane.surfaces[number]
        x = np.linspace(0.0, 1.0, CHORDWISE + 1)
        slope = 0.5 * (self._slope(a, x[:-1] + 0.75 / CHORDWISE) + self._slope(b, x[:-1] + 0.75 / CHORDWISE))
        twist = 0.5 * (a.station.twist_deg + b.station.twist_deg)
        ends = [a.station, b.station] if side > 0.0 else [b.station, a.station]
        moves = moved_by(surface, 0.5 * (a.s + b.s))
        out = []
        for i in range(CHORDWISE):
            corner = [
                [s.x_m + f * s.chord_m, side * s.y_m, s.z_m]
                for s, f in ((ends[0], x[i]), (ends[0], x[i + 1]), (ends[1], x[i + 1]), (ends[1], x[i]))
            ]
            turned: dict[str, float] = {}
            for control, fraction, gain in moves:
                behind = np.clip((x[i + 1] - (1.0 - fraction)) / (x[i + 1] - x[i]), 0.0, 1.0)
                same = side > 0.0 or control == "de"
                turned[control] = turned.get(control, 0.0) + float(behind) * (gain if same else -gain)
            out.append((corner, number, math.radians(twist) - slope[i], turned))
        return out

    def _slope(self, cut: Cut, x: FloatArray) -> FloatArray:
        """Return the slope of the mean line at places along the chord."""
        a, b, t = cut.blend
        return (1.0 - t) * np.interp(x, *self._mean_line(a)) + t * np.interp(x, *self._mean_line(b))

    def _mean_line(self, section: Airfoil) -> tuple[FloatArray, FloatArray]:
        if id(section) not in self._lines:
            x, z = section.camber
            self._lines[id(section)] = 0.5 * (x[1:] + x[:-1]), np.diff(z) / np.diff(x)
        return self._lines[id(section)]

    def _influence(self, points: FloatArray) -> FloatArray:
        """Return the velocity (points, vortices, 3) that horseshoes of unit strength give at these points.

        Katz and Plotkin, eq. 2.72, of a bound vortex from left to right with trailing ones along x; the square of the
        distance from each line has that of the core added.
        """
        a, b = (points[:, None] - self.left) * self._thin, (points[:, None] - self.right) * self._thin
        ends = self.bound * self._thin
        x = np.array([1.0, 0.0, 0.0])
        la, lb = (np.linalg.norm(v, axis=2) for v in (a, b))
        length = np.linalg.norm(ends, axis=1)

        def line(across: FloatArray, along: FloatArray, core: FloatArray) -> FloatArray:
            return across * (along / ((across**2).sum(axis=2) + core**2))[:, :, None]

        bound = line(
            np.cross(a, b), np.einsum("jk,ijk->ij", ends, a / la[:, :, None] - b / lb[:, :, None]), self.core * length
        )
        legs = line(np.cross(x, b), 1.0 + b[:, :, 0] / lb, self.core) - line(
            np.cross(x, a), 1.0 + a[:, :, 0] / la, self.core
        )
        return np.asarray((bound + legs) * self._thin / (4.0 * np.pi))

    def run(self, at: Mapping[str, float], control: Moved | None = None, deflection: float = 0.0) -> dict[str, float]:
        """Return the coefficients CL, CD, CY (wind axes), Cl, Cm, Cn (body axes), and "CL:0" of every surface's lift.

        Args:
            at: alpha, beta, rad; p b/2V, q cbar/2V, r b/2V.
            control: that is deflected, if any.
            deflection: rad.
        """
        plane = self.plane
        alpha, beta = at.get("alpha", 0.0), at.get("beta", 0.0)
        wind = np.array([math.cos(alpha) * math.cos(beta), -math.sin(beta), math.sin(alpha) * math.cos(beta)])
        p, q, r = (at.get(n, 0.0) * 2.0 / (plane.cbar_m if n == "q" else plane.b_m) for n in ("p", "q", "r"))
        turn = np.array([-p, q, -r])  # of the airspeed: V = 1
        tilt = self.tilt + (deflection * self.flap[control] if control is not None else 0.0)
        normal = self.up * np.cos(tilt)[:, None]
        normal[:, 0] += np.sin(tilt)
        free = wind * self.beta - np.cross(turn, self.control)
        gamma = np.linalg.solve(np.einsum("ijk,ik->ij", self.at_control, normal), -np.einsum("ik,ik->i", free, normal))
        velocity = wind * self.beta - np.cross(turn, self.centre) + np.einsum("ijk,j->ik", self.at_centre, gamma)
        force = 2.0 * self.share * gamma[:, None] * np.cross(velocity, self.bound) / plane.S_m2  # over qbar S
        moment = np.cross(self.centre, force).sum(axis=0)
        x, y, z = force.sum(axis=0)
        lift = np.array([-math.sin(alpha), 0.0, math.cos(alpha)])
        out = {
            "CL": float(lift @ (x, y, z)),
            "CD": float(wind @ (x, y, z)),
            "CY": float(
                np.array([math.cos(alpha) * math.sin(beta), math.cos(beta), math.sin(alpha) * math.sin(beta)])
                @ (x, y, z)
            ),
            "Cl": float(-moment[0] / plane.b_m),
            "Cm": float(moment[1] / plane.cbar_m),
            "Cn": float(-moment[2] / plane.b_m),
        }
        for number in sorted(set(self.number.tolist())):
            out[f"CL:{number}"] = float(lift @ force[self.number == number].sum(axis=0))
        return out


@dataclass(frozen=True)
class Cut:
    """A place along a surface where strips meet: the station there, and its place from 0 to 1."""

    s: float
    station: Station
    blend: tuple[Airfoil, Airfoil, float]


def cuts(surface: LiftingSurface, others: Sequence[LiftingSurface] = ()) -> list[Cut]:
    """Return the ends of the strips of a surface: its stations, ends of flaps, junctions, and even parts between them.

    Where another surface begins or ends on this one, vortices of both must run along one line: one that passed beside a
    panel's middle by chance would drive it without bound.
    """
    along = surface.along
    fixed = {*along, *(e for f in surface.flaps for e in (f.start, f.end)), *_junctions(surface, others)}
    ends: list[float] = []
    for s in sorted(fixed):
        if not ends or s - ends[-1] > 10.0 * ALONG:
            ends.append(s)
    out: list[float] = []
    for a, b in pairwise(ends):
        n = max(1, round((b - a) * _STRIPS[surface.role]))
        out += [a + (b - a) * i / n for i in range(n)]
    return [_at(surface, along, s) for s in (*out, ends[-1])]


def _junctions(surface: LiftingSurface, others: Sequence[LiftingSurface]) -> set[float]:
    """Return where along a surface others begin or end on it, as seen from the front."""
    out = set()
    for other in others:
        for end in (other.stations[0], other.stations[-1]) if other is not surface else ():
            for (a, b), (start, stop) in zip(pairwise(surface.stations), pairwise(surface.along), strict=True):
                way, to = np.array([b.y_m - a.y_m, b.z_m - a.z_m]), np.array([end.y_m - a.y_m, end.z_m - a.z_m])
                t = float(to @ way / (way @ way))
                s = start + t * (stop - start)
                near = float(np.hypot(*(to - t * way))) < _TOUCH * surface.length_m
                if near and 0.0 <= t <= 1.0 and _TOUCH < s < 1.0 - _TOUCH:
                    out.add(s)
    return out


def _at(surface: LiftingSurface, along: tuple[float, ...], s: float) -> Cut:
    i = min(max(int(np.searchsorted(along, s, side="right")) - 1, 0), len(along) - 2)
    a, b = surface.stations[i], surface.stations[i + 1]
    t = min(max((s - along[i]) / (along[i + 1] - along[i]), 0.0), 1.0)

    def mix(name: str) -> float:
        return float((1.0 - t) * getattr(a, name) + t * getattr(b, name))

    station = Station(mix("x_m"), mix("y_m"), mix("z_m"), mix("chord_m"), mix("twist_deg"), a.airfoil)
    return Cut(s, station, (a.airfoil, b.airfoil, t))


def moved_by(surface: LiftingSurface, s: float) -> list[tuple[Moved, float, float]]:
    """Return (control, chord fraction, deflection in rad per rad of the control) of the flaps at a place.

    The deflection is that of the right side, positive towards the surface's lower side; the left side turns the same
    way for the elevator and the other way for aileron and rudder. See the signs in core/channels.py.
    """
    out: list[tuple[Moved, float, float]] = []
    for f in surface.flaps:
        if f.start - ALONG < s < f.end + ALONG:
            sign = 1.0 if f.moves == "de" or (f.moves == "dr" and not surface.rises) else -1.0
            out.append((f.moves, f.chord_fraction, sign * f.gain))
    return out


# --- interference -----------------------------------------------------------------------------------------------------


def share(plane: Plane, surface: LiftingSurface) -> float:
    """Return the loads of a surface on the aircraft over those of the same surface in free air."""
    if surface.role == "tail":
        return _TAIL if surface.quarter_chord_m[0] > plane.wing.quarter_chord_m[0] else 1.0
    if surface.role == "fin" and _on_body(plane, surface):
        A = surface.length_m**2 / surface.area_m2
        return helmbold(_END_PLATE * A) / helmbold(A)
    return 1.0


def sidewash(plane: Plane, surface: LiftingSurface) -> float:
    """Return the sideslip at a surface over that of the aircraft."""
    if not _on_body(plane, surface):
        return 1.0
    cos = math.cos(math.atan2(surface.swept_m, surface.length_m))
    height, below = _at_wing(plane)
    size = surface.area_m2 / plane.S_m2
    return 0.724 + 3.06 * size / (1.0 + cos) + 0.4 * below / height + 0.009 * plane.wing.aspect_ratio


def body(plane: Plane, wing_slope: float, downwash: float) -> dict[str, float]:
    """Return Cm_alpha, CY_beta, Cn_beta and Cl_beta, per rad, that the fuselage adds about the origin of places.

    Args:
        plane: the outside, about the centre of gravity.
        wing_slope: lift slope of the wing, per rad.
        downwash: its gradient at the tail.
    """
    if not plane.body:
        return {}
    x, width, height = _hull(plane)
    wing = plane.wing
    root, tails = wing.stations[0], plane.of("tail")
    edge = root.x_m + root.chord_m
    end = max((t.quarter_chord_m[0] for t in tails), default=x[-1])
    ahead = np.maximum(root.x_m + 0.25 * root.chord_m - x, 0.25 * root.chord_m)
    behind = (1.0 - downwash) * np.clip((x - edge) / max(end - edge, 0.01 * root.chord_m), 0.0, 1.0)
    wash = np.where(x < root.x_m, 1.0 + wing_slope * root.chord_m / (4.0 * np.pi * ahead), behind)
    pitch = 0.5 * np.pi * float(np.trapezoid(width**2 * wash, x)) / (plane.S_m2 * plane.cbar_m)

    area = 0.25 * np.pi * height**2
    length = float(x[-1] - x[0])
    taper = np.gradient(area, x)
    steepest = float(x[int(np.argmin(taper))] - x[0]) if np.min(taper) < 0.0 else length
    attached = x <= x[0] + 0.378 * length + 0.527 * steepest
    inertia = 2.0 * _inertia_factors(length / float(np.sqrt(np.max(width * height))))
    wing_height, below = _at_wing(plane)
    K = 1.0 + (0.85 if below > 0.0 else 0.5) * min(abs(below) / (0.5 * wing_height), 1.0)
    turning = float(np.trapezoid(-x[attached] * taper[attached], x[attached]))
    A, b = wing.aspect_ratio, wing.span_m
    return {
        "Cm_alpha": pitch,
        "CY_beta": -inertia * K * float(area[attached][-1]) / plane.S_m2,
        "Cn_beta": -inertia * turning / (plane.S_m2 * plane.b_m),
        "Cl_beta": 1.2 * math.sqrt(A) * below / b * 2.0 * wing_height / b,
    }


def _on_body(plane: Plane, surface: LiftingSurface) -> bool:
    return bool(plane.body) and surface.role == "fin" and not surface.mirrored


def _hull(plane: Plane) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, width and height of the fuselage at many places."""
    at = np.array([h.x_m for h in plane.body])
    x = np.linspace(at[0], at[-1], _STATIONS)
    return x, *(np.interp(x, at, [getattr(h, n) for h in plane.body]) for n in ("width_m", "height_m"))


def _at_wing(plane: Plane) -> tuple[float, float]:
    """Return the height of the fuselage at the wing's root and how far the wing lies below its axis, m."""
    root = plane.wing.stations[0]
    at = [h.x_m for h in plane.body]
    x = root.x_m + 0.25 * root.chord_m
    height = float(np.interp(x, at, [h.height_m for h in plane.body]))
    return max(height, 1e-6), float(np.interp(x, at, [h.z_m for h in plane.body])) - root.z_m


def _inertia_factors(fineness: float) -> float:
    """Return k2 - k1 of a spheroid."""
    e = math.sqrt(1.0 - 1.0 / max(fineness, 1.01) ** 2)
    log = math.log((1.0 + e) / (1.0 - e))
    along = 2.0 * (1.0 - e**2) / e**3 * (0.5 * log - e)
    across = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * log
    return across / (2.0 - across) - along / (2.0 - along)
