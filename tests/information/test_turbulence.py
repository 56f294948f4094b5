"""Turbulence in the information: the filter makes its outputs white, and what misleads an estimator is found."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.core.paths import SCENARIOS
from testbench.core.scenario.air import AirSpec
from testbench.estimators.parametric.kalman.innovations import sampled_noise
from testbench.estimators.parametric.response import Sampling, respond
from testbench.flight import load_aircraft
from testbench.information.fisher import accuracy
from testbench.information.turbulence import Turbulence
from testbench.questions.design.pose import limits_of, place, problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import load_suite


@pytest.fixture(scope="module")
def case():
    """EOLO with its air data boom, as designed for in light turbulence."""
    scenario = DesignScenario.load(SCENARIOS / "design" / "eolo_short_period.toml")
    aircraft = load_aircraft(scenario.aircraft)
    at, suite = place(scenario, aircraft), load_suite(scenario.suites[0])
    return problem_of(scenario, at, suite, limits_of(scenario, aircraft, at.trimmed), starts=True)


@pytest.fixture(scope="module")
def input_(case):
    u = np.zeros((case.experiment.samples * case.experiment.stride, 1))
    u[round(2.0 * case.rate_hz) : round(3.0 * case.rate_hz)] = 0.02
    u[round(3.0 * case.rate_hz) : round(4.0 * case.rate_hz)] = -0.02
    return u


def test_the_filter_makes_what_turbulence_does_white(case):
    """Outputs of the model itself, driven by white noise: innovations of variance one without correlation.

    Over 2000 samples a variance scatters by 3 %, a correlation by 2 %; 15 % and 10 % are five of each.
    """
    e = case.experiment
    n, dt = e.samples, e.dt_s * e.stride
    whitener = e.turbulence.whitener(e.sigma, dt, n)
    Phi, Q = sampled_noise(e.turbulence.A, e.turbulence.F, dt)
    rng = np.random.default_rng(5)
    values, vectors = np.linalg.eigh(Q)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    x, y = np.zeros(len(Phi)), np.empty((n, len(e.sigma)))
    for k in range(n):
        y[k] = e.turbulence.C @ x + e.sigma * rng.standard_normal(e.sigma.size)
        x = Phi @ x + half @ rng.standard_normal(len(Phi))
    size = 2 * n
    v = np.fft.irfft(
        np.einsum("fij,fj->fi", np.fft.rfft(whitener, size, axis=0), np.fft.rfft(y, size, axis=0)), size, axis=0
    )[:n]
    v = v[200:]  # the steady gain is not that of the first samples
    np.testing.assert_allclose(v.std(axis=0), 1.0, atol=0.15)
    for lag in (1, 2, 5):
        assert np.abs(v[lag:].T @ v[:-lag] / len(v)).max() < 0.1
    assert np.abs(np.corrcoef(y[200:].T)).max() > 0.5  # the outputs themselves are not


def test_turbulence_costs_information_and_nearly_none_costs_nearly_nothing(case, input_):
    windy = case.targets.errors(accuracy(case.experiment.information(input_)))
    still = replace(case.experiment, turbulence=None)
    calm = case.targets.errors(accuracy(still.information(input_)))
    assert (windy > 1.2 * calm).all()
    t = case.experiment.turbulence
    tiny = replace(still, turbulence=Turbulence(t.A, 1e-6 * t.F, t.C))
    np.testing.assert_allclose(case.targets.errors(accuracy(tiny.information(input_))), calm, rtol=1e-3)


def test_still_air_has_no_turbulence(case):
    e = case.experiment
    assert Turbulence.of(e.structure, e.sensors, AirSpec(), 100.0, 16.0, 0.0) is None


@pytest.mark.parametrize("windy", [True, False])
def test_another_parameter_misleads_by_its_difference(case, input_, windy):
    """The outputs of the aircraft with M_q and M_de changed a little, offsets added: the change is found."""
    e = case.experiment if windy else replace(case.experiment, turbulence=None)
    s = e.structure
    change = np.zeros(s.true.size)
    for name in ("M_q", "M_de"):
        k = s.parameter_names.index(name)
        change[k] = 1e-4 * s.true[k]
    m, start = len(s.inputs), np.zeros(len(s.states))
    u = np.vstack([np.zeros((1, m)), input_])
    y0, y1 = (
        respond(s, s.true + c, (), u, Sampling(e.dt_s, np.ones(m, bool)), start).y for c in (0.0 * change, change)
    )
    difference = np.hstack([e._sensed((y1 - y0)[:, i : i + 1], i) for i in range(len(e.sensors))])
    found = e.misled(input_, difference[1:][:: e.stride] + np.arange(1.0, len(e.sensors) + 1.0))
    np.testing.assert_allclose(found, change, rtol=0.02, atol=1e-6 * np.abs(s.true).max())
