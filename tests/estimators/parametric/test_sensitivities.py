"""The small square root says what the long Jacobian says, and the colour of a long record is taken block by block."""

import numpy as np
import pytest

from testbench.estimators import residuals
from testbench.estimators.parametric.gauss_newton import Sensitivities, in_blocks, square_root
from testbench.estimators.residuals import Colour, coloured_information


def dense(parts, total):
    out = []
    for rows, columns in parts:
        whole = np.zeros((len(rows), total))
        whole[:, columns] = rows
        out.append(whole)
    return np.vstack(out)


@pytest.mark.parametrize("lengths", [(40,), (40, 30, 25), (3, 2, 40)])
def test_the_square_root_has_the_gram_matrix_of_the_whole(lengths):
    rng = np.random.default_rng(1)
    common, own = 3, 2
    total = common + own * len(lengths) + 1
    alone = np.zeros(total, bool)
    alone[common:-1] = True
    parts = []
    for i, n in enumerate(lengths):
        mine = np.arange(common + own * i, common + own * (i + 1))
        parts.append((rng.normal(size=(n, common + own + 1)), np.r_[0:common, mine, total - 1]))
    parts.append((rng.normal(size=(2, 3)), np.array([0, 2, total - 1])))
    J = dense(parts, total)
    S = square_root(((np.array_split(rows, 3), columns) for rows, columns in parts), alone)
    np.testing.assert_allclose(S.T @ S, J.T @ J, rtol=1e-12, atol=1e-12)
    assert len(S) <= total + common + 1


def test_a_row_that_is_not_finite_makes_the_whole_infinite():
    rows = np.ones((5, 2))
    rows[3, 1] = np.nan
    assert not np.any(np.isfinite(square_root([([rows], np.array([0, 1]))], np.zeros(2, bool))))


def test_blocks_of_a_record_are_its_weighted_rows():
    rng = np.random.default_rng(2)
    v, J, whiten = rng.normal(size=(20_000, 2)), rng.normal(size=(20_000, 2, 3)), np.array([[2.0, 0.0], [0.5, 3.0]])
    found = np.vstack(list(in_blocks(v, Sensitivities.of_all(J), whiten)))
    np.testing.assert_allclose(found[:, :3], (whiten @ J).reshape(-1, 3), rtol=1e-13)
    np.testing.assert_allclose(found[:, 3], (v @ whiten.T).ravel(), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("poles", [(), (0.7,), (0.99, -0.5)])
def test_blocks_of_a_long_record_give_the_information_of_the_whole(monkeypatch, poles):
    rng = np.random.default_rng(3)
    n, p, k = 6000, 2, 3
    e = rng.normal(size=(n, p)) @ np.array([[1.0, 0.3], [0.0, 0.5]])
    v = e.copy()
    for pole in poles:
        for i in range(1, n):
            v[i] += pole * v[i - 1]
    W = np.cumsum(rng.normal(size=(n, p, k)), axis=0) / 50.0
    whole = coloured_information([W, W[:1000]], [v, v[:1000]])
    assert len(Colour.of([v]).model.A) >= len(poles)
    monkeypatch.setattr(residuals, "_BLOCK", 700)
    blocks = coloured_information([W, W[:1000]], [v, v[:1000]])
    np.testing.assert_allclose(blocks, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
