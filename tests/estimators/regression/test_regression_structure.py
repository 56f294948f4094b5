"""Orthogonal functions: the true structure among candidates, decomposition, noise, colour, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from regression_systems import TERMS, TRUTH, motion, noise, signals

from testbench.core.errors import EstimationError
from testbench.estimators.regression import equation_error, orthogonal_functions, polynomial_terms
from testbench.estimators.regression.orthogonal import orthogonal_order

X = motion()
CANDIDATES = polynomial_terms(TERMS, 3)
QUADRATIC = X @ TRUTH[:3] + 60.0 * X[:, 0] ** 2 + TRUTH[3]
STRUCTURE = {*TERMS, "alpha^2"}


def test_exact_data_give_their_structure():
    found = orthogonal_functions(signals(X, QUADRATIC), "qdot", CANDIDATES)
    assert set(found.result.terms) == {*STRUCTURE, "1"}
    truth = dict(zip((*TERMS, "1"), TRUTH, strict=True)) | {"alpha^2": 60.0}
    for term in found.result.terms:
        assert found.result[term] == pytest.approx(truth[term], abs=1e-8)
    assert found.candidates == CANDIDATES


def test_the_structure_is_found_in_noise():
    hits = sum(
        set(orthogonal_functions(signals(X, QUADRATIC + noise(s, len(X), 0.0, 0.01)), "qdot", CANDIDATES).result.terms)
        == {*STRUCTURE, "1"}
        for s in range(20)
    )
    # -2 log of the odds of one more term of 19, in 400 samples: log 400 + 2 log 3 = 8.2, so that the best of 15 false
    # ones enters with a probability of at most 15 x 0.42 % = 6 %: six misses of 20 in 0.1 %.
    assert hits >= 15


def test_coloured_noise_is_not_taken_for_structure():
    right, none = 0, 0
    for seed in range(30):
        coloured = noise(seed, len(X), 0.9, 0.02)
        data = signals(X, X @ TRUTH[:3] + coloured)
        found = orthogonal_functions(data, "qdot", polynomial_terms(TERMS, 2)).result.terms
        right += set(found) == {*TERMS, "1"}
        try:
            orthogonal_functions(signals(X, coloured), "qdot", CANDIDATES)
        except EstimationError as error:
            none += "has the evidence" in str(error)
    # Measured over 150 other records: 128 right, and nothing found in 141 of noise alone. Binomial with 0.85 and 0.94:
    # fewer than 20 of 30 in 0.3 %, fewer than 24 in 0.1 %.
    assert right >= 20
    assert none >= 24


def test_orthogonal_functions_decompose_exactly():
    Z, y = signals(X, QUADRATIC).matrix(CANDIDATES), QUADRATIC + noise(3, len(X), 0.9, 0.02)
    Z, y = Z - Z.mean(axis=0), y - y.mean()
    order, errors = orthogonal_order(Z, y)
    assert order[0] == int(np.argmax((Z.T @ y) ** 2 / np.sum(Z**2, axis=0)))
    # Second way: orthogonal functions by Householder, projected one by one.
    Q = np.linalg.qr(Z[:, order] / np.linalg.norm(Z[:, order], axis=0))[0]
    assert np.allclose(errors, np.r_[y @ y, y @ y - np.cumsum((Q.T @ y) ** 2)], rtol=1e-9)
    assert np.all(np.diff(errors) <= 0.0)


def test_the_result_is_the_regression_on_the_chosen_terms():
    data = signals(X, QUADRATIC + noise(3, len(X), 0.9, 0.02))
    found = orthogonal_functions(data, "qdot", CANDIDATES).result
    same = equation_error(data, "qdot", [t for t in found.terms if t != "1"])
    assert np.array_equal(found.std_corrected, same.std_corrected)


def test_candidates_that_cannot_be_told_apart_are_said():
    tied = X.copy()
    tied[:, 2] = -2.0 * tied[:, 1]
    y = tied @ TRUTH[:3] + noise(5, len(X), 0.0, 0.01)
    found = orthogonal_functions(signals(tied, y), "qdot", TERMS)
    assert len(found.collinear) == 1
    assert found.collinear[0] in ("q", "de")
    assert found.result.status != "good"
    assert any("cannot tell them apart" in sentence for sentence in found.result.advice)


def test_several_records_choose_together():
    parts = [signals(x, x @ TRUTH[:3] + 60 * x[:, 0] ** 2) for x in (X, motion(400, -0.02))]
    assert set(orthogonal_functions(parts, "qdot", CANDIDATES).result.terms) == {*STRUCTURE, "1"}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda d: orthogonal_functions(signals(X, noise(0, len(X), 0.0, 1.0)), "qdot", TERMS), "has the evidence"),
        (lambda d: orthogonal_functions(d, "qdot", []), "at least one term"),
        (lambda d: orthogonal_functions(signals(X, np.ones(len(X))), "qdot", TERMS), "nothing to explain"),
    ],
)
def test_what_cannot_be_searched_is_refused(call, message):
    with pytest.raises(EstimationError, match=message):
        call(signals(X, QUADRATIC + noise(0, len(X), 0.0, 0.02)))
