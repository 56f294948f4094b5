"""Measured shapes on the strips, generalised masses from a distribution of mass, and what one unit of a mode is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from testbench.aircraft.strips.ritz import Inertia, heave_and_pitch, roll
from testbench.aircraft.strips.shapes import STRIPS, Shape, Tail, Wing, scaled
from testbench.core.record import FloatArray

_AT_TIP = 0.98  # of the half span: a last station beyond this shows how a free tip bends


def on_strips(
    wing: Wing, y_m: FloatArray, bend_m: FloatArray, twist_rad: FloatArray, curvature_1_m: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return displacement, twist and curvature (n,) at the strips of what was measured at stations (k,).

    Cubic splines run through the values. The displacement has no curvature at a free tip, if a station lies there.
    Before the first and beyond the last station the curves go on straight. The curvature is the spline's second
    derivative where it was not given.
    """
    tip = y_m[-1] >= _AT_TIP * 0.5 * wing.span_m
    bend, bent = _curve(y_m, bend_m, free=bool(tip))
    twist, _ = _curve(y_m, twist_rad)
    if curvature_1_m is not None:
        bent, _ = _curve(y_m, curvature_1_m)
    return bend(wing.y), twist(wing.y), bent(wing.y)


_Curve = Callable[[FloatArray], FloatArray]


def _curve(y: FloatArray, values: FloatArray, free: bool = False) -> tuple[_Curve, _Curve]:
    """Return a spline through the values, straight beyond its ends, and its second derivative."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(y, values, bc_type=("not-a-knot", "natural") if free else "not-a-knot")
    first, last = y[0], y[-1]

    def value(at: FloatArray) -> FloatArray:
        inside = np.clip(at, first, last)
        return np.asarray(spline(inside) + spline(inside, 1) * (at - inside))

    def second(at: FloatArray) -> FloatArray:
        return np.asarray(np.where((at >= first) & (at <= last), spline(np.clip(at, first, last), 2), 0.0))

    return value, second


def with_body(shape: Shape, wing: Wing, tail: Tail, inertia: Inertia) -> Shape:
    """Return the shape with the motion of the fuselage that keeps the momentum of the whole aircraft at zero.

    An elastic mode of a free aircraft moves neither its centre of gravity nor its mean axes (M. R. Waszak, D. K.
    Schmidt, J. Aircraft 25(6), 1988, eqs. 3 and 4), so its kinetic coupling with the rigid motions is nothing.
    """
    zero = np.zeros(STRIPS)
    if shape.symmetric:
        rigid = list(heave_and_pitch(wing, tail))
        parts = [Shape(zero, zero, body_up=1.0), Shape(zero, zero, body_pitch=1.0)]
    else:
        rigid, parts = [roll(wing)], [Shape(zero, zero, body_roll=1.0, symmetric=False)]
    still = replace(shape, body_up=0.0, body_pitch=0.0, body_roll=0.0)
    M = np.array([[inertia(r, part) for part in parts] for r in rigid])
    found = np.linalg.solve(M, [-inertia(r, still) for r in rigid])
    if shape.symmetric:
        return replace(still, body_up=float(found[0]), body_pitch=float(found[1]))
    return replace(still, body_roll=float(found[0]))


def generalised_mass(shape: Shape, wing: Wing, tail: Tail, inertia: Inertia) -> float:
    """Return the generalised mass of a shape, kg m2, the fuselage moving so that no momentum is left."""
    moving = with_body(shape, wing, tail, inertia)
    return inertia(moving, moving)


def largest_motion(shape: Shape, wing: Wing, cbar_m: float) -> tuple[float, str]:
    """Return the largest of a shape's motions at tip and tail, and what it is in words.

    Deflections count in chords cbar, rotations in rad; a mode divided by it moves that place by one chord or one rad.
    """
    at_tip = [float(values[-1] + 0.5 * (values[-1] - values[-2])) for values in (shape.bend, shape.twist)]
    chord = f"of one chord ({cbar_m:g} m)"
    found = [
        (at_tip[0] / cbar_m, f"wing-tip deflection {chord}"),
        (at_tip[1], "wing-tip twist of 1 rad"),
        (shape.tail_up / cbar_m, f"tail deflection {chord}"),
        (shape.tail_pitch, "tail rotation of 1 rad nose up"),
        (shape.tail_side / cbar_m, f"tail deflection to the right {chord}"),
        (shape.tail_roll, "tail roll of 1 rad"),
        (shape.tail_yaw, "tail rotation of 1 rad nose right"),
    ]
    return max(found, key=lambda pair: abs(pair[0]))


def in_units(shape: Shape, mass_kg_m2: float, size: float) -> tuple[Shape, float]:
    """Return shape and generalised mass per unit of a coordinate that is ``size`` times as large."""
    return scaled(shape, 1.0 / size), mass_kg_m2 / size**2
