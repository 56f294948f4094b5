"""What geometry.toml may hold, and what a file beside an AVL plane may hold. SI, with the unit in every key.

Places are x aft, y along the right wing, z up, from any origin that the whole file shares.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.core.schema import NonNegative, Positive, Range, Strict

Place = Annotated[tuple[float, float, float], Field(strict=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Angle = Annotated[float, Field(gt=-80.0, lt=80.0)]


class Item(Strict):
    """A point mass, or a box of even density: its middle, and its extent along x, y and z.

    ``mirrored`` puts a second one of the same mass at -y.
    """

    name: str
    mass_kg: Positive
    at_m: Place
    size_m: Annotated[tuple[NonNegative, NonNegative, NonNegative], Field(strict=False)] = (0.0, 0.0, 0.0)
    mirrored: bool = False


class Mass(Strict):
    """Mass, centre of gravity and inertias about it, or the items that they follow from.

    Ixz is that of the aircraft's body axes (x forward, z down), the integral of x z. Without any inertia all of them
    are estimated from radii of gyration.
    """

    mass_kg: Positive | None = None
    cg_m: Place | None = None
    Ixx_kg_m2: Positive | None = None
    Iyy_kg_m2: Positive | None = None
    Izz_kg_m2: Positive | None = None
    Ixz_kg_m2: float | None = None
    item: Annotated[tuple[Item, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_way(self) -> Mass:
        axes = (self.Ixx_kg_m2, self.Iyy_kg_m2, self.Izz_kg_m2)
        said = [self.mass_kg, self.cg_m, *axes, self.Ixz_kg_m2]
        if self.item:
            if any(v is not None for v in said):
                raise ValueError(
                    "mass must have items, or mass, centre of gravity and inertias, got both: leave one out"
                )
            return self
        if self.mass_kg is None or self.cg_m is None:
            raise ValueError("mass must have mass_kg and cg_m, or a list of items, got neither: give one of them")
        given = [v for v in axes if v is not None]
        if len(given) not in (0, 3) or (self.Ixz_kg_m2 is not None and not given):
            raise ValueError("Ixx_kg_m2, Iyy_kg_m2 and Izz_kg_m2 must all be given or all be left out")
        if len(given) == 3:
            _check_inertias(given[0], given[1], given[2], self.Ixz_kg_m2 or 0.0)
        return self


def _check_inertias(Ixx: float, Iyy: float, Izz: float, Ixz: float) -> None:
    """Raise ValueError if no body has these inertias, kg m2."""
    for a, b, c, words in ((Ixx, Iyy, Izz, "Ixx + Iyy >= Izz"), (Iyy, Izz, Ixx, "Iyy + Izz >= Ixx"),
                           (Izz, Ixx, Iyy, "Izz + Ixx >= Iyy")):  # fmt: skip
        if a + b < c:
            raise ValueError(f"the triangle rule {words} must hold for any body, got {a:g} + {b:g} < {c:g} kg m2")
    if Ixz**2 >= Ixx * Izz:
        raise ValueError(f"Ixz^2 < Ixx Izz must hold for any body, got Ixz = {Ixz:g} kg m2")


class Section(Strict):
    """A section of a surface: leading edge, chord, twist nose up, and its airfoil if not that of the surface."""

    x_m: float
    y_m: float = 0.0
    z_m: float = 0.0
    chord_m: Positive
    twist_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0
    airfoil: str | None = None


class Trapezoid(Strict):
    """A surface, as a trapezoid (span_m, root_chord_m, ...) or section by section from the root outwards.

    Attributes:
        airfoil: of all sections that name none.
        span_m: from tip to tip; of a fin, from foot to tip.
        root_chord_m, tip_chord_m: the tip's is the root's if not given.
        x_m, y_m, z_m: leading edge of the root; y is for twin fins only.
        sweep_deg: of the quarter-chord line, backwards.
        dihedral_deg: tips up; of a fin, cant: tip outwards.
        incidence_deg: of the whole surface, nose up.
        twist_deg: of the tip against the root.
        section: instead of the keys above, incidence excepted.
    """

    airfoil: str | None = None
    span_m: Positive | None = None
    root_chord_m: Positive | None = None
    tip_chord_m: Positive | None = None
    x_m: float = 0.0
    y_m: NonNegative = 0.0
    z_m: float = 0.0
    sweep_deg: Angle = 0.0
    dihedral_deg: Angle = 0.0
    incidence_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0
    twist_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0
    section: Annotated[tuple[Section, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_way(self) -> Trapezoid:
        shape = sorted(self.model_fields_set - {"airfoil", "section", "incidence_deg", "twin"})
        if self.section and shape:
            raise ValueError(
                f"a surface must have sections or the keys of a trapezoid, got both: leave out {', '.join(shape)}"
            )
        if len(self.section) == 1:
            raise ValueError("a surface must have at least two sections, got 1")
        if not self.section:
            missing = [k for k in ("span_m", "root_chord_m") if getattr(self, k) is None]
            if missing:
                raise ValueError(
                    f"a surface must have sections or span_m and root_chord_m, {' and '.join(missing)} missing"
                )
        return self

    @property
    def sections(self) -> tuple[Section, ...]:
        """Sections from the root outwards: those given, or root and tip of the trapezoid."""
        if self.section or self.root_chord_m is None:
            return self.section
        tip = self.tip_chord_m or self.root_chord_m
        side, across, up = self._to_tip(self.span_m or 0.0, math.radians(self.dihedral_deg))
        aft = side * math.tan(math.radians(self.sweep_deg)) + 0.25 * (self.root_chord_m - tip)
        x, y, z = self.x_m, self.y_m, self.z_m
        ends = ((x, y, z, self.root_chord_m, 0.0), (x + aft, y + across, z + up, tip, self.twist_deg))
        return tuple(Section(x_m=x, y_m=y, z_m=z, chord_m=c, twist_deg=twist) for x, y, z, c, twist in ends)

    @property
    def flat(self) -> bool:
        """Whether the tip stands as high as the root."""
        return self.sections[0].z_m == self.sections[-1].z_m

    def _to_tip(self, span_m: float, tilt: float) -> tuple[float, float, float]:
        """Return the span of one side along which it is swept, and how far the tip lies to the right and up, m."""
        return 0.5 * span_m, 0.5 * span_m, 0.5 * span_m * math.tan(tilt)


class Fin(Trapezoid):
    """A fin; ``twin`` adds a second one at -y, ``downwards`` places it below its root."""

    twin: bool = False
    downwards: bool = False

    def _to_tip(self, span_m: float, tilt: float) -> tuple[float, float, float]:
        return span_m, span_m * math.sin(tilt), (-span_m if self.downwards else span_m) * math.cos(tilt)


class Servo(Strict):
    """What moves a control: full deflection either way, first-order lag, fastest rate."""

    throw_deg: Annotated[float, Field(gt=0.0, le=60.0)]
    lag_rad_s: Positive = 33.0
    rate_limit_deg_s: Positive = 150.0


class Surface(Servo):
    """A control surface: the part of the surface that moves, and its throw."""

    surface: Literal["wing", "tail", "fin"]
    span_from: Share = 0.0
    span_to: Share = 1.0
    chord_fraction: Annotated[float, Field(gt=0.0, le=1.0)]

    @model_validator(mode="after")
    def _has_span(self) -> Surface:
        if not self.span_from < self.span_to:
            raise ValueError(f"span_from < span_to must hold, got {self.span_from:g} and {self.span_to:g}")
        return self


class Named(Servo):
    """The same with an AVL plane, whose CONTROL lines state what moves: their name, if it is not a usual one."""

    avl: str | None = None


class Propeller(Strict):
    """A fixed-pitch propeller and the shaft power that the motor gives it at full throttle."""

    diameter_m: Positive
    pitch_m: Positive
    power_W: Positive


class Motor(Strict):
    """Thrust along x: static thrust and the speed at which full throttle gives none, or a propeller.

    ``at_m`` is where it acts; through the centre of gravity if not given. ``down_deg`` and ``right_deg`` turn it.
    """

    static_thrust_N: Positive | None = None
    zero_thrust_V_m_s: Positive | None = None
    propeller: Propeller | None = None
    at_m: Place | None = None
    down_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0
    right_deg: Annotated[float, Field(ge=-30.0, le=30.0)] = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> Motor:
        two = [self.static_thrust_N is not None, self.zero_thrust_V_m_s is not None]
        if self.propeller is not None and any(two):
            raise ValueError("a motor must have a propeller or static thrust and speed of no thrust, got both")
        if self.propeller is None and not all(two):
            raise ValueError("a motor must have static_thrust_N and zero_thrust_V_m_s, or a propeller")
        return self


class Cross(Strict):
    """A cross-section of the fuselage: x aft, height of its middle z up, width and height."""

    x_m: float
    z_m: float = 0.0
    width_m: NonNegative
    height_m: NonNegative


class Fuselage(Strict):
    """Cross-sections from nose to end."""

    section: Annotated[tuple[Cross, ...], Field(strict=False, min_length=2)]

    @model_validator(mode="after")
    def _runs_aft(self) -> Fuselage:
        xs = [s.x_m for s in self.section]
        if any(b <= a for a, b in pairwise(xs)):
            raise ValueError(f"x_m must rise from nose to end, got {xs}")
        if not any(s.width_m * s.height_m > 0.0 for s in self.section):
            raise ValueError("one section at least must have width and height")
        return self


class Drag(Strict):
    """Drag in addition to that of surfaces and fuselage (gear, gaps, antennas), as a drag coefficient."""

    CD0_added: NonNegative = 0.0


class Reference(Strict):
    """Reference quantities, if not those of the wing: area as seen from above, span, mean chord."""

    S_m2: Positive | None = None
    b_m: Positive | None = None
    cbar_m: Positive | None = None


class Limits(Strict):
    """Limits of flights; those that are not given are derived."""

    V_m_s: Range | None = None
    alpha_deg: Range | None = None
    beta_deg: Range | None = None
    theta_deg: Range | None = None
    phi_deg: Range | None = None
    h_m: Range | None = None


class Common(Strict):
    """What both kinds of files hold: all but lifting surfaces."""

    title: str = ""
    design_V_m_s: Positive
    design_h_m: Annotated[float, Field(ge=-400.0, le=15000.0)] = 100.0
    rate_hz: Annotated[float, Field(ge=50.0, le=2000.0)] = 400.0
    mass: Mass
    fuselage: Fuselage | None = None
    motor: Motor | None = None
    drag: Drag = Drag()
    reference: Reference = Reference()
    limits: Limits = Limits()

    @property
    def body(self) -> tuple[Cross, ...]:
        """Cross-sections of the fuselage from nose to end; none without one."""
        return self.fuselage.section if self.fuselage else ()


class GeometryFile(Common):
    """geometry.toml: a whole aircraft. Without a motor it is a glider, without a tail a flying wing."""

    wing: Trapezoid
    tail: Trapezoid | None = None
    fin: Annotated[tuple[Fin, ...], Field(strict=False)] = ()
    control: dict[Literal["de", "da", "dr"], Surface] = {}


class BesideAvl(Common):
    """Data that an AVL file lacks: mass, design condition, servos, motor, body.

    ``spare_airfoil`` is for sections without coordinates; ``length_unit_m`` is one unit of the AVL file.
    """

    spare_airfoil: str | None = None
    length_unit_m: Positive = 1.0
    control: dict[Literal["de", "da", "dr"], Named] = {}
