"""Aerodynamic derivatives by quasi-steady strips: what each motion does to the aircraft and to its mode shapes.

Lift acts at the quarter chord; the angle of attack is that at the three-quarter chord,

    alpha_local = alpha + twist - wdot(3/4) / V,     L' = qbar c a alpha_local,

and a section that rotates carries the non-circulatory lift qbar c (pi c / 2) twistdot / V at its three-quarter chord
(quasi-steady limit of T. Theodorsen, NACA report 496, 1935). Generalised forces are the work of these loads on the mode
shapes (M. R. Waszak, D. K. Schmidt, J. Aircraft 25(6), 1988). The lag of the wake is wake.py's; the wing's downwash on
the tail due to elastic motion is left out. Coefficients are nondimensional as in elastic.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from testbench.aircraft.elastic import ElasticMode, WingShape
from testbench.core.record import FloatArray

STRIPS = 80  # per wing; 40 change no coefficient by more than 0.1 %


@dataclass(frozen=True)
class Wing:
    """A trapezoidal wing: span and root chord in m, the rest in fractions of the chord or of the wing."""

    # span_m, root_chord_m, taper: plan form
    span_m: float
    root_chord_m: float
    taper: float
    mass_kg: float  # both sides; the mass per length goes with the square of the chord if ``mass_points`` do not say it
    # elastic_axis, centre_of_mass: fractions of the chord behind the leading edge
    elastic_axis: float
    centre_of_mass: float
    gyration: float  # radius of gyration of a section about its centre of mass, fraction of the chord
    lift_slope: float  # per rad, of a strip
    quarter_chord_m: float  # X of the quarter chord in the plane of symmetry
    sweep_rad: float = 0.0  # of the quarter-chord line, backwards
    # (y in m, kg/m) along the right wing, linear between them and constant beyond
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
    """The tail at the end of the boom, at X = -arm."""

    arm_m: float  # from the centre of gravity to the tail's quarter chord
    mass_kg: float  # tail, moving with the end of the boom
    # area_m2, lift_slope, downwash, elevator: horizontal tail; downwash d eps / d alpha, elevator effectiveness
    area_m2: float
    lift_slope: float
    downwash: float
    elevator: float
    # fin_area_m2, fin_slope, fin_height_m, rudder: fin, with its centre above the boom
    fin_area_m2: float
    fin_slope: float
    fin_height_m: float
    rudder: float
    span_m: float  # of the horizontal tail, for its damping in roll
    # roll_inertia_kg_m2, mass_height_m: inertia about the boom, and height of the tail's centre of mass above it
    roll_inertia_kg_m2: float
    mass_height_m: float
    fin_arm_m: float | None = None  # from the centre of gravity to the fin's quarter chord, where it is not the tail's

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
    """One shape of motion, per unit of its coordinate."""

    bend: FloatArray  # (n,) displacement of the elastic axis of the right wing, m, up
    twist: FloatArray  # (n,) rad, nose up
    # (n,) second derivative of ``bend`` along the span, 1/m: strain per distance from the neutral axis
    curvature: FloatArray = field(default_factory=lambda: np.zeros(STRIPS))
    # tail_up, tail_pitch, tail_side, tail_roll, tail_yaw: of the tail, m (up, right) and rad
    tail_up: float = 0.0
    tail_pitch: float = 0.0
    tail_side: float = 0.0
    tail_roll: float = 0.0
    tail_yaw: float = 0.0
    # body_up, body_pitch, body_roll: of the fuselage, m and rad
    body_up: float = 0.0
    body_pitch: float = 0.0
    body_roll: float = 0.0
    symmetric: bool = field(default=True, kw_only=True)  # the left wing does the same; else the opposite


def combine(shapes: list[Shape], weights: FloatArray) -> Shape:
    """Return the sum of shapes of one symmetry times ``weights``."""
    parts = [sum(w * getattr(s, name) for w, s in zip(weights, shapes, strict=True)) for name in _MOTIONS]
    return Shape(*parts, symmetric=shapes[0].symmetric)


def scaled(shape: Shape, factor: float) -> Shape:
    """Return the shape times a factor."""
    return Shape(*(getattr(shape, name) * factor for name in _MOTIONS), symmetric=shape.symmetric)


MOTIONS = {True: ("zero", "alpha", "q", "de"), False: ("beta", "p", "r", "da", "dr")}
"""Symmetric or not -> the rigid motions and controls that drive such modes."""


@dataclass(frozen=True, eq=False)
class Flow:
    """What a unit of one motion does to the flow."""

    wing: FloatArray  # (n,) angle of attack of the right wing's strips, rad
    rotation: FloatArray  # (n,) twist rate over speed, 1/m, of the right wing's strips
    tail: float = 0.0  # angle of attack of the horizontal tail
    fin: float = 0.0  # angle of the flow at the fin, positive from the right
    tail_roll: float = 0.0  # roll rate over speed of the tail, 1/m
    symmetric: bool = True  # the left wing sees the same; else the opposite


@dataclass(frozen=True)
class StripModel:
    """Wing, tail, reference quantities, and the constants that strips do not give."""

    wing: Wing
    tail: Tail
    # S_m2, cbar_m: reference area and chord
    S_m2: float
    cbar_m: float
    dihedral_rad: float  # of the wing
    CL: float  # lift coefficient at the design condition, which roll due to yaw rate goes with
    zero_lift_rad: float  # angle of attack of the wing at zero alpha of the aircraft
    aileron: tuple[float, float, float]  # (inner y, outer y, effectiveness d alpha / d da)
    b_m: float | None = None  # reference span; the wing's if not given

    @property
    def b(self) -> float:
        """Reference span, m."""
        return self.wing.span_m if self.b_m is None else self.b_m

    def flow(self, motion: str) -> Flow:
        """Return the flow of a unit of a rigid motion or control, nondimensional as in C_Q ("alpha", "q", "da" ...)."""
        wing, tail, y = self.wing, self.tail, self.wing.y
        zero, one = np.zeros(STRIPS), np.ones(STRIPS)
        long, wide = 2.0 / self.cbar_m, 2.0 / self.b  # q cbar / 2V and p b / 2V of one
        X34 = wing.quarter_line - 0.5 * wing.chord
        inner, outer, effect = self.aileron
        flows = {
            "zero": Flow(self.zero_lift_rad * one, zero),
            "alpha": Flow(one, zero, tail=1.0 - tail.downwash),
            "q": Flow(-X34 * long, long * one, tail=tail.arm_m * long),
            "de": Flow(zero, zero, tail=tail.elevator),
            "beta": Flow(self.dihedral_rad * one, zero, fin=1.0, symmetric=False),
            "p": Flow(y * wide, zero, fin=tail.fin_height_m * wide, tail_roll=wide, symmetric=False),
            "r": Flow(-2.0 * self.CL / wing.lift_slope * y * wide, zero, fin=-tail.fin_arm * wide, symmetric=False),
            "da": Flow(np.where((y > inner) & (y < outer), -effect, 0.0), zero, symmetric=False),
            "dr": Flow(zero, zero, fin=-tail.rudder, symmetric=False),
        }
        return flows[motion]

    def flow_of_deflection(self, shape: Shape) -> Flow:
        """Return the flow of a unit of eta of a mode shape."""
        return Flow(shape.twist, np.zeros(STRIPS), shape.tail_pitch, -shape.tail_yaw, symmetric=shape.symmetric)

    def flow_of_rate(self, shape: Shape) -> Flow:
        """Return the flow of a unit of eta' cbar / 2V of a mode shape."""
        k = 2.0 / self.cbar_m
        side = shape.tail_side + self.tail.fin_height_m * shape.tail_roll
        return Flow(
            -k * self._three_quarter(shape),
            k * shape.twist,
            -k * shape.tail_up,
            k * side,
            k * shape.tail_roll,
            shape.symmetric,
        )

    def rotary(self, shape: Shape) -> Flow:
        """Return the part of :meth:`flow_of_rate` whose lift does not hang on the wake."""
        return Flow(np.zeros(STRIPS), self.flow_of_rate(shape).rotation, symmetric=shape.symmetric)

    def force(self, flow: Flow, shape: Shape) -> float:
        """Return C_Q, the work of a flow's loads on a mode shape over qbar S cbar; 0 across symmetries."""
        if flow.symmetric != shape.symmetric:
            return 0.0
        circulatory, rotary = self._lift(flow)
        quarter = shape.bend + shape.twist * (self.wing.elastic_axis - 0.25) * self.wing.chord
        work = self.wing.both_sides(circulatory * quarter + rotary * self._three_quarter(shape))
        lift, side, roll = self._tail_loads(flow)
        work += lift * shape.tail_up + side * shape.tail_side
        work += (side * self.tail.fin_height_m + roll) * shape.tail_roll
        return work / (self.S_m2 * self.cbar_m)

    def effect(self, flow: Flow) -> dict[str, float]:
        """Return what a flow adds to CL and Cm, or to CY, Cl and Cn, of the aircraft about its centre of gravity."""
        wing, tail, b = self.wing, self.tail, self.b
        circulatory, rotary = self._lift(flow)
        lift, side, roll = self._tail_loads(flow)
        if flow.symmetric:
            X34 = wing.quarter_line - 0.5 * wing.chord
            moment = wing.both_sides(circulatory * wing.quarter_line + rotary * X34) - lift * tail.arm_m
            total = wing.both_sides(circulatory + rotary) + lift
            return {"CL": total / self.S_m2, "Cm": moment / (self.S_m2 * self.cbar_m)}
        rolling = -wing.both_sides((circulatory + rotary) * wing.y) + side * tail.fin_height_m + roll
        yawing = -side * tail.fin_arm
        return {"CY": side / self.S_m2, "Cl": rolling / (self.S_m2 * b), "Cn": yawing / (self.S_m2 * b)}

    def _lift(self, flow: Flow) -> tuple[FloatArray, FloatArray]:
        """Return circulatory and non-circulatory lift per length over qbar, (n,), m."""
        c = self.wing.chord
        return self.wing.lift_slope * c * flow.wing, 0.5 * np.pi * c**2 * flow.rotation

    def _tail_loads(self, flow: Flow) -> tuple[float, float, float]:
        """Return lift, side force (m2) and rolling moment (m3) of the tail over qbar."""
        tail = self.tail
        lift = tail.area_m2 * tail.lift_slope * flow.tail
        side = -tail.fin_area_m2 * tail.fin_slope * flow.fin
        roll = -tail.area_m2 * tail.lift_slope * tail.span_m**2 / 12.0 * flow.tail_roll
        return lift, side, roll

    def _three_quarter(self, shape: Shape) -> FloatArray:
        """Return the displacement of the three-quarter chord, (n,), m."""
        return shape.bend - shape.twist * (0.75 - self.wing.elastic_axis) * self.wing.chord


