"""Evidence, to first order, of all hypotheses of a library at once, each of which has one column of its own.

Residuals about a point are r = X d + a s + U u + e. All hypotheses share the columns X, d ~ N(mean, std^2). Each has
one column s of its own in a multiple a ~ N(0, size^2). The noise e is as it is stated. The pulses u ~ N(0, kappa^2) of
an unknown motion are told by their principal directions U (:func:`.linear.fewer`): U'U is diagonal, so that no size
kappa needs a factorisation of its own. Another residual changes right-hand sides only: thousands are asked at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from testbench.core.record import FloatArray
from testbench.inference.linear import KAPPAS, Motion, factored


@dataclass(frozen=True, eq=False)
class Sums:
    """What the evidence needs of columns, at every size of the unknown motion; those of several records add up."""

    A: FloatArray  # (kappas, k, K) inner products of the first k columns, or of all, with all, pulses integrated
    squares: FloatArray  # (kappas, K) of each with itself
    log_det: FloatArray  # (kappas,) of the covariance of the samples
    samples: float  # their number

    def __add__(self, other: Sums) -> Sums:
        both = self.log_det + other.log_det, self.samples + other.samples
        return Sums(self.A + other.A, self.squares + other.squares, *both)

    def left_by(self, columns: Sequence[int]) -> Left:
        """Return the sums of residuals that are these columns themselves, without noise."""
        at = list(columns)
        return Left(self.A[:, :, at], self.A[:, at, at])


@dataclass(frozen=True, eq=False)
class Left:
    """What the evidence needs of r residuals beside the columns, likewise."""

    b: FloatArray  # (kappas, K, r) inner products with the columns
    c: FloatArray  # (kappas, r) with themselves

    def __add__(self, other: Left) -> Left:
        return Left(self.b + other.b, self.c + other.c)

    @classmethod
    def beside(cls, several: Sequence[Left]) -> Left:
        """Return the residuals of several together."""
        return cls(np.concatenate([x.b for x in several], axis=2), np.concatenate([x.c for x in several], axis=1))


S = TypeVar("S", Sums, Left)


@dataclass(frozen=True, eq=False)
class Columns:
    """K columns in one record and the principal directions of its unknown motion, in units of the noise."""

    X: FloatArray  # (samples, K); 0 where no sample was taken, as in all others
    U: FloatArray  # (samples, m)
    count: float  # number of samples that were taken

    @classmethod
    def of(cls, columns: FloatArray, unknown: Motion, taken: NDArray[np.bool_]) -> Columns:
        """Return those of columns (n, p, K) and an unknown motion at samples (n, p) that were taken."""
        X = columns if taken.all() else np.where(taken[:, :, None], columns, 0.0)
        return cls(X.reshape(taken.size, -1), unknown.by_sample, float(taken.sum()))

    @cached_property
    def _own(self) -> tuple[FloatArray, FloatArray]:
        """Return the squares of the directions (m,), and the columns along them (K, m)."""
        return np.sum(self.U**2, axis=0), self.X.T @ self.U

    @cached_property
    def _share(self) -> FloatArray:
        """What is taken out along each direction, (kappas, m)."""
        squares = np.array(KAPPAS)[:, None] ** 2
        return np.asarray(squares / (1.0 + squares * self._own[0]))

    @cached_property
    def sums(self) -> Sums:
        """Their inner products."""
        return self.beside(self.X.shape[1])

    def beside(self, k: int) -> Sums:
        """Return the inner products of the first k, which all hypotheses share, with all."""
        squares, along = self._own
        A = (self.X[:, :k].T @ self.X) - (along[:k] * self._share[:, None, :]) @ along.T
        own = np.sum(self.X**2, axis=0) - self._share @ (along**2).T
        return Sums(A, own, np.sum(np.log1p(np.array(KAPPAS)[:, None] ** 2 * squares), axis=1), self.count)

    def acting(self, rows: NDArray[np.bool_], k: int) -> Columns:
        """Return the columns after the first k as they are in some of the samples alone, 0 in all others."""
        X = self.X.copy()
        X[~rows, k:] = 0.0
        return Columns(X, self.U, self.count)

    def left(self, residuals: FloatArray) -> Left:
        """Return the sums of residuals (samples, r)."""
        return self._left(self.X.T @ residuals, self.U.T @ residuals, np.sum(residuals**2, axis=0))

    def drawn(self, multiples: FloatArray, pulses: FloatArray, rng: np.random.Generator) -> Left:
        """Return the sums of one residual: so much of each column (K,) and direction (m,), and white noise.

        Of the noise, what no column and no direction sees is left out: it is the same to all hypotheses.
        """
        known = np.concatenate([multiples, pulses])
        gram, half = self._noise
        z = rng.standard_normal((half.shape[1],))
        noise, moved = half @ z, gram @ known
        at = moved + noise
        square = np.array([known @ (moved + 2.0 * noise) + z @ z])
        return self._left(at[: len(multiples), None], at[len(multiples) :, None], square)

    @cached_property
    def _noise(self) -> tuple[FloatArray, FloatArray]:
        """Return the inner products of all columns and directions, and a root of them that makes noise of its own."""
        squares, along = self._own
        gram = np.block([[self.X.T @ self.X, along], [along.T, np.diag(squares)]])
        values, vectors = np.linalg.eigh(gram)
        seen = values > 1e-12 * max(values[-1], 1e-300)
        return gram, vectors[:, seen] * np.sqrt(values[seen])

    def _left(self, by_column: FloatArray, along: FloatArray, square: FloatArray) -> Left:
        b = by_column - self._own[1] @ (self._share[:, :, None] * along)
        return Left(b, square - self._share @ along**2)

    def some(self, columns: Sequence[int]) -> Columns:
        """Return a few of the columns."""
        return Columns(self.X[:, list(columns)], self.U, self.count)


def sum_of(parts: Iterable[S]) -> S:
    """Return the sums over several records."""
    return reduce(add, parts)


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """What r residuals say of h hypotheses, at every size of the unknown motion."""

    alone: FloatArray  # (kappas, r) ln p without any column but the shared ones
    logs: FloatArray  # (kappas, h, r) ln p of each hypothesis
    multiples: FloatArray  # (kappas, h, r) the most probable multiple of its column

    @classmethod
    def of(cls, sums: Sums, left: Left, mean: FloatArray, std: FloatArray, sizes: FloatArray) -> FirstOrder:
        """Weigh the hypotheses.

        Args:
            sums: of columns that all share, k, and of the h own ones after them.
            left: of the residuals beside these.
            mean: (k,) of the shared columns' multiples.
            std: (k,) their prior standard deviations.
            sizes: (h,) those of the own columns' multiples.
        """
        k, out = len(std), []
        for A, squares, log_det, b, c in zip(sums.A, sums.squares, sums.log_det, left.b, left.c, strict=True):
            M = np.eye(k) + std[:, None] * A[:k, :k] * std
            factor = factored(M)
            v = b - (A[:k].T @ mean)[:, None]
            q = c - mean @ (b[:k] + v[:k])
            shared = std[:, None] * v[:k]
            q = q - np.sum(shared * cho_solve(factor, shared, check_finite=False), axis=0)
            log_det = log_det + 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
            alone = -0.5 * (sums.samples * float(np.log(2.0 * np.pi)) + log_det + q)
            across = std[:, None] * A[:k, k:]
            solved = cho_solve(factor, across, check_finite=False)
            precision = (squares[k:] - np.sum(across * solved, axis=0) + sizes**-2.0)[:, None]
            a = (v[k:] - solved.T @ shared) / precision
            gain = 0.5 * a**2 * precision - 0.5 * np.log(sizes[:, None] ** 2 * precision)
            out.append((alone, alone + gain, a))
        alone, logs, multiples = zip(*out, strict=True)
        return cls(np.array(alone), np.array(logs), np.array(multiples))
