"""Switching signals designed by information: every step at full amplitude or at rest, chosen by exchange.

With steps of one length the response is a sum over steps, so the information is a quadratic form in their signs: M =
sum_i sum_j s_i s_j K_ij. The K are computed once; changing one step then costs a few small matrix operations. The
exchange visits all steps, keeps for each the sign that lowers the cost most, and starts again until nothing changes
(coordinate exchange: R. K. Meyer and C. J. Nachtsheim, Technometrics 37, 1995; optimal square waves in flight test: E.
A. Morelli and V. Klein, Journal of Aircraft 27(8), 1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.information.fisher import Criterion, Experiment, cost
from testbench.questions.design.prediction import Prediction

PASSES = 20
"""Most visits of all steps."""
LEVELS = (1.0, -1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Switching:
    """The quadratic form of one experiment for steps of one length.

    Attributes:
        K: (b, b, k, k) information of pairs of blocks; a block is one step on one control.
        y: (b, n, c) deviations of the limited channels that a block at unit amplitude makes, at the sensors' rate.
        prediction: the limits.
        gradient: (t, k) targets in units of their wanted standard errors by parameters.
        criterion: what the design minimises.
        known: (k, k) information that earlier flights gave; None: none.
    """

    K: FloatArray
    y: FloatArray
    prediction: Prediction
    gradient: FloatArray
    criterion: Criterion
    known: FloatArray | None = None

    def value(self, M: FloatArray, deviation: FloatArray) -> float:
        """Return the cost at the largest admissible amplitude."""
        factor, _ = self.prediction.factor_of(deviation)
        return self.cost_at(M, factor)

    def cost_at(self, M: FloatArray, factor: float) -> float:
        """Return the cost at a factor on unit amplitude."""
        if self.known is None:
            return cost(M, self.gradient, self.criterion) / factor
        return cost(factor**2 * M + self.known, self.gradient, self.criterion)

    def exchange(self, signs: FloatArray, levels: Sequence[float] = LEVELS) -> tuple[FloatArray, float]:
        """Return signs (b,) that no change of a single step improves, and their cost, starting from others."""
        s = np.array(signs, float)
        M = np.einsum("i,j,ijkl->kl", s, s, self.K)
        deviation = np.tensordot(s, self.y, axes=1)
        best = self.value(M, deviation)
        for _ in range(PASSES):
            changed = False
            for b in range(s.size):
                row = np.tensordot(s, self.K[b], axes=1)  # sum_j s_j K_bj
                for level in levels:
                    step = level - s[b]
                    if step == 0.0:
                        continue
                    trial = M + step * (row + row.T) + step**2 * self.K[b, b]
                    moved = deviation + step * self.y[b]
                    value = self.value(trial, moved)
                    if value < best * (1.0 - 1e-9):
                        best, M, deviation, changed = value, trial, moved, True
                        s[b] = level
                        row = np.tensordot(s, self.K[b], axes=1)
            if not changed:
                break
        return s, best


def switching(
    experiment: Experiment,
    prediction: Prediction,
    gradient: FloatArray,
    criterion: Criterion,
    step: int,
    start: int,
    count: int,
    repeats: int = 1,
    known: FloatArray | None = None,
) -> Switching:
    """Return the quadratic form for ``count`` steps of ``step`` input samples each from sample ``start`` on.

    The whole sequence is flown ``repeats`` times, one after the other. ``known`` is what earlier flights gave.

    With several controls each has ``count`` blocks, all of the first control first.
    """
    m, k = len(experiment.structure.inputs), len(experiment.structure.parameters)
    length = experiment.samples * experiment.stride
    columns, moved = [], []
    for j in range(m):
        for i in range(count):
            u = np.zeros((length, m))
            for r in range(repeats):
                begin = start + (r * count + i) * step
                u[begin : begin + step, j] = 1.0
            columns.append(experiment.weighted(u))
            moved.append(prediction.response(u)[:: experiment.stride])
    W = np.stack(columns, axis=1).reshape(-1, len(columns) * k)
    K = (W.T @ W).reshape(len(columns), k, len(columns), k).transpose(0, 2, 1, 3)
    return Switching(K, np.stack(moved), prediction, gradient, criterion, known)


def design_switching(
    form: Switching, starts: Sequence[FloatArray], random_starts: int, seed: int
) -> tuple[FloatArray, float]:
    """Return the best signs (b,) and their cost over exchanges from given and from random starts."""
    rng = np.random.default_rng(seed)
    points = [*starts, *(rng.choice([1.0, -1.0], len(form.K)) for _ in range(random_starts))]
    found = [form.exchange(point) for point in points]
    return min(found, key=lambda pair: pair[1])
