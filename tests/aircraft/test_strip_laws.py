"""Laws that modes coupled by strips keep: symmetry, rigid motions as modes, reciprocity, a section that flutters."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.aircraft.elastic import ElasticModel
from testbench.aircraft.strips.flexible import generalised_mass, largest_motion, on_strips, with_body
from testbench.aircraft.strips.loads import (
    STRIPS,
    Shape,
    StripModel,
    Tail,
    Vibration,
    Wing,
    at_stations,
    combine,
    coupled_modes,
)
from testbench.aircraft.strips.ritz import (
    Stiffness,
    asymmetric_inertia,
    asymmetric_modes,
    heave_and_pitch,
    roll,
    symmetric_inertia,
    symmetric_modes,
)

SWEPT = Wing(12.0, 1.2, 0.4, 60.0, 0.38, 0.43, 0.26, 5.1, 0.1, np.radians(12.0))
TAIL = Tail(4.0, 8.0, 1.3, 4.1, 0.3, 0.5, 0.9, 2.9, 0.5, 0.6, 2.6, 1.5, 0.2)
MASS, IYY, IXX = 320.0, 900.0, 1300.0
STATIONS = np.linspace(0.0, 6.0, 17)


@pytest.fixture
def strips() -> StripModel:
    """A swept, tapered aircraft whose elastic motion and angle of attack reach the tail alike: no downwash."""
    tail = replace(TAIL, downwash=0.0)
    return StripModel(SWEPT, tail, 11.0, 0.95, np.radians(3.0), 0.5, 0.05, (3.5, 5.7, 0.4))


def coupled(strips: StripModel, *shapes: Shape):
    """Return the coefficients of shapes as modes of 1 kg m2 at 1 Hz."""
    return coupled_modes(
        [Vibration(str(i), 1.0 + i, 0.01, 1.0, s) for i, s in enumerate(shapes)], strips, strips, STATIONS
    )


def bending(*weights: float, symmetric: bool = True) -> Shape:
    """Return a displacement as a polynomial of y without twist."""
    bend = sum(w * SWEPT.y ** (k + 1) for k, w in enumerate(weights))
    return Shape(bend, np.zeros(STRIPS), symmetric=symmetric)


def test_symmetric_modes_act_on_lift_and_pitch_alone_and_asymmetric_ones_on_the_rest(strips):
    first, second = coupled(strips, bending(0.1, 0.2), bending(0.3, -0.1, symmetric=False))
    for table in (first.effect_eta, first.effect_etadot):
        assert set(table) == {"CL", "Cm"}
    for table in (second.effect_eta, second.effect_etadot):
        assert set(table) == {"CY", "Cl", "Cn"}
    assert set(first.force) == {"zero", "alpha", "q", "de"}
    assert set(second.force) == {"beta", "p", "r", "da", "dr"}
    assert set(first.force_eta) == set(first.force_etadot) == {1}
    assert set(second.force_eta) == set(second.force_etadot) == {2}


def test_heave_as_a_mode_is_the_angle_of_attack_and_pitch_as_a_mode_the_pitch_rate(strips):
    """Heave at hdot is alpha = -hdot / V; a rate of pitch is q, and an attitude held is alpha. On a swept wing too."""
    heave, pitch = heave_and_pitch(strips.wing, strips.tail)
    up, nose = coupled(strips, heave, pitch)
    alpha, q = strips.effect(strips.flow("alpha")), strips.effect(strips.flow("q"))
    for c in ("CL", "Cm"):
        assert up.effect_eta[c] == 0.0
        assert up.effect_etadot[c] * 0.5 * strips.cbar_m == pytest.approx(-alpha[c], rel=1e-12)
        assert nose.effect_eta[c] == pytest.approx(alpha[c], rel=1e-12)
        assert nose.effect_etadot[c] == pytest.approx(q[c], rel=1e-12)
    # Work of alpha's loads on the motions: the lift, and its moment, per chord.
    assert up.force["alpha"] * strips.cbar_m == pytest.approx(alpha["CL"], rel=1e-12)
    assert nose.force["alpha"] == pytest.approx(alpha["Cm"], rel=1e-12)
    assert nose.force["q"] == pytest.approx(q["Cm"], rel=1e-12)
    assert nose.force_etadot[2] == pytest.approx(q["Cm"], rel=1e-12)


def test_a_bend_that_goes_with_y_is_roll_damping(strips):
    (mode,) = coupled(strips, roll(strips.wing))
    p = strips.effect(strips.flow("p"))
    for c in ("Cl", "Cn", "CY"):
        assert mode.effect_etadot[c] * strips.cbar_m / strips.b == pytest.approx(p[c], rel=1e-12)
    assert mode.force["p"] * strips.cbar_m / strips.b == pytest.approx(p["Cl"], rel=1e-12)
    assert mode.force["beta"] * strips.cbar_m / strips.b == pytest.approx(strips.effect(strips.flow("beta"))["Cl"])
    linear = coupled(strips, Shape(-strips.wing.y, np.zeros(STRIPS), symmetric=False))[0]
    alone = replace(strips, tail=replace(strips.tail, area_m2=0.0, fin_area_m2=0.0))
    damping = alone.effect(alone.flow("p"))["Cl"]
    assert linear.effect_etadot["Cl"] * strips.cbar_m / strips.b == pytest.approx(damping, rel=1e-12)


def test_bending_modes_are_reciprocal(strips):
    """Without twist strips see wdot alone: C_Q of alpha is -1/2 of CL of eta', and damping among modes is symmetric."""
    shapes = [replace(bending(0.1, 0.2), tail_up=0.3), replace(bending(-0.2, 0.0, 0.05), tail_up=-0.1), bending(0.4)]
    modes = coupled(strips, *shapes)
    for mode in modes:
        assert mode.force["alpha"] == pytest.approx(-0.5 * mode.effect_etadot["CL"], rel=1e-12)
        assert mode.effect_eta == {"CL": 0.0, "Cm": 0.0}
    D = np.array([[m.force_etadot[j] for j in (1, 2, 3)] for m in modes])
    assert pytest.approx(D.T, rel=1e-12) == D
    assert np.all(np.linalg.eigvalsh(D) < 0.0)  # the air takes energy from any bending
    odd = coupled(strips, *(replace(s, symmetric=False, tail_up=0.0) for s in shapes))
    for mode in odd:
        assert mode.force["p"] == pytest.approx(mode.effect_etadot["Cl"], rel=1e-12)


