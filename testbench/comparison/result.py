"""What a comparison found: errors of every case, what each suite buys, and what information foretold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from testbench.comparison.placement import Placed
from testbench.comparison.seen import Known, Prediction
from testbench.comparison.statistics import (
    Interval,
    Paired,
    holm,
    mean_interval,
    paired,
    paired_misses,
    root_mean_square,
    scatter_interval,
    seeds_needed,
)
from testbench.record import FloatArray
from testbench.scenario.compare import BEST_CASE, CompareScenario
from testbench.sensors import SensorSuite

_WN = "wn of "
FAR = 20.0
"""Predicted standard error, percent, above which a linear bound says little; judgement."""


class CaseKey(NamedTuple):
    """One input, suite and estimator."""

    manoeuvre: str
    suite: str
    estimator: str


class Quantity(NamedTuple):
    """What an error is of.

    ``kind`` is "prediction", "mode", "parameter" or, among gains, "missed": how often a mode is not found at all;
    ``unit`` is "%" or "" (damping ratios).
    """

    kind: str
    name: str
    unit: str = "%"


class Agreement(NamedTuple):
    """How many scatters of the best case have the predicted one ``inside`` their 95 % interval.

    Out of ``total``; of ``far`` more, whose predicted errors are too large, nothing is said. ``ratios``: least, median
    and largest scatter found over the predicted one.
    """

    inside: int
    total: int
    far: int
    ratios: tuple[float, float, float]


@dataclass(frozen=True)
class Failure:
    """One identification that gave no model."""

    case: CaseKey
    repetition: int
    reason: str


@dataclass(frozen=True)
class Summary:
    """Errors of one quantity in one case over the repetitions.

    Attributes:
        found: in how many repetitions there is such a figure (a mode was found, a prediction stayed finite).
        of: repetitions.
        rms: root mean square error with its 95 % interval; None for fewer than two.
        mean, scatter: mean error with its 95 % interval and standard deviation; None for predictions, whose errors have
            no sign.
        predicted: standard error by information; None where it speaks of another thing.
    """

    case: CaseKey
    quantity: Quantity
    found: int
    of: int
    rms: Interval | None
    mean: Interval | None
    scatter: float | None
    predicted: float | None


@dataclass(frozen=True)
class Gain:
    """What a suite buys over the first one: how much smaller the size of an error is, pair by pair.

    Attributes:
        case: of the suite.
        quantity: what the error is of.
        before, after: median size of the error with the first suite and with this one; share of repetitions that
            miss a mode.
        paired: size of the error with the first suite minus that with this one.
        p_holm: probability by chance, corrected for all gains of the comparison; None: too few pairs.
        predicted: ratio of the standard errors by information, this suite over the first; None: not predicted.
    """

    case: CaseKey
    quantity: Quantity
    before: float
    after: float
    paired: Paired
    p_holm: float | None
    predicted: float | None

    def significant(self, level: float) -> bool:
        """Say whether the difference is more than chance at a level for the whole comparison."""
        return self.p_holm is not None and self.p_holm <= level


@dataclass(frozen=True, eq=False)
class CompareResult:
    """Everything a comparison found.

    Attributes:
        scenario, known: what was asked, of which aircraft.
        suites: the first is what the others are compared with.
        seed: of the first repetition.
        errors: case -> quantity -> errors (repetitions,), NaN where there is none.
        failures: identifications without a model.
        predictions: (manoeuvre, suite) -> what information foretells.
        placed: best stations, if they were asked for.
        flights: how many flights were simulated.
    """

    scenario: CompareScenario
    known: Known
    suites: tuple[SensorSuite, ...]
    seed: int
    errors: Mapping[CaseKey, Mapping[Quantity, FloatArray]]
    failures: tuple[Failure, ...]
    predictions: Mapping[tuple[str, str], Prediction]
    placed: Placed | None
    flights: int

    @property
    def name(self) -> str:
        """Names the results folder."""
        return self.scenario.name

    @property
    def manoeuvres(self) -> tuple[str, ...]:
        """Names of the inputs that are compared."""
        return tuple(m.name for m in self.scenario.manoeuvre if m.use == "identification")

    @cached_property
    def summaries(self) -> tuple[Summary, ...]:
        """One entry per case and quantity."""
        out = []
        for case, quantities in self.errors.items():
            for quantity, errors in quantities.items():
                found = errors[np.isfinite(errors)]
                signed = quantity.kind != "prediction" and found.size >= 2
                out.append(
                    Summary(
                        case,
                        quantity,
                        found.size,
                        errors.size,
                        root_mean_square(found),
                        mean_interval(found) if signed else None,
                        float(np.std(found, ddof=1)) if signed else None,
                        self._predicted(case, quantity),
                    )
                )
        return tuple(out)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """One entry per suite but the first, input, estimator and quantity that both suites give.

        Errors of a mode can be compared only where both suites find it; where one of them misses it, how often is
        compared too.
        """
        out: list[Gain] = []
        for case, quantities in self.errors.items():
            base = case._replace(suite=self.suites[0].name)
            if case == base:
                continue
            for quantity, errors in quantities.items():
                before = self.errors.get(base, {}).get(quantity)
                if before is None:
                    continue
                both = np.isfinite(before) & np.isfinite(errors)
                differences = np.abs(before[both]) - np.abs(errors[both])
                first, this = (float(np.median(np.abs(e[both]))) if both.any() else np.nan for e in (before, errors))
                found = paired(differences, self.scenario.test)
                out.append(Gain(case, quantity, first, this, found, None, self._ratio(case, base, quantity)))
                if quantity.kind == "mode" and quantity.name.startswith(_WN) and not both.all():
                    lost = ~np.isfinite(before), ~np.isfinite(errors)
                    share = [100.0 * float(np.mean(m)) for m in lost]
                    missed = Quantity("missed", quantity.name.removeprefix(_WN))
                    out.append(Gain(case, missed, share[0], share[1], paired_misses(*lost), None, None))
        tested = [k for k, g in enumerate(out) if g.paired.p is not None]
        corrected = holm([out[k].paired.p or 0.0 for k in tested])
        for k, p in zip(tested, corrected, strict=True):
            out[k] = replace(out[k], p_holm=p)
        return tuple(out)

    @property
    def too_few(self) -> int | None:
        """How many repetitions the test would need to find anything, if there are fewer; else None."""
        needed = seeds_needed(len(self.gains), self.scenario.level)
        return needed if self.gains and self.scenario.test == "wilcoxon" and self.scenario.seeds < needed else None

    def _predicted(self, case: CaseKey, quantity: Quantity) -> float | None:
        prediction = self.predictions.get((case.manoeuvre, case.suite))
        return None if prediction is None or quantity.kind == "prediction" else prediction.of(quantity.name)

    def _ratio(self, case: CaseKey, base: CaseKey, quantity: Quantity) -> float | None:
        after, before = self._predicted(case, quantity), self._predicted(base, quantity)
        if after is None or before is None or not (np.isfinite(after) and np.isfinite(before)):
            return None
        return after / before

    @property
    def agreement(self) -> Agreement:
        """Hold the scatter of the best case against the predicted one.

        A sample standard deviation of n errors scatters as sqrt(chi2 / (n - 1)). Where the predicted one exceeds
        :data:`FAR`, the model is no longer linear in its parameters over the errors, and the bound says little.
        """
        inside = far = 0
        ratios: list[float] = []
        for s in self.summaries:
            if s.case.estimator != BEST_CASE or s.scatter is None or s.predicted is None or s.found <= 2:
                continue
            if s.predicted > (FAR if s.quantity.unit else 0.01 * FAR):
                far += 1
                continue
            low, high = scatter_interval(s.scatter, s.found)
            ratios.append(s.scatter / s.predicted)
            inside += low <= s.predicted <= high
        least, median, most = np.quantile(ratios, [0.0, 0.5, 1.0]).tolist() if ratios else (np.nan,) * 3
        return Agreement(inside, len(ratios), far, (least, median, most))
