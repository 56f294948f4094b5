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
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from testbench.aircraft.geometry.airfoils import Airfoil
from testbench.aircraft.geometry.interference import share, sidewash
from testbench.aircraft.geometry.shape import Moved, Plane
from testbench.aircraft.geometry.strips import Cut, cuts, moved_by
from testbench.core.record import FloatArray

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
            np.cross(a, b),
            np.einsum("jk,ijk->ij", ends, a / la[:, :, None] - b / lb[:, :, None]),
            self.core * length,
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
