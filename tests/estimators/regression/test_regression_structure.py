"""Orthogonal functions: the true structure among candidates, decomposition, noise, colour."""

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

from testbench.estimators.regression.global_model import (
    choose,
    columns,
    factors,
    least_squares,
    orthogonal_order,
    polynomial_terms,
)

DT = 0.02
TRUTH = np.array([-8.0, -2.0, -9.0, 0.05])  # of qdot: alpha, q, de, 1
TERMS = ("alpha", "q", "de")
_A = np.array([[-1.2, 0.95, -0.1], [-8.0, -2.0, -9.0], [0.0, 0.0, 0.0]])


def motion(n: int = 600, size: float = 0.03) -> np.ndarray:
    """Return (n, 3) alpha, q, de of a short period of 3 rad/s after an elevator multistep, 50 Hz."""
    t = np.arange(n) * DT
    u = np.zeros(n)
    for start, end, sign in ((0.5, 2, 1), (2, 3, -1), (3, 3.5, 1), (3.5, 4, -1), (6, 7, -1), (7, 8, 1)):
        u[(t >= start) & (t < end)] = sign * size
    u = lfilter([0.2], [1.0, -0.8], u)  # an actuator
    step = expm(_A * DT)
    x = np.zeros((n, 3))
    x[:, 2] = u
    for i in range(n - 1):
        x[i + 1, :2] = step[:2] @ x[i]
    return x


def noise(seed: int, n: int, pole: float, std: float) -> np.ndarray:
    """Return (n,) noise of first order, e(k) = pole e(k - 1) + w(k), of standard deviation ``std``."""
    white = np.random.default_rng(seed).standard_normal(n + 1000)
    return lfilter([1.0], [1.0, -pole], white)[1000:] * np.sqrt(1.0 - pole**2) * std


def part(x: np.ndarray, y: np.ndarray, terms: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a constant, the candidates and the target of one record."""
    return np.ones((len(x), 1)), columns(dict(zip(TERMS, x.T, strict=True)), {}, terms), y


def chosen(x: np.ndarray, y: np.ndarray, terms: tuple[str, ...]) -> set[str]:
    return {terms[i] for i in choose([part(x, y, terms)])}


X = motion()
CANDIDATES = polynomial_terms(TERMS, 3)
QUADRATIC = X @ TRUTH[:3] + 60.0 * X[:, 0] ** 2 + TRUTH[3]
STRUCTURE = {*TERMS, "alpha^2"}


def test_exact_data_give_their_structure():
    assert chosen(X, QUADRATIC, CANDIDATES) == STRUCTURE
    one, Z, y = part(X, QUADRATIC, (*TERMS, "alpha^2"))
    assert np.allclose(least_squares(np.hstack([Z, one]), y)[0], [*TRUTH[:3], 60.0, TRUTH[3]], atol=1e-8)


def test_the_structure_is_found_in_noise():
    hits = sum(chosen(X, QUADRATIC + noise(s, len(X), 0.0, 0.01), CANDIDATES) == STRUCTURE for s in range(20))
    # -2 log of the odds of one more term of 19, in 400 samples: log 400 + 2 log 3 = 8.2, so that the best of 15 false
    # ones enters with a probability of at most 15 x 0.42 % = 6 %: six misses of 20 in 0.1 %.
    assert hits >= 15


def test_coloured_noise_is_not_taken_for_structure():
    right, none = 0, 0
    for seed in range(30):
        coloured = noise(seed, len(X), 0.9, 0.02)
        right += chosen(X, X @ TRUTH[:3] + coloured, polynomial_terms(TERMS, 2)) == {*TERMS}
        none += not chosen(X, coloured, CANDIDATES)
    # Measured over 150 other records: 128 right, and nothing found in 141 of noise alone. Binomial with 0.85 and 0.94:
    # fewer than 20 of 30 in 0.3 %, fewer than 24 in 0.1 %.
    assert right >= 20
    assert none >= 24


def test_orthogonal_functions_decompose_exactly():
    Z, y = part(X, QUADRATIC, CANDIDATES)[1], QUADRATIC + noise(3, len(X), 0.9, 0.02)
    Z, y = Z - Z.mean(axis=0), y - y.mean()
    order, errors = orthogonal_order(Z, y)
    assert order[0] == int(np.argmax((Z.T @ y) ** 2 / np.sum(Z**2, axis=0)))
    # Second way: orthogonal functions by Householder, projected one by one.
    Q = np.linalg.qr(Z[:, order] / np.linalg.norm(Z[:, order], axis=0))[0]
    assert np.allclose(errors, np.r_[y @ y, y @ y - np.cumsum((Q.T @ y) ** 2)], rtol=1e-9)
    assert np.all(np.diff(errors) <= 0.0)


def test_of_candidates_that_cannot_be_told_apart_one_is_chosen():
    tied = X.copy()
    tied[:, 2] = -2.0 * tied[:, 1]
    found = chosen(tied, tied @ TRUTH[:3] + noise(5, len(X), 0.0, 0.01), TERMS)
    assert len(found & {"q", "de"}) == 1


def test_several_records_choose_together():
    parts = [part(x, x @ TRUTH[:3] + 60 * x[:, 0] ** 2, CANDIDATES) for x in (X, motion(400, -0.02))]
    assert {CANDIDATES[i] for i in choose(parts)} == STRUCTURE


def test_terms_are_products_of_powers():
    a, q, de = X.T
    made = part(X, QUADRATIC, ("1", "alpha^2", "alpha*q", "alpha^2*de"))[1]
    assert np.allclose(made, np.column_stack([np.ones(len(X)), a**2, a * q, a**2 * de]))
    assert factors("alpha^2*de") == (("alpha", 2), ("de", 1))
    assert polynomial_terms(["a", "b"], 2) == ("a", "b", "a^2", "a*b", "b^2")
    assert len(polynomial_terms(["a", "b", "c"], 3)) == 19  # C(6, 3) - 1