# --- a section that flutters ------------------------------------------------------------------------------------------

CHORD, LENGTH, SLOPE, DENSITY = 0.3, 4.0, 5.5, 1.225
AXIS, CENTRE, GYRATION, PER_M = 0.35, 0.42, 0.25, 4.0
K_HEAVE, K_PITCH = 3000.0, 300.0
SECTION = Wing(LENGTH, CHORD, 1.0, PER_M * LENGTH, AXIS, CENTRE, GYRATION, SLOPE, 0.0)
NOTHING = Tail(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)


def section_matrices():
    """Mass, stiffness, and air of a section that heaves (h up) and pitches (theta nose up) about its elastic axis.

    M x'' + q D x' / V + (K - q A) x = 0, written down by hand: lift S a (theta - (h' - d theta') / V) at the quarter
    chord, e ahead of the axis, with d from the axis to the three-quarter chord, and the non-circulatory lift
    S (pi c / 2) theta' / V at the three-quarter chord (R. L. Bisplinghoff, H. Ashley, Principles of Aeroelasticity,
    section 4.2, in its quasi-steady limit).
    """
    S, m = CHORD * LENGTH, PER_M * LENGTH
    s, r = (CENTRE - AXIS) * CHORD, GYRATION * CHORD
    e, d = (AXIS - 0.25) * CHORD, (0.75 - AXIS) * CHORD
    rotary = S * 0.5 * np.pi * CHORD
    M = m * np.array([[1.0, -s], [-s, s**2 + r**2]])
    A = S * SLOPE * np.array([[0.0, 1.0], [0.0, e]])
    D = S * SLOPE * np.array([[1.0, -d], [e, -e * d]]) + rotary * np.array([[0.0, -1.0], [0.0, d]])
    return M, np.diag([K_HEAVE, K_PITCH]), A, D


def section_poles(V: float):
    M, K, A, D = section_matrices()
    q = 0.5 * DENSITY * V**2
    top = np.hstack([np.zeros((2, 2)), np.eye(2)])
    low = np.hstack([np.linalg.solve(M, q * A - K), -np.linalg.solve(M, q * D / V)])
    return np.linalg.eigvals(np.vstack([top, low]))


