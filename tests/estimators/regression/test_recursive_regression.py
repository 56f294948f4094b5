"""Recursive regression: its end is the batch result, it follows a change, and it says what it does not know yet."""

from __future__ import annotations

import numpy as np
import pytest
from regression_systems import DT, TERMS, TRUTH, motion, noise, signals

from testbench.core.errors import EstimationError
from testbench.estimators.regression import (
    equation_error,
    frequency_equation_error,
    recursive_frequency,
    recursive_least_squares,
)

X = motion()
QDOT = X @ TRUTH[:3] + TRUTH[3]
BAND = (0.1, 1.5)


@pytest.mark.parametrize("bias", [True, False])
def test_without_forgetting_the_end_is_the_batch_result(bias):
    valid = np.ones((len(X), 4), bool)
    valid[200:230, 0] = False
    data = signals(X, QDOT + noise(0, len(X), 0.9, 0.02), valid)
    batch = equation_error(data, "qdot", TERMS, bias=bias)
    found = recursive_least_squares(data, "qdot", TERMS, bias=bias)
    assert found.t_s[-1] == data.t_s[-1]
    assert np.allclose(found.params[-1], batch.params, rtol=1e-10)
    assert np.allclose(found.std_plain[-1], batch.std_plain, rtol=1e-9)
    assert np.allclose(found.std[-1], batch.std_corrected, rtol=1e-9)
    assert found.memory_s == np.inf


def test_every_estimate_is_that_of_the_data_up_to_then():
    y = QDOT + noise(1, len(X), 0.5, 0.02)
    found = recursive_least_squares(signals(X, y), "qdot", TERMS)
    for n in (150, 400):
        batch = equation_error(signals(X[:n], y[:n]), "qdot", TERMS)
        i = int(np.searchsorted(found.t_s, (n - 1) * DT - 1e-9))
        assert np.allclose(found.params[i], batch.params, rtol=1e-8)
        assert np.allclose(found.std_plain[i], batch.std_plain, rtol=1e-8)


def test_forgetting_is_weighted_least_squares():
    y = QDOT + noise(2, len(X), 0.0, 0.02)
    found = recursive_least_squares(signals(X, y), "qdot", TERMS, forgetting=0.99)
    assert found.memory_s == pytest.approx(1.99, abs=0.01)
    w = 0.99 ** np.arange(len(X))[::-1]
    Z = np.column_stack([X, np.ones(len(X))])
    A = np.linalg.inv(Z.T @ (Z * w[:, None]))
    theta = A @ Z.T @ (w * y)
    A2 = Z.T @ (Z * w[:, None] ** 2)
    s2 = w @ (y - Z @ theta) ** 2 / (w.sum() - np.trace(A @ A2))
    assert np.allclose(found.params[-1], theta, rtol=1e-8)
    assert np.allclose(found.std_plain[-1] ** 2, s2 * np.diag(A @ A2 @ A), rtol=1e-8)


def test_forgetting_follows_a_change():
    long = np.vstack([X, X])
    y = long @ TRUTH[:3] + noise(3, len(long), 0.0, 0.01)
    y[len(X) :] += 3.0 * X[:, 2]  # a third of the elevator is lost
    data = signals(long, y)
    fixed = recursive_least_squares(data, "qdot", TERMS)
    moving = recursive_least_squares(data, "qdot", TERMS, forgetting=0.99)
    middle = int(np.searchsorted(fixed.t_s, (len(X) + 400) * DT))
    assert fixed.params[middle, 2] < -7.0  # the old data hold it
    middle = int(np.searchsorted(moving.t_s, (len(X) + 400) * DT))
    # five standard errors: a false alarm once in a million
    assert moving.params[middle, 2] == pytest.approx(-6.0, abs=5 * moving.std_plain[middle, 2])
    assert moving.std_plain[middle, 2] < 0.3


def test_errors_with_forgetting_agree_with_the_scatter():
    ends, stds = [], []
    for seed in range(200):
        found = recursive_least_squares(
            signals(X[:450], QDOT[:450] + noise(seed, 450, 0.0, 0.02)), "qdot", TERMS, forgetting=0.99
        )
        ends.append(found.params[-1])
        stds.append(found.std_plain[-1])
    ratio = np.std(ends, axis=0, ddof=1) / np.sqrt(np.mean(np.square(stds), axis=0))
    # 200 draws: 5 %; four deviations, false alarm 6e-5 per estimate
    assert np.all(np.abs(ratio - 1.0) < 0.2)


def test_without_excitation_there_is_no_estimate():
    tied = np.outer(np.sin(3.0 * np.arange(3000) * DT), [0.02, -0.03, 0.01])
    flown = np.vstack([np.zeros((50, 3)), X, tied])
    y = flown @ TRUTH[:3] + noise(4, len(flown), 0.0, 0.01)
    found = recursive_least_squares(signals(flown, y), "qdot", TERMS, forgetting=0.98)
    assert found.t_s[0] > 50 * DT
    assert found.t_s[-1] < len(flown) * DT - 10.0  # what told the terms apart is forgotten
    assert any("have no estimate" in sentence for sentence in found.advice)
    assert found.status != "good"
    assert np.all(np.isfinite(found.params))


def test_the_frequency_domain_ends_at_its_batch_result():
    data = signals(X, QDOT + noise(5, len(X), 0.5, 0.02))
    batch = frequency_equation_error(data, "qdot", TERMS, band_hz=BAND, step_hz=0.04)
    found = recursive_frequency(data, "qdot", TERMS, band_hz=BAND, step_hz=0.04, update_s=0.5)
    assert found.t_s[-1] == data.t_s[-1]
    assert np.allclose(np.diff(found.t_s), 0.5)
    assert np.allclose(found.params[-1], batch.params, rtol=1e-9)
    assert np.allclose(found.std[-1], batch.std_corrected, rtol=1e-9)
    assert np.all(found.std[-1] < found.std[0])
    apart = np.abs(found.params - TRUTH[:3]) / found.std
    # 20 updates of one record, far from independent; normal errors exceed 4.5 once in 150 000
    assert np.all(apart[4:] < 4.5)


def test_exact_data_are_exact_at_every_update():
    for forgetting in (1.0, 0.995):
        found = recursive_frequency(
            signals(X, QDOT), "qdot", TERMS, band_hz=BAND, step_hz=0.04, update_s=1.0, forgetting=forgetting
        )
        assert np.allclose(found.params, TRUTH[:3], rtol=1e-6)  # condition of early updates: up to 1e5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda d: recursive_least_squares(d, "qdot", TERMS, forgetting=1.1), "0 < forgetting <= 1"),
        (lambda d: recursive_least_squares(d, "qdot", TERMS, forgetting=0.2), "never decide"),
        (
            lambda d: recursive_frequency(d, "qdot", TERMS, band_hz=BAND, step_hz=0.04, update_s=0.001),
            "at least the sample time",
        ),
        (
            lambda d: recursive_frequency(d, "qdot", TERMS, band_hz=BAND, step_hz=-1.0, update_s=1.0),
            "step_hz must be positive",
        ),
        (
            lambda d: recursive_frequency(d, "qdot", TERMS, band_hz=(0.1, 0.14), step_hz=0.04, update_s=1.0),
            "never decide",
        ),
    ],
)
def test_what_cannot_be_done_recursively_is_refused(call, message):
    with pytest.raises(EstimationError, match=message):
        call(signals(X, QDOT))
