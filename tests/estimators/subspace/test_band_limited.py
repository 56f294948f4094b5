"""Flight-test inputs at two rates: every method right within 2 % in frequency, or it warns; it is never silent."""

import numpy as np
import pytest
from dsr_e_systems import flight_test_inputs, poles_of, record, sampled, short_period, simulate

from testbench.core.errors import EstimationError
from testbench.estimators.settings import DsrE, Subspace
from testbench.estimators.subspace import dsr_e
from testbench.estimators.subspace.family import PREDICTORS, PROJECTIONS, estimate

METHODS = [*PROJECTIONS, *PREDICTORS, "dsr_e", "dsr_e eolo"]


def identify(method, records, outputs=("alpha", "q"), **settings):
    if method.startswith("dsr_e"):
        variant = "eolo" if method.endswith("eolo") else "original"
        return dsr_e.estimate(records, ("de",), outputs, DsrE(variant=variant, **settings))
    return estimate(records, ("de",), outputs, Subspace(method=method, **settings))


def frequency_error(model, wn=3.0):
    """Relative error of the undamped frequency, infinite if the two poles have become others."""
    poles = poles_of(model)
    return abs(np.sqrt(abs(np.prod(poles))) / wn - 1.0) if poles.size == 2 else np.inf


@pytest.mark.sampled(4)
@pytest.mark.parametrize("dt", [0.02, 0.1])
@pytest.mark.parametrize("name", list(flight_test_inputs()))
@pytest.mark.parametrize("block", [10, 20])
@pytest.mark.parametrize("method", METHODS)
def test_right_or_warned(dt, name, block, method):
    # Short period of 3 rad/s and 0.617, 30 s, 5 % noise, order 2. The seed is fixed.
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs(dt)[name]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y + 0.05 * y.std(axis=0) * np.random.default_rng(100 * block).standard_normal(y.shape)
    flown = record(dt, u, y, ("de",), ("alpha", "q"))
    model = identify(method, [flown], past_horizon=block, future_horizon=block, order=2)
    error = frequency_error(model)
    assert error < 0.02 or model.status != "good"
    if name in ("3211", "prbs"):
        assert model.status == "good"
        assert error < 0.01
    elif method not in ("n4sid", "dsr_e eolo"):
        assert error < 0.03  # right all the same, though warned of
    elif dt == 0.02 and method == "n4sid":
        assert error < 0.03
    if error > 0.05:
        assert method == "dsr_e eolo"
        assert any("unweighted projection" in s or "do not excite" in s for s in model.advice)


def test_decimation_is_automatic_and_comes_back_to_the_records_rate():
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs(dt)["sweep"]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y + 0.01 * y.std(axis=0) * np.random.default_rng(0).standard_normal(y.shape)
    flown = record(dt, u, y, ("de",), ("alpha", "q"))
    model = identify("moesp", [flown], past_horizon=15, future_horizon=15, order=2)
    assert model.diagnostics["decimate"] == 2
    assert model.diagnostics["identified_at_dt_s"] == pytest.approx(0.04)
    assert model.dt_s == pytest.approx(dt)
    assert np.all(model.diagnostics["output_error_percent"] < 2.0)  # the noise alone is 1 %
    for stride in (1, 3, 4):
        other = identify("cva", [flown], past_horizon=15, future_horizon=15, order=2, decimate=stride)
        assert other.diagnostics["decimate"] == stride
        assert frequency_error(other) < 0.02
        assert other.simulate(flown).shape == y.shape


def test_a_sine_cannot_show_two_poles():
    t = np.arange(0.0, 40.0, 0.05)
    A, B = sampled(*short_period(), 0.05)
    u = 0.1 * np.sin(2.0 * t)[:, None]
    start = np.linalg.solve(np.exp(2j * 0.05) * np.eye(2) - A, 0.1 * B.astype(complex)).imag[:, 0]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u, x0=start)
    y = y + 0.02 * y.std(axis=0) * np.random.default_rng(0).standard_normal(y.shape)
    for method in (*PROJECTIONS, *PREDICTORS):
        with pytest.raises(EstimationError, match="more directions than the order = 2, got 2"):
            identify(
                method,
                [record(0.05, u, y, ("de",), ("alpha", "q"))],
                past_horizon=10,
                future_horizon=10,
                order=2,
                decimate=1,
            )


@pytest.mark.parametrize("method", ["dsr_e", "dsr_e eolo"])
def test_dsr_e_decimates_when_asked(method):
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs(dt)["prbs"]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y + 0.02 * y.std(axis=0) * np.random.default_rng(1).standard_normal(y.shape)
    flown = record(dt, u, y, ("de",), ("alpha", "q"))
    settings = {"past_horizon": 10, "future_horizon": 10, "order": 2}
    for stride in ("auto", 2, 3):
        model = identify(method, [flown], decimate=stride, **settings)
        assert model.diagnostics["decimate"] == (1 if stride == "auto" else stride)
        assert model.dt_s == pytest.approx(dt)
        assert frequency_error(model) < 0.02
        assert np.all(model.diagnostics["output_error_percent"] < 4.0)  # the noise alone is 2 %
    with pytest.raises(EstimationError, match=r"decimate.*must be a valid integer, got 1\.5"):
        identify(method, [flown], decimate=1.5, **settings)