def flutter_speed() -> float:
    """Speed at which Routh's discriminant of the section is zero, in closed form.

    det(M s^2 + V D' s + K - V^2 A') = p0 s^4 + p1 V s^3 + (p2 + p2' V^2) s^2 + (p3 + p3' V^2) V s + p4 + p4' V^2, and
    p1 p2 p3 = p0 p3^2 + p1^2 p4 is quadratic in V^2 after a factor V^2.
    """
    M, K, A, D = section_matrices()
    A, D = 0.5 * DENSITY * A, 0.5 * DENSITY * D

    def mixed(P, Q):
        """The part of det(P + Q) that is linear in both."""
        return P[0, 0] * Q[1, 1] + P[1, 1] * Q[0, 0] - P[0, 1] * Q[1, 0] - P[1, 0] * Q[0, 1]

    p0, p1 = np.linalg.det(M), mixed(M, D)
    p2, p3, p4 = (
        (mixed(M, K), np.linalg.det(D) - mixed(M, A)),
        (mixed(D, K), -mixed(D, A)),
        (np.linalg.det(K), -mixed(K, A)),
    )
    assert abs(np.linalg.det(A)) < 1e-12
    P = np.polynomial.Polynomial
    discriminant = p1 * P(p2) * P(p3) - p0 * P(p3) ** 2 - p1**2 * P(p4)
    roots = [r.real for r in discriminant.roots() if abs(r.imag) < 1e-9 and r.real > 0.0]
    return float(np.sqrt(min(roots)))


@pytest.fixture
def section() -> ElasticModel:
    """The same section through its normal modes and the strips."""
    M, K, _, _ = section_matrices()
    from scipy.linalg import eigh

    squares, V = eigh(K, M)
    one, zero = np.ones(STRIPS), np.zeros(STRIPS)
    shapes = [combine([Shape(one, zero), Shape(zero, one)], v) for v in V.T]
    strips = StripModel(SECTION, NOTHING, CHORD * LENGTH, CHORD, 0.0, 0.0, 0.0, (0.0, 1.0, 0.0))
    vibrations = [
        Vibration(str(i), float(np.sqrt(w2) / (2 * np.pi)), 0.0, 1.0, s)
        for i, (w2, s) in enumerate(zip(squares, shapes, strict=True))
    ]
    return ElasticModel(coupled_modes(vibrations, strips, strips, np.linspace(0.0, 2.0, 5)), CHORD * LENGTH, CHORD)


def model_poles(section: ElasticModel, V: float):
    K, D, _ = section.matrices(0.5 * DENSITY * V**2, V)
    return np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -D]]))


@pytest.mark.parametrize("V", [3.0, 10.0, 20.0, 40.0])
def test_a_typical_section_has_the_poles_of_its_equations(section, V):
    ours, theirs = (np.sort_complex(f) for f in (model_poles(section, V), section_poles(V)))
    assert np.max(np.abs(ours - theirs)) < 1e-9 * np.max(np.abs(theirs))


def test_a_typical_section_flutters_where_routh_says(section):
    V = flutter_speed()
    assert 10.0 < V < 40.0
    assert np.max(model_poles(section, V).real) == pytest.approx(
        0.0, abs=1e-7 * np.max(np.abs(model_poles(section, V)))
    )
    assert np.max(model_poles(section, 0.999 * V).real) < 0.0 < np.max(model_poles(section, 1.001 * V).real)


def test_pitch_alone_diverges_where_the_textbook_says():
    """q_D = K_theta / (S a e): R. L. Bisplinghoff, H. Ashley, R. L. Halfman, Aeroelasticity, eq. 8-5."""
    S, e, inertia = CHORD * LENGTH, (AXIS - 0.25) * CHORD, 0.02
    strips = StripModel(SECTION, NOTHING, S, CHORD, 0.0, 0.0, 0.0, (0.0, 1.0, 0.0))
    pitch = Vibration(
        "pitch", float(np.sqrt(K_PITCH / inertia) / (2 * np.pi)), 0.0, inertia, Shape(np.zeros(STRIPS), np.ones(STRIPS))
    )
    model = ElasticModel(coupled_modes([pitch], strips, strips, np.linspace(0.0, 2.0, 5)), S, CHORD)
    q = K_PITCH / (S * SLOPE * e)
    assert model.matrices(q, 20.0)[0][0, 0] == pytest.approx(0.0, abs=1e-9 * K_PITCH / inertia)


