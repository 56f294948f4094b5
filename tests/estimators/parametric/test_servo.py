"""Servos between commands and surfaces: known, estimated, limited in rate, delayed; and what they refuse."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.servo import behind_servos, surfaces
from testbench.estimators.parametric.structures import short_period
from testbench.estimators.structured import Servo

TRUE = {"Z_alpha": -2.0, "M_alpha": -12.0, "M_q": -6.0, "M_de": -20.0}
A, B = np.array([[-2.0, 1.0], [-12.0, -6.0]]), np.array([-0.15, -20.0])
FINE, RATE, LENGTH = 1000, 50, 20.0
NOISE = (0.002, 0.004)


@cache
def motion(lag: float, delay: float, limit_deg_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Command and (alpha, q) at the samples, flown in steps of 1 ms behind a servo."""
    t = np.arange(round(LENGTH * FINE)) / FINE
    u, start, sign = np.zeros(t.size), 2.0, 1.0
    for n in (3, 2, 1, 1) * 4:
        u[(t >= start - 1e-9) & (t < start + 0.3 * n - 1e-9)] = 0.06 * sign
        start, sign = start + 0.3 * n, -sign
    late = np.r_[np.zeros(round(delay * FINE)), u][: t.size]
    M = np.zeros((3, 3))
    M[:2, :2], M[:2, 2] = A, B
    E = expm(M / FINE)
    x, delta, out = np.zeros(2), 0.0, np.zeros((t.size, 2))
    most = np.radians(limit_deg_s) / FINE if limit_deg_s else np.inf
    for k in range(t.size):
        out[k] = x
        new = delta + np.clip((late[k] - delta) * (1.0 - np.exp(-1.0 / FINE / lag)), -most, most)
        x = E[:2, :2] @ x + E[:2, 2] * 0.5 * (delta + new)
        delta = new
    return u[:: FINE // RATE], out[:: FINE // RATE]


def flight(lag: float, delay: float = 0.0, limit: float = 0.0, seed: int = 0) -> FlightRecord:
    u, x = motion(lag, delay, limit)
    y = x + np.array(NOISE) * np.random.default_rng(seed).standard_normal(x.shape)
    return FlightRecord(np.arange(len(u)) / RATE, ("de_cmd", "alpha", "q"), np.column_stack([u, y]), "measured")


def fitted(method: str, record: FlightRecord, **servo):
    settings = {"servo": {"de_cmd": servo}} if servo else {}
    return estimate(method, [record], ["de_cmd"], ["alpha", "q"], structure="short_period", **settings)


def errors(model, **more: float) -> dict[str, float]:
    """Deviation from the truth in standard errors."""
    return {n: abs(model.values[n] - v) / model.standard_errors[n] for n, v in {**TRUE, **more}.items()}


CASES = [(0.05, 0.0, 0.0), (0.1, 0.0, 0.0), (0.05, 0.05, 0.0), (0.05, 0.0, 60.0)]
DEAR = pytest.mark.slow  # seconds each; the first case and equation error's have all of it


def described(lag, delay, limit: float) -> dict:
    return {"lag_s": lag, "delay_s": delay} | ({"rate_limit_deg_s": limit} if limit else {})


@pytest.mark.parametrize(
    ("method", "lag", "delay", "limit"),
    [
        *(("output_error", *case) for case in CASES),
        *(pytest.param("filter_error", *case, marks=DEAR) for case in CASES),
    ],
)
def test_a_known_servo_gives_the_derivatives_within_their_errors(method, lag, delay, limit):
    # 4 derivatives beyond 4 of their errors by chance: 3e-4 per case
    model = fitted(method, flight(lag, delay, limit), **described(lag, delay, limit))
    assert max(errors(model).values()) < 4.0


@pytest.mark.parametrize(("lag", "delay", "limit"), CASES)
def test_equation_error_takes_the_surface_that_a_known_servo_makes(lag, delay, limit):
    model = fitted("equation_error", flight(lag, delay, limit), **described(lag, delay, limit))
    for name, value in TRUE.items():  # noise biases equation error by a few percent
        assert model.values[name] == pytest.approx(value, rel=0.05), name
    assert model.inputs == ("de_cmd",)
    assert model.values["tau_de"] == lag


@pytest.mark.parametrize(("lag", "delay", "limit"), [*CASES[:3], pytest.param(*CASES[3], marks=DEAR)])
def test_output_error_estimates_the_lag_within_its_error(lag, delay, limit):
    model = fitted("output_error", flight(lag, delay, limit), **described("estimate", delay, limit))
    assert max(errors(model, tau_de=lag).values()) < 4.0


def test_filter_error_estimates_the_lag_and_shakes_no_servo():
    model = fitted("filter_error", flight(0.1), lag_s="estimate")
    assert max(errors(model, tau_de=0.1).values()) < 4.0
    assert set(model.settings["process_noise"]) <= {"alpha", "q"}


@pytest.mark.slow
def test_intervals_of_an_estimated_lag_cover_over_seeds():
    # 5 x 30 correlated intervals of 95 %: were they 40 independent ones, 4 standard deviations would be 14 %
    held = [list(errors(fitted("output_error", flight(0.1, seed=s), lag_s="estimate"), tau_de=0.1).values())
            for s in range(30)]  # fmt: skip
    assert np.mean(np.array(held) < 1.96) > 0.95 - 0.14


def test_an_unknown_delay_is_told_from_the_lag():
    model = fitted("output_error", flight(0.05, 0.05), lag_s="estimate", delay_s="estimate")
    assert max(errors(model, tau_de=0.05, T_de=0.05).values()) < 4.0


def test_without_a_servo_the_damping_is_lost():
    assert errors(fitted("output_error", flight(0.1)))["M_q"] > 10.0


def test_a_second_order_servo_is_the_chain_of_its_lags():
    u, tau = np.zeros((200, 1)), 0.05
    u[10:60] = 0.1
    twice = behind_servos(short_period(control="de_cmd"), {"de_cmd": Servo(wn_rad_s=1.0 / tau, zeta=1.0)})
    once = behind_servos(short_period(control="de_cmd"), {"de_cmd": Servo(lag_s=tau)})
    t = np.arange(200) * 0.02
    record = FlightRecord(t, ("de_cmd",), u, "measured")
    found = surfaces(twice, record, np.array([True]))["de_cmd"]
    s = np.maximum(t - 0.2, 0.0) / tau
    expected = np.where(t < 1.2, 0.1 * (1.0 - (1.0 + s) * np.exp(-s)), np.nan)
    assert np.nanmax(np.abs(found - expected)) < 1e-12
    single = surfaces(once, record, np.array([True]))["de_cmd"]
    assert np.max(np.abs(single[:60] - 0.1 * (1.0 - np.exp(-s[:60])))) < 1e-12


def made(record: FlightRecord, **servo) -> np.ndarray:
    """Return the surface that a servo makes of a held command."""
    structure = behind_servos(short_period(control="de_cmd"), {"de_cmd": Servo(**servo)})
    return surfaces(structure, record, np.array([True]))["de_cmd"]


def test_a_rate_limit_is_never_passed_and_matters_only_when_reached():
    u = np.zeros((200, 1))
    u[10:100] = 0.2
    record = FlightRecord(np.arange(200) * 0.02, ("de_cmd",), u, "measured")
    slow = made(record, lag_s=0.05, rate_limit_deg_s=30.0)
    assert np.max(np.abs(np.diff(slow))) <= np.radians(30.0) * 0.02 * (1.0 + 1e-9)
    assert slow[99] == pytest.approx(0.2, abs=1e-3)
    free, hardly = made(record, lag_s=0.05), made(record, lag_s=0.05, rate_limit_deg_s=1e5)
    assert np.max(np.abs(hardly - free)) < 1e-6


def test_linear_and_general_structures_behind_servos_agree():
    linear, general = (
        behind_servos(short_period(control="de_cmd"), {"de_cmd": Servo(lag_s=0.06, delay_s="estimate", **limit)})
        for limit in ({}, {"rate_limit_deg_s": 1e6})
    )
    u = 0.05 * np.sin(np.arange(150) * 0.1)[:, None]
    x0 = np.zeros(len(linear.states))
    free = np.flatnonzero(linear.free).tolist()
    a, b = (respond(s, s.values, free, u, Sampling(0.02, np.array([False]), 40), x0) for s in (linear, general))
    assert np.max(np.abs(a.y - b.y)) < 1e-7 * np.max(np.abs(a.y))
    assert np.max(np.abs(a.dparams - b.dparams)) < 1e-5 * np.max(np.abs(a.dparams))


@pytest.mark.parametrize(
    ("method", "servo", "message"),
    [
        ("equation_error", {"lag_s": "estimate"}, "needs a known servo of 'de_cmd'"),
        ("ekf", {"lag_s": "estimate"}, "let output_error or filter_error"),
        ("filter_error", {"lag_s": "estimate", "rate_limit_deg_s": 60.0}, "with its rate limit; give"),
        ("output_error", {"rate_limit_deg_s": 60.0}, "goes with lag_s"),
        ("output_error", {"lag_s": 0.1, "wn_rad_s": 20.0, "zeta": 0.7}, "got both"),
        ("output_error", {"wn_rad_s": 20.0}, "go together"),
        ("output_error", {"ignore": False}, "needs lag_s"),
        ("output_error", {"lag_s": 0.1, "ignore": True}, "ignore = true and none"),
    ],
)
def test_servos_that_cannot_be_are_refused(method, servo, message):
    with pytest.raises(EstimationError, match=message):
        fitted(method, flight(0.05), **servo)


def test_a_servo_of_no_input_and_a_delay_given_twice_are_refused():
    with pytest.raises(EstimationError, match="got 'da_cmd'"):
        estimate("output_error", [flight(0.05)], ["de_cmd"], ["alpha", "q"], structure="short_period",
                 servo={"da_cmd": {"lag_s": 0.1}})  # fmt: skip
    with pytest.raises(EstimationError, match="give it once"):
        estimate("output_error", [flight(0.05)], ["de_cmd"], ["alpha", "q"], structure="short_period",
                 delays_s={"de_cmd": 0.1}, servo={"de_cmd": {"lag_s": 0.1, "delay_s": 0.1}})  # fmt: skip


def test_a_delay_that_does_not_show_spoils_no_other_estimate():
    model = fitted("output_error", flight(0.1, seed=3), lag_s="estimate", delay_s="estimate")
    assert model.values["T_de"] == pytest.approx(0.002)  # the least that is sought
    assert model.status != "wrong"
    assert model.diagnostics["at_bound"] == []
    assert "none_shows" in [a.code for a in model.advice]
    assert max(errors(model, tau_de=0.1, T_de=0.0).values()) < 4.0
