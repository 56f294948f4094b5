"""Derive the aerodynamic and elastic coefficients of the EOLO-like aircraft from its geometry and estimated masses.

    python aircraft_models/eolo/derive.py            # print them
    python aircraft_models/eolo/derive.py --write    # write them into eolo.xml and aircraft.toml

Published (EOLO paper, tables 1 and 2): S, b, cbar, mass, inertias, the eight frequencies and damping ratios. Everything
else below is estimated; the mode shapes and generalised masses follow from it by Rayleigh-Ritz, the coefficients by
strips, and the yawing moments of the wing, made of induced velocities, by a lifting line. The frequencies of the
assumed-mode model differ from the ground test's; the ground test's are used.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from testbench.aircraft.elastic import ElasticModel
from testbench.aircraft.strips.loads import (
    MOTIONS,
    Shape,
    StripModel,
    Tail,
    Vibration,
    Wing,
    at_stations,
    coupled_modes,
)
from testbench.aircraft.strips.ritz import Modes, Stiffness, asymmetric_modes, symmetric_modes
from testbench.core.record import FloatArray

FOLDER = Path(__file__).resolve().parent
S, b, cbar, mass, Ixx, Iyy = 0.846, 4.0, 0.2311, 8.87, 2.53, 1.60  # published
TAPER = 0.31  # computed: the trapezoid with S / b = 0.2115 m and mean aerodynamic chord 0.2311 m
WING = Wing(
    span_m=b,
    root_chord_m=2.0 * S / b / (1.0 + TAPER),
    taper=TAPER,
    mass_kg=3.0,  # estimated: a third of the aircraft
    elastic_axis=0.35,  # estimated: the main spar's place
    centre_of_mass=0.42,  # estimated: skin and trailing edge behind the spar
    gyration=0.27,  # estimated: a uniform plate has 0.29
    lift_slope=5.65,  # computed: Helmbold's formula for AR = 18.91
    quarter_chord_m=0.022,  # chosen: with this tail, a static margin of 2.6 % of the chord (SOURCES.md says why)
)
TAIL = Tail(
    arm_m=1.05,
    mass_kg=0.35,
    area_m2=0.060,  # chosen with the static margin: Cm_q = -10.6
    lift_slope=3.3,
    downwash=0.35,
    elevator=0.55,
    fin_area_m2=0.060,
    fin_slope=2.8,
    fin_height_m=0.08,
    rudder=0.5,
    span_m=0.50,
    roll_inertia_kg_m2=0.006,
    mass_height_m=0.036,
)  # all estimated: a small tail on a glider's boom
BOOM_UP, BOOM_SIDE, BOOM_ROLL, POWER = 3e4, 1500.0, 16.0, 1.5  # estimated; boom torsion near 7.7 Hz
MODEL = StripModel(
    WING,
    TAIL,
    S_m2=S,
    cbar_m=cbar,
    dihedral_rad=np.radians(4.0),
    CL=0.69,
    zero_lift_rad=0.30 / 5.65,
    aileron=(1.2, 1.9, 0.4),
)
# --- the lifting line ------------------------------------------------------------------------------------------------

# What a wing that rolls, yaws or turns its ailerons does in yaw, by Prandtl's lifting line.
#
# Strips see no induced velocity, and these moments are made of it. With y to the right, W the air that comes up at a
# section, U that it meets from ahead, w the downwash of the free vortices and m the lift slope of a section,
#
#     Gamma = m c (W - w) / 2 = 2 b V sum of A_n sin(n theta),    y = b / 2 cos(theta),
#     w / V = sum of n A_n sin(n theta) / sin(theta)
#
# (H. Glauert, The Elements of Aerofoil and Airscrew Theory, 1926, chapter 11). A section's force along the flight path
# is rho Gamma (W' - w), W' the part of W that comes of rolling: the lift of a wing that goes down leans forward. Its
# profile drag is rho U^2 c cd / 2. The series is solved by collocation, for the steady flight and for a small motion
# about it. The wake of a yawing wing is taken for straight.

TERMS = 120  # 60 change no moment by more than 0.3 %


class LiftingLine(NamedTuple):
    """An untwisted wing in steady flight at lift coefficient CL.

    Attributes:
        span_m: b.
        chord_m: (TERMS,) at the sections ``y``.
        CL: of the wing.
        profile_drag: drag coefficient cd of a section.
        section_slope: m, per rad.
    """

    span_m: float
    chord_m: FloatArray
    CL: float
    profile_drag: float
    section_slope: float = 2.0 * np.pi

    @property
    def area_m2(self) -> float:
        """Area of the wing, m2."""
        return self._integral(self.chord_m)

    def moments(self, motion: str, aileron: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, float]:
        """Return Cl and Cn of the wing per unit of p b / 2V ("p"), of r b / 2V ("r") or of the aileron ("da").

        Args:
            motion: which.
            aileron: inner y, outer y (m), and effectiveness d alpha / d da.

        Cl is positive right wing down, Cn nose right; a positive aileron takes lift from the right wing.
        """
        b, c, y = self.span_m, self.chord_m, sections(self.span_m)
        gamma0, down0 = self._vortices(self._incidence() * np.ones(TERMS))
        ahead, rolling = np.zeros(TERMS), np.zeros(TERMS)  # changes of U / V and of W' / V
        if motion == "p":
            rolling = 2.0 * y / b
            change = rolling
        elif motion == "r":
            ahead = -2.0 * y / b
            change = self._incidence() * ahead
        else:
            change = -aileron[2] * np.sign(y) * self._share(*aileron[:2])
        gamma, down = self._vortices(change)
        lift = 2.0 * (gamma + gamma0 * ahead)  # per length, over qbar; gamma is over V
        forward = 2.0 * (gamma0 * (rolling - down) - gamma * down0) - 2.0 * c * self.profile_drag * ahead
        size = self.area_m2 * b
        return {"Cl": -self._integral(lift * y) / size, "Cn": -self._integral(forward * y) / size}

    def lift_slope(self) -> float:
        """Return CL per rad of the wing."""
        return self._integral(2.0 * self._vortices(np.ones(TERMS))[0]) / self.area_m2

    def _share(self, inner_m: float, outer_m: float) -> FloatArray:
        """Return the share of each section's piece of span that lies between two distances from the middle."""
        edges = 0.5 * self.span_m * np.cos(np.arange(TERMS + 1) * np.pi / TERMS)
        high, low = np.maximum(abs(edges[:-1]), abs(edges[1:])), np.minimum(abs(edges[:-1]), abs(edges[1:]))
        return np.asarray(np.clip(np.minimum(high, outer_m) - np.maximum(low, inner_m), 0.0, None) / (high - low))

    def _incidence(self) -> float:
        return self.CL / self.lift_slope()

    def _vortices(self, upwash: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return Gamma / V (m) and w / V at the sections, where ``upwash`` is W / V."""
        n, theta = np.arange(1, TERMS + 1), _angles()[:, None]
        sines = np.sin(n * theta)
        induced = n * sines / np.sin(theta)
        half = 0.5 * self.section_slope * self.chord_m
        A = np.linalg.solve(2.0 * self.span_m * sines + half[:, None] * induced, half * upwash)
        return 2.0 * self.span_m * sines @ A, induced @ A

    def _integral(self, per_length: FloatArray) -> float:
        """Return the integral over the span; the midpoint rule in theta is exact for the products of the series."""
        return float(np.sum(per_length * np.sin(_angles())) * 0.5 * self.span_m * np.pi / TERMS)


def _angles() -> FloatArray:
    return np.asarray((np.arange(TERMS) + 0.5) * np.pi / TERMS, dtype=np.float64)


def sections(span_m: float) -> FloatArray:
    """Return y (TERMS,) of the sections of a wing, right ones first, m."""
    return 0.5 * span_m * np.cos(_angles())


# The profile drag is estimated: a section at a Reynolds number of 2.3e5.
LINE = LiftingLine(
    b, WING.root_chord_m * (1.0 - (1.0 - TAPER) * np.abs(sections(b)) / (0.5 * b)), CL=MODEL.CL, profile_drag=0.015
)
BODY = {"CY_beta": -0.15, "Cn_beta": -0.010}  # estimated: the fuselage
STATIONS = np.linspace(0.0, 0.5 * b, 17)
# Number, symmetric, index among the modes of its symmetry, name, ground-test frequency and damping, and what a unit of
# the coordinate is: wing-tip deflection of one chord cbar, tip twist of 1 rad, or tail roll of 1 rad.
GROUND_TEST = (
    (True, 0, "1st symmetric wing bending", 4.6, 0.016, "tip"),
    (False, 0, "tail-boom torsion", 7.7, 0.021, "roll"),
    (False, 1, "1st asymmetric wing bending and tail-boom torsion, lower", 10.6, 0.022, "tip"),
    (False, 2, "1st asymmetric wing bending and tail-boom torsion, upper", 11.6, 0.012, "roll"),
    (True, 1, "1st symmetric wing torsion and tail-boom bending", 15.0, 0.017, "twist"),
    (False, 3, "1st asymmetric wing torsion", 19.1, 0.032, "twist"),
    (True, 2, "2nd symmetric wing bending and symmetric wing torsion", 21.2, 0.038, "tip"),
    (False, 4, "2nd asymmetric wing bending", 30.4, 0.024, "tip"),
)


def stiffness() -> Stiffness:
    """Return the stiffness that puts the first symmetric bending and torsion at 4.6 and 15.0 Hz."""

    def make(v: np.ndarray) -> Stiffness:
        return Stiffness(*np.exp(v), POWER, BOOM_UP, BOOM_SIDE, BOOM_ROLL)

    def miss(v: np.ndarray) -> np.ndarray:
        return np.log(symmetric_modes(WING, TAIL, make(v), mass, Iyy).f_hz[:2] / np.array([4.6, 15.0]))

    return make(least_squares(miss, np.log([500.0, 35.0])).x)


def modes() -> tuple[list[Shape], list[float], dict[bool, Modes]]:
    """Return the eight shapes in the order of the ground test, their generalised masses, kg m2, and all modes."""
    k = stiffness()
    found = {True: symmetric_modes(WING, TAIL, k, mass, Iyy), False: asymmetric_modes(WING, TAIL, k, Ixx)}
    shapes, masses = [], []
    for symmetric, i, _, _, _, unit in GROUND_TEST:
        shape, m = found[symmetric].shapes[i], found[symmetric].masses[i]
        bend, twist = (at_stations(WING, values, STATIONS)[-1] for values in (shape.bend, shape.twist))
        tip = {"tip": bend / cbar, "twist": twist}
        size = tip.get(unit, shape.tail_roll)
        shapes.append(Shape(*(getattr(shape, n) / size for n in MOTION_FIELDS), symmetric=symmetric))
        masses.append(float(m / size**2))
    return shapes, masses, found


MOTION_FIELDS = tuple(n for n in Shape.__dataclass_fields__ if n != "symmetric")


def rigid() -> dict[str, float]:
    """Return the coefficients of eolo.xml that strips give, and the wing's yawing moments by the lifting line."""
    out = {}
    for symmetric, motions in MOTIONS.items():
        for motion in motions:
            for name, value in MODEL.effect(MODEL.flow(motion)).items():
                if motion != "zero" and (symmetric or (name, motion) not in SKIPPED):
                    out[f"{name}_{motion}"] = value + BODY.get(f"{name}_{motion}", 0.0)
    for motion in ("p", "r", "da"):
        out[f"Cn_{motion}"] += LINE.moments(motion, MODEL.aileron)["Cn"]
    out["CL0"] = MODEL.effect(MODEL.flow("zero"))["CL"]
    return {name: float(f"{value:.4g}") for name, value in out.items()}


SKIPPED = {("CY", "da")}  # nothing


def elastic_toml() -> str:
    """Return the [elastic] table of aircraft.toml."""
    shapes, masses, _ = modes()
    found = [
        Vibration(name, f_hz, zeta, m, shape)
        for (_, _, name, f_hz, zeta, _), m, shape in zip(GROUND_TEST, masses, shapes, strict=True)
    ]
    coupled = ElasticModel(tuple(coupled_modes(found, MODEL, MODEL, STATIONS)), S, cbar, tuple(STATIONS))
    return coupled.toml(lambda value: f"{value:.5g}")


def amended_files() -> dict[Path, str]:
    """Return path -> text of eolo.xml and aircraft.toml with the derived coefficients in place."""
    xml = (FOLDER / "eolo.xml").read_text(encoding="utf-8")
    for name, value in rigid().items():
        pattern = rf'(<function name="aero/coefficient/{name}">.*?)<value>[^<]*</value>'
        xml, count = re.subn(pattern, rf"\g<1><value>{value}</value>", xml, count=1, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"eolo.xml must hold aero/coefficient/{name}, got none")
    toml = (FOLDER / "aircraft.toml").read_text(encoding="utf-8")
    toml = re.split(r"^\[elastic\]$|^\[\[elastic", toml, maxsplit=1, flags=re.MULTILINE)[0] + elastic_toml()
    return {FOLDER / "eolo.xml": xml, FOLDER / "aircraft.toml": toml}


if __name__ == "__main__":
    _, _, found = modes()
    print("frequencies of the assumed-mode model, Hz")
    for symmetric, word in ((True, "symmetric"), (False, "asymmetric")):
        print(f"  {word}: {', '.join(f'{f:.1f}' for f in found[symmetric].f_hz[:6])}")
    print("\n".join(f"{name} = {value}" for name, value in rigid().items()))
    print(elastic_toml())
    if "--write" in sys.argv[1:]:
        for path, text in amended_files().items():
            path.write_text(text, encoding="utf-8")
