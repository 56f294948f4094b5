"""Whether stated errors are true: errors over stated errors, against the normal distribution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray


class Calibration(NamedTuple):
    """Sorted errors over stated errors (n,), the normal quantiles (n,) they belong to, and their 95 % band (n,) each.

    The band holds each of them with 95 % if the errors are normal and as large as stated.
    """

    found: FloatArray
    expected: FloatArray
    low: FloatArray
    high: FloatArray


def calibration(errors: FloatArray, stated: FloatArray) -> Calibration:
    """Compare errors with their stated standard errors.

    The i-th smallest of n uniform numbers is distributed as beta(i, n + 1 - i), which gives quantiles and band.

    Args:
        errors: (n,) estimate minus truth.
        stated: (n,) standard errors in the same unit; those that are not positive numbers are left out.
    """
    from scipy.stats import beta, norm

    known = np.isfinite(errors) & np.isfinite(stated) & (stated > 0.0)
    z = np.sort(errors[known] / stated[known])
    i = np.arange(1, z.size + 1)
    expected, low, high = (norm.ppf(beta.ppf(q, i, z.size + 1 - i)) for q in (0.5, 0.025, 0.975))
    return Calibration(z, expected, low, high)
