"""Numbers as people read them: a value has no more decimals than its error lends it."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.words import array_found, with_error


@pytest.mark.parametrize(
    ("value", "error", "said"),
    [
        (12.0534, 0.0632, "12.053 ± 0.063"),
        (5.0612, 0.4812, "5.06 ± 0.48"),
        (0.09963, 0.1, "0.10 ± 0.10"),
        (81234.4, 123.4, "81234 ± 123"),
        (1.23456e-7, 2.3e-9, "1.235e-07 ± 2.3e-09"),
        (-0.5, 0.0, "-0.5 ± 0"),
        (3.0, float("nan"), "3 ± nan"),
    ],
)
def test_value_and_error_have_the_same_decimals(value, error, said):
    assert with_error(value, error) == said


def test_an_array_that_is_refused_says_whether_its_shape_or_its_numbers_are_wrong() -> None:
    """A model of NaN "must be of shape (4, 4), got shape (4, 4)"."""
    assert array_found(np.ones((4, 2))) == "shape (4, 2)"
    assert array_found(np.array([1.0, np.nan, np.inf])) == "shape (3,), with NaN"
    assert array_found(np.array([1.0, -np.inf])) == "shape (2,), with infinite values"
