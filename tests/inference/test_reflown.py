"""The user's flight again: scatter as a second estimate of errors, bias, and what is drawn in place of noise."""

import numpy as np
import pytest
from scipy.signal import csd
from varying import fitted, flown

import testbench as tb
from testbench.inference.reflown import FEWEST, Reflown, reflown, surrogate


def test_flights_of_a_clean_fit_scatter_as_its_errors_say():
    record = flown(0.03)
    found = reflown(fitted(record), [record], np.random.default_rng(1), 200)
    own = [k for k, name in enumerate(found.names) if not name.endswith("_0")]
    assert found.failed == 0
    assert np.all(np.abs(found.bias[own]) < 0.3 * found.stated[own])  # 4 of its standard errors
    assert np.all((found.scatter[own] > 0.65 * found.stated[own]) & (found.scatter[own] < 1.3 * found.stated[own]))
    assert np.all(found.held[own] > 0.9)
    assert np.all(found.added[own] == 0.0)
    assert found.wrong == 0.0


def test_what_an_estimator_does_not_state_is_added():
    rng = np.random.default_rng(2)
    estimates = np.array([1.0, 5.0]) + rng.standard_normal((400, 2)) * [0.1, 0.2] + [0.0, 0.3]
    found = Reflown(("a", "b"), np.array([1.0, 5.0]), np.array([0.1, 0.1]), estimates, 0)
    assert found.added[0] == 0.0
    assert found.added[1] == pytest.approx(0.2**2 + 0.3**2 - 0.1**2, rel=0.15)
    assert found.held[1] < 0.5
    assert found.wrong == 0.0  # of the widened ones


def test_noise_is_drawn_with_its_spectra_and_other_phases():
    rng = np.random.default_rng(3)
    white = rng.standard_normal((4096, 2))
    left = np.column_stack([np.convolve(white[:, 0], np.ones(8) / 8, "same"), white[:, 0] + 0.2 * white[:, 1]])
    drawn = surrogate(left, rng)
    assert drawn.std(axis=0) == pytest.approx(left.std(axis=0), rel=0.05)
    _, was = csd(left[:, 0], left[:, 1], nperseg=256)
    _, now = csd(drawn[:, 0], drawn[:, 1], nperseg=256)
    assert np.abs(now[:8].sum() - was[:8].sum()) < 0.3 * np.abs(was[:8].sum())
    assert abs(np.corrcoef(left[:, 1], drawn[:, 1])[0, 1]) < 0.07  # 4 standard errors


def test_only_output_error_is_flown_again_and_short_records_more_often():
    record = flown(0.03)
    other = tb.estimate("equation_error", [record], ["de"], ["alpha", "q"], structure="short_period")
    assert reflown(other, [record], np.random.default_rng(1)) is None
    done = []
    found = reflown(fitted(record), [record], np.random.default_rng(1), progress=lambda k, of: done.append((k, of)))
    assert done[-1] == (len(found.estimates), len(found.estimates))
    assert len(found.estimates) > FEWEST
