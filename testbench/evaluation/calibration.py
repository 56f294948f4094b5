"""Whether stated errors are true: errors over stated errors, against the normal distribution; and ranks of methods."""

from __future__ import annotations

import math
from dataclasses import dataclass
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


# --- ranks ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Ranks:
    """How methods rank over data sets, rank 1 for the smallest error.

    Attributes:
        blocks: number of data sets.
        mean: (k,) mean ranks; ties share theirs.
        chi2: Friedman's statistic, without correction for ties.
        p: probability of such ranks if all methods are alike, by the F of Iman and Davenport (1980).
        critical: difference of mean ranks beyond which two methods differ, by Nemenyi's test.
        level: of that test.
    """

    blocks: int
    mean: FloatArray
    chi2: float
    p: float
    critical: float
    level: float

    def groups(self) -> list[tuple[int, ...]]:
        """Return the largest sets of methods that the test cannot tell apart, each in the order of the ranks."""
        order = np.argsort(self.mean, kind="stable").tolist()
        out: list[tuple[int, ...]] = []
        for i, first in enumerate(order):
            group = tuple(k for k in order[i:] if self.mean[k] - self.mean[first] < self.critical)
            if len(group) > 1 and not any(set(group) <= set(other) for other in out):
                out.append(group)
        return out


def ranks(errors: FloatArray, level: float = 0.05) -> Ranks:
    """Rank methods over data sets by the size of their errors.

    Args:
        errors: (n, k) of k >= 2 methods on n >= 2 data sets. NaN, where a method gave nothing, ranks last.
        level: of Nemenyi's test.

    Raises:
        ValueError: fewer than two methods or data sets.
    """
    from scipy.stats import f, rankdata, studentized_range

    n, k = errors.shape
    if n < 2 or k < 2:
        raise ValueError(f"ranks need two methods and two data sets, got {k} and {n}")
    mean = rankdata(np.where(np.isnan(errors), np.inf, errors), axis=1).mean(axis=0)
    chi2 = 12.0 * n / (k * (k + 1)) * (float(np.sum(mean**2)) - 0.25 * k * (k + 1) ** 2)
    rest = n * (k - 1) - chi2
    p = float(f.sf((n - 1) * chi2 / rest, k - 1, (k - 1) * (n - 1))) if rest > 1e-9 * n else 0.0
    q = float(studentized_range.ppf(1.0 - level, k, np.inf)) / math.sqrt(2.0)
    return Ranks(n, mean, chi2, p, q * math.sqrt(k * (k + 1) / (6.0 * n)), level)
