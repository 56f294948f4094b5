"""What explains a manoeuvre is told as it is flown: sums against dense covariances, faults by name, no false ones."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import cont2discrete
from scipy.stats import multivariate_normal

from testbench.estimators.parametric.kalman.innovations import sampled_noise
from testbench.inference.multiple_models import P_FAULT, Bank, Watched, _steady, in_quiet_flight

DT, NOISE, QUIET = 0.02, 0.003, 250
BELIEVED = np.array([-2.0, -15.0, -3.0, -20.0])
"""Z_alpha / V, M_alpha, M_q, M_de of a small aircraft, 1/s and 1/s2; each is known to 10 %."""
TURBULENCE_M_S = (0.03, 0.3, 1.2)


def steps(params, rms=0.0):
    Z, M_alpha, M_q, M_de = params
    F, G = np.array([[Z, 1.0], [M_alpha, M_q]]), np.array([[-0.1], [M_de]])
    white = np.sqrt([2.0 * rms**2 / (100.0 * 20.0), (0.02 * rms) ** 2])
    return *cont2discrete((F, G, np.eye(2), np.zeros((2, 1))), DT)[:2], sampled_noise(F, white, DT)[1]


@cache
def bank():
    each = [steps(BELIEVED), *(steps(BELIEVED + 0.1 * BELIEVED * (np.arange(4) == k)) for k in range(4))]
    A, B = (np.array([one[k] for one in each]) for k in range(2))
    gusts = np.array([steps(BELIEVED, rms)[2] for rms in TURBULENCE_M_S])
    return Bank(A, B, (0, 1), np.full(2, NOISE), np.full(2, 0.01), gusts, (0, 1), (0,), DT, np.zeros(1), np.zeros(2))


def flight(seed, gain=1.0, late_s=0.0, q=1.0, tail=1.0, rms=0.3):
    """A 3-2-1-1 of an aircraft within what is known, after five seconds of quiet flight."""
    rng = np.random.default_rng(seed)
    params = BELIEVED * (1.0 + 0.1 * rng.standard_normal(4)) * np.array([1.0, tail, 1.0, 1.0])
    t = np.arange(QUIET + 400) * DT

    def multistep(t):
        at = ((5.0, 5.9, 1.0), (5.9, 6.5, -1.0), (6.5, 6.8, 1.0), (6.8, 7.1, -1.0))
        return 0.05 * sum(size * ((t >= begin) & (t < end)) for begin, end, size in at)

    A, B, Q = steps(params, rms)
    root, acts, x = np.linalg.cholesky(Q), gain * multistep(t - late_s), np.zeros((t.size, 2))
    for k in range(1, t.size):
        x[k] = A @ x[k - 1] + B[:, 0] * 0.5 * (acts[k] + acts[k - 1]) + root @ rng.standard_normal(2)
    return multistep(t)[:, None], x * np.array([1.0, q]) + NOISE * rng.standard_normal(x.shape)


def watched(seed, seconds=8.0, **fault):
    u, y = flight(seed, **fault)
    watch, least, begin = Watched(bank()), 1.0, 0
    for end in range(25, QUIET + round(seconds / DT) + 1, 25):
        watch.take(u[begin:end], y[begin:end], np.ones((end - begin, 2), bool))
        begin = end
        if end > QUIET:
            least = min(least, watch.weigh()[0].probability)
    return watch, least


def test_probabilities_are_those_of_the_covariance_of_all_samples(monkeypatch):
    kept = []
    add = Watched._add
    monkeypatch.setattr(Watched, "_add", lambda self, left, own: (kept.append((left, own)), add(self, left, own)))
    u, y = flight(3)
    watch = Watched(bank())
    watch.take(u[:320], y[:320], np.ones((320, 2), bool))
    ((left, own),) = kept
    for gust, scale in ((0, 1.0), (2, 0.5**0.5)):
        white = left[:, :, :, gust, 0].transpose(1, 0, 2).reshape(5, -1)
        E = own[:, gust, 0].transpose(2, 0, 1).reshape(own.shape[4], -1)
        columns = np.vstack([white[1:] - white[0], E[1:] * watch._std[5:, None]])  # without the control's effect
        dense = scale**2 * np.eye(white.shape[1]) + columns.T @ columns
        told, _ = watch._solved(scale, slice(1))
        expected = multivariate_normal.logpdf(white[0], cov=dense) + watch._log_det[gust, 0]
        assert told[gust, 0] + 0.5 * 638 * np.log(0.5 / np.pi) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("fault", "kind", "value"),
    [
        ({"gain": -1.0}, "gain", -1.0),
        ({"gain": 0.5}, "gain", 0.5),
        ({"late_s": 0.25}, "late", 0.25),
        ({"q": -1.0}, "reads", -1.0),
        ({"tail": 0.3}, "other", 0.0),
    ],
)
def test_a_fault_is_named_within_three_seconds(fault, kind, value):
    for seed in (1, 2):
        watch, least = watched(seed, 3.0, **fault)
        assert least < 0.01
        found = max(watch.weigh(), key=lambda w: w.probability)
        assert found.kind == kind
        assert found.value == pytest.approx(value, abs=max(0.1, 3.0 * found.std))


@pytest.mark.parametrize("flights", [6, pytest.param(20, marks=pytest.mark.slow)])
def test_flights_within_what_is_known_are_answered_as_believed(flights):
    # The chance that p(believed) ever falls below 0.01 is 0.01 / 0.95 a flight at most: two of 6 in 2 of 1000, and of
    # 20, none in four of five.
    least = [watched(seed, rms=TURBULENCE_M_S[seed % 3])[1] for seed in range(100, 100 + flights)]
    assert sum(p < 0.01 for p in least) <= 1
    assert np.median(least) > 0.8


def test_a_run_narrows_what_is_known_about_the_truth():
    mean, covariance = watched(5)[0].learnt()
    true = np.random.default_rng(5).standard_normal(4)
    assert np.all(np.sqrt(np.diag(covariance)) < 1.0)
    assert np.sqrt(covariance[3, 3]) < 0.6  # the effect of the control
    assert (mean - true) @ np.linalg.solve(covariance, mean - true) < 18.5  # chi-square of 4, p = 0.001


def test_samples_that_are_lost_do_not_count():
    u, y = flight(1)
    valid = np.ones((len(u), 2), bool)
    valid[::3, 1] = False
    lost = np.where(valid, y, 1e9)
    some, none = Watched(bank()), Watched(bank())
    some.take(u, np.where(valid, y, 0.0), valid)
    none.take(u, lost, valid)
    assert [w.probability for w in none.weigh()] == [w.probability for w in some.weigh()]


def test_steps_hold_the_noise_of_their_length():
    A, B, Q = steps(BELIEVED, 0.5)
    F, white = np.array([[-2.0, 1.0], [-15.0, -3.0]]), np.diag([2.0 * 0.25 / 2000.0, 0.0001])
    inner = np.linspace(0.0, DT, 2001)
    summed = np.trapezoid([expm(F * s) @ white @ expm(F * s).T for s in inner], inner, axis=0)
    assert pytest.approx(summed, rel=1e-6) == Q
    assert pytest.approx(expm(F * DT), rel=1e-12) == A
    assert pytest.approx(np.linalg.solve(F, (expm(F * DT) - np.eye(2)) @ [[-0.1], [-20.0]])) == B


def test_steady_filters_are_those_of_the_riccati_equation():
    rng = np.random.default_rng(4)
    A, C = steps(BELIEVED)[0], np.array([[0.0, 1.0]])
    Q = np.array([10.0**e * np.cov(rng.standard_normal((2, 5))) for e in (-12, -8, -4)])
    R = np.array([[[10.0**e]] for e in (-5, -7, -4)])
    found = _steady(A, C, Q, R)
    for P, q, r in zip(found, Q, R, strict=True):
        assert pytest.approx(solve_discrete_are(A.T, C.T, q, r), rel=1e-8) == P
        K = P @ C.T / (C @ P @ C.T + r)
        assert np.abs(A @ (P - K @ C @ P) @ A.T + q - P).max() < 1e-13 * np.abs(P).max()


def test_the_air_is_told_by_quiet_flight():
    gusts = np.array([steps(BELIEVED, rms)[2] for rms in TURBULENCE_M_S])
    for k, rms in enumerate(TURBULENCE_M_S):
        u, y = flight(7, rms=rms)
        turned = (u @ bank().B[0].T)[:QUIET]
        told = in_quiet_flight(bank().A[0], (0, 1), np.full((3, 2), NOISE), gusts, turned, y[:QUIET])
        assert int(np.argmax(told)) == k


def test_quiet_flight_does_not_tell_which_aircraft_flies():
    u, y = flight(3, rms=1.0)
    watch = Watched(bank(), QUIET)
    watch.take(u[: QUIET - 10], y[: QUIET - 10], np.ones((QUIET - 10, 2), bool))
    believed, other = (next(w.probability for w in watch.weigh() if w.kind == kind) for kind in ("believed", "other"))
    assert other / believed == pytest.approx((P_FAULT / 4.0) / (1.0 - P_FAULT), rel=1e-6)
