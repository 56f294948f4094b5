"""Flutter in air that lags: Theodorsen's section exactly, Goland's wing, and what has no lag."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import fsolve
from scipy.special import hankel2

from testbench.aircraft.elastic import ElasticModel, with_wake
from testbench.aircraft.strips.loads import STRIPS, Shape, StripModel, Tail, Vibration, Wing, combine, coupled_modes
from testbench.aircraft.strips.ritz import cantilever_bending, cantilever_torsion

NOTHING = Tail(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
RHO = 1.225


def in_air(wing: Wing, shapes: list[Shape], K: np.ndarray) -> list[Vibration]:
    """Return the modes of a cantilevered wing as a test on the ground finds them: its mass, and that of the air."""
    m, c = wing.mass_per_length, wing.chord
    s, r = (wing.centre_of_mass - wing.elastic_axis) * c, wing.gyration * c
    air, middle = RHO * np.pi * c**2 / 4.0, (0.5 - wing.elastic_axis) * c

    def inertia(a, b):
        own = m * ((a.bend - s * a.twist) * (b.bend - s * b.twist) + r**2 * a.twist * b.twist)
        moved = (a.bend - middle * a.twist) * (b.bend - middle * b.twist) + c**2 / 32.0 * a.twist * b.twist
        return wing.both_sides(own + air * moved)

    M = np.array([[inertia(a, b) for b in shapes] for a in shapes])
    squares, vectors = eigh(K, M)
    frequencies = np.sqrt(squares) / (2.0 * np.pi)
    return [
        Vibration(str(i), float(f), 1e-6, 1.0, combine(shapes, v))
        for i, (f, v) in enumerate(zip(frequencies, vectors.T, strict=True))
    ]


def growth(elastic: ElasticModel, V: float, share: float) -> complex:
    """Return the fastest growing pole of the modes of a held wing."""
    n, qbar = len(elastic), 0.5 * RHO * V**2
    K, D, _ = elastic.matrices(qbar, V)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]])
    states = [f"{kind}_{i + 1}" for kind in ("eta", "etadot") for i in range(n)]
    poles = np.linalg.eigvals(with_wake(A, states, elastic, qbar, V, share))
    poles = poles[poles.imag > 1e-3]  # no divergence
    return complex(poles[np.argmax(poles.real)])


def flutter(wing: Wing, shapes: list[Shape], K: np.ndarray, share: float = 1.0, most: float = 400.0):
    """Return speed and frequency (rad/s) of flutter."""
    S = wing.both_sides(wing.chord)
    strips = StripModel(wing, NOTHING, S, wing.root_chord_m, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))
    modes = coupled_modes(in_air(wing, shapes, K), strips, strips, np.linspace(0.0, 0.5 * wing.span_m, 5))
    elastic = ElasticModel(modes, S, wing.root_chord_m)
    speeds = np.linspace(0.05 * most, most, 120)
    first = next(k for k, V in enumerate(speeds) if growth(elastic, V, share).real > 0.0)
    low, high = speeds[first - 1], speeds[first]
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if growth(elastic, middle, share).real > 0.0 else (middle, high)
    return float(low), abs(growth(elastic, low, share).imag)


def goland(share: float):
    """M. Goland's uniform cantilever (J. Applied Mechanics 12(4), 1945): 20 ft, chord 6 ft."""
    half, m, inertia, s = 6.096, 35.71, 8.64, 0.10 * 1.8288
    gyration = np.sqrt(inertia / m - s**2) / 1.8288  # the inertia is that about the elastic axis
    wing = Wing(2.0 * half, 1.8288, 1.0, 2.0 * half * m, 0.33, 0.43, gyration, 2.0 * np.pi, 0.0)
    x, zero = wing.y / half, np.zeros(STRIPS)
    bends, twists = ([form(i, x) for i in (1, 2)] for form in (cantilever_bending, cantilever_torsion))
    shapes = [*(Shape(f, zero) for f, _ in bends), *(Shape(zero, f) for f, _ in twists)]
    K = np.zeros((4, 4))
    for first, EI, forms, power in ((0, 9.77e6, bends, 4), (2, 0.987e6, twists, 2)):
        for i, (_, a) in enumerate(forms):
            for j, (_, b) in enumerate(forms):
                K[first + i, first + j] = wing.both_sides(EI * a * b) / half**power
    return flutter(wing, shapes, K, share)