# --- shapes and masses ------------------------------------------------------------------------------------------------


def test_momentum_gives_the_fuselage_back_and_with_it_the_generalised_mass():
    """Wing and tail of a free mode say how its fuselage moves, and so its generalised mass."""
    k = Stiffness(4e4, 3e3, 2.0, 3e4, 2e4, 3e3)
    straight = replace(SWEPT, sweep_rad=0.0)
    for modes, inertia in (
        (symmetric_modes(straight, TAIL, k, MASS, IYY), symmetric_inertia(straight, TAIL, MASS, IYY)),
        (asymmetric_modes(straight, TAIL, k, IXX), asymmetric_inertia(straight, TAIL, IXX)),
    ):
        for shape, mass in zip(modes.shapes[:4], modes.masses[:4], strict=True):
            seen = replace(shape, body_up=0.0, body_pitch=0.0, body_roll=0.0)
            found = with_body(seen, straight, TAIL, inertia)
            for name in ("body_up", "body_pitch", "body_roll"):
                size = max(abs(shape.body_up), abs(shape.body_pitch), abs(shape.body_roll))
                assert getattr(found, name) == pytest.approx(getattr(shape, name), rel=1e-6, abs=1e-6 * size)
            assert generalised_mass(seen, straight, TAIL, inertia) == pytest.approx(mass, rel=1e-9)


def test_a_distribution_of_mass_may_be_given_by_points():
    points = tuple((float(y), float(m)) for y, m in zip(SWEPT.y, SWEPT.mass_per_length, strict=True))
    assert replace(SWEPT, mass_points=points).mass_per_length == pytest.approx(SWEPT.mass_per_length, rel=1e-12)


def test_measured_shapes_pass_through_their_values_and_a_cubic_is_found_again():
    y = np.array([0.0, 1.0, 2.5, 4.0, 5.2, 6.0])
    free = 3.0 * 6.0 * y**2 - y**3  # a cantilever with a load at its tip: no curvature there
    bend, twist, bent = on_strips(SWEPT, y, free, 0.1 * y**2)
    assert bend == pytest.approx(18.0 * SWEPT.y**2 - SWEPT.y**3, rel=1e-9, abs=1e-9)
    assert bent == pytest.approx(36.0 - 6.0 * SWEPT.y, rel=1e-9, abs=1e-9)
    assert twist == pytest.approx(0.1 * SWEPT.y**2, rel=1e-9, abs=1e-9)
    at = on_strips(SWEPT, SWEPT.y, free := np.sin(SWEPT.y), np.zeros(STRIPS))[0]
    assert at == pytest.approx(free, rel=1e-12)


def test_beyond_the_stations_a_shape_goes_on_straight():
    y = np.array([1.0, 2.0, 3.0, 4.0])
    bend, _, bent = on_strips(SWEPT, y, y**2, np.zeros(4))
    inside, beyond = (SWEPT.y >= 1.0) & (SWEPT.y <= 4.0), SWEPT.y > 4.0
    assert bend[inside] == pytest.approx(SWEPT.y[inside] ** 2)
    assert bend[beyond] == pytest.approx(16.0 + 8.0 * (SWEPT.y[beyond] - 4.0))
    assert np.all(bent[beyond] == 0.0)


def test_the_unit_of_a_mode_is_its_largest_motion():
    shape = Shape(0.002 * SWEPT.y, np.full(STRIPS, -0.5), tail_up=0.1)
    size, words = largest_motion(shape, SWEPT, 0.95)
    assert (size, words) == (pytest.approx(-0.5), "wing-tip twist of 1 rad")
    straight = Shape(0.5 * SWEPT.y, np.zeros(STRIPS))  # the tip lies half a strip beyond the last one
    assert largest_motion(straight, SWEPT, 0.95)[0] == pytest.approx(0.5 * 6.0 / 0.95)
    twisted = Shape(np.zeros(STRIPS), -0.1 * SWEPT.y)
    assert largest_motion(twisted, SWEPT, 0.95)[0] == pytest.approx(-0.6)
    assert at_stations(SWEPT, shape.bend, STATIONS)[-1] == pytest.approx(0.012)
