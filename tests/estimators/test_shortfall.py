"""Errors of short records are as large as the scatter, though the fit took colour out of the residuals."""

import numpy as np
import pytest
from scipy.signal import lfilter

from testbench.estimators.parametric.accuracy import _Felt, coloured_covariance, shortfall
from testbench.estimators.parametric.gauss_newton import Sensitivities
from testbench.estimators.residuals import Autoregression, Colour

STEP_S = 0.04


def regressors(n, waves=((2.0, 3.1), (4.0, 1.7), (0.5, 9.3))):
    t = np.arange(n) * STEP_S
    moved = [lfilter([STEP_S], [1.0, STEP_S * w - 1.0], np.sign(np.sin(2.0 * np.pi * t / q))) for w, q in waves]
    return np.column_stack([np.ones(n), *moved])


def noise(rng, n, tau_s, p=1):
    pole = np.exp(-STEP_S / tau_s) if tau_s else 0.0
    return lfilter([1.0], [1.0, -pole], rng.standard_normal((n + 500, p)), axis=0)[500:]


def fitted(X, e):
    """Return the errors of the estimates, the residuals, their variance and the covariance for white ones."""
    H = np.linalg.pinv(X)
    v = e - X @ (H @ e)
    R = v.T @ v / (len(X) - X.shape[1])
    return H @ e, v, R, np.linalg.inv(X.T @ X) * R[0, 0]


def of(X, v, R, plain):
    return shortfall([v], lambda: [Sensitivities.of_all(X[:, None, :])], R, plain, Colour.of([v]))


def test_white_residuals_have_none():
    X, white = regressors(250), 0
    for seed in range(5):
        _, v, R, plain = fitted(X, noise(np.random.default_rng(seed), 250, 0.0))
        if len(Colour.of([v]).model.A):  # a draw that looks coloured by chance
            assert of(X, v, R, plain).max() < 1.1
        else:
            white += 1
            np.testing.assert_array_equal(of(X, v, R, plain), 1.0)
    assert white >= 3


def test_it_falls_with_the_length_and_vanishes_in_long_records():
    means = []
    for n in (200, 800, 9000):  # 8, 32 and 360 s at a correlation time of 0.5 s
        X = regressors(n)
        found = [of(X, *fitted(X, noise(np.random.default_rng(seed), n, 0.5))[1:]) for seed in range(8)]
        means.append(np.mean(found))
    assert means[0] > 1.4
    assert 1.02 < means[1] < 1.25
    assert means[2] == 1.0


def test_intervals_of_short_coloured_records_hold():
    # 40 records of 10 s, 10 correlation times each. Of 160 intervals 95 % would hold; the four of one record go
    # together, so that 80 independent ones are counted on: of a true 95 % fewer than 88 % hold in 1 % of draws.
    X, rng = regressors(250), np.random.default_rng(5)
    held = {"told": 0, "colour alone": 0}
    for _ in range(40):
        off, v, R, plain = fitted(X, noise(rng, 250, 1.0))
        felt = [Sensitivities.of_all(X[:, None, :])]
        told = np.diag(coloured_covariance([v], lambda f=felt: f, R, plain, np.zeros(4)))
        colour = Colour.of([v]).score(X[:, None, :] / R[0, 0])
        alone = np.diag(plain @ colour @ plain)
        for name, variance in (("told", told), ("colour alone", alone)):
            held[name] += int(np.sum(np.abs(off[:, 0]) < 1.96 * np.sqrt(variance)))
    assert held["told"] <= 0.99 * 160
    assert held["colour alone"] < 0.88 * 160 < held["told"]


def test_a_record_in_two_parts_shares_one_factor_and_its_own_unknowns_count():
    rng = np.random.default_rng(2)
    X = regressors(300)
    own = np.zeros((600, 5))
    own[:300, :3], own[300:, :3] = X[:, 1:], X[:, 1:]
    own[:300, 3], own[300:, 4] = 1.0, 1.0  # a constant of each record
    _, v, R, plain = fitted(own, noise(rng, 600, 0.4))
    parts = [
        Sensitivities(own[:300, None, :4], np.arange(4)),
        Sensitivities(own[300:][:, None, [0, 1, 2, 4]], np.array([0, 1, 2, 4])),
    ]
    residuals = [v[:300], v[300:]]
    split = shortfall(residuals, lambda: parts, R, plain, Colour.of(residuals))
    assert np.all(split > 1.02)
    assert split[3:].min() > split[:3].max()  # what the fit takes of a constant is most of the slow noise


def test_unknowns_on_a_bound_are_left_alone():
    X = regressors(250)
    _, v, R, plain = fitted(X, noise(np.random.default_rng(0), 250, 0.5))
    plain[0], plain[:, 0] = 0.0, 0.0
    found = of(X, v, R, plain)
    assert found[0] == 1.0
    assert np.all(found[1:] > 1.0)


def test_a_prior_is_not_made_wider():
    X = regressors(250)
    _, v, R, plain = fitted(X, noise(np.random.default_rng(0), 250, 0.5))
    tight = np.full(4, 1e3 / np.sqrt(np.diag(plain)).min())
    believed = np.linalg.inv(np.linalg.inv(plain) + np.diag(tight**2))
    felt = [Sensitivities.of_all(X[:, None, :])]
    told = coloured_covariance([v], lambda: felt, R, believed, tight)
    np.testing.assert_allclose(np.diag(told), 1.0 / tight**2, rtol=1e-3)


@pytest.mark.parametrize("order", [0, 2])
def test_the_variances_of_a_colour_are_those_of_its_score(order):
    rng = np.random.default_rng(3)
    A = np.array([[[0.8, 0.1], [0.0, 0.6]], [[-0.1, 0.0], [0.05, 0.1]]])[:order]
    model = Autoregression(A, np.array([[1.0, 0.3], [0.3, 2.0]]))
    J, R = rng.standard_normal((200, 2, 3)), np.array([[2.0, 0.1], [0.1, 1.0]])
    plain = np.linalg.inv(np.einsum("iak,ab,ibl->kl", J, np.linalg.inv(R), J))
    s = Sensitivities.of_all(J)
    score = Colour(model, np.zeros((0, 0, 0))).score(np.linalg.inv(R) @ J)
    mine = _Felt.of(s, np.linalg.inv(R), plain, np.arange(3)).variances(model)
    np.testing.assert_allclose(mine, np.diag(plain @ score @ plain), rtol=1e-9)


@pytest.mark.parametrize("root", [0.99, 0.99997, 1.00003, 1.04])
def test_a_root_as_slow_as_the_record_is_taken_for_chance(root):
    X = regressors(250)
    _, v, R, plain = fitted(X, noise(np.random.default_rng(1), 250, 0.3))
    slow = Colour(Autoregression(np.array([[[root]]]), R), np.zeros((0, 0, 0)))
    found = shortfall([v], lambda: [Sensitivities.of_all(X[:, None, :])], R, plain, slow)
    assert np.all(found >= 1.0)
    assert found.max() < 40.0  # of variances; over a million where a root of 0.99997 is drawn as it is
    damped = slow.model.damped(0.98)
    assert damped.slowest() == pytest.approx(0.98)
    assert slow.model.damped(2.0).slowest() == pytest.approx(root)