# --- modes that fly ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Vibration:
    """A mode as a ground vibration test finds it, or as it is assumed."""

    name: str  # for people
    # f_hz, zeta: natural frequency and damping ratio, without air
    f_hz: float
    zeta: float
    mass_kg_m2: float  # generalised mass per unit of the coordinate that ``shape`` belongs to
    shape: Shape  # at the strips


def coupled_modes(
    vibrations: Sequence[Vibration], symmetric: StripModel, asymmetric: StripModel, stations_m: FloatArray
) -> tuple[ElasticMode, ...]:
    """Return the modes with all aerodynamic coefficients; modes of different symmetry do not couple.

    Args:
        vibrations: the modes, in the order in which they are numbered.
        symmetric: strips of the symmetric motions.
        asymmetric: strips of the asymmetric motions; both have one plan form.
        stations_m: (n,) places y along the right wing at which the shapes are written.
    """
    out = []
    for v in vibrations:
        model = symmetric if v.shape.symmetric else asymmetric
        alike = {j: w.shape for j, w in enumerate(vibrations, 1) if w.shape.symmetric == v.shape.symmetric}
        forms = (at_stations(model.wing, values, stations_m) for values in (v.shape.bend, v.shape.twist))
        curvature = at_stations(model.wing, v.shape.curvature, stations_m)
        out.append(
            ElasticMode(
                v.name,
                v.f_hz,
                v.zeta,
                v.mass_kg_m2,
                "symmetric" if v.shape.symmetric else "asymmetric",
                {m: model.force(model.flow(m), v.shape) for m in MOTIONS[v.shape.symmetric]},
                {j: model.force(model.flow_of_deflection(s), v.shape) for j, s in alike.items()},
                {j: model.force(model.flow_of_rate(s), v.shape) for j, s in alike.items()},
                model.effect(model.flow_of_deflection(v.shape)),
                model.effect(model.flow_of_rate(v.shape)),
                WingShape(*(tuple(map(float, form)) for form in (*forms, curvature))),
                {j: model.force(model.rotary(s), v.shape) for j, s in alike.items()},
            )
        )
    return tuple(out)


def at_stations(wing: Wing, values: FloatArray, stations_m: FloatArray) -> FloatArray:
    """Return a quantity of the strips (n,) at stations (k,) along the right wing, by a cubic spline."""
    from scipy.interpolate import CubicSpline

    found = CubicSpline(wing.y, values)(stations_m)
    return np.where(np.abs(found) < 1e-12, 0.0, found)
