"""Normal modes of a slender aircraft (straight wing, boom, tail) by the Rayleigh-Ritz method with assumed shapes.

Axes as in shapes.py.
The rigid-body motions are among the assumed shapes, so that the elastic normal modes are orthogonal to them: they are
modes about the mean axes, as M. R. Waszak and D. K. Schmidt, J. Aircraft 25(6), 1988, ask for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from testbench.aircraft.strips.loads import STRIPS, Shape, Tail, Wing, combine
from testbench.core.record import FloatArray


@dataclass(frozen=True)
class Stiffness:
    """Elastic constants; those of the wing at its root, falling with (chord / root chord) ** power."""

    # bending_N_m2, torsion_N_m2, power: of the wing
    bending_N_m2: float
    torsion_N_m2: float
    power: float
    # boom_up_N_m, boom_side_N_m: force at the tail per displacement
    boom_up_N_m: float
    boom_side_N_m: float
    boom_roll_N_m: float  # moment at the tail per rotation, N m/rad


def cantilever_bending(number: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return shape and curvature (n,) of a uniform cantilever at ``x`` = 0 to 1, tip deflection 1, length 1.

    R. D. Blevins, Formulas for Natural Frequency and Mode Shape, 1979, table 8-1.
    """
    k = (1.875104068711961, 4.694091132974174, 7.854757438237613)[number - 1]
    s = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))

    def form(sign: float, z: FloatArray) -> FloatArray:
        """Return cosh z -+ cos z - s (sinh z -+ sin z)."""
        return np.asarray(np.cosh(z) - sign * np.cos(z) - s * (np.sinh(z) - sign * np.sin(z)))

    tip = float(form(1.0, np.array([k]))[0])
    return form(1.0, k * x) / tip, k**2 * form(-1.0, k * x) / tip


