"""Paired comparisons: differences with intervals, exact tests, and the correction for many tests at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.proportion import proportion_interval
from testbench.core.record import FloatArray

Test = Literal["wilcoxon", "t"]
CONFIDENCE = 0.95
LEAST_PAIRS = 3


@dataclass(frozen=True)
class Interval:
    """A figure and the interval that holds the true one with probability 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Paired:
    """What a set of paired differences says."""

    pairs: int  #: how many
    #: Hodges-Lehmann pseudo-median (Wilcoxon) or mean (t), with its 95 % interval; None: too few pairs
    difference: Interval | None
    p: float | None  #: two-sided probability of such differences by chance; None: too few pairs


def root_mean_square(errors: FloatArray) -> Interval | None:
    """Return the root mean square of errors (n,) and its interval: Student's t on the logarithm of the mean square.

    The logarithm's standard error is that of the mean square over the mean square (delta method). None for less than
    two errors.
    """
    square = np.asarray(errors, float) ** 2
    if square.size < 2:
        return None
    half = _student(square.size) * float(np.std(square, ddof=1)) / math.sqrt(square.size)
    mean = float(np.mean(square))
    if mean == 0.0:
        return Interval(0.0, 0.0, 0.0)
    factor = math.exp(min(0.5 * half / mean, 700.0))
    return Interval(math.sqrt(mean), math.sqrt(mean) / factor, math.sqrt(mean) * factor)


def mean_interval(errors: FloatArray) -> Interval:
    """Return the mean of two or more errors (n,) and its interval by Student's t."""
    mean, n = float(np.mean(errors)), len(errors)
    half = _student(n) * float(np.std(errors, ddof=1)) / math.sqrt(n)
    return Interval(mean, mean - half, mean + half)


