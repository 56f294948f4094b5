"""Errors of instruments in the errors of derivatives: the gain against identifying again, and known cases."""

import numpy as np
import pytest

import testbench as tb
from testbench.core.errors import EstimationError
from testbench.inference.considered import considered
from testbench.inference.instruments import Agreement, without_errors
from testbench.sensors.sensor import first_order_lag

RATE = 50.0


def record(late_s=0.0, seed=3, noise=1.0, lag_s=0.0, moments=(-12.0, -6.0, -20.0)):
    """Return 12 s of a short period, a 3-2-1-1 that acts ``late_s`` after what is logged, and behind a lag."""
    n, fine = round(12.0 * RATE), 20
    t, rng = np.arange(n) / RATE, np.random.default_rng(seed)
    dense = np.arange(n * fine) / RATE / fine
    u = np.zeros(n * fine)
    for at, width, sign in ((2.0, 0.9, 1), (2.9, 0.6, -1), (3.5, 0.3, 1), (3.8, 0.3, -1)):
        u[(dense >= at) & (dense < at + width)] = 0.03 * sign
    u = np.convolve(u, np.ones(2 * fine) / (2 * fine), mode="same")
    x, y = np.zeros(2), np.zeros((n, 2))
    acting = np.interp(dense - late_s, dense, first_order_lag(u, 1.0 / RATE / fine, lag_s) if lag_s else u)
    for k in range(n * fine):
        if k % fine == 0:
            y[k // fine] = x
        a, q = x
        turned = np.dot(moments, [a, q, acting[k]])
        x = x + np.array([-2.0 * a + 0.97 * q - 0.2 * acting[k], turned]) / RATE / fine
    y += noise * np.array([5e-4, 1e-3]) * rng.standard_normal(y.shape)
    return tb.FlightRecord(t, ("alpha", "q", "de"), np.column_stack([y, u[::fine]]), "measured")


def fitted(flown, **settings):
    return tb.estimate("output_error", [flown], ["de"], ["alpha", "q"], structure="short_period", **settings)


@pytest.mark.parametrize("error", ["alpha_scale", "q_scale", "de_scale", "q_late", "de_late"])
def test_the_gain_is_what_identifying_again_gives(error):
    flown = record()
    model = fitted(flown)
    found = considered(model, [flown], Agreement(), {}, {})
    size = 5e-4
    again = fitted(without_errors(flown, {error: -size}))
    gain = found.gain[:, found.errors.index(error)]
    free = model.structure.free
    scale = np.sqrt(np.diag(model.covariance))[free]
    # A clock is moved by interpolation, which smooths the noise of q by 5 % and gives it another weight: 0.15 errors.
    assert (again.params - model.params)[free] / scale == pytest.approx(size * gain[free] / scale, rel=0.1, abs=0.15)


def test_a_scale_of_the_vane_moves_stiffness_by_as_much():
    flown = record()
    found = considered(fitted(flown), [flown], Agreement(), {}, {})
    at = [p.name for p in fitted(flown).structure.parameters].index("M_alpha")
    assert found.gain[at, found.errors.index("alpha_scale")] == pytest.approx(12.0, rel=0.05)


def test_known_instruments_add_as_little_as_they_err():
    flown = record()
    model = fitted(flown)
    usual = considered(model, [flown], Agreement(), {}, {}).parameters_covariance
    names = [f"{c}_{kind}" for c in ("alpha", "q", "de") for kind in ("scale", "late")]
    exact = considered(model, [flown], Agreement(), {}, dict.fromkeys(names, 1e-5)).parameters_covariance
    free = model.structure.free
    assert np.all(np.diag(exact)[free] < 1e-4 * np.diag(usual)[free])


@pytest.mark.parametrize("late_s", [-0.03, 0.0, 0.045])
def test_how_late_an_input_acts_is_found_and_the_derivatives_with_it(late_s):
    model = fitted(record(late_s), late_std_s={"de": 0.05})
    (late,), (std,) = model.diagnostics["lateness_s"], model.diagnostics["lateness_std_s"]
    assert abs(late["de"] - late_s) < 4.0 * std["de"] + 5e-4  # interpolation between samples; by chance 6e-5
    for name, value in {"M_alpha": -12.0, "M_q": -6.0, "M_de": -20.0}.items():
        assert abs(model.values[name] - value) < 4.0 * model.standard_errors[name] + 0.01 * abs(value), name


def test_lateness_belongs_to_an_input_and_is_no_delay_of_the_noise():
    with pytest.raises(EstimationError, match="lateness belongs to an input"):
        fitted(record(), late_std_s={"da": 0.05})
    model = fitted(record(noise=0.01, late_s=0.03), late_std_s={"de": 1e-4})
    assert abs(model.diagnostics["lateness_s"][0]["de"]) < 0.02  # a prior that is narrow holds against the data
