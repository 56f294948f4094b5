"""Hypotheses side by side: white residuals, white columns, and what each explains beside the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from testbench.core.record import FloatArray
from testbench.estimators.causes.coloured_fit import (
    Stretch,
    Whitener,
    normal,
)
from testbench.estimators.causes.found import SLOW
from testbench.estimators.causes.leavings import Candidate, Data

CHANCE = 1e-4  # false-alarm probability of the tests of one round of causes together
SLOPES, NUISANCES, RESPONSE, MOVED = "slopes", "nuisances", "response", "moved inputs"


class Tried(NamedTuple):
    """A candidate, the sum of squares that it takes, degrees of freedom, tests that share the chance, where it leads.

    ``statistic`` is tested, beside any linear response for what is none. ``order`` puts causes in order: of a linear
    response it is what it takes beside all others. Both count in variances of the noise.
    """

    candidate: Candidate
    statistic: float
    order: float
    degrees: int
    tests: int
    data: Data | None = None

    def significant(self, freedom: int) -> bool:
        """Return whether F tells it from chance; the noise is known with ``freedom`` degrees."""
        degrees = max(self.degrees, 1)
        return bool(f_distribution.sf(max(self.statistic, 0.0) / degrees, degrees, freedom) * self.tests < CHANCE)

    def gain(self, samples: int) -> float:
        """Return what it takes beyond what its degrees of freedom cost."""
        return self.order - self.degrees * float(np.log(samples))


def name_of(c: Candidate) -> str:
    """Return the name of the block of a candidate."""
    return f"{c.code} {c.subject}" if c.subject not in ("", SLOW) else c.code


class Board:
    """White residuals and white columns of all hypotheses with their products, in blocks by name."""

    def __init__(self, noise: Whitener, parts: Sequence[Stretch], blocks: Mapping[str, list[FloatArray]]) -> None:
        self.noise = noise
        self.Z = {name: noise(columns) for name, columns in blocks.items()}
        self._multiply(parts)

    def _multiply(self, parts: Sequence[Stretch]) -> None:
        self.e = self.noise([s.v[:, :, None] for s in parts])[:, 0]
        ends = np.cumsum([0, *(Z.shape[1] for Z in self.Z.values())])
        self.at = {name: np.arange(a, b) for name, a, b in zip(self.Z, ends[:-1], ends[1:], strict=True)}
        self.products = normal(np.hstack(list(self.Z.values())), self.e)

    def replaced(self, parts: Sequence[Stretch], slopes: list[FloatArray], **more: list[FloatArray]) -> Board:
        """Return a board with other residuals and slopes, and more blocks."""
        other = object.__new__(Board)
        other.noise = self.noise
        other.Z = self.Z | {name: self.noise(columns) for name, columns in ({SLOPES: slopes} | more).items()}
        other._multiply(parts)
        return other

    def left(self, names: Sequence[str], extra: NDArray[np.intp] | None = None) -> float:
        """Return the sum of squares that the blocks named, and ``extra`` columns, leave."""
        at = np.concatenate([self.at[n] for n in names] + ([] if extra is None else [extra]))
        return self.products.total - self.products.of(at).explained()


def width_of(columns: list[FloatArray]) -> int:
    """Return the number of regressors."""
    return int(columns[0].shape[2])