def scatter_interval(std: float, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a standard deviation from n normal samples: std sqrt((n - 1) / chi2)."""
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = (math.sqrt((n - 1) / float(chi2.ppf(q, n - 1))) for q in (1.0 - tail, tail))
    return std * low, std * high


def chance_of_scatter(ratio: float, n: int) -> float:
    """Return the two-sided probability that n normal samples scatter by ``ratio`` times their standard deviation."""
    from scipy.stats import chi2

    square = (n - 1) * ratio**2
    return min(1.0, 2.0 * min(float(chi2.cdf(square, n - 1)), float(chi2.sf(square, n - 1))))


def paired(differences: FloatArray, test: Test) -> Paired:
    """Test whether paired differences (n,) lie about zero.

    "wilcoxon": the signed rank test, exact for any ties, zeros left out (F. Wilcoxon, Biometrics Bulletin 1, 1945),
    with the pseudo-median of J. L. Hodges and E. L. Lehmann, Annals of Mathematical Statistics 34, 1963, and the
    interval of the same test. "t": Student's paired t.
    """
    d = np.asarray(differences, float)
    if d.size < LEAST_PAIRS:
        return Paired(d.size, None, None)
    if test == "t":
        return _t(d)
    return Paired(d.size, _hodges_lehmann(d), _signed_rank_p(d))


def paired_misses(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> Paired:
    """Compare how often something is missed, pair by pair (n,): the difference is in percent of the pairs.

    p is that of McNemar's test, exact: only pairs that differ count, either way with probability a half
    (Q. McNemar, Psychometrika 12, 1947). The interval takes b - c, the shares of pairs missed before alone and after
    alone, each within its interval of Clopper and Pearson at 97.5 %, so that both hold together with 95 % or more.
    """
    from scipy.stats import binom

    n = len(before)
    if n < LEAST_PAIRS:
        return Paired(n, None, None)
    b, c = int(np.sum(before & ~after)), int(np.sum(~before & after))
    p = min(1.0, 2.0 * float(binom.cdf(min(b, c), b + c, 0.5)))
    (b_low, b_high), (c_low, c_high) = (
        proportion_interval(k, n, 1.0 - 0.5 * (1.0 - CONFIDENCE), "exact") for k in (b, c)
    )
    return Paired(n, Interval(100.0 * (b - c) / n, 100.0 * (b_low - c_high), 100.0 * (b_high - c_low)), p)


def holm(p: Sequence[float]) -> list[float]:
    """Return probabilities corrected for their number, in their order (S. Holm, Scandinavian Journal of Statistics 6,
    1979): the chance of a single false finding among all of them stays below the level of the tests.
    """
    order = np.argsort(np.asarray(p, float), kind="stable")
    out, largest = np.empty(len(p)), 0.0
    for rank, k in enumerate(order):
        largest = max(largest, min(1.0, (len(p) - rank) * float(p[k])))
        out[k] = largest
    return out.tolist()


def seeds_needed(questions: int, level: float) -> int:
    """Return how many pairs the signed rank test needs to find anything among so many questions.

    n pairs that all point one way have p = 2 / 2^n, and Holm's first step multiplies it by the number of questions.
    """
    return max(LEAST_PAIRS, math.ceil(math.log2(2.0 * max(questions, 1) / level) - 1e-12))


def _t(d: FloatArray) -> Paired:
    from scipy.stats import ttest_1samp

    if np.ptp(d) == 0.0:  # no scatter at all: certain, one way or the other
        return Paired(d.size, mean_interval(d), 1.0 if d[0] == 0.0 else 0.0)
    found = ttest_1samp(d, 0.0)
    low, high = found.confidence_interval(CONFIDENCE)
    return Paired(d.size, Interval(float(np.mean(d)), float(low), float(high)), float(found.pvalue))


def _student(n: int) -> float:
    from scipy.stats import t as student

    return float(student.ppf(0.5 * (1.0 + CONFIDENCE), n - 1))


def _signed_rank_p(d: FloatArray) -> float:
    """Return the two-sided p of the signed rank test, every assignment of signs to the ranks counted."""
    from scipy.stats import rankdata

    d = d[d != 0.0]
    if not d.size:
        return 1.0
    doubled = np.rint(2.0 * rankdata(np.abs(d))).astype(int)  # ranks of ties are halves
    share = _rank_sums(doubled)
    observed = int(doubled[d > 0.0].sum())
    smaller = min(observed, int(doubled.sum()) - observed)
    return float(min(1.0, 2.0 * share[: smaller + 1].sum()))


def _rank_sums(ranks: np.ndarray) -> FloatArray:
    """Return the probability of every sum of ranks, each counted or not with probability a half."""
    share = np.zeros(int(ranks.sum()) + 1)
    share[0] = 1.0
    for r in ranks.tolist():
        moved = np.zeros_like(share)
        moved[r:] = share[: share.size - r]
        share = 0.5 * (share + moved)
    return share


def _hodges_lehmann(d: FloatArray) -> Interval:
    """Return the median of the Walsh averages, and the averages that the test cannot tell from the true value."""
    i, j = np.triu_indices(d.size)
    walsh = np.sort(0.5 * (d[i] + d[j]))
    below = np.cumsum(_rank_sums(np.arange(1, d.size + 1)))
    cut = max(1, int(np.searchsorted(below, 0.5 * (1.0 - CONFIDENCE) - 1e-12)))
    return Interval(float(np.median(walsh)), float(walsh[cut - 1]), float(walsh[walsh.size - cut]))


# --- calibration and ranks --------------------------------------------------------------------------------------------


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
    """How methods rank over data sets, rank 1 for the smallest error."""

    blocks: int  #: number of data sets
    mean: FloatArray  #: (k,) mean ranks; ties share theirs
    chi2: float  #: Friedman's statistic, without correction for ties
    p: float  #: probability of such ranks if all methods are alike, by the F of Iman and Davenport (1980)
    critical: float  #: difference of mean ranks beyond which two methods differ, by Nemenyi's test
    level: float  #: of that test

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
