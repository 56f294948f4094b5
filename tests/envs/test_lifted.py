"""The lifted system against the design room: same responses, same information, same use of limits, same cost."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError, ScenarioError
from testbench.envs.gain import Gain
from testbench.envs.lifted import lift
from testbench.envs.tasks import prepare, task_scenario
from testbench.information.fisher import cost

CASES = [("eolo", "rigid"), ("eolo", "flexible"), ("taurus", "rigid"), ("b1", "rigid")]


def flown(task, samples=None):
    """Fly random commands decision by decision; return lifted system, outputs, sensitivities, use and held commands."""
    problem = task.problem
    experiment = problem.experiment
    r = samples or round(problem.shortest_s * problem.rate_hz / experiment.stride)
    lifted = lift(problem, r)
    steps = experiment.samples // r
    u = np.random.default_rng(0).uniform(-0.05, 0.05, (steps, len(problem.controls)))
    held = np.zeros((experiment.samples * experiment.stride, u.shape[1]))
    held[: steps * lifted.R] = np.repeat(u, lifted.R, axis=0)
    z, parts = np.zeros(lifted.nz), []
    for a in u:
        z, *rest = lifted.parts(lifted.matrix @ np.concatenate([z, a]))
        parts.append(rest)
    y, S, use = (np.concatenate(x) for x in zip(*parts, strict=True))
    return lifted, y, S, use, held


@pytest.mark.parametrize(("name", "wings"), CASES)
def test_decision_by_decision_is_the_response_of_the_whole_flight(name, wings):
    task = prepare(name, wings)
    _, y, S, _, held = flown(task)
    whole_y, whole_S = task.problem.experiment.response(held)
    # rounding of Fourier transforms over a slowly damped phugoid: 1e-10 of the largest was measured
    np.testing.assert_allclose(y, whole_y[: len(y)], rtol=0.0, atol=1e-8 * np.abs(whole_y).max())
    np.testing.assert_allclose(S, whole_S[: len(S)], rtol=0.0, atol=1e-8 * np.abs(whole_S).max())


@pytest.mark.parametrize(("name", "wings"), CASES)
def test_use_of_limits_is_that_of_the_prediction(name, wings):
    task = prepare(name, wings)
    _, _, _, use, held = flown(task)
    prediction = task.problem.prediction
    deviation = prediction.response(held)[: len(use)]
    # the prediction keeps the lateral motion, which couples by 1e-7 through a trim that banks by its propeller
    np.testing.assert_allclose(use[:, 0], deviation / prediction.high, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(use[:, 1], deviation / prediction.low, rtol=0.0, atol=1e-5)
    factor, _ = prediction.factor_of(deviation)
    assert use.max() == pytest.approx(1.0 / factor, rel=1e-5)


@pytest.mark.parametrize("name", ["eolo", "taurus"])  # taurus: sensors of two rates
def test_information_at_any_moment_is_that_of_the_design(name):
    task = prepare(name)
    lifted, _, S, _, held = flown(task, samples=3)
    gain = Gain(task.problem, "D", 1.0)
    gain.reset(0)
    half = len(S) // 2 // lifted.r * lifted.r
    for start in range(0, half, lifted.r):
        gain.add(S[start : start + lifted.r] * gain.sensitivity_scale)
    M = task.problem.experiment.until(half).information(held)
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    np.testing.assert_allclose(gain.information / scale, M / scale, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("criterion", ["D", "worst", "A", "E"])
def test_cost_with_next_to_no_prior_is_that_of_the_design(criterion):
    task = prepare("eolo")
    lifted, _, S, _, held = flown(task)
    gain = Gain(task.problem, criterion, 1e3)
    gain.reset(0)
    for start in range(0, len(S), lifted.r):
        gain.add(S[start : start + lifted.r] * gain.sensitivity_scale)
    known = gain.known()
    problem = task.problem
    wanted = cost(problem.experiment.until(len(S)).information(held), problem.targets.gradient, criterion)
    assert np.exp(known.log_cost) == pytest.approx(wanted, rel=1e-6)
    if criterion == "worst":
        assert known.relative.max() == pytest.approx(wanted, rel=1e-6)


def test_before_the_flight_nothing_but_the_prior_is_known():
    problem = prepare("eolo").problem
    known = Gain(problem, "worst", 0.5).known()
    np.testing.assert_allclose(known.relative, 0.5 / 0.005, rtol=1e-12)  # 50 % believed, 0.5 % wanted


def test_faults_are_named():
    problem = prepare("eolo").problem
    with pytest.raises(EstimationError, match="prior > 0"):
        Gain(problem, "D", 0.0)
    with pytest.raises(EstimationError, match="at least one sample"):
        lift(problem, 0)
    with pytest.raises(ScenarioError, match="must be one of eolo, taurus, b1"):
        task_scenario("concorde")
