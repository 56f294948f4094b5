"""Errors of airspeed, mass and inertia that all logs share: first order against Monte Carlo, in words, in the file."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import testbench as tb
from testbench.aircraft.model import Geometry, read_aircraft
from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.evaluation.coefficients import PartialMass, Scaling, weights
from testbench.pooling.scales import changes_by_scale, scaled
from testbench.questions.identify.pool.answer import pool_answer

NAMES = ("L_p", "L_da", "N_p", "N_da")
SYMBOLS = ("Cl_p", "Cl_da", "Cn_p", "Cn_da")
X = np.array([-9.0, 40.0, -0.6, -2.5])
STATED = {"airspeed": 0.02, "mass": 0.01, "Ixx": 0.05, "Izz": 0.03, "Ixz": 0.1}


def model(x=X):
    structure = SimpleNamespace(name="lateral_directional", meaning="lateral_directional", parameter_names=NAMES)
    return SimpleNamespace(structure=structure, params=x, values=dict(zip(NAMES, x, strict=True)))


def scaling(V):
    return Scaling(V, 0.6 * V**2, Geometry(0.6, 2.4, 0.25), PartialMass(3.0, 0.3, 0.2, 0.5, 0.04))


def converted(x, at):
    return np.array([weights("lateral_directional", NAMES, n, at)[1] @ x for n in NAMES])


def logs(noise, exact=True):
    """Logs at two speeds; the errors of their derivatives are ``noise`` of the values."""
    out = []
    for i, V in enumerate((14.0, 18.0)):
        x = X * (V / 14.0) ** np.array([1.0, 2.0, 1.0, 2.0])
        H = np.stack([weights("lateral_directional", NAMES, n, scaling(V))[1] for n in NAMES])
        P = H @ np.diag((noise * x) ** 2) @ H.T
        out.append(
            tb.LogCoefficients(f"day{i}", SYMBOLS, H @ x, P, {"V": V}, changes_by_scale(model(x), NAMES, scaling(V)))
        )
    return out


def test_the_covariance_is_that_of_monte_carlo():
    """4000 draws: a variance comes within 10 % of its own at 4.5 standard deviations of it (chance 1e-5 for all)."""
    rng, draws = np.random.default_rng(5), []
    every = logs(0.02)
    own = tb.pool(every, trend="none")
    told = tb.pool(every, trend="none", scale_uncertainty=STATED)
    weight = [own.covariance @ log.information for log in every]
    d = {name: std * rng.standard_normal(4000) for name, std in STATED.items()}
    noise = 0.02 * rng.standard_normal((4000, 2, 4))
    for k in range(4000):
        b = 0.0
        for i, V in enumerate((14.0, 18.0)):
            x, at = X * (V / 14.0) ** np.array([1.0, 2.0, 1.0, 2.0]), scaling(V)
            for name in STATED:
                at = scaled(at, name, d[name][k])
            b = b + weight[i] @ converted(x * (1.0 + noise[k, i]), at)
        draws.append(b)
    found = np.cov(np.array(draws).T)
    for i, c in enumerate(told.coefficients):
        assert c.std**2 == pytest.approx(found[i, i], rel=0.1)
        assert c.std > 1.5 * own.coefficients[i].std
    size = np.sqrt(np.diag(found))
    assert np.abs((told.covariance - found) / np.outer(size, size)).max() < 0.1


def test_more_logs_do_not_lessen_it_and_the_answer_says_what_it_is():
    many = [log for k in range(8) for log in logs(0.02)]
    told = tb.pool(many, trend="none", scale_uncertainty={"Ixx": 0.05})
    c = told.coefficient("Cl_p")
    assert c.std > 0.04 * abs(c.value) > 3.0 * c.own_std
    assert c.mostly == "Ixx"
    flights = SimpleNamespace(pooled=told, doubts=(), notes=())
    said = " ".join(line.text for line in pool_answer(flights)).replace("\xa0", " ")
    assert "he error of Ixx, 5 %, causes most of the variance of" in said
    assert "measurement of the inertia" in said


def test_nothing_stated_changes_nothing():
    assert np.array_equal(tb.pool(logs(0.02)).covariance, tb.pool(logs(0.02), scale_uncertainty={}).covariance)
    assert tb.pool(logs(0.02)).coefficients[0].mostly == ""


def test_an_aircraft_states_them_beside_its_coefficients(tmp_path):
    folder = tmp_path / "mine"
    shutil.copytree(AIRCRAFT_MODELS / "taurus", folder)
    text = (folder / "aircraft.toml").read_text(encoding="utf-8")
    stated = "\n[uncertainty]\nairspeed = 0.02\nIyy = 0.05\n"
    (folder / "aircraft.toml").write_text(text + stated, encoding="utf-8")
    aircraft = read_aircraft(folder)
    assert aircraft.scale_uncertainty == {"airspeed": 0.02, "Iyy": 0.05}
    assert not set(aircraft.uncertainty) & {"airspeed", "Iyy"}
    (folder / "aircraft.toml").write_text(f"{text}\n[uncertainty]\nIzy = 0.05\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="must have this coefficient"):
        read_aircraft(folder)
