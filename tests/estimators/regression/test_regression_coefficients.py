"""Coefficients and regressors from a record: by the equations, by the Twin Otter's file, and what is absent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from regression_systems import twin_otter

from testbench.core.errors import ChannelError, EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.prepare import prepare
from testbench.estimators.regression import MassProperties, equation_error, polynomial_terms, regression_data

MASS = MassProperties(
    mass_kg=900.0,
    area_m2=14.0,
    span_m=10.0,
    chord_m=1.5,
    Ixx=1200.0,
    Iyy=1900.0,
    Izz=2900.0,
    Ixz=110.0,
    thrust_angle_rad=0.05,
    thrust_arm_m=0.2,
)
RHO = 1.1
N = 400
COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


def flight() -> tuple[FlightRecord, np.ndarray]:
    """Return a record that obeys the equations of motion with the coefficients (n, 6) beside it, forwards."""
    g = np.random.default_rng(0)
    t = np.arange(N) * 0.02
    channels = {name: 0.1 * np.sin((i + 1) * t + i) for i, name in enumerate(("alpha", "beta", "p", "q", "r", "de"))}
    V = 50.0 + np.sin(t)
    T = 800.0 + 50.0 * np.cos(t)
    C = 0.1 * g.standard_normal((N, 6))
    qbar = 0.5 * RHO * V**2
    force = C[:, :3] * (qbar * MASS.area_m2)[:, None]
    force += T[:, None] * np.array([np.cos(MASS.thrust_angle_rad), 0.0, -np.sin(MASS.thrust_angle_rad)])
    moment = C[:, 3:] * (qbar * MASS.area_m2)[:, None] * np.array([MASS.span_m, MASS.chord_m, MASS.span_m])
    moment[:, 1] += T * MASS.thrust_arm_m
    inertia = np.array([[MASS.Ixx, 0, -MASS.Ixz], [0, MASS.Iyy, 0], [-MASS.Ixz, 0, MASS.Izz]])
    rates = np.column_stack([channels[k] for k in "pqr"])
    # Euler: I w' + w x I w = M, solved as vectors, so that no term of the scalar equations is used here
    accelerations = np.linalg.solve(inertia, (moment - np.cross(rates, rates @ inertia)).T).T
    channels |= {"V": V, "qbar": qbar, "thrust": T}
    channels |= dict(zip(("ax", "ay", "az"), (force / MASS.mass_kg).T, strict=True))
    channels |= dict(zip(("pdot", "qdot", "rdot"), accelerations.T, strict=True))
    return FlightRecord(t, tuple(channels), np.column_stack(list(channels.values())), "measured"), C


def without(record: FlightRecord, *names: str) -> FlightRecord:
    return record.select([c for c in record.channels if c not in names])


def test_coefficients_invert_the_equations_of_motion():
    record, C = flight()
    data = regression_data(record, MASS)
    for i, name in enumerate(COEFFICIENTS):
        assert np.allclose(data[name], C[:, i], atol=1e-12), name
    alpha = record["alpha"]
    # lift and drag are the same force in wind axes (beta = 0): its square is kept, and at alpha = 0 they are -CZ, -CX
    assert np.allclose(data["CL"] ** 2 + data["CD"] ** 2, data["CX"] ** 2 + data["CZ"] ** 2)
    assert np.allclose(data["CL"] * np.cos(alpha) + data["CD"] * np.sin(alpha), -data["CZ"])
    assert np.allclose(data["p_hat"], record["p"] * 10.0 / (2 * record["V"]))
    assert np.allclose(data["q_hat"], record["q"] * 1.5 / (2 * record["V"]))
    assert data.valid.all()


def test_derivatives_and_airdata_are_made_where_missing():
    record, C = flight()
    made = regression_data(without(record, "qbar"), MASS, density_kg_m3=RHO)
    assert np.allclose(made["CZ"], C[:, 2], atol=1e-12)
    made = regression_data(without(record, "V"), MASS, density_kg_m3=RHO)
    assert np.allclose(made["V"], record["V"])
    # Quadratics through 5 samples lose (w dt)^2 17 / 30 of a sine: 0.36 % of 0.4 rad/s2 at w = 4 rad/s.
    for how, tolerance in (("fourier", 2e-4), ("local", 2e-3)):
        made = regression_data(without(record, "pdot", "qdot", "rdot"), MASS, differentiation=how)
        exact = 0.1 * 4 * np.cos(4 * record.t_s + 3)  # of q
        assert np.allclose(made["qdot"][20:-20], exact[20:-20], atol=tolerance)
        assert np.allclose(made["alphadot"][20:-20], 0.1 * np.cos(record.t_s)[20:-20], atol=tolerance)


def test_the_twin_otter_coefficients_are_those_of_its_file():
    flight, mass, made, _ = twin_otter()
    # Its q was corrected by 0.0367 deg/s after these columns were made, which a constant cannot hide.
    offset = made["q_hat"] * 2 * flight["V"] / mass.chord_m - flight["q"]
    assert np.ptp(offset) < 1e-12
    data = regression_data(flight.with_columns({"q": flight["q"] + offset}), mass)
    for name in ("p_hat", "q_hat", "r_hat", "Cl", "Cm", "Cn"):
        assert np.allclose(data[name], made[name], rtol=0.0, atol=1e-12), name
    assert np.allclose(data["CY"], made["CY"], rtol=1e-4)  # its mass falls by 1e-4 in the record
    # CZ was made before az was corrected in the data compatibility check, by up to 3 % of its spread.
    assert np.max(np.abs(data["CZ"] - made["CZ"])) < 0.04 * np.std(made["CZ"])


def test_what_is_absent_is_said():
    record, _ = flight()
    cases = [
        (without(record, "thrust"), "CX", "'CX' needs channel 'thrust'"),
        (without(record, "thrust"), "Cm", "'Cm' needs channel 'thrust'"),
        (without(record, "thrust"), "CD", "'CD' needs channel 'thrust'"),
        (without(record, "p", "pdot"), "Cm", "'Cm' needs channel 'p'"),
        (without(record, "V", "qbar"), "CY", "density_kg_m3"),
        (without(record, "beta"), "betadot", "needs channel 'beta'"),
    ]
    for part, name, message in cases:
        with pytest.raises(ChannelError, match=message):
            regression_data(part, MASS)[name]
    with pytest.raises(ChannelError, match="did you mean 'q_hat'"):
        regression_data(record, MASS)["qhat"]
    plain = replace(MASS, thrust_angle_rad=0.0, thrust_arm_m=0.0)
    assert "CZ" in regression_data(without(record, "thrust"), plain).names  # the thrust does not enter
    assert "CX" in regression_data(without(record, "thrust"), plain, unpowered=True).names
    longitudinal = without(record, "p", "r", "pdot", "rdot", "beta")
    assert "Cm" not in regression_data(longitudinal, MASS).names
    assert "Cm" in regression_data(longitudinal, MASS, symmetric=True).names


def test_gaps_are_bridged_and_marked():
    record, _ = flight()
    valid = np.ones(record.data.shape, bool)
    valid[50:60, record.channels.index("V")] = False
    spoilt = np.array(record.data)
    spoilt[50:60, record.channels.index("V")] = 9.0
    data = regression_data(replace(record, data=spoilt, valid=valid), MASS)
    assert np.allclose(data["V"], record["V"], atol=0.02)
    assert not data.sampled(["q_hat"])[50:60].any()
    assert data.sampled(["q_hat"]).sum() == N - 10
    assert data.sampled(["Cm", "alpha"]).all()  # from qbar, not from V


def test_what_cannot_give_coefficients_is_refused():
    record, _ = flight()
    with pytest.raises(EstimationError, match="bias 'mean' was subtracted"):
        regression_data(prepare(record, bias="mean", trim_s=0.0), MASS)
    assert "alphadot" in regression_data(prepare(record, bias="mean", trim_s=0.0)).names
    with pytest.raises(EstimationError, match="'V' must be positive"):
        regression_data(record.with_columns({"V": np.zeros(N)}), MASS)
    with pytest.raises(EstimationError, match="mass_kg must be positive"):
        replace(MASS, mass_kg=0.0)
    with pytest.raises(EstimationError, match="density_kg_m3 must be positive"):
        regression_data(record, MASS, density_kg_m3=-1.0)
    with pytest.raises(EstimationError, match="'fourier' or 'local'"):
        regression_data(record, MASS, differentiation="central")  # type: ignore[arg-type]


def test_terms_are_products_of_powers():
    record, _ = flight()
    data = regression_data(record, MASS)
    made = data.matrix(["1", "alpha^2", "alpha*q_hat", "alpha^2*de"])
    a = record["alpha"]
    assert np.allclose(made, np.column_stack([np.ones(N), a**2, a * data["q_hat"], a**2 * record["de"]]))
    assert polynomial_terms(["a", "b"], 2) == ("a", "b", "a^2", "a*b", "b^2")
    assert len(polynomial_terms(["a", "b", "c"], 3)) == 19  # C(6, 3) - 1
    with pytest.raises(EstimationError, match="order >= 1"):
        polynomial_terms(["a"], 0)


def test_a_whole_record_gives_its_derivatives_back():
    record, _ = flight()
    data = regression_data(record, MASS)
    truth = np.array([-5.0, -12.0, -0.4, 0.02])
    terms = ["alpha", "q_hat", "de"]
    cz = np.column_stack([data.matrix(terms), np.ones(N)]) @ truth
    qS = record["qbar"] * MASS.area_m2
    az = (cz * qS - record["thrust"] * np.sin(MASS.thrust_angle_rad)) / MASS.mass_kg
    found = equation_error(regression_data(record.with_columns({"az": az}), MASS), "CZ", terms)
    assert np.max(np.abs(found.params - truth)) < 1e-10
    assert np.allclose(found.predict(record), cz, atol=1e-10)  # from the record itself, made the same way
