"""What mends a fit is tried: a servo, gusts; and nothing where nothing is wanting."""

from dataclasses import replace

import numpy as np
import pytest
from test_considered import record

import testbench as tb
from testbench.estimators.settings import OutputErrorEntry
from testbench.inference.remedies import Rival, evidence, mended, mixed, wanting
from testbench.sensors.sensor import first_order_lag

ENTRY = OutputErrorEntry(method="output_error", structure="short_period")


def asked(flown, gusts=True, entry=ENTRY):
    def fit(other):
        return tb.estimate(other, [flown], ["de"], ["alpha", "q"])

    return mended(entry, fit(entry), [flown], fit, gusts)[:3]


def test_a_fit_that_leaves_white_noise_is_left_as_it_is():
    entry, model, tried = asked(record())
    assert entry is ENTRY
    assert not wanting(model)
    assert tried == ()


def test_a_servo_that_was_not_told_is_found_and_the_derivatives_with_it():
    lag, flown = 0.12, record(lag_s=0.12)
    plain = tb.estimate(ENTRY, [flown], ["de"], ["alpha", "q"])
    _, model, tried = asked(flown)
    assert wanting(plain)
    assert [t.name for t in tried if t.taken] == ["a lag behind de"]
    assert model.values["tau_de"] == pytest.approx(lag, abs=0.02)
    assert model.values["M_alpha"] == pytest.approx(-12.0, rel=0.05)
    assert abs(plain.values["M_alpha"] + 12.0) > 2.0 * abs(model.values["M_alpha"] + 12.0)


@pytest.mark.slow
def test_gusts_are_no_cure_where_kinematics_show_none():
    rng = np.random.default_rng(8)
    flown = record()
    gust = np.zeros(len(flown))
    for k in range(1, len(flown)):
        gust[k] = 0.95 * gust[k - 1] + 1e-3 * rng.standard_normal()
    q = first_order_lag(gust, flown.dt_s, 0.2) * 8.0
    flown = flown.with_columns({"alpha": flown["alpha"] + gust, "q": flown["q"] - q})
    _, _, tried = asked(flown, gusts=False)
    assert all("gusts" not in t.name for t in tried)
    entry, model, tried = asked(flown)
    assert [t.name for t in tried if t.taken][-1:] == ["gusts"]
    assert entry.method == model.method == "filter_error"
    assert evidence(model, 2 * len(flown)) > evidence(
        tb.estimate(ENTRY, [flown], ["de"], ["alpha", "q"]), 2 * len(flown)
    )


def test_a_lag_that_changes_places_with_the_mode_is_a_rival_that_widens_the_errors():
    # A fast aircraft behind a slow servo looks like a slow aircraft; the clock of the elevator is not known either.
    true = {"M_alpha": -120.0, "M_q": -40.0, "M_de": -240.0}
    flown = record(lag_s=0.12, noise=4.0, moments=tuple(true.values()))
    entry = ENTRY.model_copy(update={"late_std_s": {"de": 0.05}})

    def fit(other):
        return tb.estimate(other, [flown], ["de"], ["alpha", "q"])

    plain = fit(entry)
    _, model, _, rivals = mended(entry, plain, [flown], fit, False)
    errors = mixed(model, rivals).standard_errors
    off = {n: abs(plain.values[n] - v) / plain.standard_errors[n] for n, v in true.items()}
    assert not wanting(plain)
    assert max(off.values()) > 100.0
    assert max(abs(model.values[n] - v) / errors[n] for n, v in true.items()) < 2.5


def test_a_mixture_has_the_spread_of_its_models_and_says_what_they_would_be():
    model = tb.estimate(ENTRY, [record()], ["de"], ["alpha", "q"])
    moved = replace(model, params=model.params + 5.0 * np.sqrt(np.diag(model.covariance)))
    both = mixed(model, [Rival("a lag behind de", 0.2, moved)])
    assert both.standard_errors["M_q"] == pytest.approx(np.sqrt(1.0 + 0.2 * 25.0) * model.standard_errors["M_q"])
    assert both.values == model.values
    assert next(a.code for a in both.advice) == "rival_model"
    few = mixed(model, [Rival("a lag behind de", 0.01, moved)])
    assert [a.code for a in few.advice] == [a.code for a in model.advice]


def gusted(rms_rad, seed):
    """Return a flight in which a slow gust turns the flow, in noise of a vane that hides it."""
    rng, calm = np.random.default_rng(seed), record(seed=seed)
    x, gust, n = np.zeros(2), 0.0, len(calm)
    moved, a = np.zeros((n, 2)), np.exp(-0.5 * calm.dt_s)
    for k in range(n):
        moved[k] = x + np.array([gust, 0.0])  # the vane feels it
        forced = np.array([-2.0 * (x[0] + gust) + 0.97 * x[1], -12.0 * (x[0] + gust) - 6.0 * x[1]])
        x = x + calm.dt_s * forced
        gust = a * gust + rms_rad * np.sqrt(1.0 - a**2) * rng.standard_normal()
    return calm.with_columns({"alpha": calm["alpha"] + moved[:, 0], "q": calm["q"] + moved[:, 1]})


@pytest.mark.parametrize("gusts", [None, True])
def test_light_gusts_are_found_in_residuals_that_look_white(gusts):
    flown = gusted(4e-4, 5)
    assert not wanting(tb.estimate(ENTRY, [flown], ["de"], ["alpha", "q"]))
    entry, model, tried = asked(flown, gusts)
    assert entry.method == model.method == "filter_error"
    assert [t.name for t in tried if t.taken] == ["gusts"]
    assert asked(flown, False)[0] is ENTRY, "kinematics show that there are none"


def test_no_gusts_are_found_in_calm_air():
    # By chance 2 ln L exceeds 2 * 4.4 + ln 1200 = 16, of size and bandwidth of a gust: in 2e-4 of flights.
    for seed in (3, 4):
        entry, _, tried = asked(record(seed=seed), None)
        assert entry is ENTRY
        assert tried == ()
