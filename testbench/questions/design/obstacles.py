"""What prevents a wanted accuracy: the noise of which sensor, which limit, or the time."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from testbench.questions.design.flown import limit_words
from testbench.questions.design.problem import Design, Problem

_QUIET = 0.01  # of a sensor's noise that is left when it is taken away
_FREE = 1e9  # times a limit


@dataclass(frozen=True)
class Obstacle:
    """What a design would reach without one of its obstacles.

    Attributes:
        words: what is taken away.
        cost: the criterion without it, in wanted errors.
    """

    words: str
    cost: float


@dataclass(frozen=True)
class Obstacles:
    """Everything that was tried, the most helpful first, and how many flights of the same input would be enough."""

    tried: tuple[Obstacle, ...]
    flights: int


def obstacles(problem: Problem, design: Design) -> Obstacles:
    """Return what the same input would tell if one sensor had no noise, or one limit were not there.

    Each sensor in turn gets a hundredth of its noise. If a limit is taken away, the next one binds. Several flights of
    one input add up their information: what scatters falls as the root of their number, what the estimates are off by
    stays.
    """
    experiment = problem.experiment
    out = []
    for i, sensor in enumerate(experiment.sensors):
        M = experiment.with_less_noise(i, _QUIET).information(design.u)
        less = problem.cost_off(M, design.off)
        out.append(Obstacle(f"the noise of {sensor.channel}", less))
    prediction = problem.prediction
    deviation = prediction.response(design.u)
    high = np.maximum(deviation.max(axis=0), 1e-150)
    low = np.minimum(deviation.min(axis=0), -1e-150)
    rooms = np.minimum(prediction.high / high, prediction.low / low)
    binding = prediction.names.index(design.limit) if design.limit in prediction.names else int(np.argmin(rooms))
    others = np.delete(rooms, binding)
    gain = min(max(float(others.min()) if others.size else _FREE, 1.0), _FREE)
    words = f"the limit on {limit_words(prediction.names[binding]).removeprefix('the ')}"
    off = None if design.off is None else gain * design.off
    out.append(Obstacle(words, problem.cost_off(gain**2 * design.information, off)))
    return Obstacles(tuple(sorted(out, key=lambda o: o.cost)), _flights(problem, design))


def _flights(problem: Problem, design: Design) -> int:
    """Return how many flights together reach the wanted errors; 0 if none do, or if earlier ones count, too."""
    alone = problem.cost_of(design.information)
    if not np.isfinite(alone) or problem.known is not None:
        return 0
    off = np.zeros(len(design.information)) if design.off is None else design.off
    stays = float(np.max(np.abs(problem.targets.gradient @ off)))
    if stays >= 1.0:
        return 0
    return max(1, ceil(alone**2 / (1.0 - stays**2) * (1.0 - 1e-9)))
