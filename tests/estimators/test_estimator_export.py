"""Models as files: JSON and MAT hold what the model says, JSBSim flies the fragment as the model's own equations."""

import json
from dataclasses import replace

import numpy as np
import pytest
from estimators.fragments import flown, state_at
from scipy.io import loadmat

from testbench.core.errors import EstimationError, RecordError
from testbench.estimators.export import MassProperties, jsbsim_aerodynamics, save_jsbsim, save_json, save_mat
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.structures import (
    Airframe,
    aerodynamic_longitudinal,
    lateral_directional,
    longitudinal,
    short_period,
)

V0, ALPHA0, THETA0 = 20.0, 0.05, 0.08
MASS = MassProperties(mass=12.0, Ixx=1.1, Iyy=1.7, Izz=2.4, Ixz=0.15)
THRUST = 9.0
LONGITUDINAL = {
    "X_V": -0.1, "X_alpha": 4.0, "X_de": -0.6, "Z_V": -0.9, "Z_alpha": -80.0, "Z_q": -2.0, "Z_de": -7.0, "M_V": 0.03,
    "M_alpha": -40.0, "M_q": -6.0, "M_de": -50.0,
}  # fmt: skip
LATERAL = {
    "Y_beta": -9.0, "Y_r": 0.4, "Y_dr": 3.0, "L_beta": -20.0, "L_p": -9.0, "L_r": 3.0, "L_da": 60.0, "L_dr": 2.0,
    "N_beta": 12.0, "N_p": -0.7, "N_r": -1.5, "N_da": -3.0, "N_dr": -9.0,
}  # fmt: skip


def state(V=V0, alpha=ALPHA0, theta=THETA0, **more):
    return state_at(V, alpha, theta, **more)


def model_of(structure, values):
    structure = structure.with_parameters(values)
    k = len(structure.parameters)
    return ParametricModel(
        method="output_error",
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=0.02,
        structure=structure,
        params=structure.values,
        covariance=np.eye(k) * 0.01,
        covariance_plain=np.eye(k) * 0.01,
        noise_covariance=np.eye(len(structure.outputs)),
        held=(False,) * len(structure.inputs),
        delays_s=(0.0,) * len(structure.inputs),
        operating_point=(np.zeros(len(structure.states)), np.zeros(len(structure.inputs))),
        advice=("an advice", "another"),
        status="warning",
    )


@pytest.fixture(scope="module")
def rigid():
    return model_of(longitudinal(V0, ALPHA0, THETA0), LONGITUDINAL)


def test_json_is_the_dictionary(rigid, tmp_path):
    path = save_json(rigid, tmp_path / "models" / "one.json")
    assert json.loads(path.read_text()) == json.loads(json.dumps(rigid.to_dict()))


def test_mat_holds_matrices_parameters_and_advice(rigid, tmp_path):
    path = save_mat(rigid, tmp_path / "one.mat")
    model = loadmat(path, simplify_cells=True)["model"]
    said = rigid.to_dict()
    assert np.allclose(model["A"], said["A"])
    assert model["parameters"]["M_alpha"]["value"] == -40.0
    assert list(model["advice"]) == ["an advice", "another"]
    assert (model["method"], model["status"], list(model["outputs"])) == (
        "output_error",
        "warning",
        list(rigid.outputs),
    )
    assert path.read_bytes() == save_mat(rigid, tmp_path / "two.mat").read_bytes()


def test_a_file_that_cannot_be_written_is_one_clear_error(rigid, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="could not be written"):
        save_mat(rigid, tmp_path / "file" / "one.mat")


