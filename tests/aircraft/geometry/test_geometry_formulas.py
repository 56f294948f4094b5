"""What is computed on the way from a plan to its coefficients, formula by formula, against values worked out here.

What fuselage, wake and boundary layer do, by hand.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.aircraft.geometry.aerodynamics import (
    _operating_point,
    _polar,
    aerodynamics,
    downwash_gradient,
    finite_slope,
)
from testbench.aircraft.geometry.build import _remarks, limits_of
from testbench.aircraft.geometry.lattice import Lattice, _inertia_factors, body, share, sidewash
from testbench.aircraft.geometry.model_xml import Polar
from testbench.aircraft.geometry.schema import Cross, Limits
from testbench.aircraft.geometry.shape import LiftingSurface, Plane, Station, airfoil
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import ModelError

pytest.importorskip("aerosandbox", reason="needs the extra geometry: pip install flight-testbench[geometry]")
FLAT = airfoil("naca0010")


def surface(half_m, root, tip, x=0.0, z=0.0, aft_m=0.0, role="wing", mirrored=True, y=0.0, up_m=0.0):
    stations = (
        Station(x - 0.25 * root, y, z, root, 0.0, FLAT),
        Station(x - 0.25 * tip + aft_m, y + half_m, z + up_m, tip, 0.0, FLAT),
    )
    return LiftingSurface(role, role, mirrored, stations)


def plane(*surfaces, hull=()):
    w = surfaces[0]
    return Plane(tuple(surfaces), hull, w.projected_m2, w.span_m, w.mean_chord_m)


def test_an_operating_point_has_degrees_and_rates_per_second():
    p = plane(surface(2.0, 0.5, 0.5))
    asb = SimpleNamespace(OperatingPoint=dict)
    at = {"alpha": 0.1, "beta": -0.05, "p": 0.02, "q": 0.03, "r": -0.04}
    found = _operating_point(asb, p, "air", 20.0, at)
    assert found["velocity"] == 20.0
    assert found["alpha"] == pytest.approx(math.degrees(0.1))
    assert found["beta"] == pytest.approx(math.degrees(-0.05))
    rates = [0.02 * 2 * 20 / 4.0, 0.03 * 2 * 20 / 0.5, -0.04 * 2 * 20 / 4.0]  # p b / 2V, q c / 2V, r b / 2V
    assert [found[n] for n in "pqr"] == pytest.approx(rates)


@pytest.mark.parametrize(("role", "mirrored", "A"), [("wing", True, 8.0), ("fin", False, 4.0), ("fin", True, 4.0)])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_finite_surface_has_datcoms_share_of_its_sections_lift(role, mirrored, A, share):
    rising = {"half_m": 0.0, "up_m": 2.0} if role == "fin" else {"half_m": 2.0}
    s = surface(root=0.5, tip=0.5, role=role, mirrored=mirrored, y=0.3 if role == "fin" and mirrored else 0.0, **rising)
    datcom = share * A / (2.0 + math.sqrt(4.0 + (share * A) ** 2))
    assert finite_slope(s, share) == pytest.approx(datcom**0.8, rel=2e-3)  # its softened Prandtl-Glauert factor: 0.1 %


def test_downwash_is_datcoms():
    w = surface(3.0, 1.2, 0.6, aft_m=0.4)
    t = surface(0.8, 0.4, 0.4, x=4.0, z=-0.7, role="tail")
    A = 6.0**2 / (2.0 * 0.9 * 3.0)
    K_A, K_l = 1.0 / A - 1.0 / (1.0 + A**1.7), (10.0 - 3.0 * 0.5) / 7.0
    xw, xt = w.quarter_chord_m[0], t.quarter_chord_m[0]
    K_h = (1.0 - 0.7 / 6.0) / (2.0 * (xt - xw) / 6.0) ** (1.0 / 3.0)
    expected = 4.44 * (K_A * K_l * K_h * math.sqrt(math.cos(math.atan(0.4 / 3.0)))) ** 1.19
    assert downwash_gradient(plane(w, t), t) == pytest.approx(expected, rel=1e-9)
    canard = surface(0.8, 0.4, 0.4, x=-3.0, role="tail")
    assert downwash_gradient(plane(w, canard), canard) == 0.0
    inverse = surface(3.0, 0.6, 1.2)  # wider at the tip: as wide as at the root
    A = 6.0**2 / (2.0 * 0.9 * 3.0)
    K_A, K_l = 1.0 / A - 1.0 / (1.0 + A**1.7), 1.0
    x, z = (t.quarter_chord_m[i] - inverse.quarter_chord_m[i] for i in (0, 2))
    K_h = (1.0 - abs(z) / 6.0) / (2.0 * x / 6.0) ** (1.0 / 3.0)
    found = downwash_gradient(plane(inverse, t), t)
    assert found == pytest.approx(4.44 * (K_A * K_l * K_h) ** 1.19, rel=1e-9)


@pytest.mark.parametrize("trim_deg", [-1.0, 3.0, 5.0])
def test_a_polar_is_found_between_the_alphas_where_lift_is_straight(trim_deg):
    alpha = np.arange(-12.0, 20.1, 1.0) * DEG_RAD
    line = 0.3 + 5.0 * alpha
    stall = 6.0 * (np.maximum(alpha - 10.0 * DEG_RAD, 0.0) - np.maximum(-8.0 * DEG_RAD - alpha, 0.0))
    CL = line - stall
    CD = 0.02 + 0.05 * (CL - 0.15) ** 2 + 3.0 * (np.abs(stall) > 0.1)
    k, CD0, least, rms, (low, high) = _polar(alpha, CL, CD, trim_deg * DEG_RAD)
    assert (k, CD0, least) == pytest.approx((0.05, 0.02, 0.15))
    assert rms == pytest.approx(0.0, abs=1e-9)
    # within 0.2 of the line: 6 x 1.9 deg = 0.199
    assert (low / DEG_RAD, high / DEG_RAD) == pytest.approx((-9.0, 11.0))


def test_a_polar_that_bends_down_is_a_constant():
    alpha = np.arange(-12.0, 20.1, 1.0) * DEG_RAD
    CL = 5.0 * alpha
    k, least_drag, least, _, ends = _polar(alpha, CL, 0.1 - 0.05 * CL**2, 2.0 * DEG_RAD)
    assert (k, least) == (0.0, 0.0)
    fitted = CL[CL > 5.0 * 2.0 * DEG_RAD - 0.4]  # from so far below the trim
    assert least_drag == pytest.approx(np.mean(0.1 - 0.05 * fitted**2))
    assert ends == (alpha[0], alpha[-1])


def test_an_aircraft_too_heavy_for_its_speed_is_refused():
    p = plane(surface(2.0, 0.5, 0.5))
    mass = 0.5 * 1.225 * 20.0**2 * 2.0 * 1.6 / G0_M_S2  # CL = 1.6 takes some 20 deg
    with pytest.raises(ModelError, match=r"between -10 and 16 deg of alpha, got CL = 1\.60 at 19\.\d deg: fly faster"):
        aerodynamics(p, mass, 20.0, 0.0)


@pytest.mark.parametrize("given", [None, (-6.0, 12.0)])
def test_the_slowest_flight_is_that_of_the_highest_alpha(given):
    plan = SimpleNamespace(said=SimpleNamespace(limits=Limits(alpha_deg=given), design_V_m_s=20.0, design_h_m=300.0))
    found = SimpleNamespace(alpha_limits_rad=(-8.0 * DEG_RAD, 11.0 * DEG_RAD), CL=0.5)
    values = {"CL0": SimpleNamespace(used=0.2), "CL_alpha": SimpleNamespace(used=5.0)}
    limits = limits_of(plan, found, values)
    most = 0.2 + 5.0 * math.radians(12.0 if given else 11.0)
    assert limits["V_m_s"][0] == (math.ceil(10.0 * 20.0 * math.sqrt(0.5 / most)) / 10.0, 40.0)
    assert limits["alpha_deg"][0] == (given or (-8.0, 11.0))
    assert limits["h_m"][0] == (10.0, 1800.0)
    assert (limits["alpha_deg"][1] == "given") == bool(given)
    slow = limits_of(plan, SimpleNamespace(alpha_limits_rad=found.alpha_limits_rad, CL=1.2), values)
    assert slow["V_m_s"][0][0] == 18.0  # no closer than a tenth to the design speed


def remarks(**changes):
    used = {"CL_alpha": 5.0, "Cm_alpha": -1.0, "Cn_beta": 0.05, "CL0": 0.2, "Cm0": 0.01, "Cm_de": -1.2} | changes
    values = {n: SimpleNamespace(used=v) for n, v in used.items() if v is not None}
    tails = [SimpleNamespace(name="tail", quarter_chord_m=(changes.get("tail_m", 1.0), 0.0, 0.0))]
    plan = SimpleNamespace(
        plane=SimpleNamespace(notes=("a note",), of=lambda role: tails),
        said=SimpleNamespace(design_V_m_s=20.0),
        balance=SimpleNamespace(mass_kg=10.0, cg_m=(0.1, 0.0, 0.0)),
        servos={"de": SimpleNamespace(throw_deg=20.0), "da": None, "dr": None},
    )
    thrust = SimpleNamespace(at=lambda lever, V: changes.get("thrust_N", 50.0))
    return _remarks(plan, 0.5, values, Polar(0.03, 0.05, 0.1), thrust)


def test_what_is_remarked_of_an_aircraft_that_flies_badly():
    assert remarks() == ("a note",)
    assert any("10 % of the mean chord behind the neutral point" in r for r in remarks(Cm_alpha=0.5))
    assert any("no weathercock stability" in r for r in remarks(Cn_beta=-0.01))
    drag = (0.03 + 0.05 * 0.4**2) / 0.5 * 10.0 * G0_M_S2
    assert any(f"level flight takes {drag:.3g} N" in r for r in remarks(thrust_N=drag - 0.1))
    assert not any("level flight takes" in r for r in remarks(thrust_N=drag + 0.1))
    # trim: alpha = 0.3 / 5, de = (0.01 - 0.06) / Cm_de ...: -0.3333 rad of 0.8 x 20 deg = 0.279 rad
    assert any("takes -19 deg of elevator, of 20" in r for r in remarks(Cm_de=-0.15))
    assert not any("of elevator" in r for r in remarks(Cm_de=-0.2))
    assert "no elevator: it cannot be trimmed" in remarks(Cm_de=None)
    assert any("tail lies ahead of the centre of gravity" in r for r in remarks(tail_m=0.05))
    assert not any("ahead of the centre" in r for r in remarks(tail_m=0.1))


def trapezoid(role, x, z, half_m, root, tip, aft_m=0.0):
    up = role == "fin"
    end = Station(x + aft_m, 0.0 if up else half_m, z + half_m if up else z, tip, 0.0, FLAT)
    return LiftingSurface(role, role, not up, (Station(x, 0.0, z, root, 0.0, FLAT), end))


WING = trapezoid("wing", -0.25, 0.0, 5.0, 1.0, 1.0)
TAIL = trapezoid("tail", 4.0, 0.0, 1.5, 0.6, 0.6)
FIN = trapezoid("fin", 4.0, 0.2, 1.0, 1.0, 1.0)
TUBE = tuple(Cross(x_m=x, width_m=w, height_m=w) for x, w in ((-3.0, 0.0), (-2.0, 1.0), (4.0, 1.0), (5.0, 0.0)))


def test_tail_and_fin_bear_what_wake_and_body_leave_them():
    p = plane(WING, TAIL, FIN, hull=TUBE)
    helmbold = [2.0 * math.pi * A / (2.0 + math.hypot(A, 2.0)) for A in (1.55, 1.0)]
    assert (share(p, WING), share(p, TAIL)) == (1.0, 0.9)
    assert share(p, FIN) == pytest.approx(helmbold[0] / helmbold[1])
    assert sidewash(p, FIN) == pytest.approx(0.724 + 3.06 * 0.1 / 2.0 + 0.009 * 10.0)
    bare = plane(WING, TAIL, FIN)
    assert (share(bare, FIN), sidewash(bare, FIN)) == (1.0, 1.0)
    assert share(plane(WING, trapezoid("tail", -4.0, 0.0, 1.5, 0.6, 0.6)), TAIL) == 0.9
    ahead = trapezoid("tail", -4.0, 0.0, 1.5, 0.6, 0.6)
    assert share(plane(WING, ahead), ahead) == 1.0


def test_a_spheroid_has_lambs_inertia_factors():
    """H. Lamb, Hydrodynamics, section 115: k1 and k2 of fineness 2 are 0.209 and 0.702, of 6 0.045 and 0.918."""
    assert _inertia_factors(2.0) == pytest.approx(0.702 - 0.209, abs=2e-3)
    assert _inertia_factors(6.0) == pytest.approx(0.918 - 0.045, abs=2e-3)


def test_a_body_turns_the_aircraft_away_from_the_wind_and_a_low_wing_rolls_it_less():
    p = plane(WING, TAIL, hull=TUBE)
    found = body(p, 5.0, 0.4)
    assert found["Cm_alpha"] > 0.0 > found["Cn_beta"]
    # Behind the wing alone, with no downwash at all, strips along 3.25 m grow evenly from nothing to all of pi/2 w^2.
    behind = tuple(Cross(x_m=x, width_m=w, height_m=w) for x, w in ((0.75, 0.5), (4.15, 0.5)))
    strips = 0.5 * math.pi * 0.25 * 0.5 * 3.4 / 10.0
    assert body(plane(WING, TAIL, hull=behind), 5.0, 0.0)["Cm_alpha"] == pytest.approx(strips, rel=0.01)
    pod = tuple(Cross(x_m=x, width_m=0.5, height_m=0.5) for x in (-0.25, 0.5))  # within the root chord, no tail
    assert body(plane(WING, hull=pod), 5.0, 0.0)["Cm_alpha"] == 0.0
    # A cone ahead of its centre: the flow leaves at 90 % of it; slender-body theory, 2 A a third from the base.
    cone = tuple(Cross(x_m=x, width_m=w, height_m=w) for x, w in ((-3.0, 0.0), (0.0, 0.6)))
    expected = -2.0 * _inertia_factors(3.0 / 0.6) * 0.25 * math.pi * 0.36 * 1.0 / (10.0 * 10.0)
    assert body(plane(WING, hull=cone), 5.0, 0.0)["Cn_beta"] == pytest.approx(expected, rel=0.03)
    low = replace(WING, stations=tuple(replace(s, z_m=-0.4) for s in WING.stations))
    rolled = body(plane(low, TAIL, hull=TUBE), 5.0, 0.4)
    assert rolled["Cl_beta"] == pytest.approx(1.2 * math.sqrt(10.0) * 0.04 * 0.2)
    assert rolled["CY_beta"] == pytest.approx(found["CY_beta"] * (1.0 + 0.85 * 0.8))
    assert body(plane(WING, TAIL), 5.0, 0.4) == {}


def test_a_lattice_of_any_size_lifts_alike_and_the_more_the_faster_it_flies():
    """A swept wing of 60 m once gave a negative lift: rounding of places on a vortex over a core too small for it."""

    def lift(size, mach=0.0, half=5.0):
        a, b = (Station(s.x_m * size, s.y_m * size, 0.0, s.chord_m * size, 0.0, FLAT) for s in
                (Station(-0.3, 0.0, 0.0, 1.2, 0.0, FLAT), Station(4.2, half, 0.0, 0.5, 0.0, FLAT)))  # fmt: skip
        swept = LiftingSurface("wing", "wing", True, (a, b))
        return Lattice(plane(swept), mach=mach).run({"alpha": 0.05})["CL"]

    assert lift(12.0) == pytest.approx(lift(1.0), rel=1e-6)
    half, mach = 5.0, 0.6
    beta, A = math.sqrt(1.0 - mach**2), 10.0**2 / (1.7 * half)
    sweep = math.atan((4.2 - 0.3 + 0.3 - 0.35) / half)  # about half chord

    def datcom(b):
        return A / (2.0 + math.sqrt(A**2 * b**2 * (1.0 + np.tan(sweep) ** 2 / b**2) + 4.0))

    assert lift(1.0, mach) / lift(1.0) == pytest.approx(datcom(beta) / datcom(1.0), rel=0.03)
