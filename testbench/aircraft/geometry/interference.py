"""What fuselage, wake and boundary layer do that lifting surfaces by themselves do not show: the usual handbook terms.

* The body in pitch: strips under the wing's upwash and downwash (H. Multhopp, NACA TM 1036, 1942),

      Cm_alpha = pi/(2 S cbar) int w^2 (1 + d eps_u/d alpha) dx,

  w the width; ahead of the wing the upwash of its bound vortex, a c/(4 pi s) at s ahead of its quarter chord; none of
  it along the root chord; behind, growing evenly to 1 - eps' at the tail. Its lift is that of the wing within it.
* The body in sideslip: slender-body theory up to the place x0 = l (0.378 + 0.527 x1/l) where the flow leaves it, x1
  that of its steepest taper, by the height h (USAF DATCOM, sections 4.2.1.1 and 5.2.1.1),

      CY_beta = -2 K_i (k2 - k1) (pi/4) h(x0)^2 / S,    Cn_beta = -2 (k2 - k1)/(S b) int (x_cg - x) d(pi h^2/4),

  k1, k2 the inertia factors of the spheroid of the same fineness (H. Lamb, Hydrodynamics, section 114), K_i = 1 + 0.5
  or 0.85 of the wing's height above or below the axis over half the body's height.
* A wing above or below the axis of the body rolls: Cl_beta = -1.2 sqrt(A) (z_w/b) (2 d/b), z_w its height (USAF DATCOM,
  section 5.2.2.1).
* A fin on a body stands on an end plate: the lift slope of 1.55 times its aspect ratio (J. Roskam, Airplane Design,
  part VI, section 10.2.4.1: 1.4 to 1.7), and the air at it turns by (1 + d sigma/d beta) q_v/q = 0.724 +
  3.06 (S_v/S)/(1 + cos L) + 0.4 z/d + 0.009 A, z how far the wing lies below the axis (the same, eq. 10.31).
* The air at a tail behind the wing has lost speed: q_h/q = 0.9 (the same, section 8.1.5: 0.85 to 0.95).
* A flap turns the air less than thin-aerofoil theory says: by 0.78, that of 25 to 35 % of the chord at the Reynolds
  numbers of flight, gap included (USAF DATCOM, figure 6.1.1.1-39b).
"""

from __future__ import annotations

import math

import numpy as np

from testbench.aircraft.geometry.shape import LiftingSurface, Plane
from testbench.aircraft.strips.fit import helmbold
from testbench.core.record import FloatArray

FLAP = 0.78
_TAIL, _END_PLATE = 0.9, 1.55
_STATIONS = 400


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
    a, b = surface.stations[0], surface.stations[-1]
    aft = b.x_m + 0.25 * b.chord_m - a.x_m - 0.25 * a.chord_m
    cos = math.cos(math.atan2(aft, surface.length_m))
    height, below = _at_wing(plane)
    A = plane.wing.span_m**2 / plane.wing.projected_m2
    return 0.724 + 3.06 * surface.area_m2 / plane.S_m2 / (1.0 + cos) + 0.4 * below / height + 0.009 * A


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
    A, b = wing.span_m**2 / wing.projected_m2, wing.span_m
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
