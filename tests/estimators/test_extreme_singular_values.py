"""The two extreme singular values of a wide triangle, found without all the others."""

import numpy as np
import pytest

from testbench.estimators.hankel import BlockHankel, block_factor, extreme_singular_values


def test_they_are_those_of_the_whole_decomposition():
    R = np.linalg.qr(np.random.default_rng(1).standard_normal((300, 200)) * np.geomspace(1.0, 1e-4, 200), mode="r")
    s = np.linalg.svd(R, compute_uv=False)
    assert extreme_singular_values(R) == (pytest.approx(s[0], rel=1e-12), pytest.approx(s[-1], rel=1e-12))


def test_a_narrow_or_a_nearly_singular_triangle_has_none():
    assert extreme_singular_values(np.eye(20)) is None
    assert extreme_singular_values(np.diag(np.geomspace(1.0, 1e-9, 200))) is None


def test_a_costly_factor_is_the_one_of_the_windows():
    z = np.random.default_rng(2).standard_normal((1500, 5))
    good = np.ones(1500, bool)
    quick, columns = BlockHankel([z], [good], [100]).factor(100)
    slow, same = block_factor([z], [good], 100)
    assert columns == same == 1401
    np.testing.assert_allclose(np.abs(quick), np.abs(slow), rtol=0.0, atol=1e-9 * np.abs(slow).max())
