"""The lattice against solved cases, by hand, and against AeroSandbox's own."""

import math

import numpy as np
import pytest

from testbench.aircraft.geometry.lattice import Lattice
from testbench.aircraft.geometry.shape import Flap, LiftingSurface, Plane, Station, airfoil

FLAT, CAMBERED = airfoil("naca0010"), airfoil("naca4410")
STEP = 1e-3


def wing(b, root, tip=None, sweep_m=0.0, rise_m=0.0, section=FLAT, flaps=(), x=0.0, role="wing", twist=0.0):
    tip = tip or root
    aft = sweep_m + 0.25 * (root - tip)
    stations = (
        Station(x - 0.25 * root, 0.0, 0.0, root, twist, section),
        Station(x - 0.25 * root + aft, 0.5 * b, rise_m, tip, twist, section),
    )
    return LiftingSurface(role, role, True, stations, tuple(flaps))


def plane(*surfaces):
    w = surfaces[0]
    return Plane(tuple(surfaces), (), w.projected_m2, w.span_m, w.mean_chord_m)


def slope(p, state, coefficient, **at):
    lattice = Lattice(p)
    ends = [lattice.run({**at, state: at.get(state, 0.0) + s * STEP})[coefficient] for s in (1.0, -1.0)]
    return (ends[0] - ends[1]) / (2.0 * STEP)


@pytest.mark.parametrize("A", [4.0, 8.0, 16.0])
def test_lift_slope_of_a_plain_wing_is_helmbolds(A):
    """Helmbold's formula is that of elliptic wings; rectangular ones lie some 2 to 6 % below."""
    helmbold = 2.0 * math.pi * A / (2.0 + math.sqrt(A**2 + 4.0))
    found = slope(plane(wing(A, 1.0)), "alpha", "CL")
    assert 0.94 * helmbold < found < 0.98 * helmbold


def test_an_elliptic_wing_has_the_induced_drag_of_an_elliptic_load():
    """CL^2 / (pi A); forces on the bound vortices of a dozen strips miss some 8 % of it. Only a deviation needs it."""
    y = np.sin(np.linspace(0.0, 0.5 * np.pi, 17)) * 4.0
    chord = np.sqrt(np.maximum(1.0 - (y / 4.0) ** 2, 0.01))
    stations = tuple(Station(-0.25 * c, v, 0.0, c, 0.0, FLAT) for v, c in zip(y, chord, strict=True))
    p = plane(LiftingSurface("wing", "wing", True, stations))
    found = Lattice(p).run({"alpha": 0.1})
    A = p.b_m**2 / p.S_m2
    assert found["CD"] == pytest.approx(found["CL"] ** 2 / (math.pi * A), rel=0.1)


def test_a_slender_wing_rolls_as_strips_do():
    """Strips of slope a without induction: Cl_p = -a / 6 of a rectangle; induction takes more the shorter it is."""
    found = slope(plane(wing(60.0, 1.0)), "p", "Cl")
    assert -2.0 * math.pi / 6.0 < found < -0.88 * 2.0 * math.pi / 6.0


def test_twist_and_a_flap_of_the_whole_chord_are_an_angle_of_attack():
    whole = plane(wing(6.0, 1.0, flaps=[Flap("de", 0.0, 1.0, 1.0)]))
    d = 0.02
    flapped = Lattice(whole).run({"alpha": 0.03}, "de", d)["CL"]
    twisted = Lattice(plane(wing(6.0, 1.0, twist=math.degrees(d)))).run({"alpha": 0.03})["CL"]
    assert flapped == pytest.approx(twisted, rel=1e-9)
    assert flapped == pytest.approx(Lattice(whole).run({"alpha": 0.03 + d})["CL"], rel=1e-3)


@pytest.mark.parametrize("E", [0.2, 0.25, 0.3, 0.4])
def test_a_plain_flap_has_the_effectiveness_of_thin_aerofoils(E):
    """Glauert: tau = 1 - (t - sin t) / pi with cos t = 2 E - 1 of a hinge at 1 - E; of a nearly plane flow.

    Twelve panels along the chord smear the hinge and find some 3 to 5 % less.
    """
    t = math.acos(2.0 * E - 1.0)
    p = plane(wing(200.0, 1.0, flaps=[Flap("de", 0.0, 1.0, E)]))
    lattice = Lattice(p)
    effect = (lattice.run({}, "de", STEP)["CL"] - lattice.run({}, "de", -STEP)["CL"]) / (2.0 * STEP)
    tau = 1.0 - (t - math.sin(t)) / math.pi
    assert 0.94 * tau < effect / slope(p, "alpha", "CL") < tau