def test_golands_wing_flutters_where_it_is_published_to():
    """137.2 m/s at 70.7 rad/s, with two-dimensional air of Theodorsen along the span."""
    V, w = goland(1.0)
    assert pytest.approx(137.2, rel=0.03) == V
    assert w == pytest.approx(70.7, rel=0.03)
    assert goland(0.0)[0] < 0.75 * V  # quasi-steady


def theodorsen(mu: float, axis: float, guess: tuple[float, float]) -> float:
    """Return the flutter speed of a section over b w_theta by Theodorsen's function itself.

    Per unit of span, lengths in half chords b, time in 1/w_theta: mass ratio mu = m / pi rho b^2, elastic axis and
    centre of mass at ``axis`` and ``axis`` + 0.2 behind mid-chord, radius of gyration 0.5, w_h / w_theta = 0.4
    (T. Theodorsen, NACA report 496; here with h down).
    """
    x, r2, ratio = 0.2, 0.25, 0.4

    def determinant(z):
        V, w = np.abs(z)
        k = w / V
        C = hankel2(1, k) / (hankel2(1, k) + 1j * hankel2(0, k))
        s = 1j * w
        w34 = np.array([s, V + (0.5 - axis) * s])  # downwash at three quarters: h' + V theta + b (1/2 - a) theta'
        lift = np.array([s**2, V * s - axis * s**2]) + 2.0 * V * C * w34
        moment = np.array([axis * s**2, -(0.5 - axis) * V * s - (0.125 + axis**2) * s**2])
        moment = moment + 2.0 * V * (axis + 0.5) * C * w34
        D = mu * np.array([[s**2 + ratio**2, x * s**2], [x * s**2, r2 * (s**2 + 1.0)]]) + np.array([lift, -moment])
        value = np.linalg.det(D) / mu**2
        return [value.real, value.imag]

    found, _, ok, _ = fsolve(determinant, guess, full_output=True)
    assert ok == 1
    return abs(float(found[0]))


@pytest.mark.parametrize("mu", [8.0, 20.0, 60.0])
@pytest.mark.parametrize("axis", [-0.4, -0.2])
def test_a_section_flutters_where_theodorsens_function_has_it(mu, axis):
    chord, w_theta = 1.0, 20.0
    b = 0.5 * chord
    m = mu * np.pi * RHO * b**2
    to_chord = 0.5 * (1.0 + axis)
    gyration = np.sqrt(0.25 - 0.04) * b / chord  # about the centre of mass
    wing = Wing(2.0, chord, 1.0, 2.0 * m, to_chord, to_chord + 0.1, gyration, 2.0 * np.pi, 0.0)
    zero, one = np.zeros(STRIPS), np.ones(STRIPS)
    K = np.diag([2.0 * m * (0.4 * w_theta) ** 2, 2.0 * m * 0.25 * b**2 * w_theta**2])
    V, w = flutter(wing, [Shape(one, zero), Shape(zero, one)], K, most=12.0 * b * w_theta)
    exact = theodorsen(mu, axis, (V / (b * w_theta), w / w_theta)) * b * w_theta
    assert pytest.approx(exact, rel=0.02) == V


def test_no_lag_leaves_the_poles_where_they_are():
    wing = Wing(2.0, 1.0, 1.0, 20.0, 0.4, 0.45, 0.25, 5.0, 0.0)
    zero, one = np.zeros(STRIPS), np.ones(STRIPS)
    vibrations = in_air(wing, [Shape(one, zero), Shape(zero, one)], np.diag([500.0, 900.0]))
    strips = StripModel(wing, NOTHING, 2.0, 1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))
    elastic = ElasticModel(coupled_modes(vibrations, strips, strips, np.linspace(0.0, 1.0, 5)), 2.0, 1.0)
    K, D, _ = elastic.matrices(60.0, 10.0)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -D]])
    whole = with_wake(A, ["eta_1", "eta_2", "etadot_1", "etadot_2"], elastic, 60.0, 10.0, share=0.0)
    poles = np.linalg.eigvals(whole)
    for s in np.linalg.eigvals(A):
        assert np.min(np.abs(poles - s)) < 1e-9 * abs(s)
    assert np.sum(np.abs(poles.imag) < 1e-9) == 4
