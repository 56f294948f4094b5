"""Coefficients of an aircraft from its plan by two methods, about the same point in the same signs.

*Build-up* (AeroSandbox's AeroBuildup): sections with viscous lift and drag (NeuralFoil) strip by strip, each under
the mean induced angle of its surface. Surfaces do not see each other, and
a pitching section takes its incidence at the aerodynamic centre. Both are mended here:

* The tail's incidence is alpha - eps, eps = eps' (alpha - alpha_L0), with the gradient of USAF DATCOM, method 2 of
  section 4.4.1 (J. Roskam, Airplane Design, part VI, eq. 8.45):

      eps' = 4.44 (K_A K_l K_h sqrt(cos L))^1.19,  K_A = 1/A - 1/(1 + A^1.7),  K_l = (10 - 3 l)/7,
      K_h = (1 - |h/b|) / (2 l_h/b)^(1/3)

* A section that pitches about its quarter chord meets the air at its three-quarter chord (thin-aerofoil theory): lift
  CL_a q c/2V more at the quarter chord, and the moment -(CL_a/8) q c/2V of its apparent camber.

* The lift of a flap is that of the section; here it is reduced as the lift of incidence is, by the ratio of the lift
  slopes of surface and section, AeroBuildup's own (CL/cl)^0.8. The lift of camber is left as it is: too large by as
  much.

* Lift that one side gains and the other loses is reduced as that of a wing of half the aspect ratio (lifting line,
  second term of Glauert's series): the wing's share of Cl_p, Cl_r and Cn_p, and what ailerons do.

*Lattice* (vortex lattice, lattice.py): surfaces see each other, without viscosity and thickness.

What fuselage, wake and boundary layer do to either method's surfaces stands in interference.py; the drag of the
fuselage is the build-up's.

The lag of the downwash gives both methods' alphadot terms: the tail meets at t what the wing shed at t - l/V, so that
its incidence rises by eps' alphadot l/V (B. Etkin, L. D. Reid, Dynamics of Flight, 3rd ed., section 5.6):

      CL_alphadot = 2 CL_a,t eps' l/cbar,   Cm_alphadot = 2 Cm_a,t eps' l/cbar

with CL_a,t and Cm_a,t of the tail alone, referred to S and cbar, and l from the wing's quarter chord to the tail's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.aircraft.geometry.lattice import FLAP, Lattice, body, cuts, moved_by, share, sidewash
from testbench.aircraft.geometry.shape import Airfoil, LiftingSurface, Moved, Plane
from testbench.core.constants import COEFFICIENTS, DEG_RAD, G0_M_S2
from testbench.core.errors import MissingPackage, ModelError, missing
from testbench.core.record import FloatArray

_LINEAR = ("CL", "CY", "Cl", "Cm", "Cn")
STATES = ("alpha", "beta", "p", "q", "r")
# Steps of differences. Those of angles span the flight about the trim: lift of a small wing is no straight line
# (bubbles of laminar flow), and the model's is to fit there. Rates are nondimensional.
_STEPS = {"alpha": 3.0 * DEG_RAD, "beta": 3.0 * DEG_RAD, "p": 0.05, "q": 0.005, "r": 0.05}
_DEFLECTION_DEG = 4.0
_SWEEP_DEG = tuple(range(-14, 19))
_STALL = 0.20  # of CL that lift may differ from the straight line before alpha leaves its range
_STRAIGHT = 0.10  # the same for the polar's fit, which begins at CL = 0 or so far below the trim
_BELOW = 0.4
_ROOM = 5.0 * DEG_RAD  # about the trim that alpha has at least; judged


@dataclass(frozen=True)
class Method:
    """What one method finds at the trimmed alpha."""

    # "CL_alpha", "Cm_de" and so on -> value per rad, or per nondimensional rate; CL0 and Cm0 at alpha = 0 of the
    # straight lines through the trim
    values: Mapping[str, float]
    k: float  # induced drag over (CL - CL of least drag)^2
    downwash: float  # eps'


@dataclass(frozen=True)
class Aerodynamics:
    """What both methods find."""

    # buildup, lattice: either method
    buildup: Method
    lattice: Method
    alpha_rad: float  # at which the lattice and the fuselage carry the weight at the design speed
    CL: float  # lift coefficient there
    # CD0, CL_least_drag: of the build-up's polar CD = CD0 + k (CL - CL_least_drag)^2, and its error, rms of CD
    CD0: float
    CL_least_drag: float
    polar_rms: float
    alpha_limits_rad: tuple[float, float]  # between which the build-up's lift follows a straight line


def aerosandbox() -> Any:
    """Return the package.

    Raises:
        MissingPackage: it is not installed; names the extra.
    """
    try:
        import aerosandbox as asb
    except ImportError as error:
        raise MissingPackage(missing("an aircraft from its geometry needs aerosandbox", "geometry")) from error
    return asb


def aerodynamics(plane: Plane, mass_kg: float, V_m_s: float, h_m: float) -> Aerodynamics:
    """Return both methods' coefficients of an aircraft whose places count from its centre of gravity.

    Args:
        plane: the outside, about the centre of gravity.
        mass_kg: whose weight the lift carries.
        V_m_s: speed of the design condition.
        h_m: its height in the standard atmosphere.

    Raises:
        MissingPackage: AeroSandbox is not installed.
        ModelError: the aircraft cannot carry its weight at this speed.
    """
    asb = aerosandbox()
    air = asb.Atmosphere(altitude=h_m)
    qbar = 0.5 * float(air.density()) * V_m_s**2
    CL = mass_kg * G0_M_S2 / (qbar * plane.S_m2)
    mach = V_m_s / float(air.speed_of_sound())
    lattice = Lattice(plane, mach=mach)
    low, high = (lattice.run({"alpha": alpha})["CL"] for alpha in (0.0, 4.0 * DEG_RAD))
    slope = (high - low) / (4.0 * DEG_RAD)
    if not slope > 0.0:
        raise ModelError(f"lift must rise with alpha, got a slope of {slope:.3g} per rad: check the sections' order")
    alpha = (CL - low) / slope
    if not -10.0 * DEG_RAD < alpha < 16.0 * DEG_RAD:
        raise ModelError(
            f"the aircraft must carry {mass_kg:g} kg at {V_m_s:g} m/s between -10 and 16 deg of alpha, got CL = "
            f"{CL:.2f} at "
            f"{alpha / DEG_RAD:.1f} deg: fly {'faster' if alpha > 0.0 else 'slower'}, or check areas and mass"
        )
    buildup = _Buildup(asb, plane, air, V_m_s)
    found = _lattice_method(plane, lattice, mach, alpha)
    built, polar = _buildup_method(plane, buildup, alpha)
    k, CD0, least, rms, (low, high) = polar
    limits = (min(low, alpha - _ROOM), max(high, alpha + _ROOM))
    built = Method(built.values, k, built.downwash)
    return Aerodynamics(built, found, alpha, CL, CD0, least, rms, limits)


# --- what either method makes of a point ---------------------------------------------------------------------------


def _operating_point(asb: Any, plane: Plane, air: Any, V_m_s: float, at: Mapping[str, Any]) -> Any:
    """Return AeroSandbox's operating point for alpha, beta (rad) and nondimensional rates, scalars or (n,)."""
    rates = {n: at.get(n, 0.0) * 2.0 * V_m_s / (plane.cbar_m if n == "q" else plane.b_m) for n in ("p", "q", "r")}
    angles = {n: at.get(n, 0.0) / DEG_RAD for n in ("alpha", "beta")}
    return asb.OperatingPoint(atmosphere=air, velocity=V_m_s, **angles, **rates)


