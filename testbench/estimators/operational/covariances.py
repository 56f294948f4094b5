"""Covariances of outputs with reference outputs over lags, and the scatter of each by chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

Masked = tuple[FloatArray, NDArray[np.bool_]]
"""Samples (n, r) of zero mean and which of them were taken."""


@dataclass(frozen=True, eq=False)
class Covariances:
    """R_i = E[y(k+i) y_ref(k)'] for i = 1 .. L.

    Attributes:
        lags: (L, r, r0) R_1 to R_L.
        deviations: (b, L, r, r0) of b blocks of the data: the covariance of all elements of ``lags`` is the sum over
            the blocks of the outer products of their deviations.
    """

    lags: FloatArray
    deviations: FloatArray


def covariances(data: Sequence[Masked], references: Sequence[int], count: int, blocks: int) -> Covariances:
    """Estimate R_1 to R_count over all records, each pair of samples that were both taken counting once.

    An element is the ratio of two sums, S of products over N of pairs. Blocks of consecutive k are nearly independent,
    so that to first order (Taylor expansion of the ratio; W. G. Cochran, Sampling Techniques, 1977, section 6.3)

        cov(R) = b / (b - 1) sum_b d_b d_b',  d_b = (S_b - R N_b) / N.

    The pairs of a block may reach ``count`` samples into the next one.

    Args:
        data: samples (n, r) and validity of each record, means removed; different lengths.
        references: columns that the outputs are correlated with.
        count: of lags, L.
        blocks: wanted in all records together; records are divided in proportion to their length.

    Raises:
        EstimationError: a pair of channels was never taken at the same time at some lag, or fewer than two blocks are
            left.
    """
    total = sum(len(y) for y, _ in data)
    sums, pairs = [], []
    for y, valid in data:
        if len(y) <= count:
            continue
        y, known = np.where(valid, y, 0.0), valid.astype(np.float64)
        own = max(1, round(blocks * len(y) / total))
        edges = np.linspace(0, len(y) - 1, own + 1).astype(int)
        for begin, end in pairwise(edges):
            sums.append(_products(y, references, begin, end, count))
            pairs.append(_products(known, references, begin, end, count))
    if len(sums) < 2:
        raise EstimationError(f"covariances need records longer than {count} samples and two blocks; give more data")
    S, N = np.array(sums), np.array(pairs)
    every = N.sum(axis=0)
    if not np.all(every > 0.0):
        lag, a, b = np.argwhere(every == 0.0)[0]
        raise EstimationError(
            f"every two outputs must have been sampled together, but outputs {a} and {references[b]} never were at "
            f"a lag of {lag + 1} samples; leave one of them out or give more data"
        )
    R = S.sum(axis=0) / every
    return Covariances(R, np.sqrt(len(S) / (len(S) - 1)) * (S - R * N) / every)


def _products(y: FloatArray, references: Sequence[int], begin: int, end: int, count: int) -> FloatArray:
    """Return the sums over begin <= k < end of y(k+i) y_ref(k)', (count, r, r0); none reach beyond it."""
    held = y[:, references]
    out = np.empty((count, y.shape[1], len(references)))
    for i in range(1, count + 1):
        last = min(end, len(y) - i)
        out[i - 1] = y[begin + i : last + i].T @ held[begin:last] if last > begin else 0.0
    return out