def test_camber_gives_the_lift_at_no_incidence_of_thin_aerofoils():
    """NACA 44xx: alpha_L0 = -4.15 deg (Abbott and von Doenhoff, section 4.4)."""
    p = plane(wing(200.0, 1.0, section=CAMBERED))
    alpha = -Lattice(p).run({})["CL"] / slope(p, "alpha", "CL")
    assert math.degrees(alpha) == pytest.approx(-4.15, abs=0.15)


def test_a_far_tail_adds_what_it_does_by_hand():
    """Cm_alpha,t = -a_t (1 - eps') S_t l / (S c), eps' = 2 a_w / (pi A) far behind an elliptic wing, +- 20 %."""
    far = 30.0
    main = wing(8.0, 1.2, 0.6)
    tail = wing(2.0, 0.5, role="tail", x=far)
    both, alone = plane(main, tail), plane(main)
    found = slope(both, "alpha", "Cm") - slope(alone, "alpha", "Cm")
    a_w, A = slope(alone, "alpha", "CL"), alone.b_m**2 / alone.S_m2
    a_t = slope(plane(tail), "alpha", "CL")
    eps = 2.0 * a_w / (math.pi * A)
    volume = tail.area_m2 * far / (both.S_m2 * both.cbar_m)
    assert -found / (a_t * volume) == pytest.approx(1.0 - eps, abs=0.2 * eps)


def test_an_aircraft_mirrored_in_its_plane_of_symmetry_answers_mirrored():
    p = plane(wing(6.0, 1.0, 0.5, 0.4, 0.3, CAMBERED), wing(2.0, 0.5, role="tail", x=4.0))
    lattice = Lattice(p)
    right = lattice.run({"alpha": 0.05, "beta": 0.04, "p": 0.02, "r": -0.01})
    left = lattice.run({"alpha": 0.05, "beta": -0.04, "p": -0.02, "r": 0.01})
    for c in ("CL", "CD", "Cm"):
        assert right[c] == pytest.approx(left[c], rel=1e-9)
    for c in ("CY", "Cl", "Cn"):
        assert right[c] == pytest.approx(-left[c], rel=1e-9)
    assert right["Cl"] < 0.0  # dihedral, and damping


def test_aerosandbox_has_the_same_lattice_where_it_applies():
    asb = pytest.importorskip("aerosandbox", reason="needs the extra geometry")
    from testbench.aircraft.geometry.lattice import cuts

    p = plane(wing(6.0, 1.0, 0.5, 0.4, 0.3, CAMBERED), wing(2.0, 0.5, role="tail", x=4.0))
    wings = [
        asb.Wing(
            symmetric=True,
            xsecs=[
                asb.WingXSec(
                    [c.station.x_m, c.station.y_m, c.station.z_m],
                    c.station.chord_m,
                    airfoil=asb.Airfoil("x", coordinates=c.station.airfoil.points),
                )
                for c in cuts(s)
            ],
        )
        for s in p.surfaces
    ]
    airplane = asb.Airplane(xyz_ref=[0, 0, 0], wings=wings, s_ref=p.S_m2, c_ref=p.cbar_m, b_ref=p.b_m)
    lattice = Lattice(p)
    lattice.share = 1.0  # theirs knows no wake
    for at in ({"alpha": 0.05}, {"alpha": 0.05, "beta": 0.1}, {"p": 0.05}, {"q": 0.02}, {"alpha": 0.1, "r": 0.05}):
        rates = {n: 2.0 * at.get(n, 0.0) / (p.cbar_m if n == "q" else p.b_m) for n in "pqr"}
        angles = {n: math.degrees(at.get(n, 0.0)) for n in ("alpha", "beta")}
        op = asb.OperatingPoint(velocity=1.0, **angles, **rates)
        method = asb.VortexLatticeMethod(
            airplane, op, spanwise_resolution=1, chordwise_resolution=12, chordwise_spacing_function=np.linspace
        )
        theirs = method.run()
        ours = lattice.run(at)
        for c, size in (("CL", 0.03), ("CY", 0.002), ("Cl", 0.002), ("Cm", 0.04), ("Cn", 0.001)):
            assert ours[c] == pytest.approx(float(theirs[c]), abs=size), (at, c)
