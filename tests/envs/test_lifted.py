"""The lifted system against the design room: same responses, same information, same use of limits, same cost.

Responses carried from row to row against those to the record of the whole flight.
"""

import numpy as np
import pytest

from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.record import FlightRecord
from testbench.envs.gain import Gain
from testbench.envs.lifted import lift
from testbench.envs.tasks import prepare, task_scenario
from testbench.information.fisher import cost
from testbench.sensors.kinds.flow_vane import FlowVane
from testbench.sensors.kinds.rate_gyro import RateGyro
from testbench.sensors.sensor import Sensor
from testbench.sensors.stream import Sensed

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
        out = lifted.matrix @ np.concatenate([z, a])
        z, y, S, use = np.split(out, np.cumsum([lifted.nz, r * lifted.p, r * lifted.p * lifted.k]))
        parts.append((y.reshape(r, lifted.p), S.reshape(r, lifted.p, -1), use.reshape(lifted.R, 2, lifted.c)))
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
    half = len(S) // 2 // lifted.r * lifted.r
    for start in range(0, half, lifted.r):
        new = S[None, start : start + lifted.r] * gain.sensitivity_scale
        gain.add(new, np.array([start]), np.ones(1, bool), len(new[0]))
    M = task.problem.experiment.until(half).information(held)
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    np.testing.assert_allclose(gain.information[0] / scale, M / scale, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("criterion", ["D", "worst", "A", "E"])
def test_cost_with_next_to_no_prior_is_that_of_the_design(criterion):
    task = prepare("eolo")
    lifted, _, S, _, held = flown(task)
    gain = Gain(task.problem, criterion, 1e3)
    for start in range(0, len(S), lifted.r):
        new = S[None, start : start + lifted.r] * gain.sensitivity_scale
        gain.add(new, np.array([start]), np.ones(1, bool), len(new[0]))
    known = gain.known
    problem = task.problem
    wanted = cost(problem.experiment.until(len(S)).information(held), problem.targets.gradient, criterion)
    assert np.exp(known.log_cost[0]) == pytest.approx(wanted, rel=1e-6)
    if criterion == "worst":
        assert known.relative.max() == pytest.approx(wanted, rel=1e-6)


def test_before_the_flight_nothing_but_the_prior_is_known():
    problem = prepare("eolo").problem
    known = Gain(problem, "worst", 0.5).known
    np.testing.assert_allclose(known.relative[0], 0.5 / 0.005, rtol=1e-12)  # 50 % believed, 0.5 % wanted


def test_faults_are_named():
    problem = prepare("eolo").problem
    with pytest.raises(EstimationError, match="prior > 0"):
        Gain(problem, "D", 0.0)
    with pytest.raises(EstimationError, match="at least one sample"):
        lift(problem, 0)
    with pytest.raises(ScenarioError, match="must be one of eolo, taurus, b1"):
        task_scenario("concorde")


CHANNELS = ("q", "alpha", "psi", "u", "v", "w", "p", "r", "V")
RATE_HZ, STRIDE, PIECES = 50.0, 5, (40, 5, 10, 5, 100, 40)
SENSORS = (
    Sensor("V"),
    RateGyro("q", scale=1.02, lag_s=0.03, cross_axis=(0.01, 0.0, -0.02)),
    FlowVane("alpha", lag_s=0.1, delay_s=0.033, upwash=1.1, position_m=(0.4, 0.0, 0.1)),
    Sensor("psi", lag_s=0.2),
    Sensor("r", delay_s=0.5, recorder="own", clock_offset_s=0.02, clock_ppm=300.0),
)


def rows() -> np.ndarray:
    """A smooth flight (sum of the pieces, channels) that turns through north."""
    t = np.arange(sum(PIECES)) / RATE_HZ
    data = np.column_stack([1.0 + 0.3 * np.sin(t * (1.0 + 0.2 * i) + i) for i in range(len(CHANNELS))])
    data[:, CHANNELS.index("psi")] = np.mod(6.0 + 4.0 * t, 2.0 * np.pi)
    return data


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: s.channel)
def test_a_response_in_pieces_is_that_to_the_whole_flight(sensor):
    data = rows()
    whole = sensor.respond(FlightRecord(np.arange(len(data)) / RATE_HZ, CHANNELS, data, "truth"))[::STRIDE]
    sensed = Sensed([sensor], CHANNELS, RATE_HZ, len(data))
    for _ in range(2):  # a second flight remembers nothing of the first
        sensed.begin()
        pieces = [sensed.add(piece, STRIDE) for piece in np.split(data, np.cumsum(PIECES)[:-1])]
        np.testing.assert_allclose(np.concatenate(pieces)[:, 0], whole, rtol=1e-13)
