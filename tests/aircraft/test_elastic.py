"""Shapes of a ground vibration test at their stations: what an asymmetric one may show in the plane of symmetry."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from structure_alone import uncoupled

from testbench.aircraft.elastic import _held, first_order_hold
from testbench.aircraft.strips.ground_test import _Columns, _shape
from testbench.core.errors import Faults
from testbench.flight import load_aircraft

# GVT of the EOLO paper, Table 2: frequency in Hz, damping in percent.
TABLE_2 = [(4.6, 1.6), (7.7, 2.1), (10.6, 2.2), (11.6, 1.2), (15.0, 1.7), (19.1, 3.2), (21.2, 3.8), (30.4, 2.4)]


def test_eolo_carries_the_eight_modes_of_the_ground_vibration_test(eolo):
    assert [(m.f_hz, round(100 * m.zeta, 6)) for m in eolo.elastic.modes] == TABLE_2


def test_eolo_has_the_mass_and_geometry_of_table_1(eolo):
    g, m = eolo.geometry, eolo.mass
    assert (g.S_m2, g.b_m, g.cbar_m) == (0.846, 4.0, 0.2311)
    assert (m.mass_kg, m.Ixx, m.Iyy, m.Izz) == (8.87, 2.53, 1.60, 3.96)


def test_symmetric_and_asymmetric_modes_do_not_couple(eolo):
    for block in eolo.elastic.blocks():
        assert len({eolo.elastic.modes[i].symmetry for i in block}) == 1


def test_first_order_hold_is_exact_for_inputs_linear_between_samples():
    rng = np.random.default_rng(3)
    A = np.array([[0.0, 1.0], [-900.0, -1.5]])
    B = np.array([[0.0], [1.0]])
    dt = 0.004
    u = rng.standard_normal(51)
    Ad, B0, B1 = first_order_hold(A, B, dt)
    x = np.zeros(2)
    for k in range(50):
        x = Ad @ x + B0[:, 0] * u[k] + B1[:, 0] * u[k + 1]
    t = dt * np.arange(51)
    reference = np.zeros(2)
    for k in range(50):  # piece by piece, so that the integrator never steps over a corner

        def rate(s, y, k=k):
            return A @ y + B[:, 0] * np.interp(s, t[k : k + 2], u[k : k + 2])

        reference = solve_ivp(rate, t[k : k + 2], reference, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert x == pytest.approx(reference, rel=1e-9, abs=1e-13)


def test_the_force_that_the_hold_takes_keeps_the_mean_of_a_parabola():
    """A parabola through three frames, held as the model's functions hold it; a hold of the chord misses by 1 / 12."""
    held, begin = (f.find(".//sum") for f in _held(1))
    names = [f"modal/input-{suffix}1" for suffix in ("", "previous-", "before-")]
    u = dict(zip(names, (1.0, 0.0, 1.0), strict=True))  # t^2 at t = 1, 0, -1: mean over [0, 1] is 1/3
    terms = {p.findtext("property"): float(p.findtext("value")) for p in held.findall("product")}
    assert sorted(terms) == sorted(names)
    end_value = sum(w * u[n] for n, w in terms.items())
    assert [p.text for p in begin.findall("property")] == ["modal/held-1", names[1]]
    begin_value = end_value + u[names[1]] - u[names[0]]
    assert 0.5 * (end_value + begin_value) == pytest.approx(1.0 / 3.0)
    assert sum(terms.values()) == pytest.approx(1.0)  # a steady force stays what it is


def test_a_sinusoidal_force_on_a_mode_keeps_its_size_to_a_tenth_of_a_percent():
    """Each mode alone, driven at its own frequency at 500 frames per second; the chord alone costs 1.2 % at 30 Hz.

    The parabola's error, (w dt)^3 / 24 of the third difference, is one of phase.
    """
    dt = 0.002
    for w in 2 * np.pi * np.array([f for f, _ in TABLE_2]):
        A, B = np.array([[0.0, 1.0], [-(w**2), -0.06 * w]]), np.array([[0.0], [1.0]])
        Ad, B0, B1 = first_order_hold(A, B, dt)
        z = np.exp(1j * w * dt)
        bend = (z - 2.0 + 1.0 / z) / 12.0
        found = np.linalg.solve(z * np.eye(2) - Ad, B0 * (1.0 - bend) + B1 * (z - bend))[0, 0]
        exact = 1.0 / (1j * 0.06 * w**2)
        assert abs(found) == pytest.approx(abs(exact), rel=1e-3)
        assert abs(found / exact - 1.0) < (w * dt) ** 3 / 20.0


def test_matrices_without_coupling_are_those_of_the_structure(eolo):
    bare = uncoupled(eolo.elastic)
    K, D, _ = bare.matrices(150.0, 16.0)
    w = 2 * np.pi * np.array([f for f, _ in TABLE_2])
    assert np.allclose(K, np.diag(w**2), rtol=1e-12)
    assert np.allclose(D, np.diag(2 * w * np.array([z for _, z in TABLE_2]) / 100), rtol=1e-12)


def test_rigid_wings_write_the_plain_model():
    rigid = load_aircraft("eolo", "rigid")
    assert rigid.elastic is None
    assert "modal/" not in rigid.model_xml(500.0, 150.0, 16.0)


TAIL = dict.fromkeys(("tail_up_m", "tail_pitch_rad", "tail_side_m", "tail_roll_rad", "tail_yaw_rad"), 0.0)


def read(symmetry: str, bend: list[float], twist: list[float] | None = None, first_m: float = 0.0):
    mode = SimpleNamespace(symmetry=symmetry, csv=None, bend_m=bend, twist_rad=twist, curvature_1_m=None, **TAIL)
    content = SimpleNamespace(mode=[mode], shapes=None, stations_m=[first_m + k for k in range(len(bend))])
    faults = Faults(Path("test.toml"))
    return _shape(Path("test.toml"), content, 0, _Columns({}, {}), faults), list(faults)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_asymmetric_shape_is_zero_in_the_plane_of_symmetry_up_to_a_twentieth(sign):
    for root, bad in ((0.049, False), (0.051, True)):
        shape, faults = read("asymmetric", [sign * root, 0.01, -1.0])
        assert (shape is None) == bad
        assert [("an asymmetric shape must be 0 at y = 0" in f) for f in faults] == [True] * bad
        _, faults = read("asymmetric", [0.0, 0.5, 1.0], [sign * root * 0.1, 0.0, 0.1])
        assert len(faults) == bad
    assert read("symmetric", [sign, 0.5, 0.2])[1] == []
    assert read("asymmetric", [sign, 0.5, 0.2], first_m=0.3)[1] == []  # no station at the root


def test_a_shape_needs_stations_that_rise_and_something_that_moves():
    assert "something must move" in read("symmetric", [0.0, 0.0, 0.0])[1][0]
    assert "at least 3 stations must rise" in read("symmetric", [0.0, 1.0])[1][0]
    shape, faults = read("symmetric", [0.0, 0.5, 1.0], [0.1, 0.2, 0.3])
    assert faults == []
    assert (shape.bend_m.tolist(), shape.twist_rad.tolist()) == ([0.0, 0.5, 1.0], [0.1, 0.2, 0.3])