def cantilever_torsion(number: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return twist and its slope (n,) of a uniform cantilever shaft at ``x`` = 0 to 1, tip twist 1 or -1, length 1."""
    k = (number - 0.5) * np.pi
    return np.sin(k * x), k * np.cos(k * x)


@dataclass(frozen=True, eq=False)
class Modes:
    """Normal modes of one symmetry: frequencies (k,), shapes, and generalised masses (k,) per unit of the shapes."""

    f_hz: FloatArray
    shapes: list[Shape]
    masses: FloatArray


Inertia = Callable[[Shape, Shape], float]
"""Kinetic coupling of two shapes of one symmetry, kg m2; of a shape with itself, its generalised mass."""


def symmetric_inertia(wing: Wing, tail: Tail, mass_kg: float, Iyy: float) -> Inertia:
    """Return the kinetic coupling of symmetric shapes.

    The fuselage takes the mass and the pitch inertia that wing and tail leave over, at the place that keeps the centre
    of gravity.
    """
    X_mass = wing.axis_line - _offset(wing)
    m = wing.mass_per_length
    body = mass_kg - wing.mass_kg - tail.mass_kg
    X_body = -(wing.both_sides(m * X_mass) - tail.mass_kg * tail.arm_m) / body
    spin = (wing.gyration * wing.chord) ** 2
    others = wing.both_sides(m * (X_mass**2 + spin)) + tail.mass_kg * tail.arm_m**2 + body * X_body**2

    def inertia(a: Shape, b: Shape) -> float:
        """Return the kinetic coupling of two shapes."""
        wings = wing.both_sides(m * (_mass_point(wing, a) * _mass_point(wing, b) + spin * a.twist * b.twist))
        bodies = body * (a.body_up + a.body_pitch * X_body) * (b.body_up + b.body_pitch * X_body)
        return wings + bodies + (Iyy - others) * a.body_pitch * b.body_pitch + tail.mass_kg * a.tail_up * b.tail_up

    return inertia


def asymmetric_inertia(wing: Wing, tail: Tail, Ixx: float) -> Inertia:
    """Return the kinetic coupling of asymmetric shapes; the fuselage takes the roll inertia that is left over.

    Sway and yaw of the fuselage are left out: it is an order heavier than the tail.
    """
    m = wing.mass_per_length
    spin = (wing.gyration * wing.chord) ** 2
    body = Ixx - wing.both_sides(m * wing.y**2) - tail.roll_inertia_kg_m2
    lever = tail.mass_kg * tail.mass_height_m

    def inertia(a: Shape, b: Shape) -> float:
        """Return the kinetic coupling of two shapes."""
        wings = wing.both_sides(m * (_mass_point(wing, a) * _mass_point(wing, b) + spin * a.twist * b.twist))
        tails = tail.roll_inertia_kg_m2 * a.tail_roll * b.tail_roll + tail.mass_kg * a.tail_side * b.tail_side
        return (
            wings
            + tails
            + lever * (a.tail_side * b.tail_roll + a.tail_roll * b.tail_side)
            + body * a.body_roll * b.body_roll
        )

    return inertia


def heave_and_pitch(wing: Wing, tail: Tail) -> tuple[Shape, Shape]:
    """Return the symmetric rigid motions as shapes, 1 m up and 1 rad nose up."""
    zero, one = np.zeros(STRIPS), np.ones(STRIPS)
    heave = Shape(one, zero, tail_up=1.0, body_up=1.0)
    return heave, Shape(wing.axis_line, one, tail_up=-tail.arm_m, tail_pitch=1.0, body_pitch=1.0)


def roll(wing: Wing) -> Shape:
    """Return the asymmetric rigid motion as a shape, 1 rad right wing down."""
    return Shape(-wing.y, np.zeros(STRIPS), tail_roll=1.0, body_roll=1.0, symmetric=False)


def symmetric_modes(wing: Wing, tail: Tail, stiffness: Stiffness, mass_kg: float, Iyy: float) -> Modes:
    """Return the symmetric elastic modes.

    Assumed shapes: heave, pitch, three bendings and two torsions of the wing, bending of the boom.
    """
    bends, twists = _wing_shapes(wing)
    zero, L = np.zeros(STRIPS), 0.5 * wing.span_m
    shapes = [
        *heave_and_pitch(wing, tail),
        *(Shape(f, zero, curvature / L**2) for f, curvature in bends),
        *(Shape(zero, f) for f, _ in twists),
        Shape(zero, zero, tail_up=1.0, tail_pitch=-1.5 / tail.arm_m),
    ]
    K = _wing_stiffness(wing, stiffness, bends, twists, first=2, size=len(shapes))
    K[7, 7] = stiffness.boom_up_N_m
    return _solve(shapes, symmetric_inertia(wing, tail, mass_kg, Iyy), K)


def asymmetric_modes(wing: Wing, tail: Tail, stiffness: Stiffness, Ixx: float) -> Modes:
    """Return the asymmetric elastic modes.

    Assumed shapes: roll, three bendings and two torsions of the wing, torsion and side bending of the boom.
    """
    bends, twists = _wing_shapes(wing)
    zero, L = np.zeros(STRIPS), 0.5 * wing.span_m
    shapes = [
        roll(wing),
        *(Shape(f, zero, curvature / L**2, symmetric=False) for f, curvature in bends),
        *(Shape(zero, f, symmetric=False) for f, _ in twists),
        Shape(zero, zero, tail_roll=1.0, symmetric=False),
        Shape(zero, zero, tail_side=1.0, tail_yaw=-1.5 / tail.arm_m, symmetric=False),
    ]
    K = _wing_stiffness(wing, stiffness, bends, twists, first=1, size=len(shapes))
    K[6, 6], K[7, 7] = stiffness.boom_roll_N_m, stiffness.boom_side_N_m
    return _solve(shapes, asymmetric_inertia(wing, tail, Ixx), K)


_Family = list[tuple[FloatArray, FloatArray]]


def _wing_shapes(wing: Wing) -> tuple[_Family, _Family]:
    x = wing.y / (0.5 * wing.span_m)
    return [cantilever_bending(i, x) for i in (1, 2, 3)], [cantilever_torsion(i, x) for i in (1, 2)]


def _offset(wing: Wing) -> FloatArray:
    """Return how far the centre of mass of each section lies behind the elastic axis, m."""
    return (wing.centre_of_mass - wing.elastic_axis) * wing.chord


def _mass_point(wing: Wing, shape: Shape) -> FloatArray:
    return shape.bend - shape.twist * _offset(wing)


def _wing_stiffness(
    wing: Wing, stiffness: Stiffness, bends: _Family, twists: _Family, first: int, size: int
) -> FloatArray:
    """Return K (size, size) with the wing's blocks; its bendings begin at row ``first``, its torsions follow."""
    falling = (wing.chord / wing.root_chord_m) ** stiffness.power
    L = 0.5 * wing.span_m
    K = np.zeros((size, size))
    for i, (_, a) in enumerate(bends):
        for j, (_, b) in enumerate(bends):
            K[first + i, first + j] = wing.both_sides(stiffness.bending_N_m2 * falling * a * b) / L**4
    start = first + len(bends)
    for i, (_, a) in enumerate(twists):
        for j, (_, b) in enumerate(twists):
            K[start + i, start + j] = wing.both_sides(stiffness.torsion_N_m2 * falling * a * b) / L**2
    return K


def _solve(shapes: list[Shape], inertia: Inertia, K: FloatArray) -> Modes:
    """Solve K v = w^2 M v and leave out the rigid motions (below 0.1 Hz)."""
    M = np.array([[inertia(a, b) for b in shapes] for a in shapes])
    squares, vectors = eigh(K, M)
    elastic = squares > (2.0 * np.pi * 0.1) ** 2
    V = vectors[:, elastic]
    return Modes(np.sqrt(squares[elastic]) / (2.0 * np.pi), [combine(shapes, v) for v in V.T], np.diag(V.T @ M @ V))
