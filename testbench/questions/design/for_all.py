"""Designs for all drawn aircraft at once: the smallest worst criterion, at the amplitude that keeps limits in all.

    minimise over u:  max_d cost_d(u) / min_d f_d(u),    f_d the largest admissible factor on u in draw d.

Switching signals are found by exchange, as for one aircraft, with the response and the quadratic form of every draw.
A multisine has its line powers by the multiplicative algorithm for one criterion, the draws weighed by how badly they
do: a draw's weight grows with its cost in every round (maximin by multiplicative weights).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np

from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Multisine
from testbench.questions.design.draws import Draws
from testbench.questions.design.problem import Design, Problem
from testbench.questions.design.refine import BLOCKS, lines_of, room, shaped, switched
from testbench.questions.design.switching import LEVELS, PASSES, Switching, switching

_STARTS, _RANDOM = 5, 2  # designs, random signs, and random signs with rests, that the exchange starts from
_KEPT = 2  # of its results: which is best when it is flown is not certain
_ROUNDS, _LOOK = 240, 10  # of the multiplicative algorithm, and how often the multisine itself is judged
_PULL = 0.3  # exponent with which a draw's weight follows its cost


def worst_of(draws: Draws, u: FloatArray, cut: float = np.inf) -> float:
    """Return the worst criterion over the draws of an input (samples, m) at the amplitude that keeps limits in all.

    Args:
        draws: at least one that can be judged.
        u: at any amplitude.
        cut: from which the worst need not be known.
    """
    factor = min(d.problem.prediction.largest_factor(u)[0] for d in draws.judged)
    worst = 0.0
    for d in draws.judged:
        worst = max(worst, d.problem.cost_of(d.problem.experiment.information(u), factor))
        if worst >= cut:
            break
    return worst


def for_all(problem: Problem, designs: Sequence[Design], draws: Draws) -> tuple[Design, ...]:
    """Return further designs, made for all draws at once: switching signals, and a multisine unless a pilot flies.

    Args:
        problem: of the believed aircraft.
        designs: to start from.
        draws: at least one that can be judged.
    """
    ranked = sorted(designs, key=lambda d: worst_of(draws, d.u))
    shape = [] if problem.by_hand else _shaped_for_all(problem, ranked, draws)
    return (*shape, *_switched_for_all(problem, [*shape, *ranked], draws))


def _switched_for_all(problem: Problem, ranked: Sequence[Design], draws: Draws) -> list[Design]:
    start, left, shortest = room(problem)
    step = shortest * ceil(left / shortest / max(BLOCKS // len(problem.controls), 1))
    count = left // step
    forms = [
        switching(p.experiment, p.prediction, p.targets.gradient, p.criterion, step, start, count, known=p.known)
        for p in (d.problem for d in draws.judged)
    ]
    middle = start + step // 2 + step * np.arange(count)
    points = [np.sign(np.round(d.u[middle].T.ravel(), 9)) for d in ranked[:_STARTS]]
    rng = np.random.default_rng(problem.seed)
    for levels in ([1.0, -1.0], [1.0, -1.0, 0.0]):
        points += [rng.choice(levels, len(forms[0].K)) for _ in range(_RANDOM)]
    found = sorted((exchange_for_all(forms, s) for s in points if np.any(s)), key=lambda pair: pair[1])
    best = [found[0][0], *(s for s, _ in found[1:] if not np.array_equal(s, found[0][0]))][:_KEPT]
    return [switched(problem, problem.prediction, s, (step, start, count, 1), "switching for all draws") for s in best]


def exchange_for_all(forms: Sequence[Switching], signs: FloatArray) -> tuple[FloatArray, float]:
    """Return signs (b,) that no change of a single step improves in the worst draw, and their worst cost."""
    s = np.array(signs, float)
    M = [np.einsum("i,j,ijkl->kl", s, s, f.K) for f in forms]
    moved = [np.tensordot(s, f.y, axes=1) for f in forms]
    best = _worst(forms, M, moved)
    for _ in range(PASSES):
        changed = False
        for b in range(s.size):
            rows = [np.tensordot(s, f.K[b], axes=1) for f in forms]
            for level in LEVELS:
                step = level - s[b]
                if step == 0.0:
                    continue
                trial = [m + step * (r + r.T) + step**2 * f.K[b, b] for m, r, f in zip(M, rows, forms, strict=True)]
                there = [y + step * f.y[b] for y, f in zip(moved, forms, strict=True)]
                value = _worst(forms, trial, there, best)
                if value < best * (1.0 - 1e-9):
                    best, M, moved, changed = value, trial, there, True
                    s[b] = level
                    rows = [np.tensordot(s, f.K[b], axes=1) for f in forms]
        if not changed:
            break
    return s, best


def _worst(
    forms: Sequence[Switching], M: Sequence[FloatArray], moved: Sequence[FloatArray], cut: float = np.inf
) -> float:
    factor = min(f.prediction.factor_of(y)[0] for f, y in zip(forms, moved, strict=True))
    worst = 0.0
    for f, m in zip(forms, M, strict=True):
        worst = max(worst, f.cost_at(m, factor))
        if worst >= cut:
            break
    return worst


def _shaped_for_all(problem: Problem, ranked: Sequence[Design], draws: Draws) -> list[Design]:
    spec = next((d.specs[0] for d in ranked if len(d.specs) == 1 and isinstance(d.specs[0], Multisine)), None)
    if not isinstance(spec, Multisine):
        return []
    wide, waves = lines_of(problem, spec)
    of = [d.problem for d in draws.judged]
    free = np.array([min(p.prediction.largest_factor(v)[0] for p in of) ** 2 for _, v in waves])
    K = [_of_lines(p, waves, free) for p in of]
    power, weight = np.full(len(waves), 1.0 / len(waves)), np.full(len(of), 1.0 / len(of))
    best: tuple[float, Design] | None = None
    for k in range(1, _ROUNDS + 1):
        worth, costs = np.zeros(len(waves)), np.zeros(len(of))
        for i, p in enumerate(of):
            M = np.einsum("l,lij->ij", power, K[i]) + (0.0 if p.known is None else p.known)
            half = np.linalg.solve(M, p.targets.gradient.T)
            variances = np.einsum("ti,it->t", p.targets.gradient, half)
            worst = int(np.argmax(variances))
            costs[i] = variances[worst]
            worth += weight[i] * np.einsum("i,lij,j->l", half[:, worst], K[i], half[:, worst])
        weight = weight * np.exp(_PULL * costs / costs.max())
        weight /= weight.sum()
        power = power * np.sqrt(worth)
        power /= power.sum()
        if k % _LOOK == 0:
            design = shaped(problem, wide, power * free, "multisine for all draws", "powers shaped for all draws")
            value = worst_of(draws, design.u, np.inf if best is None else best[0])
            if best is None or value < best[0]:
                best = value, design
    return [] if best is None else [best[1]]


def _of_lines(problem: Problem, waves: Sequence[tuple[FloatArray, FloatArray]], free: FloatArray) -> FloatArray:
    """Return the information (lines, k, k) of a unit of power on each line."""
    information = problem.experiment.information
    return np.stack([f * (information(u) + information(v)) for f, (u, v) in zip(free, waves, strict=True)])