@pytest.mark.parametrize("surface", [0.0, 0.03])
def test_jsbsim_flies_the_longitudinal_equations(rigid, tmp_path, surface):
    fragment = jsbsim_aerodynamics(rigid, MASS, trim_controls={"de": -0.02}, thrust_N=THRUST)
    x = {"V": 1.5, "alpha": 0.04, "q": 0.2}
    de = surface + 0.02  # from its trim
    X, Z, M = (sum(LONGITUDINAL.get(f"{s}_{n}", 0.0) * v for n, v in {**x, "de": de}.items()) for s in "XZM")
    c, s = np.cos(ALPHA0), np.sin(ALPHA0)
    force, moment = flown(
        tmp_path, fragment, state(V0 + 1.5, ALPHA0 + 0.04, THETA0 + 0.04, q=0.2, elevator=surface), MASS
    )
    g = rigid.structure.trim.g
    expected = MASS.mass * np.array([g * np.sin(THETA0) + c * X - s * Z, 0.0, -g * np.cos(THETA0) + s * X + c * Z])
    assert force == pytest.approx(expected - [THRUST, 0.0, 0.0], rel=1e-6, abs=1e-6)
    assert moment == pytest.approx([0.0, MASS.Iyy * M, 0.0], rel=1e-6, abs=1e-6)


def test_jsbsim_flies_the_lateral_equations(tmp_path):
    model = model_of(lateral_directional(V0, ALPHA0, THETA0), LATERAL)
    x = {"beta": 0.05, "p": 0.3, "r": -0.1, "da": 0.02, "dr": -0.04}
    Y, L, N = (sum(LATERAL.get(f"{s}_{n}", 0.0) * v for n, v in x.items()) for s in "YLN")
    at = state(beta=0.05, p=0.3, r=-0.1, left_aileron=0.02, rudder=-0.04)
    force, moment = flown(tmp_path, jsbsim_aerodynamics(model, MASS), at, MASS)
    assert force[1] == pytest.approx(MASS.mass * Y, rel=1e-6)
    assert moment == pytest.approx([MASS.Ixx * L - MASS.Ixz * N, 0.0, MASS.Izz * N - MASS.Ixz * L], rel=1e-6, abs=1e-6)


def test_jsbsim_flies_the_polynomials(tmp_path):
    a = Airframe(S_m=1.0 / 12.0, S_cbar_Iyy=0.4 / 1.7, cbar=0.4, mass=12.0, V0=V0, rho=1.2)
    values = {"CD_0": 0.03, "CD_V": 0.01, "CD_alpha": 0.3, "CL_0": 0.2, "CL_V": 0.05, "CL_alpha": 5.0, "Cm_0": 0.02}
    values |= {"Cm_V": 0.01, "Cm_alpha": -0.6, "Cm_q": -12.0, "Cm_de": -1.1}
    model = model_of(aerodynamic_longitudinal(a), values)
    V, alpha, q, de = 21.0, 0.1, 0.2, 0.05
    qhat, rate = V / V0, q * 0.4 / (2.0 * V0)
    CD = 0.03 + 0.01 * qhat + 0.3 * alpha
    CL = 0.2 + 0.05 * qhat + 5.0 * alpha
    Cm = 0.02 + 0.01 * qhat - 0.6 * alpha - 12.0 * rate - 1.1 * de
    force, moment = flown(tmp_path, jsbsim_aerodynamics(model, MASS), state(V, alpha, 0.15, q=q, elevator=de), MASS)
    c, s = np.cos(alpha), np.sin(alpha)
    along = np.array([-CD * c + CL * s, 0.0, -CD * s - CL * c])
    pressure = np.linalg.norm(force) / np.linalg.norm(along)
    assert pressure == pytest.approx(0.5 * 1.167 * V**2, rel=0.01)  # standard atmosphere at 500 m, 1 m2
    assert force == pytest.approx(pressure * along, rel=1e-6, abs=1e-6)
    assert moment == pytest.approx([0.0, pressure * 0.4 * Cm, 0.0], rel=1e-6, abs=1e-6)


def test_what_has_no_forces_is_refused(rigid, tmp_path):
    with pytest.raises(EstimationError, match="got 'short_period': its states do not say what forces act"):
        jsbsim_aerodynamics(model_of(short_period(), {}), MASS)
    with pytest.raises(EstimationError, match="Iyy > 0 must hold"):
        jsbsim_aerodynamics(rigid, replace(MASS, Iyy=0.0))
    path = save_jsbsim(rigid, tmp_path / "aero.xml", MASS)
    assert path.read_text().startswith("<aerodynamics>")
