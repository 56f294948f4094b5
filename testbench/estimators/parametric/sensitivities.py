"""Sensitivities of records to unknowns of which some belong to one record alone.

Initial states, offsets and biases of a record move its outputs only. So a record keeps the columns that it feels, and
the columns of all records meet in a small square root of the information, not in one long Jacobian: with m records of
n samples, k common unknowns and q of each record, n (k + q) numbers at a time in place of m n (k + m q).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray

_ROWS = 8192  # of a block: as many as a cache holds


class Sensitivities(NamedTuple):
    """Derivatives (N, p, c) of one record's outputs or residuals by the unknowns ``columns`` (c,) that it feels."""

    values: FloatArray
    columns: NDArray[np.intp]

    @classmethod
    def of_all(cls, values: FloatArray) -> Sensitivities:
        """Return the sensitivities (N, p, k) by all unknowns, in their order."""
        return cls(values, np.arange(values.shape[2]))


def in_blocks(residuals: FloatArray, sensitivities: Sensitivities, whiten: FloatArray) -> Iterator[FloatArray]:
    """Yield rows (r, c + 1) of one record, by time: weighted sensitivities (N, p, c) and residuals (N, p), last.

    ``whiten`` (p, p) multiplies both.
    """
    step = max(1, _ROWS // residuals.shape[1])
    for i in range(0, len(residuals), step):
        block = np.concatenate([sensitivities.values[i : i + step], residuals[i : i + step, :, None]], axis=2)
        yield (whiten @ block).reshape(-1, block.shape[2])


def believed_alone(
    columns: NDArray[np.intp], prior_weight: FloatArray, alone: NDArray[np.bool_], point: FloatArray | None = None
) -> Iterator[FloatArray]:
    """Yield rows (r, c + 1) of the priors about zero of unknowns that this record alone feels, if it has any.

    Args:
        columns: (c,) unknowns that it feels.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
        alone: (k,) or more, which only one record feels.
        point: (k,) of the search, whose distance from the priors stands last; none if not given.
    """
    mine = np.flatnonzero(alone[columns] & (prior_weight[columns] > 0.0))
    if mine.size:
        rows = np.zeros((mine.size, columns.size + 1))
        rows[np.arange(mine.size), mine] = weight = prior_weight[columns[mine]]
        if point is not None:
            rows[:, -1] = weight * point[columns[mine]]
        yield rows


def square_root(parts: Iterable[tuple[Iterable[FloatArray], NDArray[np.intp]]], alone: NDArray[np.bool_]) -> FloatArray:
    """Return S (s, k) with S' S = J' J of the rows of all parts.

    Each part is reduced by Householder reflections, block by block, the unknowns of its own first, so that only its
    rows of the common ones go on (A. Bjorck, Numerical Methods for Least Squares Problems, 1996, section 6.3: block
    angular problems). A row that is not finite makes all of S infinite.

    Args:
        parts: blocks of rows (r, c) and which columns (c,) of the whole they are; consumed one by one.
        alone: (k,) unknowns that only one part feels.
    """
    out: list[FloatArray] = []
    common = np.flatnonzero(~alone)
    shared = np.zeros((0, common.size))
    for blocks, columns in parts:
        order = np.argsort(~alone[columns], kind="stable")  # its own first
        triangle = np.zeros((0, columns.size))
        for rows in blocks:
            if not np.all(np.isfinite(rows)):
                return np.full((1, alone.size), np.inf)
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows[:, order]]), mode="r"))
        own = int(np.sum(alone[columns]))
        whole = np.zeros((len(triangle[:own]), alone.size))
        whole[:, columns[order]] = triangle[:own]
        out.append(whole)
        rest = np.zeros((len(triangle[own:]), common.size))
        rest[:, np.searchsorted(common, columns[order][own:])] = triangle[own:, own:]
        shared = np.asarray(np.linalg.qr(np.vstack([shared, rest]), mode="r"))
    last = np.zeros((len(shared), alone.size))
    last[:, common] = shared
    return np.vstack([*out, last])
