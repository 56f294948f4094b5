"""Aerodynamic coefficients by perturbation, against the numbers that the models are written with."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.linalg import expm
from structure_alone import uncoupled

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ChannelError, ModelError
from testbench.evaluation.modes import frequency_and_damping, longitudinal_modes
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.coefficients import coefficients
from testbench.inputs.signal import InputSignal


@pytest.fixture(scope="module")
def linear(eolo, eolo_trim):
    return linearise(eolo, eolo_trim)


def test_every_mode_but_the_spiral_is_stable_at_16_m_s(linear):
    # Heading and height are not states or integrate only; the roots at zero are theirs.
    poles = linear.poles()
    (spiral,) = poles[poles.real > 1e-3]
    assert spiral.imag == 0.0
    # Constant of Routh's cubic, g / V (L_beta N_r - L_r N_beta): this fin damps yaw too little for 4 deg of dihedral.
    assert 0.0 < spiral.real < 0.1


def test_linear_and_nonlinear_flight_agree_for_a_small_input(eolo, eolo_trim, linear):
    rate, dt = 500.0, 0.01
    u = np.zeros((1500, 1))
    u[:150] = 0.1 * DEG_RAD
    u[150:300] = -0.1 * DEG_RAD
    record = fly(eolo, eolo_trim, Manoeuvre("small", InputSignal(np.arange(1500) / rate, u, ("de",)), 0.5), 100.0)
    k = linear.inputs.index("de_cmd")
    n = len(linear.states)
    step = expm(np.block([[linear.A, linear.B[:, [k]]], [np.zeros((1, n + 1))]]) * dt)
    x = np.zeros(n)
    names = ("V", "alpha", "q", "theta", "az", "eta_1", "eta_5", "eta_7")
    predicted = []
    held = np.concatenate([np.zeros(50), u[::5, 0]])
    for i in range(len(record)):
        rows = [linear.outputs.index(name) for name in names]
        predicted.append(linear.C[rows] @ x)
        x = step[:n, :n] @ x + step[:n, n] * held[min(i, held.size - 1)]
    predicted = np.array(predicted)
    for j, name in enumerate(names):
        deviation = record[name] - record[name][0]
        error = np.sqrt(np.mean((deviation - predicted[:, j]) ** 2)) / np.std(deviation)
        assert error < 0.03, (
            name,
            error,
        )  # the held step against the simulator's ramp over one frame is the larger part


def test_uncoupled_structure_and_rigid_body_appear_among_the_poles(eolo, eolo_trim):
    from dataclasses import replace

    from testbench.flight import trim

    bare = replace(eolo, elastic=uncoupled(eolo.elastic))
    poles = linearise(bare, trim(bare, eolo_trim.condition)).poles()
    for mode in eolo.elastic.modes:
        expected = mode.omega_rad_s * complex(-mode.zeta, np.sqrt(1 - mode.zeta**2))
        assert np.min(np.abs(poles - expected)) < 1e-6 * abs(expected)


def test_true_poles_carry_their_names(linear, eolo):
    symmetric = {i: m.name for i, m in enumerate(eolo.elastic.modes, 1) if m.symmetry == "symmetric"}
    modes = longitudinal_modes(linear, symmetric)
    assert list(modes)[:3] == ["phugoid", "short period, slow root", "short period, fast root"]
    wn, zeta = frequency_and_damping(modes["1st symmetric wing bending"])
    assert wn / (2 * np.pi) == pytest.approx(4.6, rel=0.1)  # the air moves it a little and damps it a lot
    assert zeta > 0.1


def test_taurus_short_period_is_that_of_its_derivatives(taurus, taurus_trim):
    """Estimate from the derivatives alone: wn^2 = -M_alpha - M_q Z_alpha / V within 10 % (two-state approximation)."""
    modes = longitudinal_modes(linearise(taurus, taurus_trim), {})
    g, m = taurus.geometry, taurus.mass
    qbar, V = taurus_trim.state["qbar"], 12.0
    Z = -qbar * g.S_m2 * taurus.coefficient("CL_alpha") / (m.mass_kg * V)
    M_alpha = qbar * g.S_m2 * g.cbar_m * taurus.coefficient("Cm_alpha") / m.Iyy
    M_q = qbar * g.S_m2 * g.cbar_m**2 / (2 * V) * taurus.coefficient("Cm_q") / m.Iyy
    assert abs(modes["short period"]) == pytest.approx(np.sqrt(-M_alpha + M_q * Z), rel=0.1)


def test_frequency_response_is_the_transfer_matrix(linear):
    omega = np.array([0.5, 3.0, 30.0])
    found = linear.frequency_response(omega, ["q", "V"], ["de"])
    for k, w in enumerate(omega):
        full = linear.C @ np.linalg.solve(1j * w * np.eye(len(linear.states)) - linear.A, linear.B) + linear.D
        for r, name in enumerate(("q", "V")):
            assert found[k, r, 0] == pytest.approx(full[linear.outputs.index(name), linear.inputs.index("de")])


def test_an_unknown_channel_is_named(linear):
    with pytest.raises(ChannelError, match="did you mean 'theta'"):
        linear.frequency_response(np.array([1.0]), ["theata"], ["de"])


@pytest.mark.parametrize("name", ["taurus", "eolo", "b1"])
def test_what_a_packaged_model_is_written_with_is_found(name):
    aircraft = load_aircraft(name, "rigid")
    found = coefficients(aircraft, trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)))
    checked = 0
    for function in ET.fromstring(aircraft.xml).iter("function"):
        coefficient = (function.get("name") or "").removeprefix("aero/coefficient/")
        values = function.findall("product/value")
        if coefficient in found and coefficient.count("_") == 1 and len(values) == 1:
            assert found[coefficient] == pytest.approx(float(values[0].text), abs=2e-7), coefficient
            checked += 1
    assert checked >= 18


def test_lift_carries_the_weight():
    aircraft = load_aircraft("jsbsim:SGS")
    t = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    found = coefficients(aircraft, t)
    weight = aircraft.mass.mass_kg * 9.777 * np.cos(t.condition.gamma_rad)  # 1 km above the equator, turning with it
    assert found["CL"] * t.state["qbar"] * aircraft.geometry.S_m2 == pytest.approx(weight, rel=1e-3)
    assert found["CD"] / found["CL"] == pytest.approx(-t.condition.gamma_rad, rel=2e-3)  # an unpowered glide


def test_a_stock_model_is_asked_like_a_packaged_one():
    c172p = load_aircraft("jsbsim:c172p")
    assert c172p.coefficient("CL_de") == pytest.approx(0.43, rel=1e-6)  # CLDe of c172p.xml
    assert c172p.coefficient("CL_q") == pytest.approx(3.9, rel=1e-6)
    assert c172p.coefficient("CL_alphadot") == pytest.approx(1.7, rel=1e-6)
    assert c172p.coefficient("Cn_da") == pytest.approx(-0.0053, rel=1e-6)
    with pytest.raises(ModelError, match="must have a coefficient 'CL_gamma'"):
        c172p.coefficient("CL_gamma")


def test_the_numbers_of_the_packaged_three_are_those_of_their_files():
    taurus = load_aircraft("taurus")
    assert taurus.coefficient("CL_alpha") == 4.58
    assert taurus.perturbed["CL_alpha"] == pytest.approx(4.58, rel=1e-7)
    assert taurus.perturbed["CL_q"] == pytest.approx(6.1639, rel=1e-6)
