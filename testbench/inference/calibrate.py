"""How far can stated probabilities be trusted? Found by flying the user's own flight again, many times.

Truths are drawn from the priors, flown with the user's inputs, sensors and air, and asked about as the measured records
were. The curve of stated against found frequencies, and the power for each truth, take the place of numbers that were
found elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.proportion import proportion_interval
from testbench.core.record import FloatArray

T = TypeVar("T")
EDGES = (0.0, 0.2, 0.5, 0.8, 0.9, 0.99, 1.0)  #: of the classes of stated probabilities
SURE = 0.9  #: probability from which one hypothesis is named
CREDIBLE = 0.95  #: probability that a set which is named holds


def fewest(said: Mapping[str, float], probability: float = CREDIBLE) -> tuple[str, ...]:
    """Return the fewest names that hold so much probability together, the most probable first."""
    total, out = 0.0, []
    for name in sorted(said, key=lambda n: -said[n]):
        out.append(name)
        total += said[name]
        if total >= probability:
            break
    return tuple(out)


@dataclass(frozen=True)
class Trial:
    """One flight again: the truth that was drawn and the probability that was stated of each hypothesis."""

    truth: str
    stated: Mapping[str, float]

    @property
    def called(self) -> str:
        """The most probable hypothesis."""
        return max(self.stated, key=lambda name: (self.stated[name], name))


@dataclass(frozen=True)
class Stated:
    """Of probabilities stated between ``low`` and ``high``: how many, their mean, and how often they were right.

    ``lowest`` and ``highest`` are the 95 % interval of the frequency.
    """

    low: float
    high: float
    count: int
    mean: float
    right: float
    lowest: float
    highest: float


@dataclass(frozen=True)
class Power:
    """What was stated where one truth flew."""

    flights: int  #: their number
    sure: float  #: share in which the truth was stated with at least 90 %
    held: float  #: share in which it was in the set that holds 95 %
    size: float  #: median number of names in that set
    #: other hypothesis or the truth -> probability that it was given on average, the largest first
    given: Mapping[str, float]


def calibration_error(stated: FloatArray, right: FloatArray) -> float:
    """Return the mean over classes of |stated - right|, of stated probabilities (n,) and whether (n,) they were right.

    The classes are between :data:`EDGES`; each counts as often as it occurs.
    """
    place = np.clip(np.searchsorted(EDGES, stated, side="right") - 1, 0, len(EDGES) - 2)
    classes = [place == k for k in range(len(EDGES) - 1) if np.any(place == k)]
    return float(sum(abs(stated[here].mean() - right[here].mean()) * np.mean(here) for here in classes))


@dataclass(frozen=True)
class Reliability:
    """What flights again say of stated probabilities."""

    trials: tuple[Trial, ...]

    def curve(self) -> tuple[Stated, ...]:
        """Return the classes of stated probabilities that occurred, all hypotheses of all trials together."""
        stated = np.array([p for t in self.trials for p in t.stated.values()])
        right = np.array([float(name == t.truth) for t in self.trials for name in t.stated])
        out = []
        for low, high in pairwise(EDGES):
            inside = (stated >= low) & ((stated < high) | ((high == EDGES[-1]) & (stated <= high)))
            if inside.any():
                n, share = int(inside.sum()), float(right[inside].mean())
                out.append(
                    Stated(low, high, n, float(stated[inside].mean()), share, *proportion_interval(round(share * n), n))
                )
        return tuple(out)

    @property
    def calibration_error(self) -> float:
        """Expected calibration error of the most probable hypothesis: mean |stated - right| over classes."""
        stated = np.array([t.stated[t.called] for t in self.trials])
        right = np.array([float(t.called == t.truth) for t in self.trials])
        return calibration_error(stated, right)

    def power(self) -> dict[str, Power]:
        """Return truth -> what was stated where it flew."""
        out = {}
        for truth in dict.fromkeys(t.truth for t in self.trials):
            flown = [t for t in self.trials if t.truth == truth]
            sets, names = [fewest(t.stated) for t in flown], dict.fromkeys(name for t in flown for name in t.stated)
            given = {name: float(np.mean([t.stated.get(name, 0.0) for t in flown])) for name in names}
            out[truth] = Power(
                len(flown),
                float(np.mean([t.stated.get(truth, 0.0) >= SURE for t in flown])),
                float(np.mean([truth in known for known in sets])),
                float(np.median([len(known) for known in sets])),
                dict(sorted(given.items(), key=lambda one: -one[1])),
            )
        return out

    def false_alarms(self) -> tuple[int, int]:
        """Return the flights of nothing in which something was stated with at least 90 %, and all of them."""
        flown = [t for t in self.trials if t.truth == "nothing"]
        return sum(t.called != "nothing" and t.stated[t.called] >= SURE for t in flown), len(flown)

    def sentence(self, stated: float) -> str:
        """Return what a stated probability of the answer is worth, as a sentence."""
        low, high = next((a, b) for a, b in pairwise(EDGES) if stated < b or b == EDGES[-1])
        found = [t for t in self.trials if low <= t.stated[t.called] and (t.stated[t.called] < high or high == 1.0)]
        if not found:
            return f"of {len(self.trials)} flights again none was answered with {100 * low:g} to {100 * high:g} %"
        right = sum(t.called == t.truth for t in found)
        said = f"answers stated with {100 * low:g} to {100 * high:g} %"
        return f"{said} were right in {right} of {len(found)} flights again"


def calibrate(
    draw: Callable[[np.random.Generator], tuple[str, T]],
    ask: Callable[[T], Mapping[str, float]],
    count: int,
    seed: int,
    kept: Iterable[Trial] = (),
) -> Iterator[Reliability]:
    """Fly again ``count`` times; yield what is known after each flight, so that whoever asks may stop.

    Each trial has a generator of its own, by its number: what was interrupted goes on to the same trials.

    Args:
        draw: draws a truth from the priors and flies it; returns its name and what the same sensors measured.
        ask: the question that the measured records were asked: hypothesis -> probability.
        count: of trials, those kept included.
        seed: of all draws.
        kept: trials of an earlier, interrupted call.

    Raises:
        EstimationError: ``count`` is below 1, or the question names no hypothesis.

    Example:
        >>> import testbench as tb
        >>> def ask(record):
        ...     found = tb.compare_hypotheses([record], hypotheses, noise)
        ...     return {row.name: row.probability for row in found.rows}
        >>> for found in tb.calibrate(draw, ask, 100, seed=1):  # doctest: +SKIP
        ...     print(found.sentence(0.95))
    """
    one = lambda numbers: [draw(np.random.default_rng([seed, number])) for number in numbers]  # noqa: E731
    yield from calibrate_together(one, lambda flown: [ask(measured) for measured in flown], count, kept)


def calibrate_together(
    draw: Callable[[Sequence[int]], Sequence[tuple[str, T]]],
    ask: Callable[[Sequence[T]], Sequence[Mapping[str, float]]],
    count: int,
    kept: Iterable[Trial] = (),
    together: int = 1,
) -> Iterator[Reliability]:
    """Do as :func:`calibrate` with so many trials at a time, drawn by their numbers and flown, then asked about."""
    if count < 1:
        raise EstimationError(f"flights again must be 1 or more, got {count}")
    trials: Sequence[Trial] = tuple(kept)[:count]
    if trials:
        yield Reliability(tuple(trials))
    for first in range(len(trials), count, together):
        numbers = range(first, min(first + together, count))
        drawn = draw(numbers)
        for (truth, _), stated in zip(drawn, ask([measured for _, measured in drawn]), strict=True):
            if not stated:
                raise EstimationError("the question must name a hypothesis in every flight again, got none")
            trials = (*trials, Trial(truth, dict(stated)))
        yield Reliability(tuple(trials))
