"""What fuselage, wake and boundary layer do, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from testbench.aircraft.geometry.airfoils import airfoil
from testbench.aircraft.geometry.interference import _inertia_factors, body, share, sidewash
from testbench.aircraft.geometry.lattice import Lattice
from testbench.aircraft.geometry.shape import Hull, LiftingSurface, Plane, Station

FLAT = airfoil("naca0010")


def trapezoid(role, x, z, half_m, root, tip, aft_m=0.0):
    up = role == "fin"
    end = Station(x + aft_m, 0.0 if up else half_m, z + half_m if up else z, tip, 0.0, FLAT)
    return LiftingSurface(role, role, not up, (Station(x, 0.0, z, root, 0.0, FLAT), end))


WING = trapezoid("wing", -0.25, 0.0, 5.0, 1.0, 1.0)
TAIL = trapezoid("tail", 4.0, 0.0, 1.5, 0.6, 0.6)
FIN = trapezoid("fin", 4.0, 0.2, 1.0, 1.0, 1.0)
TUBE = tuple(Hull(x, 0.0, w, 1.0 * w) for x, w in ((-3.0, 0.0), (-2.0, 1.0), (4.0, 1.0), (5.0, 0.0)))


def plane(*surfaces, hull=()):
    w = surfaces[0]
    return Plane(tuple(surfaces), hull, w.projected_m2, w.span_m, w.mean_chord_m)


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
    behind = tuple(Hull(x, 0.0, w, w) for x, w in ((0.75, 0.5), (4.15, 0.5)))
    strips = 0.5 * math.pi * 0.25 * 0.5 * 3.4 / 10.0
    assert body(plane(WING, TAIL, hull=behind), 5.0, 0.0)["Cm_alpha"] == pytest.approx(strips, rel=0.01)
    pod = tuple(Hull(x, 0.0, 0.5, 0.5) for x in (-0.25, 0.5))  # within the root chord, no tail
    assert body(plane(WING, hull=pod), 5.0, 0.0)["Cm_alpha"] == 0.0
    # A cone ahead of its centre: the flow leaves at 90 % of it; slender-body theory, 2 A a third from the base.
    cone = tuple(Hull(x, 0.0, w, w) for x, w in ((-3.0, 0.0), (0.0, 0.6)))
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
