"""A pitch damper that feeds the measured, noisy q back: who stays right, who is biased and says so."""

import numpy as np
import pytest
from dsr_e_systems import record, sampled, short_period
from test_band_limited import identify

from testbench.core.errors import EstimationError

DT, GAIN, SEEDS = 0.05, 0.15, 4
A, B = sampled(*short_period(2.0, 0.3), DT)
K = np.array([[0.3, 0.2], [0.1, 0.7]])  # turbulence: innovations that move the states
OMEGA = np.geomspace(0.3, 10.0, 20)


def response(A, B):
    return np.linalg.solve(np.exp(1j * OMEGA * DT)[:, None, None] * np.eye(2) - A, B.astype(complex))


def damped_flight(seed, gain=GAIN, n=4000):
    rng = np.random.default_rng(seed)
    e = np.radians(1.0) * rng.standard_normal((n, 2))
    command = 0.02 * np.repeat(rng.choice([-1.0, 1.0], n // 8 + 1), 8)[:n]
    x, u, y, q = np.zeros(2), np.empty((n, 1)), np.empty((n, 2)), 0.0
    for k in range(n):
        u[k] = command[k] + gain * q  # the damper acts on the sample before
        y[k] = x + e[k]
        q = y[k, 1]
        x = A @ x + B @ u[k] + K @ e[k]
    return record(DT, u, y, ("de",), ("alpha", "q"))


def worst_error(model):
    true = response(A, B)
    return float(np.max(np.abs(model.frequency_response(OMEGA) - true) / np.abs(true)))


def run(method, seed, **settings):
    return identify(method, [damped_flight(seed)], past_horizon=20, future_horizon=10, order=2, **settings)


@pytest.mark.parametrize("method", ["moesp", "n4sid", "cva", "dsr"])
def test_projections_are_biased_and_say_so(method):
    # The error of the response is 0.7 at its worst frequency, of which scatter makes 0.15.
    models = [run(method, seed) for seed in range(SEEDS)]
    assert np.mean([worst_error(m) for m in models]) > 0.4
    for model in models:
        assert model.diagnostics["feedback"] > 0.05
        assert any("closed loop" in s and "use ssarx, pbsid_opt or dsr_e" in s for s in model.advice)
    with pytest.raises(EstimationError, match="closed_loop needs ssarx or pbsid_opt without decimation"):
        run(method, 0, closed_loop=True)


@pytest.mark.parametrize("method", ["ssarx", "pbsid_opt", "dsr_e", "dsr_e eolo"])
def test_predictors_are_not(method):
    errors = [worst_error(run(method, seed, closed_loop=True)) for seed in range(SEEDS)]
    assert np.mean(errors) < 0.3  # 0.16 to 0.2: scatter
    left = [worst_error(run(method, seed)) for seed in range(SEEDS)]
    assert np.mean(left) > 1.5 * np.mean(errors)  # what closed_loop is for


def test_error_falls_with_more_data_in_closed_loop():
    def error(method, n):
        flights = [damped_flight(seed, n=n) for seed in range(3)]
        settings = {"closed_loop": True} if method == "ssarx" else {}
        return np.mean(
            [
                worst_error(identify(method, [f], past_horizon=20, future_horizon=10, order=2, **settings))
                for f in flights
            ]
        )

    assert error("ssarx", 16_000) < 0.12
    assert error("moesp", 16_000) > 0.4


def test_an_open_loop_is_not_suspected():
    for seed in range(SEEDS):
        flown = damped_flight(seed, gain=0.0)
        model = identify("moesp", [flown], past_horizon=20, future_horizon=10, order=2)
        assert model.diagnostics["feedback"] < 0.02
        assert not any("closed loop" in s for s in model.advice)