def _points(alpha: float) -> list[dict[str, float]]:
    """Return the points of central differences about ``alpha``, up then down for each of STATES."""
    points = []
    for name in STATES:
        for sign in (1.0, -1.0):
            at = {"alpha": alpha}
            at[name] = at.get(name, 0.0) + sign * _STEPS[name]
            points.append(at)
    return points


def _differences(found: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return "CL_alpha" and so on from values at the points of :func:`_points`."""
    out = {}
    for i, name in enumerate(STATES):
        for c in COEFFICIENTS:
            out[f"{c}_{name}"] = float((found[c][2 * i] - found[c][2 * i + 1]) / (2.0 * _STEPS[name]))
    return out


def _fuselage(asb: Any, plane: Plane) -> Any:
    sections = [
        asb.FuselageXSec(xyz_c=[h.x_m, 0.0, h.z_m], width=max(h.width_m, 1e-4), height=max(h.height_m, 1e-4))
        for h in plane.body
    ]
    return asb.Fuselage(name="fuselage", xsecs=sections)


def _airplane(asb: Any, plane: Plane, wings: list[Any], fuselages: list[Any]) -> Any:
    return asb.Airplane(
        xyz_ref=[0.0, 0.0, 0.0], wings=wings, fuselages=fuselages, s_ref=plane.S_m2, c_ref=plane.cbar_m, b_ref=plane.b_m
    )


# --- build-up
# ----------------------------------------------------------------------------------------------------------


class _Buildup:
    """AeroBuildup of the whole aircraft, many points at once."""

    def __init__(self, asb: Any, plane: Plane, air: Any, V_m_s: float) -> None:
        self.asb, self.plane, self.air, self.V_m_s = asb, plane, air, V_m_s
        self.sections: dict[int, Any] = {}
        self.fuselages = [_fuselage(asb, plane)] if plane.body else []

    def section(self, blend: tuple[Airfoil, Airfoil, float]) -> Any:
        """Return the Kulfan section between two airfoils; each is fitted once."""
        a, b, t = blend
        for x in (a, b):
            if id(x) not in self.sections:
                self.sections[id(x)] = self.asb.Airfoil(name=x.name, coordinates=x.points).to_kulfan_airfoil()
        first, second = self.sections[id(a)], self.sections[id(b)]
        return first if a is b or t == 0.0 else first.blend_with_another_airfoil(second, t)

    def moved(self, control: Moved | None) -> list[LiftingSurface]:
        """Return the surfaces that a control moves; all if none is given."""
        return [s for s in self.plane.surfaces if control is None or any(f.moves == control for f in s.flaps)]

    def wings(self, control: Moved | None = None, deflection_deg: float = 0.0) -> list[Any]:
        """Return AeroSandbox's wings of the surfaces that a control moves, deflected."""
        out = []
        for surface in self.moved(control):
            places = cuts(surface)
            sections = []
            for i, cut in enumerate(places):
                middle = 0.5 * (cut.s + places[i + 1].s) if i + 1 < len(places) else -1.0
                flaps = [
                    self.asb.ControlSurface(
                        name=moves,
                        symmetric=moves == "de",
                        deflection=gain * deflection_deg if moves == control else 0.0,
                        hinge_point=1.0 - fraction,
                    )
                    for moves, fraction, gain in moved_by(surface, middle)
                ]
                s = cut.station
                sections.append(
                    self.asb.WingXSec(
                        xyz_le=[s.x_m, s.y_m, s.z_m],
                        chord=s.chord_m,
                        twist=s.twist_deg,
                        airfoil=self.section(cut.blend),
                        control_surfaces=flaps,
                    )
                )
            out.append(self.asb.Wing(name=surface.name, symmetric=surface.mirrored, xsecs=sections))
        return out

    def run(self, at: Mapping[str, Any], control: Moved | None = None, deflection_deg: float = 0.0) -> dict[str, Any]:
        """Return coefficients (n,) and, as "parts", all but CD of every surface by itself.

        With a control: of the surfaces that it moves alone, as what it does not move does not change.
        """
        op = _operating_point(self.asb, self.plane, self.air, self.V_m_s, at)
        wings = self.wings(control, deflection_deg)
        found = self.asb.AeroBuildup(
            _airplane(self.asb, self.plane, wings, [] if control else self.fuselages), op
        ).run()
        qS = float(op.dynamic_pressure()) * self.plane.S_m2
        b, cbar = self.plane.b_m, self.plane.cbar_m
        parts = []
        for surface, part in zip(self.moved(control), found["wing_aero_components"], strict=True):
            size = qS / share(self.plane, surface)
            own = (part.L, part.Y, part.l_b / b, part.m_b / cbar, part.n_b / b)
            parts.append({c: np.ravel(v) / size for c, v in zip(_LINEAR, own, strict=True)})
        out: dict[str, Any] = {c: sum(part[c] for part in parts) for c in _LINEAR}
        return {**out, "CD": np.ravel(np.asarray(found["CD"], float)), "parts": parts}

    def finite(self, control: Moved) -> float:
        """Return the lift slope of the surfaces that a control moves over that of their sections, by area."""
        moved = self.moved(control)
        share = 0.5 if control == "da" else 1.0
        return float(np.average([finite_slope(s, share) for s in moved], weights=[s.area_m2 for s in moved]))


def finite_slope(surface: LiftingSurface, share: float = 1.0) -> float:
    """Return the lift slope of a surface over that of its sections, as AeroBuildup has it.

    Args:
        surface: of which twin fins count each by itself.
        share: of its aspect ratio that counts.
    """
    from aerosandbox.library.aerodynamics import CL_over_Cl

    span = surface.length_m * (2.0 if surface.mirrored and surface.role != "fin" else 1.0)
    area = surface.area_m2 / (2.0 if surface.mirrored and surface.role == "fin" else 1.0)
    return float(CL_over_Cl(aspect_ratio=share * span**2 / area, mach=0.0, sweep=0.0)) ** 0.8


def _buildup_method(
    plane: Plane, buildup: _Buildup, alpha: float
) -> tuple[Method, tuple[float, float, float, float, tuple[float, float]]]:
    points = _points(alpha)
    columns = {n: np.array([at.get(n, 0.0) for at in points]) for n in STATES}
    sweep = np.array(_SWEEP_DEG) * DEG_RAD
    both = {n: np.concatenate([columns[n], [alpha], sweep if n == "alpha" else 0.0 * sweep]) for n in STATES}
    both["beta"][len(points)] = both["p"][len(points)] = both["q"][len(points)] = both["r"][len(points)] = 0.0
    found = buildup.run(both)
    n = len(points)
    values = _differences({c: found[c][:n] for c in COEFFICIENTS})
    CL, Cm = float(found["CL"][n]), float(found["Cm"][n])
    step = 2.0 * _STEPS["alpha"]
    slopes = []
    for part in found["parts"]:
        lift, moment = (float((part[c][0] - part[c][1]) / step) for c in ("CL", "Cm"))
        slopes.append((lift, moment))
    for surface, (CL_a, _) in zip(plane.surfaces, slopes, strict=True):  # a pitching section meets the air at 3/4 chord
        x, _, _ = surface.quarter_chord_m
        chord = surface.mean_chord_m / plane.cbar_m
        values["CL_q"] += CL_a * chord
        values["Cm_q"] -= CL_a * chord * x / plane.cbar_m + CL_a * chord**2 / 8.0
    wing_lift, wing_slope = float(found["parts"][0]["CL"][n]), slopes[0][0]
    opposed = finite_slope(plane.wing, 0.5) / finite_slope(plane.wing) - 1.0
    for c, state in (("Cl", "p"), ("Cl", "r"), ("Cn", "p")):
        at = 2 * STATES.index(state)
        share = found["parts"][0][c][at] - found["parts"][0][c][at + 1]
        values[f"{c}_{state}"] += opposed * float(share / (2.0 * _STEPS[state]))
    gradient = 0.0
    for surface, (CL_t, Cm_t) in zip(plane.surfaces, slopes, strict=True):
        if surface.role != "tail":
            continue
        here = downwash_gradient(plane, surface)
        gradient = here or gradient
        eps = here * wing_lift / wing_slope  # eps' (alpha - alpha_L0)
        arm = (surface.quarter_chord_m[0] - plane.wing.quarter_chord_m[0]) / plane.cbar_m
        values["CL_alpha"] -= CL_t * here
        values["Cm_alpha"] -= Cm_t * here
        CL -= CL_t * eps
        Cm -= Cm_t * eps
        values["CL_alphadot"] = values.get("CL_alphadot", 0.0) + 2.0 * CL_t * here * arm
        values["Cm_alphadot"] = values.get("Cm_alphadot", 0.0) + 2.0 * Cm_t * here * arm
    values["CL0"] = CL - values["CL_alpha"] * alpha
    values["Cm0"] = Cm - values["Cm_alpha"] * alpha
    at = 2 * STATES.index("beta")
    for surface, part in zip(plane.surfaces, found["parts"], strict=True):
        for c in ("CY", "Cl", "Cn"):
            slope = float(part[c][at] - part[c][at + 1]) / (2.0 * _STEPS["beta"])
            values[f"{c}_beta"] += (sidewash(plane, surface) - 1.0) * slope
    for name, value in body(plane, wing_slope, gradient).items():
        values[name] += value
    for control in plane.controls:
        up, down = (buildup.run({"alpha": alpha}, control, s * _DEFLECTION_DEG) for s in (1.0, -1.0))
        finite = FLAP * buildup.finite(control)
        for c in _LINEAR:
            values[f"{c}_{control}"] = finite * float((up[c][0] - down[c][0]) / (2.0 * _DEFLECTION_DEG * DEG_RAD))
    polar = _polar(sweep, found["CL"][n + 1 :], found["CD"][n + 1 :], alpha)
    return Method(values, polar[0], gradient), polar


def _polar(
    alpha: FloatArray, CL: FloatArray, CD: FloatArray, trim: float
) -> tuple[float, float, float, float, tuple[float, float]]:
    """Return k, CD0, CL of least drag and error of the polar, and the alphas between which lift is a straight line."""
    near = np.abs(alpha - np.clip(trim, -4.0 * DEG_RAD, 8.0 * DEG_RAD)) < 4.5 * DEG_RAD
    slope, at = np.polyfit(alpha[near], CL[near], 1)
    straight = np.abs(CL - (slope * alpha + at)) < _STALL
    middle = int(np.argmin(np.abs(alpha - np.clip(trim, alpha[near][0], alpha[near][-1]))))
    low = high = middle
    while low > 0 and straight[low - 1]:
        low -= 1
    while high < len(alpha) - 1 and straight[high + 1]:
        high += 1
    at_trim = float(np.interp(trim, alpha, CL))
    inside = (np.abs(CL - (slope * alpha + at)) < _STRAIGHT) & (min(0.0, at_trim - _BELOW) < CL)
    inside &= (np.arange(len(alpha)) >= low) & (np.arange(len(alpha)) <= high)
    a2, a1, a0 = np.polyfit(CL[inside], CD[inside], 2)
    if a2 <= 0.0:
        a2, a1, a0 = 0.0, 0.0, float(np.mean(CD[inside]))
    least = float(-a1 / (2.0 * a2)) if a2 else 0.0
    rms = float(np.sqrt(np.mean((np.polyval((a2, a1, a0), CL[inside]) - CD[inside]) ** 2)))
    return float(a2), float(a0 - a2 * least**2), least, rms, (float(alpha[low]), float(alpha[high]))


def downwash_gradient(plane: Plane, tail: LiftingSurface) -> float:
    """Return d eps / d alpha at a tail behind the wing, by DATCOM (see above); 0 for one ahead of it."""
    wing = plane.wing
    x, _, z = wing.quarter_chord_m
    xt, _, zt = tail.quarter_chord_m
    if xt - x <= 0.5 * wing.mean_chord_m:
        return 0.0
    A, b = wing.aspect_ratio, wing.span_m
    first, last = wing.stations[0], wing.stations[-1]
    taper = min(last.chord_m / first.chord_m, 1.0)
    sweep = math.atan2(wing.swept_m, abs(last.y_m - first.y_m))
    K_A = 1.0 / A - 1.0 / (1.0 + A**1.7)
    K_l = (10.0 - 3.0 * taper) / 7.0
    K_h = (1.0 - abs((zt - z) / b)) / (2.0 * (xt - x) / b) ** (1.0 / 3.0)
    return float(4.44 * (K_A * K_l * K_h * math.sqrt(math.cos(sweep))) ** 1.19)


# --- lattice ----------------------------------------------------------------------------------------------------------


def _lattice_method(plane: Plane, lattice: Lattice, mach: float, alpha: float) -> Method:
    points = _points(alpha)
    each = [lattice.run(at) for at in points]
    values = _differences({c: np.array([f[c] for f in each]) for c in COEFFICIENTS})
    here = lattice.run({"alpha": alpha})
    values["CL0"] = here["CL"] - values["CL_alpha"] * alpha
    values["Cm0"] = here["Cm"] - values["Cm_alpha"] * alpha
    step, gradient = 2.0 * _STEPS["alpha"], 0.0
    for number, surface in enumerate(plane.surfaces):
        if surface.role != "tail":
            continue
        alone = Lattice(plane, number, mach)
        up, down = (alone.run({"alpha": alpha + s * _STEPS["alpha"]}) for s in (1.0, -1.0))
        slope = {c: (up[c] - down[c]) / step for c in ("CL", "Cm")}
        seen = (each[0][f"CL:{number}"] - each[1][f"CL:{number}"]) / step
        arm = (surface.quarter_chord_m[0] - plane.wing.quarter_chord_m[0]) / plane.cbar_m
        eps = 1.0 - seen / slope["CL"] if arm > 0.0 else 0.0
        gradient = eps or gradient
        for c in ("CL", "Cm"):
            values[f"{c}_alphadot"] = values.get(f"{c}_alphadot", 0.0) + 2.0 * slope[c] * eps * arm
    for control in plane.controls:
        d = _DEFLECTION_DEG * DEG_RAD
        moved = [lattice.run({"alpha": alpha}, control, s * d) for s in (1.0, -1.0)]
        for c in COEFFICIENTS:
            values[f"{c}_{control}"] = FLAP * (moved[0][c] - moved[1][c]) / (2.0 * d)
    for name, value in body(plane, (each[0]["CL:0"] - each[1]["CL:0"]) / step, gradient).items():
        values[name] += value
    # Induced drag over lift, through three points: the lattice sees it in the forces on its bound vortices.
    lifts = [each[0], here, each[1]]
    a2 = float(np.polyfit([f["CL"] for f in lifts], [f["CD"] for f in lifts], 2)[0])
    return Method(values, a2, gradient)


# --- signs ----------------------------------------------------------------------------------------------------------


# Control -> its own moment, and the sign of what it does: core/channels.py.
_OWN = {"de": ("Cm", -1.0), "da": ("Cl", 1.0), "dr": ("Cn", -1.0)}


def check_sign(control: Moved, found: Aerodynamics) -> None:
    """Refuse a control that does not do what its name says, as the rudder of a fin ahead of the centre of gravity.

    Raises:
        ModelError: by either method it moves the aircraft against its convention.
    """
    moment, sign = _OWN[control]
    for words, method in (("lattice", found.lattice), ("build-up", found.buildup)):
        value = method.values[f"{moment}_{control}"]
        if not sign * value > 0.0:
            raise ModelError(
                f"{control} must have {moment}_{control} {'<' if sign < 0 else '>'} 0 (signs: "
                f"core/channels.py), the {words} finds "
                f"{value:.3g} per rad: check where its surface is, about the centre of gravity"
            )
