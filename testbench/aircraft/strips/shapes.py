"""What strips are made of: a wing, a tail, and the shapes in which they move.

Axes: y along the right wing, X forward from the centre of gravity, w up, twist and pitch nose up, roll right wing down.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from testbench.core.record import FloatArray

STRIPS = 80  # per wing; 40 change no coefficient by more than 0.1 %


@dataclass(frozen=True)
class Wing:
    """A trapezoidal wing: span and root chord in m, the rest in fractions of the chord or of the wing.

    Attributes:
        span_m, root_chord_m, taper: plan form.
        mass_kg: both sides; the mass per length goes with the square of the chord if ``mass_points`` do not say it.
        elastic_axis, centre_of_mass: fractions of the chord behind the leading edge.
        gyration: radius of gyration of a section about its centre of mass, fraction of the chord.
        lift_slope: per rad, of a strip.
        quarter_chord_m: X of the quarter chord in the plane of symmetry.
        sweep_rad: of the quarter-chord line, backwards.
        mass_points: (y in m, kg/m) along the right wing, linear between them and constant beyond.
    """

    span_m: float
    root_chord_m: float
    taper: float
    mass_kg: float
    elastic_axis: float
    centre_of_mass: float
    gyration: float
    lift_slope: float
    quarter_chord_m: float
    sweep_rad: float = 0.0
    mass_points: tuple[tuple[float, float], ...] = ()

    @cached_property
    def y(self) -> FloatArray:
        """Midpoints (n,) of the strips of the right wing, m."""
        return np.asarray((np.arange(STRIPS) + 0.5) * self.width, dtype=np.float64)

    @property
    def width(self) -> float:
        """Width of a strip, m."""
        return 0.5 * self.span_m / STRIPS

    @cached_property
    def chord(self) -> FloatArray:
        """Chord (n,) of the strips, m."""
        return np.asarray(
            self.root_chord_m * (1.0 - (1.0 - self.taper) * self.y / (0.5 * self.span_m)), dtype=np.float64
        )

    @cached_property
    def quarter_line(self) -> FloatArray:
        """X (n,) of the quarter chord of the strips, m."""
        return np.asarray(self.quarter_chord_m - np.tan(self.sweep_rad) * self.y)

    @cached_property
    def axis_line(self) -> FloatArray:
        """X (n,) of the elastic axis of the strips, m."""
        return np.asarray(self.quarter_line - (self.elastic_axis - 0.25) * self.chord)

    @cached_property
    def mass_per_length(self) -> FloatArray:
        """Mass per length (n,), kg/m."""
        if self.mass_points:
            return np.asarray(np.interp(self.y, *np.transpose(self.mass_points)))
        return np.asarray(0.5 * self.mass_kg * self.chord**2 / np.sum(self.chord**2 * self.width))

    def both_sides(self, per_length: FloatArray) -> float:
        """Return the integral over both wings of ``per_length`` (n,), given on the right one."""
        return float(2.0 * np.sum(per_length) * self.width)


@dataclass(frozen=True)
class Tail:
    """The tail at the end of the boom, at X = -arm.

    Attributes:
        arm_m: from the centre of gravity to the tail's quarter chord.
        mass_kg: tail, moving with the end of the boom.
        area_m2, lift_slope, downwash, elevator: horizontal tail; downwash d eps / d alpha, elevator effectiveness.
        fin_area_m2, fin_slope, fin_height_m, rudder: fin, with its centre above the boom.
        span_m: of the horizontal tail, for its damping in roll.
        roll_inertia_kg_m2, mass_height_m: inertia about the boom, and height of the tail's centre of mass above it.
        fin_arm_m: from the centre of gravity to the fin's quarter chord, where it is not the tail's.
    """

    arm_m: float
    mass_kg: float
    area_m2: float
    lift_slope: float
    downwash: float
    elevator: float
    fin_area_m2: float
    fin_slope: float
    fin_height_m: float
    rudder: float
    span_m: float
    roll_inertia_kg_m2: float
    mass_height_m: float
    fin_arm_m: float | None = None

    @property
    def fin_arm(self) -> float:
        """From the centre of gravity to the fin's quarter chord, m: the tail's arm if not given."""
        return self.arm_m if self.fin_arm_m is None else self.fin_arm_m


_MOTIONS = (
    "bend",
    "twist",
    "curvature",
    "tail_up",
    "tail_pitch",
    "tail_side",
    "tail_roll",
    "tail_yaw",
    "body_up",
    "body_pitch",
    "body_roll",
)


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of motion, per unit of its coordinate.

    Attributes:
        bend: (n,) displacement of the elastic axis of the right wing, m, up.
        twist: (n,) rad, nose up.
        curvature: (n,) second derivative of ``bend`` along the span, 1/m: strain per distance from the neutral axis.
        tail_up, tail_pitch, tail_side, tail_roll, tail_yaw: of the tail, m (up, right) and rad.
        body_up, body_pitch, body_roll: of the fuselage, m and rad.
        symmetric: the left wing does the same; else the opposite.
    """

    bend: FloatArray
    twist: FloatArray
    curvature: FloatArray = field(default_factory=lambda: np.zeros(STRIPS))
    tail_up: float = 0.0
    tail_pitch: float = 0.0
    tail_side: float = 0.0
    tail_roll: float = 0.0
    tail_yaw: float = 0.0
    body_up: float = 0.0
    body_pitch: float = 0.0
    body_roll: float = 0.0
    symmetric: bool = field(default=True, kw_only=True)


def combine(shapes: list[Shape], weights: FloatArray) -> Shape:
    """Return the sum of shapes of one symmetry times ``weights``."""
    parts = [sum(w * getattr(s, name) for w, s in zip(weights, shapes, strict=True)) for name in _MOTIONS]
    return Shape(*parts, symmetric=shapes[0].symmetric)


def scaled(shape: Shape, factor: float) -> Shape:
    """Return the shape times a factor."""
    return Shape(*(getattr(shape, name) * factor for name in _MOTIONS), symmetric=shape.symmetric)
