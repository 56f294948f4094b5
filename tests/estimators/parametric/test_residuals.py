"""Colour of residuals: autoregressions, the covariance of a score, and the test for whiteness."""

import numpy as np
import pytest
from scipy.signal import lfilter

from testbench.estimators.residuals import (
    autocovariance,
    autoregression,
    coloured_information,
    corrected_covariance,
    ljung_box,
)

A1 = np.array([[0.8, 0.1], [-0.2, 0.6]])
S = np.array([[1.0, 0.3], [0.3, 2.0]])


def coloured(samples: int, seed: int) -> np.ndarray:
    e = np.random.default_rng(seed).multivariate_normal([0.0, 0.0], S, samples + 200)
    v = np.zeros_like(e)
    for i in range(1, len(e)):
        v[i] = A1 @ v[i - 1] + e[i]
    return v[200:]


def stationary() -> np.ndarray:
    return np.linalg.solve(np.eye(4) - np.kron(A1, A1), S.ravel()).reshape(2, 2)


def exact_score(W: np.ndarray) -> np.ndarray:
    """sum_i sum_j W[i]' E[v_i v_j'] W[j], written out."""
    N, P = len(W), stationary()
    powers = [P]
    for _ in range(N - 1):
        powers.append(powers[-1] @ A1.T)  # E[v_i v_(i+k)']
    out = np.zeros((W.shape[2], W.shape[2]))
    for i in range(N):
        for j in range(N):
            R = powers[j - i] if j >= i else powers[i - j].T
            out += W[i].T @ R @ W[j]
    return out


def weights(samples: int) -> np.ndarray:
    t = np.linspace(0.0, 1.0, samples)[:, None, None]
    return np.concatenate([np.sin(9.0 * t) * [[1.0], [0.5]], np.exp(-3.0 * t) * [[0.2], [1.0]]], axis=2)


def test_autocovariance_is_the_sum_over_pairs():
    v = coloured(50, 0)
    R = autocovariance(v, 3)
    for k in range(4):
        assert R[k] == pytest.approx(sum(np.outer(v[i], v[i + k]) for i in range(50 - k)) / 50)


def test_an_autoregression_is_recovered_from_records_of_different_length():
    model = autoregression([coloured(20000, 1), coloured(10000, 2)])
    assert len(model.A) == 1
    # standard errors of the coefficients below 0.007, of the covariance below 0.02: six of them
    assert model.A[0] == pytest.approx(A1, abs=0.04)
    assert np.abs(model.S - S).max() < 0.12


def test_white_residuals_give_the_information_matrix():
    rng = np.random.default_rng(3)
    v = rng.multivariate_normal([0.0, 0.0], S, 600)
    assert len(autoregression([v]).A) == 0
    W = weights(600)
    plain = np.einsum("iak,ab,ibl->kl", W, v.T @ v / 600, W)
    assert coloured_information([W], [v]) == pytest.approx(plain, rel=0.02)  # 20 samples of 600 serve as past


def test_score_of_coloured_residuals_is_the_double_sum():
    W, v = weights(150), coloured(20000, 4)
    long = [np.concatenate([W, np.zeros((len(v) - 150, 2, 2))])]
    found = coloured_information(long, [v])
    # coefficients known to 0.7 % of one: (1 - 0.8)^-2 of that in the spectrum at rest
    assert found == pytest.approx(exact_score(W), rel=0.15, abs=0.02 * np.abs(found).max())


def test_gaps_do_not_pass_for_whiteness():
    N = 20000
    W, v = np.concatenate([weights(150), np.zeros((N - 150, 2, 2))]), coloured(N, 5)
    mask = np.random.default_rng(6).random((N, 2)) > 0.3
    W = W * mask[:, :, None]
    found = coloured_information([W], [v * mask])
    assert found == pytest.approx(exact_score(W[:150]), rel=0.15, abs=0.02 * np.abs(found).max())


def test_units_do_not_matter():
    W, v = weights(500), coloured(500, 7)
    scale = np.array([1e-6, 1e3])
    one = coloured_information([W], [v])
    other = coloured_information([W / scale[:, None]], [v * scale])
    assert other == pytest.approx(one, rel=1e-6)
    plain = np.array([[2.0, 0.5], [0.5, 1.0]])
    factor = np.outer([1e-8, 1e5], [1e-8, 1e5])
    corrected = corrected_covariance(plain * factor, one / factor)
    assert corrected == pytest.approx(factor * corrected_covariance(plain, one), rel=1e-9)


def test_rows_of_no_variance_stay_zero():
    plain = np.diag([1.0, 0.0])
    assert corrected_covariance(plain, np.ones((2, 2))).tolist() == [[1.0, 0.0], [0.0, 0.0]]


def test_residuals_without_noise_have_no_score():
    W = weights(100)
    assert np.abs(coloured_information([W], [np.zeros((100, 2))])).max() == 0.0


def test_whiteness_test_keeps_its_level_and_finds_colour():
    rng = np.random.default_rng(8)
    p = np.array([ljung_box(rng.standard_normal(300), 20) for _ in range(400)])
    # binomial: 5 % of 400 scatters by 1.1 %; four of them, and the approximation of finite samples
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.05)
    assert ljung_box(lfilter([1.0], [1.0, -0.5], rng.standard_normal(300)), 20) < 1e-6
    assert ljung_box(np.zeros(50), 5) == 1.0
