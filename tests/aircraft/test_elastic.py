from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from testbench.aircraft import load_aircraft
from testbench.aircraft.elastic import first_order_hold

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


def test_matrices_without_coupling_are_those_of_the_structure(eolo):
    bare = eolo.elastic.uncoupled()
    K, D, _ = bare.matrices(150.0, 16.0)
    w = 2 * np.pi * np.array([f for f, _ in TABLE_2])
    assert np.allclose(K, np.diag(w**2), rtol=1e-12)
    assert np.allclose(D, np.diag(2 * w * np.array([z for _, z in TABLE_2]) / 100), rtol=1e-12)


def test_rigid_wings_write_the_plain_model():
    rigid = load_aircraft("eolo", "rigid")
    assert rigid.elastic is None
    assert "modal/" not in rigid.model_xml(500.0, 150.0, 16.0)
